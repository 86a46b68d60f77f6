"""What the air carries along: dq/dt + u . grad q = 0, by following each row back (semi-Lagrangian; Stam 1999).

    q_out(x) = q(X),    X = where the air at x was a time h before

X by the midpoint rule, X = x - h u(x - h/2 u(x)) (order 2), or by Ralston's Runge-Kutta (1962, order 3). Never by Euler's
method: a blob that turns loses itself. q at X is

    linear       a convex combination: no new extremes, order 1 in time, much diffusion
    cubic        four rows an axis, kept within the 2^dim around it: order 3 where nothing is clamped
    MacCormack   p = A q,  q' = A^-1 p (velocity turned round),  p + (q - q') / 2, kept within what p came of
                 (Selle et al. 2008)
    BFECC        A (q + (q - q') / 2), kept likewise (Kim et al. 2005; the limiter of Selle et al.)

Any h is stable: what is clamped stays within what there was. Where the way back leaves by a side through which air comes, q is
that of the air around: 0, or its velocity.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import functions, structs
from wsim.kernels.math.real import types

SCHEMES = ("linear", "cubic")


@cache
def backtrace(dim: int, real, third: bool = False):
    """Function (g, u, x, h) -> X; x in cells, h in [s]."""
    t, S, f = types(real), structs(real), functions(dim, real)

    @wp.func
    def backtrace(g: S.Grid, u: S.Faces, x: t.vec3, h: real):
        s = h / g.dx
        k1 = f.velocity(g, u, x)
        k2 = f.velocity(g, u, x - (real(0.5) * s) * k1)
        if wp.static(third):
            k3 = f.velocity(g, u, x - (real(0.75) * s) * k2)
            return x - s * (real(2.0 / 9.0) * k1 + real(3.0 / 9.0) * k2 + real(4.0 / 9.0) * k3)
        return x - s * k2

    return backtrace


@cache
def left(real):
    """Function (g, X) -> whether X is outside by a side through which air comes."""
    t, S = types(real), structs(real)

    @wp.func
    def left(g: S.Grid, X: t.vec3):
        gone = bool(False)  # noqa: UP018
        for a in range(3):
            if (g.outside[a] & 1) != 0 and X[a] < real(0.0):
                gone = True
            if (g.outside[a] & 2) != 0 and X[a] > real(g.n[a]):
                gone = True
        return gone

    return left


@cache
def advect(dim: int, axis: int, scheme: str, clamped: bool, third: bool, real, module):
    """Kernel over the rows of a component (axis 0 .. dim - 1), or of a scalar (axis -1): q_out = q followed back over
    `part` of the step clock[0] [s]. scheme: "linear" or "cubic"."""
    t, S, f = types(real), structs(real), functions(dim, real)
    back, gone = backtrace(dim, real, third), left(real)
    cubic = scheme == "cubic"

    @wp.func
    def carried(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), c: int, h: real):
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if wp.static(axis >= 0):
            shape = f.faces(g, wp.static(axis))
        o = f.offset(wp.static(axis))
        i = f.place(c, shape)
        X = back(g, u, t.vec3(real(i[0]), real(i[1]), real(i[2])) + o, h)
        value = real(0.0)
        if gone(g, X):
            if wp.static(axis >= 0):
                wind = g.air[0]
                value = wind[wp.static(max(axis, 0))]
        else:
            s = X - o
            if wp.static(cubic):
                value = f.cubic(q, shape, g.periodic, s)
                if wp.static(clamped):
                    least, most = f.around(q, shape, g.periodic, s)
                    value = wp.clamp(value, least, most)
            else:
                value = f.linear(q, shape, g.periodic, s)
        return value

    def advect(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), clock: wp.array(dtype=real), part: real,
               q_out: wp.array(dtype=real)):
        c = wp.tid()
        q_out[c] = carried(g, u, q, c, part * clock[0])

    name = f"advect_{'c' if axis < 0 else 'xyz'[axis]}_{scheme}{'_clamped' * clamped}{'_rk3' * third}_{f.name}"
    return wp.kernel(advect, name=name, module=module, enable_backward=False)


@cache
def correct(dim: int, axis: int, bfecc: bool, real, module):
    """Kernel over the rows: MacCormack's correction of p = A q by q' = A^-1 p, kept within the rows that p came of; bfecc: the
    same limit for p = A (q + (q - q') / 2), without a correction."""
    t, S, f = types(real), structs(real), functions(dim, real)
    back, gone = backtrace(dim, real), left(real)

    def correct(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), p: wp.array(dtype=real), turned: wp.array(dtype=real),
                clock: wp.array(dtype=real), part: real, q_out: wp.array(dtype=real)):
        c = wp.tid()
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if wp.static(axis >= 0):
            shape = f.faces(g, wp.static(axis))
        o = f.offset(wp.static(axis))
        i = f.place(c, shape)
        X = back(g, u, t.vec3(real(i[0]), real(i[1]), real(i[2])) + o, part * clock[0])
        value = p[c]
        if not gone(g, X):
            if wp.static(not bfecc):
                value += real(0.5) * (q[c] - turned[c])
            least, most = f.around(q, shape, g.periodic, X - o)
            value = wp.clamp(value, least, most)
        q_out[c] = value

    name = f"correct_{'c' if axis < 0 else 'xyz'[axis]}_{'bfecc' if bfecc else 'maccormack'}_{f.name}"
    return wp.kernel(correct, name=name, module=module, enable_backward=False)


@cache
def compensate(real, module):
    """Kernel over the rows: q + (q - q') / 2, of BFECC."""

    def compensate(q: wp.array(dtype=real), turned: wp.array(dtype=real), q_out: wp.array(dtype=real)):
        c = wp.tid()
        q_out[c] = q[c] + real(0.5) * (q[c] - turned[c])

    return wp.kernel(compensate, name=f"compensate_{types(real).name}", module=module, enable_backward=False)
