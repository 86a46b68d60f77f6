"""Adjoint of a coloured sweep of XPBD (kernels/solver/xpbd.py), which ran in place: it is undone, constraint by constraint.

A projection adds w_k G_k dlam to d_k and dlam to lam. Sweeps leave lam behind them, a number a constraint: dlam is the
difference to the sweep before. Of a length L the direction n does not change, L' = L + K dlam with K = w_0 + w_1, and so

    n = n',  L = L' - K dlam       (or n = -n', L = -L' - K dlam, where the points have passed each other)

gives back what was there, to rounding; where both could be, the one whose own dlam is nearer. Angles and strains leave their
points' d behind as well ("kept").

With Y the gradients by d after the projection and y that by lam, the gradients by all that it has read are Y, y and those of
s (kernels/solver/xpbd_vjp.py), which Warp differentiates: all second derivatives of C are there. No point occurs twice in a
colour, so that gradients of points are added without atomics.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import Constraint, inverse_or_zero
from wsim.kernels.cloth.terms import constraint_variant
from wsim.kernels.math import block
from wsim.kernels.math.real import types
from wsim.kernels.solver.xpbd import one_of, weights_of
from wsim.kernels.solver.xpbd_vjp import length_derivation, multiplier_work_function, rounding_gaps, work_dummy


@wp.func
def same_vector(y: Any):
    """A vector."""
    return y


@wp.func
def first_of(y: Any):
    """A vector with y first."""
    return wp.vector(y, y - y, y - y)


@cache
def sweep_states(vec3, value):
    """Struct of what a sweep reads and writes but for its tables. kept: d of the points, (m, points) by point, or none."""

    @wp.struct
    class SweepState:
        x: wp.array(dtype=vec3)
        a: wp.array(dtype=vec3)
        d: wp.array(dtype=vec3)              # in place
        kept: wp.array2d(dtype=vec3)
        lam: wp.array(dtype=value)           # before the sweep
        lam_out: wp.array(dtype=value)       # after it

    return SweepState


@cache
def sweep_gradients(vec3, value):
    """Struct of gradients: d and lam by what is after a sweep, which become those by what was before; the others are added
    to."""

    @wp.struct
    class SweepGradients:
        x: wp.array(dtype=vec3)
        a: wp.array(dtype=vec3)
        d: wp.array(dtype=vec3)
        lam: wp.array(dtype=value)

    return SweepGradients


@cache
def recorded_sweep_kernel(constraint: Constraint, real, module, damped: bool, kept: bool, fused: bool):
    """Kernel of a sweep that leaves behind what its adjoint needs. fused: one block takes all colours, between `first` and the
    end; else a launch is a colour that begins at starts[first]. Arguments: batch, seen, starts, first, rate, omega."""
    o = constraint_variant(constraint, real, True, damped, False, stored=True)
    one, n, Seen = one_of(o, False), o.points, sweep_states(o.t.vec3, o.value)

    @wp.func
    def record_projection(c: int, batch: o.Batch, s: Seen, rate: real, omega: real):
        s.lam_out[c] = s.lam[c]
        if wp.static(kept):
            p = batch.point[c]
            for k in range(n):
                s.kept[k, c] = s.d[p[k]]
        one(c, batch, s, rate, omega, s.lam, s.d, s.lam_out)

    def recorded_sweep(batch: o.Batch, s: Seen, starts: wp.array(dtype=int), first: int, rate: real, omega: real):
        i = wp.tid()
        if wp.static(fused):
            for colour in range(starts.shape[0] - 1):
                for c in range(starts[colour] + i, starts[colour + 1], wp.block_dim()):
                    record_projection(c, batch, s, rate, omega)
                block.block_barrier()
        else:
            record_projection(starts[first] + i, batch, s, rate, omega)

    return _recorded_kernel(recorded_sweep, f"stored_{o.name}{'_kept' * kept}", module, fused)


@cache
def sweep_adjoint(constraint: Constraint, real, module, damped: bool, kept: bool, fused: bool, placed: bool = True):
    """Kernel of the adjoint of `sweep`; colours in reverse. placed: it adds the gradients by x; else they are what those by d
    have gained. Arguments: batch, gradients by the tables, seen (d after the sweep, becomes that before it), gradients, starts,
    first, rate, omega."""
    o = constraint_variant(constraint, real, True, damped, False, stored=True)
    o.placed = placed
    Seen, Grads = sweep_states(o.t.vec3, o.value), sweep_gradients(o.t.vec3, o.value)
    one = _projection_adjoint_function(o) if kept else _back_length(o)

    def recorded_sweep_adjoint(batch: o.Batch, by: o.Batch, s: Seen, g: Grads, starts: wp.array(dtype=int), first: int,
                               rate: real, omega: real):
        i = wp.tid()
        if wp.static(fused):
            last = starts.shape[0] - 2
            for colour in range(last + 1):
                for c in range(starts[last - colour] + i, starts[last - colour + 1], wp.block_dim()):
                    one(c, batch, by, s, g, rate, omega)
                block.block_barrier()
        else:
            one(starts[first] + i, batch, by, s, g, rate, omega)

    if kept:
        work_dummy(o, module)
    return _recorded_kernel(recorded_sweep_adjoint, f"undo_{o.name}{'_kept' * kept}{'_placed' * placed}", module, fused)


@cache
def gradient_shift_kernel(real, module):
    """Kernel over points: adds `sign` times one gradient to another."""
    vec3 = wp.array(dtype=types(real).vec3)

    @wp.kernel(module=module, enable_backward=False)
    def shift_gradient(grad: vec3, sign: real, into: vec3):
        i = wp.tid()
        into[i] = into[i] + sign * grad[i]

    return shift_gradient


def _recorded_kernel(function, name: str, module, fused: bool):
    how = {"grid_stride": False, "launch_bounds": block.BLOCK} if fused else {}
    return wp.kernel(function, name=f"{name}{'_fused' * fused}", module=module, enable_backward=False, **how)


def _projection_adjoint_function(o):
    """Function: the adjoint of the projection of constraint c, whose points left their d behind."""
    real, vec3, n, last = o.t.scalar, o.t.vec3, o.points, same_vector if o.rows == 3 else first_of
    formula, weights, Seen, Grads = (multiplier_work_function(o), weights_of(n, real), sweep_states(vec3, o.value),
                                     sweep_gradients(vec3, o.value))
    lacks = rounding_gaps(o) if o.exact else None
    damped, placed, m = o.damped, o.placed, n - 1   # a constant: loops to it are unrolled, which adjoints of loops need
    rows, ends, more = (wp.types.matrix((k, 3), real) for k in (m, n, n + 1 + (o.rows == 3)))

    @wp.func
    def adjoint_of_projection(c: int, batch: o.Batch, by: o.Batch, s: Seen, g: Grads, rate: real, omega: real):
        p = batch.point[c]
        N = ends()
        Y = more()                # below the points that by lam
        X = rows()
        V = rows()
        for k in range(n):
            Y[k] = g.d[p[k]]
            N[k] = s.kept[k, c]
            s.d[p[k]] = N[k]
        for k in range(m):
            X[k] = (s.x[p[k + 1]] - s.x[p[0]]) + (N[k + 1] - N[0])
        gamma = real(0.0)
        if wp.static(o.damped):
            gamma = rate * batch.tau[c]
            for k in range(m):
                V[k] = (N[k + 1] - N[0]) - (s.a[p[k + 1]] - s.a[p[0]])
        y = g.lam[c]
        W = weights(batch.w, p)
        alpha = (rate * rate) * batch.alpha[c]
        how = o.t.vec2(gamma, omega)
        Y[n] = last(y)
        if wp.static(o.exact):
            Y[n + 1] = lacks(X, V, W, batch.rest[c], alpha, s.lam[c], how, s.lam_out[c] - s.lam[c])
        gX, gV, gW, grest, galpha, glam, ghow, _gY = wp.grad(formula)(X, V, W, batch.rest[c], alpha, s.lam[c], how, Y)
        by.rest[c] = by.rest[c] + grest
        g.lam[c] = y + glam
        by.alpha[c] = by.alpha[c] + (rate * rate) * galpha
        if wp.static(o.damped):
            by.tau[c] = by.tau[c] + rate * ghow[0]
        first = vec3()
        moved = vec3()
        for k in range(n):
            by.w[p[k]] = by.w[p[k]] + gW[k]
        for k in range(m):
            first -= gX[k]
            moved -= gV[k]
            spread_projection_adjoint(g, p[k + 1], gX[k], gV[k], Y[k + 1], damped, False, placed)
        spread_projection_adjoint(g, p[0], first, moved, Y[0], damped, False, placed)

    return adjoint_of_projection


@wp.func
def spread_projection_adjoint(g: Any, i: int, gX: Any, gV: Any, Y: Any, damped: bool, many: bool, placed: bool):
    """Adds to the gradients by place (if placed), displacement and anchor of a point; many: other threads do as well."""
    if many:
        wp.atomic_add(g.x, i, gX)
        wp.atomic_add(g.d, i, gX + gV)
    else:
        if placed:
            g.x[i] = g.x[i] + gX
        g.d[i] = Y + gX + gV
    if damped:
        g.a[i] = g.a[i] - gV


def _back_length(o):
    """Function: the adjoint of the projection of a length."""
    real, vec3, formula, undo = o.t.scalar, o.t.vec3, length_derivation(o), _undo_projection_function(o)
    Seen, Grads, damped, anchored, placed = (sweep_states(vec3, o.value), sweep_gradients(vec3, o.value), o.damped, o.anchored,
                                             o.placed)
    read_points, read = block.table_read_functions(2, real)

    @wp.func
    def distance_projection_adjoint(c: int, batch: o.Batch, by: o.Batch, s: Seen, g: Grads, rate: real, omega: real):
        p = read_points(batch.point, c)
        i = p[0]
        j = p[1]
        W = o.t.vec2(batch.w[i], batch.w[j])
        lam = read(s.lam, c)
        dlam = read(s.lam_out, c) - lam
        N = undo(batch, s, c, p, wp.matrix_from_rows(s.d[i], s.d[j]), W, vec3(rate, omega, dlam))
        s.d[i] = N[0]
        s.d[j] = N[1]
        gamma = real(0.0)
        V = vec3()
        if wp.static(o.damped):
            gamma = rate * batch.tau[c]
            V = (N[1] - N[0]) - (s.a[j] - s.a[i])
        alpha = real(0.0)
        if wp.static(not o.unilateral):
            alpha = rate * rate * read(batch.alpha, c)
        Y = wp.matrix_from_rows(g.d[i], g.d[j])
        y = g.lam[c]
        gX, gV, gW, grest, galpha, glam, ggamma = formula(
            (s.x[j] - s.x[i]) + (N[1] - N[0]), V, W, dlam, alpha, lam, vec3(gamma, omega, y), Y)
        by.rest[c] = by.rest[c] + grest
        g.lam[c] = y - y
        if wp.static(not o.unilateral):
            g.lam[c] = y + glam
            by.alpha[c] = by.alpha[c] + rate * rate * galpha
        if wp.static(o.damped):
            by.tau[c] = by.tau[c] + rate * ggamma
        if wp.static(not o.anchored):
            by.w[i] = by.w[i] + gW[0]
        by.w[j] = by.w[j] + gW[1]
        spread_projection_adjoint(g, j, gX, gV, Y[1], damped, False, placed)
        spread_projection_adjoint(g, i, -gX, -gV, Y[0], damped, anchored, placed)

    return distance_projection_adjoint


def _undo_projection_function(o):
    """Function: d of two points before a projection of their distance, from those after it; how: rate, omega, dlam."""
    real, Seen = o.t.scalar, sweep_states(o.t.vec3, o.value)
    ends = wp.types.matrix((2, 3), real)

    @wp.func
    def undo_projection(batch: o.Batch, s: Seen, c: int, p: o.ids, N: ends, W: o.t.vec2, how: o.t.vec3):
        rate = how[0]
        omega = how[1]
        dlam = how[2]
        step = (W[0] + W[1]) * dlam
        r = (s.x[p[1]] - s.x[p[0]]) + (N[1] - N[0])
        L = wp.length(r)
        n = inverse_or_zero(L) * r
        if step < -L:                                    # else they have not passed each other
            rest = batch.rest[c]
            straight = L - step - rest
            turned = -L - step - rest
            below = W[0] + W[1]
            if wp.static(o.unilateral):
                straight = wp.max(straight, real(0.0))
                turned = wp.max(turned, real(0.0))
            else:
                alpha = rate * rate * batch.alpha[c]
                straight += alpha * s.lam[c]
                turned += alpha * s.lam[c]
                below += alpha
            if wp.static(o.damped):
                gamma = rate * batch.tau[c]
                slide = wp.dot(n, (N[1] - N[0]) - (s.a[p[1]] - s.a[p[0]]))
                straight += gamma * (slide - step)
                turned -= gamma * (slide + step)
                below += gamma * (W[0] + W[1])
            if wp.abs(omega * turned + below * dlam) < wp.abs(omega * straight + below * dlam):
                n = -n
        return wp.matrix_from_rows(N[0] + (W[0] * dlam) * n, N[1] - (W[1] * dlam) * n)

    return undo_projection
