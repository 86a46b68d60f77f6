"""Constraints of a kind of which (X, rest) -> C, G is known and no more, C one number: forces on their points, the positive
part of the Jacobian, and the adjoint of the forces. Points gather what stands at corners, as of membranes
(kernels/cloth/element.py, hessian.py).

    f_k = -G_k s,    s = (C + tau b) / alpha,    b = sum_k G_k.v_k               energy C^2 / (2 alpha), damping tau [s]
    A_kl = (1 + tau/g) / alpha G_k G_l^T         Gauss-Newton: exact at rest, never negative; (C / alpha) dG_k/dx_l is left out

With p_k the gradients by the forces of the points, P_k = p_k - p_0, a = sum_k G_k.P_k: the gradients by all that forces are
made of are those of sum_k p_k.f_k = -s a, which Warp differentiates through the formula: all second derivatives of C are there.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import Constraint, inverse_or_zero
from wsim.kernels.cloth.corner_gradients import adjoint_works, corner_reader
from wsim.kernels.cloth.element import force_elements
from wsim.kernels.cloth.hessian import elements_of
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.marks import writes_all
from wsim.kernels.math.real import types


@cache
def general_force_kernel(row: Constraint, real, module, damped: bool):
    """Kernel over constraints: force on each of their points, f[first + n c + k] [N]. As kernels/cloth/element.py."""
    t, Elements, formula, n = types(real), force_elements(row, real), row.formula, row.points
    vec3, m = wp.array(dtype=t.vec3), n - 1
    rows = wp.types.matrix((m, 3), real)

    def general_corner_forces(batch: Elements, x: vec3, d: vec3, source: int, first: int, f_out: vec3):
        c = wp.tid()
        size = x.shape[0]
        p = batch.point[c]
        i = p[0]
        x0 = x[i]
        d0 = d[source * size + i]
        X = rows()
        for k in range(m):
            j = p[k + 1]
            X[k] = (x[j] - x0) + (d[source * size + j] - d0)
        C, G = formula(X, batch.rest[c])
        if wp.static(damped):
            v0 = d[(2 + source) * size + i]
            for k in range(m):
                C += batch.tau[c] * wp.dot(G[k], d[(2 + source) * size + p[k + 1]] - v0)
        s = batch.stiffness[c] * C
        f0 = t.vec3()
        for k in range(m):
            f = -s * G[k]
            f0 -= f
            f_out[first + n * c + k + 1] = f
        f_out[first + n * c] = f0

    name = f"corners_{row.name}{'_damped' * damped}_{t.name}"
    return writes_all(wp.kernel(general_corner_forces, name=name, module=module, enable_backward=False))


@cache
def general_element_kernel(row: Constraint, real, module):
    """Kernel over constraints: forces on corners from place at[0], and blocks of pairs (0 1), (0 2) .. (1 2) .. from at[1]."""
    t, Batch, Elements, formula, n = types(real), batch_of(row, real), elements_of(real), row.formula, row.points
    vec3, m, pairs = wp.array(dtype=t.vec3), n - 1, n * (n - 1) // 2
    rows, ends = wp.types.matrix((m, 3), real), wp.types.matrix((n, 3), real)

    def linearise_general(batch: Batch, x: vec3, d: vec3, a: vec3, rate: real, at: wp.vec2i, out: Elements):
        c = wp.tid()
        p = batch.point[c]
        i = p[0]
        X = rows()
        V = rows()
        for k in range(m):
            j = p[k + 1]
            moved = d[j] - d[i]
            X[k] = (x[j] - x[i]) + moved
            V[k] = moved - (a[j] - a[i])
        C, H = formula(X, batch.rest[c])
        stiffness = inverse_or_zero(batch.alpha[c])
        gamma = rate * batch.tau[c]
        b = real(0.0)
        G = ends()
        g0 = t.vec3()
        for k in range(m):
            b += wp.dot(H[k], V[k])
            G[k + 1] = H[k]
            g0 -= H[k]
        G[0] = g0
        for k in range(n):
            out.force[at[0] + n * c + k] = -(stiffness * (C + gamma * b)) * G[k]
        place = int(at[1] + pairs * c)
        for k in range(n):
            for j in range(k + 1, n):
                out.block[place] = ((real(1.0) + gamma) * stiffness) * wp.outer(G[k], G[j])
                place += 1

    return wp.kernel(linearise_general, name=f"element_{row.name}_{t.name}", module=module, enable_backward=False)


@cache
def force_product_function(row: Constraint, real, damped: bool):
    """Function sum_k p_k.f_k of one constraint: (X, V, P, rest, stiffness, tau)."""
    formula, m = row.formula, row.points - 1
    rows = wp.types.matrix((m, 3), real)

    @wp.func
    def force_product(X: rows, V: rows, P: rows, rest: real, stiffness: real, tau: real):
        C, G = formula(X, rest)
        a = real(0.0)
        b = real(0.0)
        for k in range(m):
            a += wp.dot(G[k], P[k])
            if wp.static(damped):
                b += wp.dot(G[k], V[k])
        return -stiffness * (C + tau * b) * a

    return force_product


def force_product_dummy(row: Constraint, real, module, damped: bool) -> None:
    """A kernel that never runs, without which Warp 1.19 leaves the adjoints of what `force_product_function` calls empty."""
    formula, rows = force_product_function(row, real, damped), wp.types.matrix((row.points - 1, 3), real)

    def call_force_product(rest: real, stiffness: real, tau: real, out: wp.array(dtype=real)):
        out[0] = formula(rows(), rows(), rows(), rest, stiffness, tau)

    name = f"need_forces_{row.name}{'_damped' * damped}_{types(real).name}"
    wp.kernel(call_force_product, name=name, module=module, enable_backward=True)


@cache
def corners_adjoint(row: Constraint, real, module, damped: bool, parameters: bool, direct: bool):
    """Kernel over constraints, as `general_force_kernel` of kernels/cloth/element_adjoint.py."""
    t, Elements, Work = types(real), force_elements(row, real), adjoint_works(real)
    vec3, by_force, n, m = wp.array(dtype=t.vec3), corner_reader(real, direct), row.points, row.points - 1
    rows, formula = wp.types.matrix((m, 3), real), force_product_function(row, real, damped)

    def general_corner_adjoint(batch: Elements, x: vec3, d: vec3, source: int, first: int, w: Work, by: Elements):
        c = wp.tid()
        size = x.shape[0]
        p = batch.point[c]
        i = p[0]
        at = first + n * c
        X = rows()
        V = rows()
        P = rows()
        p0 = by_force(w, i, at)
        for k in range(m):
            j = p[k + 1]
            X[k] = (x[j] - x[i]) + (d[source * size + j] - d[source * size + i])
            P[k] = by_force(w, j, at + k + 1) - p0
            if wp.static(damped):
                V[k] = d[(2 + source) * size + j] - d[(2 + source) * size + i]
        tau = real(0.0)
        if wp.static(damped):
            tau = batch.tau[c]
        gX, gV, _gP, grest, gstiffness, gtau = wp.grad(formula)(X, V, P, batch.rest[c], batch.stiffness[c], tau)
        sum = t.vec3()
        rate = t.vec3()
        for k in range(m):
            sum += gX[k]
            rate += gV[k]
            w.corners[at + k + 1] = gX[k]
            if wp.static(damped):
                w.rates[at + k + 1] = gV[k]
        w.corners[at] = -sum
        if wp.static(damped):
            w.rates[at] = -rate
        if wp.static(parameters):
            by.stiffness[c] = by.stiffness[c] + gstiffness
            by.rest[c] = by.rest[c] + grest
            if wp.static(damped):
                by.tau[c] = by.tau[c] + gtau

    force_product_dummy(row, real, module, damped)
    name = "_".join(["adjoint", row.name, *["damped"] * damped, *["parameters"] * parameters, *["direct"] * direct, t.name])
    return wp.kernel(general_corner_adjoint, name=name, module=module, enable_backward=False)


@cache
def constraint_probe_kernel(row: Constraint):
    """Kernel over constraints, float64, module of its own: C and G (m, n - 1, 3) of points relative to the first."""
    formula, m = row.formula, row.points - 1
    relative = wp.types.matrix((m, 3), wp.float64)

    def probe_constraint(X: wp.array(dtype=relative), rest: wp.array(dtype=wp.float64), C_out: wp.array(dtype=wp.float64),
                         G_out: wp.array2d(dtype=wp.vec3d)):
        c = wp.tid()
        C, G = formula(X[c], rest[c])
        C_out[c] = C
        for k in range(m):
            G_out[c, k] = G[k]

    return wp.kernel(probe_constraint, name=f"evaluate_{row.name}", module="unique", enable_backward=False)
