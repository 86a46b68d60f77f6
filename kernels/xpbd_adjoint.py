"""Adjoint of a coloured sweep of XPBD (kernels/xpbd.py), which ran in place: it is undone, constraint by constraint.

A projection adds w_k G_k dlam to d_k and dlam to lam. Sweeps leave lam behind them, a number a constraint: dlam is the
difference to the sweep before. Of a length L the direction n does not change, L' = L + K dlam with K = w_0 + w_1, and so

    n = n',  L = L' - K dlam       (or n = -n', L = -L' - K dlam, where the points have passed each other)

gives back what was there, to rounding; where both could be, the one whose own dlam is nearer. Angles and strains leave their
points' d behind as well ("kept").

With Y the gradients by d after the projection and y that by lam, the gradients by all that it has read are Y, y and those of
s (kernels/xpbd_product.py), which Warp differentiates: all second derivatives of C are there. No point occurs twice in a
colour, so that gradients of points are added without atomics.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels import stream
from wsim.kernels.constraint import inverse
from wsim.kernels.xpbd import WEIGHTS, one_of, variant
from wsim.kernels.xpbd_product import need, product


@wp.func
def weights_of_3(w: wp.array(dtype=Any), p: wp.vec3i):
    """Inverse masses of three points."""
    return wp.vector(w[p[0]], w[p[1]], w[p[2]])


@wp.func
def itself(y: Any):
    """A vector."""
    return y


@wp.func
def first_of(y: Any):
    """A vector with y first."""
    return wp.vector(y, y - y, y - y)


@cache
def seen(vec3, value):
    """Struct of what a sweep reads and writes but for its tables. kept: d of the points, (m, points) by point, or none."""

    @wp.struct
    class Seen:
        x: wp.array(dtype=vec3)
        a: wp.array(dtype=vec3)
        d: wp.array(dtype=vec3)              # in place
        kept: wp.array2d(dtype=vec3)
        lam: wp.array(dtype=value)           # before the sweep
        lam_out: wp.array(dtype=value)       # after it

    return Seen


@cache
def grads(vec3, value):
    """Struct of gradients: d and lam by what is after a sweep, which become those by what was before; the others are added
    to."""

    @wp.struct
    class Grads:
        x: wp.array(dtype=vec3)
        a: wp.array(dtype=vec3)
        d: wp.array(dtype=vec3)
        lam: wp.array(dtype=value)

    return Grads


@cache
def sweep(constraint: str, real, module, damped: bool, kept: bool, fused: bool):
    """Kernel of a sweep that leaves behind what its adjoint needs. fused: one block takes all colours, between `first` and the
    end; else a launch is a colour that begins at starts[first]. Arguments: batch, seen, starts, first, rate, omega."""
    o = variant(constraint, real, True, damped, False, stored=True)
    one, n, Seen = one_of(o, False), o.points, seen(o.t.vec3, o.value)

    @wp.func
    def take(c: int, batch: o.Batch, s: Seen, rate: real, omega: real):
        s.lam_out[c] = s.lam[c]
        if wp.static(kept):
            p = batch.point[c]
            for k in range(n):
                s.kept[k, c] = s.d[p[k]]
        one(c, batch, s.x, s.a, rate, omega, s.d, s.lam, s.d, s.lam_out)

    def forward(batch: o.Batch, s: Seen, starts: wp.array(dtype=int), first: int, rate: real, omega: real):
        i = wp.tid()
        if wp.static(fused):
            for colour in range(starts.shape[0] - 1):
                for c in range(starts[colour] + i, starts[colour + 1], wp.block_dim()):
                    take(c, batch, s, rate, omega)
                stream.meet()
        else:
            take(starts[first] + i, batch, s, rate, omega)

    return _kernel(forward, f"stored_{o.name}{'_kept' * kept}", module, fused)


@cache
def sweep_adjoint(constraint: str, real, module, damped: bool, kept: bool, fused: bool):
    """Kernel of the adjoint of `sweep`; colours in reverse. Arguments: batch, gradients by the tables, seen (d after the sweep,
    becomes that before it), gradients, starts, first, rate, omega."""
    o = variant(constraint, real, True, damped, False, stored=True)
    Seen, Grads = seen(o.t.vec3, o.value), grads(o.t.vec3, o.value)
    one = _back(o, kept)
    need(o, module)

    def backward(batch: o.Batch, by: o.Batch, s: Seen, g: Grads, starts: wp.array(dtype=int), first: int, rate: real,
                 omega: real):
        i = wp.tid()
        if wp.static(fused):
            last = starts.shape[0] - 2
            for colour in range(last + 1):
                for c in range(starts[last - colour] + i, starts[last - colour + 1], wp.block_dim()):
                    one(c, batch, by, s, g, rate, omega)
                stream.meet()
        else:
            one(starts[first] + i, batch, by, s, g, rate, omega)

    return _kernel(backward, f"undo_{o.name}{'_kept' * kept}", module, fused)


def _kernel(function, name: str, module, fused: bool):
    how = {"grid_stride": False, "launch_bounds": stream.BLOCK} if fused else {}
    return wp.kernel(function, name=f"{name}{'_fused' * fused}", module=module, enable_backward=False, **how)


def _back(o, kept: bool):
    """Function: the adjoint of the projection of constraint c."""
    real, n, weights, last = o.t.scalar, o.points, WEIGHTS.get(o.points, weights_of_3), itself if o.rows == 3 else first_of
    formula, undo, spread = product(o), _undo(o), _spread(o)
    Seen, Grads = seen(o.t.vec3, o.value), grads(o.t.vec3, o.value)
    m = n - 1                     # a constant: loops to it are unrolled, which adjoints of loops need
    rows, ends, more = (wp.types.matrix((k, 3), real) for k in (m, n, n + 1))

    @wp.func
    def back(c: int, batch: o.Batch, by: o.Batch, s: Seen, g: Grads, rate: real, omega: real):
        p = batch.point[c]
        N = ends()
        Y = more()                # the last row is the gradient by lam
        X = rows()
        V = rows()
        W = weights(batch.w, p)
        for k in range(n):
            Y[k] = g.d[p[k]]
            N[k] = s.d[p[k]]
            if wp.static(kept):
                N[k] = s.kept[k, c]
        if wp.static(not kept):
            N = undo(batch, s, c, N, W, rate, omega)
        for k in range(n):
            s.d[p[k]] = N[k]
        for k in range(m):
            X[k] = (s.x[p[k + 1]] - s.x[p[0]]) + (N[k + 1] - N[0])
        gamma = real(0.0)
        if wp.static(o.damped):
            gamma = rate * batch.tau[c]
            for k in range(m):
                V[k] = (N[k + 1] - N[0]) - (s.a[p[k + 1]] - s.a[p[0]])
        y = g.lam[c]
        Y[n] = last(y)
        gX, gV, gW, grest, galpha, glam, ghow, _gY = wp.grad(formula)(
            X, V, W, batch.rest[c], (rate * rate) * batch.alpha[c], s.lam[c], o.t.vec2(gamma, omega), Y)
        by.rest[c] = by.rest[c] + grest
        if wp.static(o.unilateral):
            g.lam[c] = glam
        else:
            g.lam[c] = y + glam
            by.alpha[c] = by.alpha[c] + (rate * rate) * galpha
        if wp.static(o.damped):
            by.tau[c] = by.tau[c] + rate * ghow[0]
        for k in range(wp.static(int(o.anchored)), n):
            by.w[p[k]] = by.w[p[k]] + gW[k]
        spread(p, g, gX, gV, Y)

    return back


def _spread(o):
    """Function: adds to gradients by places, anchors and displacements what those by differences to the first point say."""
    vec3, m, Grads = o.t.vec3, o.points - 1, grads(o.t.vec3, o.value)
    rows, ends = wp.types.matrix((m, 3), o.t.scalar), wp.types.matrix((m + 2, 3), o.t.scalar)

    @wp.func
    def spread(p: o.ids, g: Grads, gX: rows, gV: rows, Y: ends):
        first = vec3()
        moved = vec3()
        for k in range(m):
            j = p[k + 1]
            first -= gX[k]
            moved -= gV[k]
            g.x[j] = g.x[j] + gX[k]
            g.d[j] = Y[k + 1] + gX[k] + gV[k]
            if wp.static(o.damped):
                g.a[j] = g.a[j] - gV[k]
        i = p[0]
        if wp.static(o.anchored):                        # a pinned point of many tethers
            wp.atomic_add(g.x, i, first)
            wp.atomic_add(g.d, i, first + moved)
        else:
            g.x[i] = g.x[i] + first
            g.d[i] = Y[0] + first + moved
        if wp.static(o.damped):
            g.a[i] = g.a[i] - moved

    return spread


def _undo(o):
    """Function: d of two points before a projection of their distance, from those after it."""
    real, Seen = o.t.scalar, seen(o.t.vec3, o.value)
    ends = wp.types.matrix((2, 3), real)

    @wp.func
    def undo(batch: o.Batch, s: Seen, c: int, N: ends, W: o.t.vec2, rate: real, omega: real):
        p = batch.point[c]
        dlam = s.lam_out[c] - s.lam[c]
        step = (W[0] + W[1]) * dlam
        r = (s.x[p[1]] - s.x[p[0]]) + (N[1] - N[0])
        L = wp.length(r)
        n = inverse(L) * r
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

    return undo
