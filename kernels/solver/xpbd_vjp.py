"""What an adjoint of XPBD differentiates (kernels/solver/xpbd_adjoint.py): the multiplier of a projection times what it moves,

    s = dlam (sum_k w_k G_k.Y_k + y)

for constant Y and y. Its derivatives by all that dlam and G are made of are those of a projection in the direction of Y, y. Of
lengths they are written out: with n = X / L, E = W_1 Y_1 - W_0 Y_0, K = W_0 + W_1, B = (1 + gamma) K + alpha, dlam, which the
sweep has left, -omega (C + alpha lam + gamma n.V) / B,  s = dlam (n.E + y),  f = omega (n.E + y) / B:

    by X      -f (n + gamma (V - (n.V) n) / L) + dlam (E - (n.E) n) / L        by V      -f gamma n
    by rest   f        by alpha  -f lam - s / B        by lam  -f alpha        by gamma  -f n.V - s K / B
    by W_k    +-dlam n.Y_k - (1 + gamma) s / B
"""

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero, membrane_response, membrane_shear, membrane_slender
from wsim.kernels.cloth.terms import plane_stress_matrix
from wsim.kernels.math.matrix import solve_block
from wsim.kernels.solver.xpbd import CALM, TINY


def multiplier_work_function(o):
    """Function s of a variant `o` of kernels/solver/xpbd.py: (X, V, W, rest, alpha, lam, how, Y). X: places and V: velocities
    (times h) to the first point; W: inverse masses; how: gamma, omega; Y has a row a point, and below them y (in its first
    entry where a constraint has one row) and, where there are three, what -C lacks (`rounding_gaps`)."""
    return _block_work_function(o) if o.rows == 3 else _row_work_function(o)


def work_dummy(o, module) -> None:
    """A kernel that never runs. Warp 1.19 leaves the adjoints of functions empty that no kernel with an adjoint calls; those
    that a product calls would then be 0 in `wp.grad`, without a word."""
    n, real, block = o.points, o.t.scalar, o.rows == 3
    formula, rest = multiplier_work_function(o), o.t.mat22 if block else real
    rows, ends = wp.types.matrix((n - 1, 3), real), wp.types.matrix((n + 1 + block, 3), real)
    inverses = wp.types.vector(n, real)

    def call_multiplier_work(rest: rest, alpha: o.entry, lam: o.value, out: wp.array(dtype=real)):
        out[0] = formula(rows(), rows(), inverses(), rest, alpha, lam, o.t.vec2(), ends())

    wp.kernel(call_multiplier_work, name=f"need_{o.name}", module=module, enable_backward=True)


def _row_work_function(o):
    """Of constraints with one row and a compliance."""
    real, vec3, m, formula = o.t.scalar, o.t.vec3, o.points - 1, o.formula
    rows, ends, inverses = wp.types.matrix((m, 3), real), wp.types.matrix((m + 2, 3), real), wp.types.vector(m + 1, real)

    @wp.func
    def row_multiplier_work(X: rows, V: rows, W: inverses, rest: real, alpha: real, lam: real, how: o.t.vec2, Y: ends):
        C, G = formula(X, rest)
        r = -C - alpha * lam
        below = real(0.0)
        G0 = vec3()
        s = Y[m + 1, 0]
        for k in range(m):
            G0 -= G[k]
            below += W[k + 1] * wp.dot(G[k], G[k])
            s += W[k + 1] * wp.dot(G[k], Y[k + 1])
            if wp.static(o.damped):
                r -= how[0] * wp.dot(G[k], V[k])
        below += W[0] * wp.dot(G0, G0)
        s += W[0] * wp.dot(G0, Y[0])
        below = (real(1.0) + how[0]) * below + alpha
        out = real(0.0)
        if below > real(0.0):
            out = (how[1] * r / below) * s
        return out

    return row_multiplier_work


def _block_work_function(o):
    """Of constraints with three rows on three points."""
    real, vec3, formula, mat22, tiny = o.t.scalar, o.t.vec3, o.formula, o.t.mat22, TINY[o.t.scalar]
    rows, ends = wp.types.matrix((2, 3), real), wp.types.matrix((5, 3), real)

    @wp.func
    def block_multiplier_work(X: rows, V: rows, W: vec3, rest: mat22, alpha: o.t.vec4, lam: vec3, how: o.t.vec2, Y: ends):
        C, G1, G2 = formula(X, rest)
        r = Y[4] - C - plane_stress_matrix(alpha) * lam
        if wp.static(o.damped):
            r -= how[0] * (G1 * V[0] + G2 * V[1])
        S = membrane_response(C, rest, W[0], W[1], W[2])
        dlam = how[1] * solve_block((real(1.0) + how[0]) * S + plane_stress_matrix(alpha), r, real(tiny))
        calm = real(1.0)
        if wp.dot(r, r) > real(CALM * CALM):
            slender = membrane_slender(rest)
            most = real(2.0) * slender[1]
            step = wp.abs(membrane_shear(rest, S * dlam)) * (slender[0] - most)
            if step > most:
                calm = most / step
        s = Y[3] + W[1] * (G1 * Y[1]) + W[2] * (G2 * Y[2]) - W[0] * ((G1 + G2) * Y[0])
        return calm * wp.dot(dlam, s)

    return block_multiplier_work


def rounding_gaps(o):
    """Function: what -C of `multiplier_work_function` lacks for the dlam that a sweep has left, whose C was not rounded to
    float32; 0 where a step was cut."""
    real, vec3, formula, mat22 = o.t.scalar, o.t.vec3, o.formula, o.t.mat22
    rows = wp.types.matrix((2, 3), real)

    @wp.func
    def rounding_gap(X: rows, V: rows, W: vec3, rest: mat22, alpha: o.t.vec4, lam: vec3, how: o.t.vec2, dlam: vec3):
        C, G1, G2 = formula(X, rest)
        r = -C - plane_stress_matrix(alpha) * lam
        if wp.static(o.damped):
            r -= how[0] * (G1 * V[0] + G2 * V[1])
        S = membrane_response(C, rest, W[0], W[1], W[2])
        found = (((real(1.0) + how[0]) * S + plane_stress_matrix(alpha)) * dlam) / how[1] - r
        if wp.dot(r, r) > real(CALM * CALM):
            found = vec3()
        return found

    return rounding_gap


def length_derivation(o):
    """Function: derivatives of s of a length by X, V, W, rest, alpha, lam and gamma; how: gamma, omega, y. What is unilateral
    and slack has left a dlam of 0."""
    real, vec3, vec2, two = o.t.scalar, o.t.vec3, o.t.vec2, wp.types.matrix((2, 3), o.t.scalar)

    @wp.func
    def length_derivatives(X: vec3, V: vec3, W: vec2, dlam: real, alpha: real, lam: real, how: vec3, Y: two):
        L = wp.length(X)
        over = inverse_or_zero(L)
        n = over * X
        E = W[1] * Y[1] - W[0] * Y[0]
        gamma = how[0]
        slide = real(0.0)
        if wp.static(o.damped):
            slide = wp.dot(n, V)
        B = (real(1.0) + gamma) * (W[0] + W[1]) + alpha
        b = inverse_or_zero(B)
        along = wp.dot(n, E) + how[2]
        f = how[1] * b * along
        s = dlam * along
        if wp.static(o.unilateral):
            if dlam == real(0.0):
                f = real(0.0)
        gX = (dlam * over) * (E - wp.dot(n, E) * n) - f * n
        gV = vec3()
        if wp.static(o.damped):
            gX -= (f * gamma * over) * (V - slide * n)
            gV = -(f * gamma) * n
        own = (real(1.0) + gamma) * s * b
        gW = vec2(-dlam * wp.dot(n, Y[0]) - own, dlam * wp.dot(n, Y[1]) - own)
        return gX, gV, gW, f, -f * lam - s * b, -f * alpha, -f * slide - s * (W[0] + W[1]) * b

    return length_derivatives
