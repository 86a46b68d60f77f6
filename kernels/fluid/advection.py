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

from wsim.kernels.fluid.forces import lift, lifting
from wsim.kernels.fluid.grid import beside, flat, functions, structs
from wsim.kernels.math.real import types

SCHEMES = ("linear", "cubic")
BOUNDS = (128, 8)        # threads of a block, blocks of a processor: 64 registers a thread; two scalars would take 122


def tiles(dim: int, shape: tuple[int, ...]) -> int:
    """Threads of a kernel whose threads are `tiled` over an array of this shape."""
    return 128 * shape[0] * -(-shape[1] // 4) * -(-shape[2] // 32) if dim == 3 else shape[0] * shape[1]


@cache
def tiled(dim: int, real):
    """Function (c, shape) -> place of thread c, 32 rows along the last axis by four along the one before in a block of 128:
    what its threads read is near to one another. Flat: row by row. Some are beyond the shape."""
    f = functions(dim, real)

    @wp.func
    def tiled(c: int, shape: wp.vec3i):
        if wp.static(dim == 3):
            deepest = (shape[2] + 31) >> 5
            wide = (shape[1] + 3) >> 2
            b = c >> 7
            i = b // deepest
            k = b - i * deepest
            a = i // wide
            return wp.vec3i(a, 4 * (i - a * wide) + ((c >> 5) & 3), 32 * k + (c & 31))
        return f.place(c, shape)

    return tiled


@cache
def standing(dim: int, axis: int, real):
    """Function (g, u, i) -> velocity [m/s] at face i of an axis (-1: in the middle of cell i): its own component, and means of
    the two or four rows about it, which is what `velocity` finds there."""
    t, S, f = types(real), structs(real), functions(dim, real)

    @cache
    def component(of: int):
        @wp.func
        def component(g: S.Grid, q: wp.array(dtype=real), i: wp.vec3i):
            shape = f.faces(g, wp.static(of))
            value = q[flat(i, shape)]
            if wp.static(of != axis):
                ahead = wp.vec3i(i[0], i[1], i[2])
                ahead[wp.static(of)] = beside(i[wp.static(of)] + 1, shape[wp.static(of)], g.periodic[wp.static(of)])
                if wp.static(axis < 0):
                    value = real(0.5) * (value + q[flat(ahead, shape)])
                else:
                    n = shape[wp.static(axis)]
                    here = wp.min(i[wp.static(axis)], n - 1)
                    behind = beside(i[wp.static(axis)] - 1, n, g.periodic[wp.static(axis)])
                    now = wp.vec3i(i[0], i[1], i[2])
                    now[wp.static(axis)] = here
                    ahead[wp.static(axis)] = here
                    value = q[flat(now, shape)] + q[flat(ahead, shape)]
                    now[wp.static(axis)] = behind
                    ahead[wp.static(axis)] = behind
                    value = real(0.25) * (value + q[flat(now, shape)] + q[flat(ahead, shape)])
            return value

        return component

    x, y, z = component(0), component(1), component(2)

    @wp.func
    def standing(g: S.Grid, u: S.Faces, i: wp.vec3i):
        v = t.vec3()
        v[0] = x(g, u.x, i)
        v[1] = y(g, u.y, i)
        if wp.static(dim == 3):
            v[2] = z(g, u.z, i)
        return v

    return standing


@cache
def backtrace(dim: int, axis: int, real, third: bool = False):
    """Function (g, u, i, h) -> X of the middle of face i of an axis (-1: of cell i); X in cells, h in [s]."""
    t, S, f, here = types(real), structs(real), functions(dim, real), standing(dim, axis, real)

    @wp.func
    def backtrace(g: S.Grid, u: S.Faces, i: wp.vec3i, h: real):
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(wp.static(axis))
        s = h / g.dx
        k1 = here(g, u, i)
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
def walled(dim: int, axis: int, real):
    """Function (g, q, shape, s) -> a component at s rows, by cubics that go on beyond walls to which air sticks: along a wall
    odd about its velocity, across it even, since what flows along does not grow there."""
    t, S, f = types(real), structs(real), functions(dim, real)

    @wp.func
    def mirrored(g: S.Grid, b: int, j: int, n: int):
        """(row that stands for row j of n along axis b, side that it is beyond: 0 none, 1 low, 2 high)."""
        row = beside(j, n, g.periodic[b])
        side = int(0)
        if g.periodic[b] == 0 and row != j:
            bit = wp.where(j < 0, 1, 2)
            if (g.outside[b] & bit) == 0:
                side = bit
                row = wp.where(j < 0, -1 - j, 2 * n - 1 - j)
                if b == wp.static(axis):
                    row = wp.where(j < 0, -j, 2 * (n - 1) - j)
        return row, side

    @wp.func
    def walled(g: S.Grid, q: wp.array(dtype=real), shape: wp.vec3i, at: t.vec3):
        s = t.vec3(at[0], at[1], at[2])
        for b in range(wp.static(dim)):
            if g.periodic[b] == 0:
                low = wp.where(b != wp.static(axis) and (g.outside[b] & 1) == 0, real(-0.5), real(0.0))
                high = wp.where(b != wp.static(axis) and (g.outside[b] & 2) == 0, real(0.5), real(0.0))
                s[b] = wp.clamp(s[b], low, real(shape[b] - 1) + high)
        i = f.floors(s)
        if f.inner(i, shape):
            return f.cubic(q, shape, g.periodic, s)
        sum = real(0.0)
        count = int(wp.static(4 ** dim))
        for m in range(count):
            value = real(1.0)
            wall = real(0.0)
            weight = real(1.0)
            row = wp.vec3i()
            for b in range(wp.static(dim)):
                a = (m >> (2 * b)) & 3
                w = f.weights(s[b] - real(i[b]))
                weight = weight * w[a]
                j, side = mirrored(g, b, i[b] - 1 + a, shape[b])
                row[b] = j
                if side != 0 and b != wp.static(axis):
                    v = g.air[2 * b + side]
                    wall = real(2.0) * v[wp.static(axis)] - wall
                    value = -value
            sum += weight * (wall + value * q[flat(row, shape)])
        return sum

    return walled


@cache
def carried(dim: int, axis: int, scheme: str, clamped: bool, walls: bool, real):
    """Function (g, q, X) -> a component (axis 0 .. dim - 1) or scalar (axis -1) at X. scheme: "linear" or "cubic". walls: see
    `walled`."""
    t, S, f, gone = types(real), structs(real), functions(dim, real), left(real)
    cubic, beyond = scheme == "cubic", walled(dim, axis, real) if walls else None

    @wp.func
    def carried(g: S.Grid, q: wp.array(dtype=real), X: t.vec3):
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if wp.static(axis >= 0):
            shape = f.faces(g, wp.static(axis))
        value = real(0.0)
        if gone(g, X):
            if wp.static(axis >= 0):
                wind = g.air[0]
                value = wind[wp.static(max(axis, 0))]
        else:
            s = X - f.offset(wp.static(axis))
            if wp.static(cubic and walls):
                value = beyond(g, q, shape, s)
            elif wp.static(cubic and clamped):
                value = f.limited(q, shape, g.periodic, s)
            elif wp.static(cubic):
                value = f.cubic(q, shape, g.periodic, s)
            else:
                value = f.linear(q, shape, g.periodic, s)
        return value

    return carried


@cache
def advect(dim: int, axis: int, how: tuple[str, bool, bool, bool], pushed: str, real, module):
    """Kernel over tiles of the rows of a component (axis 0 .. dim - 1), or of a scalar (axis -1): q_out = q followed back
    over `part` of the step clock[0] [s]. how: scheme, whether clamped, with walls, a way back of order 3. pushed: what lifts
    and weighs there, see `forces.lift`; "": nothing."""
    S, f, F = structs(real), functions(dim, real), lifting(real)
    scheme, clamped, walls, third = how
    back, at, at_place = backtrace(dim, axis, real, third), carried(dim, axis, *how[:3], real), tiled(dim, real)
    push = lift(dim, axis, pushed, real) if pushed else None

    def advect(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), lifting: F, clock: wp.array(dtype=real), part: real,
               q_out: wp.array(dtype=real)):
        c = wp.tid()
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if wp.static(axis >= 0):
            shape = f.faces(g, wp.static(axis))
        i = at_place(c, shape)
        if i[1] < shape[1] and i[2] < shape[2]:
            h = part * clock[0]
            value = at(g, q, back(g, u, i, h))
            if wp.static(bool(pushed)):
                value += h * push(g, lifting, i)
            q_out[flat(i, shape)] = value

    which = f"{'c' if axis < 0 else 'xyz'[axis]}_{scheme}{'_clamped' * clamped}{'_walls' * walls}{'_rk3' * third}"
    name = f"advect_{which}{'_' * bool(pushed)}{pushed}_{f.name}"
    return wp.kernel(advect, name=name, module=module, enable_backward=False, launch_bounds=BOUNDS)


@cache
def advect_both(dim: int, scheme: str, third: bool, real, module):
    """Kernel over tiles of cells: `advect` of two scalars, which have the way back in common."""
    S, f = structs(real), functions(dim, real)
    back, at, at_place = backtrace(dim, -1, real, third), carried(dim, -1, scheme, True, False, real), tiled(dim, real)

    def advect_both(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), r: wp.array(dtype=real), clock: wp.array(dtype=real),
                    part: real, q_out: wp.array(dtype=real), r_out: wp.array(dtype=real)):
        i = at_place(wp.tid(), g.n)
        if i[1] < g.n[1] and i[2] < g.n[2]:
            X = back(g, u, i, part * clock[0])
            c = flat(i, g.n)
            q_out[c] = at(g, q, X)
            r_out[c] = at(g, r, X)

    return wp.kernel(advect_both, name=f"advect_both_{scheme}{'_rk3' * third}_{f.name}", module=module, enable_backward=False,
                     launch_bounds=BOUNDS)


@cache
def correct(dim: int, axis: int, bfecc: bool, real, module):
    """Kernel over the rows: MacCormack's correction of p = A q by q' = A^-1 p, kept within the rows that p came of; bfecc: the
    same limit for p = A (q + (q - q') / 2), without a correction."""
    S, f = structs(real), functions(dim, real)
    back, gone = backtrace(dim, axis, real), left(real)

    def correct(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), p: wp.array(dtype=real), turned: wp.array(dtype=real),
                clock: wp.array(dtype=real), part: real, q_out: wp.array(dtype=real)):
        c = wp.tid()
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if wp.static(axis >= 0):
            shape = f.faces(g, wp.static(axis))
        X = back(g, u, f.place(c, shape), part * clock[0])
        value = p[c]
        if not gone(g, X):
            if wp.static(not bfecc):
                value += real(0.5) * (q[c] - turned[c])
            least, most = f.around(q, shape, g.periodic, X - f.offset(wp.static(axis)))
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
