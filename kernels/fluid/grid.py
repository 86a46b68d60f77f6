"""A staggered grid (Harlow, Welch 1965): scalars at the centres of cells, each component of a velocity on the faces across it.

    n        cells along the axes; flat: two of them, and n[2] = 1             dx  edge of a cell [m]
    x        a place in cells from the low corner: centre of cell i at i + 1/2, face i of axis a at x_a = i
    shape    rows of an array along the axes; an axis that is not periodic has one face more than cells

Arrays are flat, the last axis first in memory. `linear` is a convex combination, of order 2; `cubic` is the tensor product of
cubics through four rows (order 4), `limited` to the 2^dim rows around (kernels/fluid/sampling.py). Beyond a side rows repeat:
the first one, or around where it is periodic.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch.
# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.sampling import natives
from wsim.kernels.math.real import types


@cache
def structs(real) -> SimpleNamespace:
    t = types(real)

    @wp.struct
    class Grid:
        n: wp.vec3i                        # cells
        periodic: wp.vec3i                 # 1: that axis is
        outside: wp.vec3i                  # bit 1, 2: beyond the low, the high side is the air around
        air: wp.array(dtype=t.vec3)        # its velocity [m/s], along the axes of the grid; then what each side has, (7,)
        dx: real                           # [m]

    @wp.struct
    class Faces:
        x: wp.array(dtype=real)            # component of a vector on the faces across each axis; z: none where flat
        y: wp.array(dtype=real)
        z: wp.array(dtype=real)

    return SimpleNamespace(Grid=Grid, Faces=Faces)


@wp.func
def wrapped(i: int, n: int, periodic: int):
    """Row that stands for row i of n."""
    j = int(i)
    if periodic != 0:
        j = i % n
        if j < 0:
            j += n
    else:
        j = wp.clamp(i, 0, n - 1)
    return j


@wp.func
def beside(i: int, n: int, periodic: int):
    """Row that stands for row i of n, which is no further off than n."""
    j = int(i)
    if periodic != 0:
        if i < 0:
            j = i + n
        elif i >= n:
            j = i - n
    return wp.clamp(j, 0, n - 1)


@wp.func
def place_of(c: int, shape: wp.vec3i):
    """(i, j, k) of a flat index."""
    i = c // shape[2]
    j = i // shape[1]
    return wp.vec3i(j, i - j * shape[1], c - i * shape[2])


@wp.func
def flat(i: wp.vec3i, shape: wp.vec3i):
    """Flat index of (i, j, k)."""
    return (i[0] * shape[1] + i[1]) * shape[2] + i[2]


@cache
def functions(dim: int, real) -> SimpleNamespace:
    """place(c, shape), faces(g, axis) -> shape, linear and cubic (q, shape, periodic, s) -> value at s rows, velocity(g, u, x),
    least and most of the rows around. dim: 2 or 3."""
    t, S, plain = types(real), structs(real), natives(dim, real)
    vec4i = wp.types.vector(4, int)
    deep = dim == 3

    @wp.func
    def place(c: int, shape: wp.vec3i):
        if wp.static(deep):
            return place_of(c, shape)
        i = c // shape[1]
        return wp.vec3i(i, c - i * shape[1], 0)

    @wp.func
    def faces(g: S.Grid, axis: int):
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        shape[axis] = g.n[axis] + 1 - g.periodic[axis]
        return shape

    @wp.func
    def held(s: t.vec3, shape: wp.vec3i, periodic: wp.vec3i):
        """s, within the rows; along a periodic axis around."""
        h = t.vec3(s[0], s[1], s[2])
        for a in range(wp.static(dim)):
            n = real(shape[a])
            if periodic[a] == 0:
                h[a] = wp.clamp(s[a], real(0.0), n - real(1.0))
            elif s[a] < real(0.0) or s[a] >= n:
                h[a] = s[a] - n * wp.floor(s[a] / n)
        return h

    @wp.func
    def row(i: int, j: int, k: int, shape: wp.vec3i, periodic: wp.vec3i):
        a = beside(i, shape[0], periodic[0])
        b = beside(j, shape[1], periodic[1])
        if wp.static(deep):
            return (a * shape[1] + b) * shape[2] + beside(k, shape[2], periodic[2])
        return a * shape[1] + b

    @wp.func
    def linear(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3):
        s = held(at, shape, periodic)
        i = int(wp.floor(s[0]))
        j = int(wp.floor(s[1]))
        k = int(0)
        fx = s[0] - real(i)
        fy = s[1] - real(j)
        i0 = beside(i, shape[0], periodic[0])
        i1 = beside(i + 1, shape[0], periodic[0])
        j0 = beside(j, shape[1], periodic[1])
        j1 = beside(j + 1, shape[1], periodic[1])
        if wp.static(deep):
            k = int(wp.floor(s[2]))
            fz = s[2] - real(k)
            k0 = beside(k, shape[2], periodic[2])
            k1 = beside(k + 1, shape[2], periodic[2])
            r00 = (i0 * shape[1] + j0) * shape[2]
            r01 = (i0 * shape[1] + j1) * shape[2]
            r10 = (i1 * shape[1] + j0) * shape[2]
            r11 = (i1 * shape[1] + j1) * shape[2]
            low = wp.lerp(wp.lerp(q[r00 + k0], q[r00 + k1], fz), wp.lerp(q[r01 + k0], q[r01 + k1], fz), fy)
            high = wp.lerp(wp.lerp(q[r10 + k0], q[r10 + k1], fz), wp.lerp(q[r11 + k0], q[r11 + k1], fz), fy)
            return wp.lerp(low, high, fx)
        return wp.lerp(wp.lerp(q[i0 * shape[1] + j0], q[i0 * shape[1] + j1], fy),
                       wp.lerp(q[i1 * shape[1] + j0], q[i1 * shape[1] + j1], fy), fx)

    @wp.func
    def around(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3):
        """(least, most) of the rows that `linear` reads."""
        s = held(at, shape, periodic)
        i = int(wp.floor(s[0]))
        j = int(wp.floor(s[1]))
        k = int(0)
        if wp.static(deep):
            k = int(wp.floor(s[2]))
        least = q[row(i, j, k, shape, periodic)]
        most = least
        for m in range(1, wp.static(2 ** dim)):
            v = q[row(i + m % 2, j + (m // 2) % 2, k + m // 4, shape, periodic)]
            least = wp.min(least, v)
            most = wp.max(most, v)
        return least, most

    @wp.func
    def weights(f: real):
        """Of the rows -1, 0, 1, 2 about a fraction f in 0 .. 1: the cubic through them (Lagrange)."""
        a = f + real(1.0)
        b = f - real(1.0)
        c = f - real(2.0)
        return t.vec4(-f * b * c / real(6.0), a * b * c * real(0.5), -a * f * c * real(0.5), a * f * b / real(6.0))

    @wp.func
    def stride(shape: wp.vec3i):
        """To the next row along the first axis."""
        return shape[1] * shape[2]

    @wp.func
    def rows(i: int, n: int, periodic: int):
        return vec4i(beside(i - 1, n, periodic), beside(i, n, periodic), beside(i + 1, n, periodic), beside(i + 2, n, periodic))

    @wp.func
    def floors(s: t.vec3):
        i = wp.vec3i(int(wp.floor(s[0])), int(wp.floor(s[1])), 0)
        if wp.static(deep):
            i[2] = int(wp.floor(s[2]))
        return i

    @wp.func
    def inner(i: wp.vec3i, shape: wp.vec3i):
        """Whether the four rows about i are all within, along each axis."""
        all = i[0] > 0 and i[0] + 2 < shape[0] and i[1] > 0 and i[1] + 2 < shape[1]
        if wp.static(deep):
            all = all and i[2] > 0 and i[2] + 2 < shape[2]
        return all

    @wp.func
    def lowest(i: wp.vec3i, shape: wp.vec3i):
        """First of the four rows about i, along each axis."""
        if wp.static(deep):
            return ((i[0] - 1) * shape[1] + i[1] - 1) * shape[2] + i[2] - 1
        return (i[0] - 1) * shape[1] + i[1] - 1

    @wp.func
    def edge(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, i: wp.vec3i, f: t.vec3):
        """The cubic where not all of its rows are within."""
        wx = weights(f[0])
        wy = weights(f[1])
        wz = weights(f[2])
        sum = real(0.0)
        count = int(wp.static(4 ** dim))
        for m in range(count):
            a = m % 4
            b = (m // 4) % 4
            c = m // 16
            w = wx[a] * wy[b]
            if wp.static(deep):
                w = w * wz[c]
            sum += w * q[row(i[0] - 1 + a, i[1] - 1 + b, i[2] - 1 + c, shape, periodic)]
        return sum

    @wp.func
    def cubic(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3):
        s = held(at, shape, periodic)
        i = floors(s)
        f = s - t.vec3(real(i[0]), real(i[1]), real(i[2]))
        value = real(0.0)
        if inner(i, shape):
            value = plain.patch(q, lowest(i, shape), stride(shape), shape[2], f)
        else:
            value = edge(q, shape, periodic, i, f)
        return value

    @wp.func
    def limited(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3):
        s = held(at, shape, periodic)
        i = floors(s)
        f = s - t.vec3(real(i[0]), real(i[1]), real(i[2]))
        value = real(0.0)
        if inner(i, shape):
            value = plain.limited(q, lowest(i, shape), stride(shape), shape[2], f)
        else:
            least, most = around(q, shape, periodic, at)
            value = wp.clamp(edge(q, shape, periodic, i, f), least, most)
        return value

    @wp.func
    def offset(axis: int):
        """Where row 0 of a component stands, in cells; axis -1: of the centres."""
        half = t.vec3(real(0.5), real(0.5), real(0.5))
        if axis >= 0:
            half[axis] = real(0.0)
        return half

    @wp.func(inline=False)
    def velocity(g: S.Grid, u: S.Faces, x: t.vec3):
        """At a place, [m/s]."""
        v = t.vec3()
        half = t.vec3(real(0.5), real(0.5), real(0.5))
        i = floors(x)
        h = floors(x - half)
        within = h[0] >= 0 and i[0] + 1 < g.n[0] and h[1] >= 0 and i[1] + 1 < g.n[1]
        if wp.static(deep):
            within = within and h[2] >= 0 and i[2] + 1 < g.n[2]
        if within:
            fi = x - t.vec3(real(i[0]), real(i[1]), real(i[2]))
            fh = x - half - t.vec3(real(h[0]), real(h[1]), real(h[2]))
            y = g.n[1] + 1 - g.periodic[1]
            if wp.static(deep):
                z = g.n[2] + 1 - g.periodic[2]
                v[0] = plain.between(u.x, (i[0] * g.n[1] + h[1]) * g.n[2] + h[2], g.n[1] * g.n[2], g.n[2],
                                     t.vec3(fi[0], fh[1], fh[2]))
                v[1] = plain.between(u.y, (h[0] * y + i[1]) * g.n[2] + h[2], y * g.n[2], g.n[2], t.vec3(fh[0], fi[1], fh[2]))
                v[2] = plain.between(u.z, (h[0] * g.n[1] + h[1]) * z + i[2], g.n[1] * z, z, t.vec3(fh[0], fh[1], fi[2]))
            else:
                v[0] = plain.between(u.x, i[0] * g.n[1] + h[1], g.n[1], 0, t.vec3(fi[0], fh[1], real(0.0)))
                v[1] = plain.between(u.y, h[0] * y + i[1], y, 0, t.vec3(fh[0], fi[1], real(0.0)))
            return v
        v[0] = linear(u.x, faces(g, 0), g.periodic, x - offset(0))
        v[1] = linear(u.y, faces(g, 1), g.periodic, x - offset(1))
        if wp.static(deep):
            v[2] = linear(u.z, faces(g, 2), g.periodic, x - offset(2))
        return v

    return SimpleNamespace(place=place, faces=faces, linear=linear, cubic=cubic, around=around, offset=offset,
                           velocity=velocity, row=row, held=held, weights=weights, rows=rows, limited=limited,
                           name=f"{dim}d_{t.name}")
