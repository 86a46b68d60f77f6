"""Adjoint of bending (kernels/cloth/curvature.py), by hand and gathered: of forces at corners, and of the targets of XPBD.

With f, f', f'' of D = theta - theta_0 (`wsim.kernels.cloth.curvature.folded_angle`) and rho = 1 - f'^2, a hinge has without the
others k q e,

    e = D - f f' + tau rho b       de/dD = rho - f f'' - 2 tau f' f'' b

Forces. With p_k the gradients by the forces of the points, P_k = p_k - p_0, a = G P and b = G V (sums over k), u of C and w of
the curvatures Y that y = k^1/2 f' a makes, the loss is -sum C.Y - sum k q a e, and the gradients are

    by D          -s,  s = k^1/2 ((f' + tau f'' b) w + f'' a u) + k q a de/dD        by theta_0   s
    by a          -m,  m = k^1/2 f' u + k q e, the moment
    by b          -tau r,  r = k^1/2 f' w + k q rho a                                by tau       -r b
    by positions  -(s G + H (m P + tau r V))                                         by velocities  -tau r G
    by k          -((f + tau f' b) w + f' a u) / (2 k^1/2) - q a e
    by value_ts   -(z_s Y_t + y_s C_t) - 2 (k a e)_s value_ts

D has symmetric second derivatives H, whose products with a motion are how G changes along it.

Targets theta_0 + D + gamma b - alpha^1/2 f' u - q e, gamma = tau / h, which stands for tau above: with p the gradient by a
target, y = alpha^1/2 f' p, w of Y,

    by D          r = p - alpha^-1/2 (f' + gamma f'' b) w - alpha^1/2 f'' p u - q p de/dD       by theta_0   p - r
    by b          gamma v,  v = p - alpha^-1/2 f' w - q rho p                                   by tau       v b / h
    by positions  r G + gamma v H V                      by displacements since the anchor  gamma v G
    by alpha      ((f + gamma f' b) w / alpha - f' p u) / (2 alpha^1/2)
    by value_ts   -(z_s Y_t + y_s C_t) - 2 (p e)_s value_ts
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import DIHEDRAL, FLAT, dihedral_constraint, inverse_or_zero
from wsim.kernels.cloth.corner_gradients import adjoint_works, corner_reader
from wsim.kernels.cloth.curvature import SLOTS, folded_angle, hinge_moment, hinge_of, sheet_curvatures, sine_cosine
from wsim.kernels.cloth.element import force_elements
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types


@wp.func
def fold_second_derivative(D: Any):
    """f'' of `folded_angle`."""
    s, _c = sine_cosine(D)
    return type(D)(-1.5) * s * s * s


@wp.func
def fold_gradient(X: Any, G: Any, Q: Any):
    """How G of `dihedral_constraint` changes along Q: G_k = -|E| N_k / |N_k|^2, k = 2, 3, and G_1 = -(t_2 G_2 + t_3 G_3)."""
    E = X[0]
    N2 = wp.cross(E, X[1])
    N3 = wp.cross(X[2], E)
    n2 = wp.dot(N2, N2)
    n3 = wp.dot(N3, N3)
    LL = wp.dot(E, E)
    q = inverse_or_zero(LL)
    two = type(q)(2.0)
    longer = q * wp.dot(E, Q[0])                         # of |E|, over it
    dG1 = type(E)()
    dG2 = type(E)()
    dG3 = type(E)()
    if (q * n2) * (q * n3) > type(q)(wp.static(FLAT)):
        L = wp.sqrt(LL)
        dN2 = wp.cross(Q[0], X[1]) + wp.cross(E, Q[1])
        dN3 = wp.cross(Q[2], E) + wp.cross(X[2], Q[0])
        dG2 = (longer - two * wp.dot(N2, dN2) / n2) * G[1] - (L / n2) * dN2
        dG3 = (longer - two * wp.dot(N3, dN3) / n3) * G[2] - (L / n3) * dN3
        t2 = q * wp.dot(E, X[1])
        t3 = q * wp.dot(E, X[2])
        dt2 = q * (wp.dot(Q[0], X[1]) + wp.dot(E, Q[1])) - two * t2 * longer
        dt3 = q * (wp.dot(Q[0], X[2]) + wp.dot(E, Q[2])) - two * t3 * longer
        dG1 = -(dt2 * G[1] + t2 * dG2) - (dt3 * G[2] + t3 * dG3)
    return wp.matrix_from_rows(dG1, dG2, dG3)


@cache
def _hinge_state(real, damped: bool, direct: bool):
    """Function of hinge c of an explicit step: X, V, P (to its first point), and D, tau b, G, a."""
    t, Elements, Work = types(real), force_elements(DIHEDRAL, real), adjoint_works(real)
    vec3, by_force = wp.array(dtype=t.vec3), corner_reader(real, direct)

    @wp.func
    def hinge_adjoint_state(batch: Elements, x: vec3, d: vec3, source: int, first: int, w: Work, c: int):
        m = x.shape[0]
        p = batch.point[c]
        i = p[0]
        at = first + 4 * c
        X = t.mat33()
        V = t.mat33()
        P = t.mat33()
        x0 = x[i]
        d0 = d[source * m + i]
        p0 = by_force(w, i, at)
        for k in range(3):
            j = p[k + 1]
            X[k] = (x[j] - x0) + (d[source * m + j] - d0)
            P[k] = by_force(w, j, at + k + 1) - p0
            if wp.static(damped):
                V[k] = d[(2 + source) * m + j] - d[(2 + source) * m + i]
        C, G = dihedral_constraint(X, batch.rest[c])
        b = real(0.0)
        if wp.static(damped):
            b = batch.tau[c] * wp.ddot(G, V)
        return X, V, P, C, b, G, wp.ddot(G, P)

    return hinge_adjoint_state


@cache
def bending_product_kernel(real, module, damped: bool, direct: bool):
    """Kernel over hinges: z, y, and a k e at kept. direct: of p, else of what stands at the places of corners."""
    t, Elements, Work, Curvatures = types(real), force_elements(DIHEDRAL, real), adjoint_works(real), sheet_curvatures(real)
    vec3, here = wp.array(dtype=t.vec3), _hinge_state(real, damped, direct)

    def bending_products(batch: Elements, x: vec3, d: vec3, source: int, first: int, cur: Curvatures, w: Work):
        c = wp.tid()
        _X, _V, _P, C, b, _G, a = here(batch, x, d, source, first, w, c)
        f, slope, rho = folded_angle(C)
        root = wp.sqrt(batch.stiffness[c])
        cur.z[c] = root * (f + slope * b)
        cur.y[c] = root * slope * a
        cur.kept[c] = batch.stiffness[c] * a * (C - f * slope + rho * b)

    name = "_".join(["adjoint_hinge", *["damped"] * damped, *["direct"] * direct])
    return wp.kernel(bending_products, name=name, module=module, enable_backward=False)


@cache
def bending_adjoint_kernel(real, module, damped: bool, parameters: bool, direct: bool):
    """Kernel over hinges: at the places of the points' forces the gradients by their positions, and those by their velocities
    at `rates`; parameters: adds by stiffness, angle at rest, tau. Arguments: those of the kernel of the forces but these, work,
    by."""
    t, Elements, Work, Curvatures = types(real), force_elements(DIHEDRAL, real), adjoint_works(real), sheet_curvatures(real)
    vec3, here = wp.array(dtype=t.vec3), _hinge_state(real, damped, direct)

    def bending_corner_adjoint(batch: Elements, x: vec3, d: vec3, source: int, first: int, cur: Curvatures, w: Work,
                               by: Elements):
        c = wp.tid()
        at = first + 4 * c
        X, V, P, C, b, G, a = here(batch, x, d, source, first, w, c)
        f, slope, rho = folded_angle(C)
        turn = fold_second_derivative(C)
        e = C - f * slope + rho * b
        k_own = batch.stiffness[c] * cur.own[c]
        root = wp.sqrt(batch.stiffness[c])
        u = hinge_moment(cur, cur.C, c)
        y = hinge_moment(cur, cur.Y, c)
        s = root * ((slope + turn * b) * y + turn * a * u) + k_own * a * (rho - turn * (f + real(2.0) * slope * b))
        Q = (root * slope * u + k_own * e) * P
        r = real(0.0)
        if wp.static(damped):
            r = root * slope * y + k_own * rho * a
            Q += (batch.tau[c] * r) * V
        by_X = s * G + fold_gradient(X, G, Q)
        sum = t.vec3()
        rate = t.vec3()
        for k in range(3):
            sum += by_X[k]
            w.corners[at + k + 1] = -by_X[k]
            if wp.static(damped):
                by_V = (batch.tau[c] * r) * G[k]
                rate += by_V
                w.rates[at + k + 1] = -by_V
        w.corners[at] = sum
        if wp.static(damped):
            w.rates[at] = rate
        if wp.static(parameters):
            lent = real(0.5) * inverse_or_zero(root) * ((f + slope * b) * y + slope * a * u)
            by.stiffness[c] = by.stiffness[c] - lent - cur.own[c] * a * e
            by.rest[c] = by.rest[c] + s
            if wp.static(damped):
                by.tau[c] = by.tau[c] - r * wp.ddot(G, V)

    name = "_".join(["adjoint_dihedral", *["damped"] * damped, *["parameters"] * parameters, *["direct"] * direct, t.name])
    return wp.kernel(bending_corner_adjoint, name=name, module=module, enable_backward=False)


@cache
def curvature_adjoint_kernel(real, module):
    """Kernel over triangles: adds the gradients by `value`. kept: (k a e) or (p e) of hinges."""
    Curvatures = sheet_curvatures(real)

    def curvature_value_adjoint(cur: Curvatures, by: Curvatures):
        c = wp.tid()
        C = cur.C[c]
        Y = cur.Y[c]
        for s in range(SLOTS * c, SLOTS * c + cur.count[c]):
            e = cur.slot[s]
            by.value[s] = by.value[s] - (cur.z[e] * Y + cur.y[e] * C + real(2.0) * cur.kept[e] * cur.value[s])

    return wp.kernel(curvature_value_adjoint, name="adjoint_curvature", module=module, enable_backward=False)


@cache
def swept_hinges(real):
    """Struct of what hinges of XPBD have besides their table."""
    t = types(real)

    @wp.struct
    class Swept:
        rest: wp.array(dtype=t.scalar)           # angles at rest
        by_rest: wp.array(dtype=t.scalar)        # gradients by them, added to
        by_target: wp.array(dtype=t.scalar)      # and by targets, read
        corners: wp.array(dtype=t.vec3)          # by the places of corners, written, (4 hinges,)
        rates: wp.array(dtype=t.vec3)            # by their displacements since the anchor

    return Swept


@cache
def target_seed_kernel(real, module, damped: bool):
    """Kernel over hinges of XPBD: z, and y and p e at kept from the gradients by targets."""
    t, Batch, Curvatures, hinge = types(real), batch_of(DIHEDRAL, real), sheet_curvatures(real), hinge_of(real, damped)
    vec3, Swept = wp.array(dtype=t.vec3), swept_hinges(real)

    def seed_target_adjoint(batch: Batch, x: vec3, d: vec3, a: vec3, rate: real, cur: Curvatures, s: Swept):
        c = wp.tid()
        _X, V, C, G = hinge(batch, s.rest, x, d, a, c)
        b = real(0.0)
        if wp.static(damped):
            b = rate * batch.tau[c] * wp.ddot(G, V)
        f, slope, rho = folded_angle(C)
        p = s.by_target[c]
        root = wp.sqrt(batch.alpha[c])
        cur.z[c] = inverse_or_zero(root) * (f + slope * b)
        cur.y[c] = root * slope * p
        cur.kept[c] = p * (C - f * slope + rho * b)

    return wp.kernel(seed_target_adjoint, name="adjoint_target_hinge" + "_damped" * damped, module=module,
                     enable_backward=False)


@cache
def target_adjoint_kernel(real, module, damped: bool):
    """Kernel over hinges of XPBD: adds the gradients by angles at rest, compliance and tau; writes those at corners."""
    t, Batch, Curvatures, hinge = types(real), batch_of(DIHEDRAL, real), sheet_curvatures(real), hinge_of(real, damped)
    vec3, Swept = wp.array(dtype=t.vec3), swept_hinges(real)

    def target_angle_adjoint(batch: Batch, x: vec3, d: vec3, a: vec3, rate: real, cur: Curvatures, s: Swept, by: Batch):
        c = wp.tid()
        X, V, C, G = hinge(batch, s.rest, x, d, a, c)
        root = wp.sqrt(inverse_or_zero(batch.alpha[c]))
        u = hinge_moment(cur, cur.C, c)
        y = hinge_moment(cur, cur.Y, c)
        p = s.by_target[c]
        f, slope, rho = folded_angle(C)
        turn = fold_second_derivative(C)
        b = real(0.0)
        if wp.static(damped):
            b = rate * batch.tau[c] * wp.ddot(G, V)
        own = cur.own[c] * p
        r = (p - root * (slope + turn * b) * y - inverse_or_zero(root) * turn * p * u
             - own * (rho - turn * (f + real(2.0) * slope * b)))
        by_X = r * G
        by_V = t.mat33()
        if wp.static(damped):
            v = p - root * slope * y - own * rho
            gamma = rate * batch.tau[c]
            by_X += (v * gamma) * fold_gradient(X, G, V)
            by_V = (v * gamma) * G
            by.tau[c] = by.tau[c] + rate * v * wp.ddot(G, V)
        s.by_rest[c] = s.by_rest[c] + p - r
        by.alpha[c] = by.alpha[c] + real(0.5) * root * ((f + slope * b) * root * root * y - slope * p * u)
        sum = t.vec3()
        moved = t.vec3()
        for k in range(3):
            sum -= by_X[k]
            moved -= by_V[k]
            s.corners[4 * c + k + 1] = by_X[k]
            s.rates[4 * c + k + 1] = by_V[k]
        s.corners[4 * c] = sum
        s.rates[4 * c] = moved

    return wp.kernel(target_angle_adjoint, name="adjoint_target" + "_damped" * damped, module=module, enable_backward=False)


@cache
def point_adjoint_kernel(real, module, damped: bool):
    """Kernel over points: adds what stands at their corners to the gradients by place and displacement; damped: and what stands
    at `rates` to that by displacement, and takes it from that by the anchor. begin, item: corners of each point."""
    t = types(real)
    vec3, ints = wp.array(dtype=t.vec3), wp.array(dtype=int)

    def gather_adjoint(begin: ints, item: ints, corners: vec3, rates: vec3, by_x: vec3, by_d: vec3, by_a: vec3):
        i = wp.tid()
        sum = t.vec3()
        rate = t.vec3()
        for k in range(begin[i], begin[i + 1]):
            sum += corners[item[k]]
            if wp.static(damped):
                rate += rates[item[k]]
        by_x[i] = by_x[i] + sum
        by_d[i] = by_d[i] + sum + rate
        if wp.static(damped):
            by_a[i] = by_a[i] - rate

    return wp.kernel(gather_adjoint, name="adjoint_target_points" + "_damped" * damped, module=module, enable_backward=False)
