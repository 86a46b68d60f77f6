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

from wsim.kernels.fluid.sampling import native_samplers
from wsim.kernels.math.real import types


@cache
def grid_structs(real) -> SimpleNamespace:
    t = types(real)

    @wp.struct
    class StaggeredGrid:
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

    return SimpleNamespace(Grid=StaggeredGrid, Faces=Faces)


@wp.func
def wrap_row(i: int, n: int, periodic: int):
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
def wrap_near_row(i: int, n: int, periodic: int):
    """Row that stands for row i of n, which is no further off than n."""
    j = int(i)
    if periodic != 0:
        if i < 0:
            j = i + n
        elif i >= n:
            j = i - n
    return wp.clamp(j, 0, n - 1)


@wp.func
def cell_from_index(c: int, shape: wp.vec3i):
    """(i, j, k) of a flat index."""
    i = c // shape[2]
    j = i // shape[1]
    return wp.vec3i(j, i - j * shape[1], c - i * shape[2])


@wp.func
def flat_cell_index(i: wp.vec3i, shape: wp.vec3i):
    """Flat index of (i, j, k)."""
    return (i[0] * shape[1] + i[1]) * shape[2] + i[2]


@cache
def grid_functions(dim: int, real) -> SimpleNamespace:
    """place(c, shape), faces(g, axis) -> shape, linear and cubic (q, shape, periodic, s) -> value at s rows, velocity(g, u, x),
    least and most of the rows around. dim: 2 or 3."""
    t, S, plain = types(real), grid_structs(real), native_samplers(dim, real)
    vec4i = wp.types.vector(4, int)
    deep = dim == 3

    @wp.func
    def grid_place(c: int, shape: wp.vec3i):
        if wp.static(deep):
            return cell_from_index(c, shape)
        i = c // shape[1]
        return wp.vec3i(i, c - i * shape[1], 0)

    @wp.func
    def face_shape(g: S.Grid, axis: int):
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        shape[axis] = g.n[axis] + 1 - g.periodic[axis]
        return shape

    @wp.func
    def clamp_to_grid(s: t.vec3, shape: wp.vec3i, periodic: wp.vec3i):
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
    def wrapped_row_index(i: int, j: int, k: int, shape: wp.vec3i, periodic: wp.vec3i):
        a = wrap_near_row(i, shape[0], periodic[0])
        b = wrap_near_row(j, shape[1], periodic[1])
        if wp.static(deep):
            return (a * shape[1] + b) * shape[2] + wrap_near_row(k, shape[2], periodic[2])
        return a * shape[1] + b

    @wp.func
    def linear_grid_sample(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3):
        s = clamp_to_grid(at, shape, periodic)
        i = int(wp.floor(s[0]))
        j = int(wp.floor(s[1]))
        k = int(0)
        fx = s[0] - real(i)
        fy = s[1] - real(j)
        i0 = wrap_near_row(i, shape[0], periodic[0])
        i1 = wrap_near_row(i + 1, shape[0], periodic[0])
        j0 = wrap_near_row(j, shape[1], periodic[1])
        j1 = wrap_near_row(j + 1, shape[1], periodic[1])
        if wp.static(deep):
            k = int(wp.floor(s[2]))
            fz = s[2] - real(k)
            k0 = wrap_near_row(k, shape[2], periodic[2])
            k1 = wrap_near_row(k + 1, shape[2], periodic[2])
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
    def linear_bounds(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3):
        """(least, most) of the rows that `linear_grid_sample` reads."""
        s = clamp_to_grid(at, shape, periodic)
        i = int(wp.floor(s[0]))
        j = int(wp.floor(s[1]))
        k = int(0)
        if wp.static(deep):
            k = int(wp.floor(s[2]))
        least = q[wrapped_row_index(i, j, k, shape, periodic)]
        most = least
        for m in range(1, wp.static(2 ** dim)):
            v = q[wrapped_row_index(i + m % 2, j + (m // 2) % 2, k + m // 4, shape, periodic)]
            least = wp.min(least, v)
            most = wp.max(most, v)
        return least, most

    @wp.func
    def lagrange_weights(f: real):
        """Of the rows -1, 0, 1, 2 about a fraction f in 0 .. 1: the cubic through them (Lagrange)."""
        a = f + real(1.0)
        b = f - real(1.0)
        c = f - real(2.0)
        return t.vec4(-f * b * c / real(6.0), a * b * c * real(0.5), -a * f * c * real(0.5), a * f * b / real(6.0))

    @wp.func
    def first_axis_stride(shape: wp.vec3i):
        """To the next row along the first axis."""
        return shape[1] * shape[2]

    @wp.func
    def cubic_rows(i: int, n: int, periodic: int):
        return vec4i(wrap_near_row(i - 1, n, periodic), wrap_near_row(i, n, periodic), wrap_near_row(i + 1, n, periodic),
                     wrap_near_row(i + 2, n, periodic))

    @wp.func
    def floor_cell(s: t.vec3):
        i = wp.vec3i(int(wp.floor(s[0])), int(wp.floor(s[1])), 0)
        if wp.static(deep):
            i[2] = int(wp.floor(s[2]))
        return i

    @wp.func
    def cubic_rows_inside(i: wp.vec3i, shape: wp.vec3i):
        """Whether the four rows about i are all within, along each axis."""
        all = i[0] > 0 and i[0] + 2 < shape[0] and i[1] > 0 and i[1] + 2 < shape[1]
        if wp.static(deep):
            all = all and i[2] > 0 and i[2] + 2 < shape[2]
        return all

    @wp.func
    def lowest_cubic_row(i: wp.vec3i, shape: wp.vec3i):
        """First of the four rows about i, along each axis."""
        if wp.static(deep):
            return ((i[0] - 1) * shape[1] + i[1] - 1) * shape[2] + i[2] - 1
        return (i[0] - 1) * shape[1] + i[1] - 1

    @wp.func
    def cubic_at_edge(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, i: wp.vec3i, f: t.vec3):
        """The cubic where not all of its rows are within."""
        wx = lagrange_weights(f[0])
        wy = lagrange_weights(f[1])
        wz = lagrange_weights(f[2])
        sum = real(0.0)
        count = int(wp.static(4 ** dim))
        for m in range(count):
            a = m % 4
            b = (m // 4) % 4
            c = m // 16
            w = wx[a] * wy[b]
            if wp.static(deep):
                w = w * wz[c]
            sum += w * q[wrapped_row_index(i[0] - 1 + a, i[1] - 1 + b, i[2] - 1 + c, shape, periodic)]
        return sum

    @wp.func
    def cubic_sample(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3):
        s = clamp_to_grid(at, shape, periodic)
        i = floor_cell(s)
        f = s - t.vec3(real(i[0]), real(i[1]), real(i[2]))
        value = real(0.0)
        if cubic_rows_inside(i, shape):
            value = plain.patch(q, lowest_cubic_row(i, shape), first_axis_stride(shape), shape[2], f)
        else:
            value = cubic_at_edge(q, shape, periodic, i, f)
        return value

    @wp.func
    def limited_cubic_sample(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3):
        s = clamp_to_grid(at, shape, periodic)
        i = floor_cell(s)
        f = s - t.vec3(real(i[0]), real(i[1]), real(i[2]))
        value = real(0.0)
        if cubic_rows_inside(i, shape):
            value = plain.limited(q, lowest_cubic_row(i, shape), first_axis_stride(shape), shape[2], f)
        else:
            least, most = linear_bounds(q, shape, periodic, at)
            value = wp.clamp(cubic_at_edge(q, shape, periodic, i, f), least, most)
        return value

    @wp.func
    def component_offset(axis: int):
        """Where row 0 of a component stands, in cells; axis -1: of the centres."""
        half = t.vec3(real(0.5), real(0.5), real(0.5))
        if axis >= 0:
            half[axis] = real(0.0)
        return half

    @wp.func(inline=False)
    def sample_velocity(g: S.Grid, u: S.Faces, x: t.vec3):
        """At a place, [m/s]."""
        v = t.vec3()
        half = t.vec3(real(0.5), real(0.5), real(0.5))
        i = floor_cell(x)
        h = floor_cell(x - half)
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
        v[0] = linear_grid_sample(u.x, face_shape(g, 0), g.periodic, x - component_offset(0))
        v[1] = linear_grid_sample(u.y, face_shape(g, 1), g.periodic, x - component_offset(1))
        if wp.static(deep):
            v[2] = linear_grid_sample(u.z, face_shape(g, 2), g.periodic, x - component_offset(2))
        return v

    return SimpleNamespace(place=grid_place, faces=face_shape, linear=linear_grid_sample, cubic=cubic_sample,
                           around=linear_bounds, offset=component_offset,
                           velocity=sample_velocity, row=wrapped_row_index, held=clamp_to_grid, weights=lagrange_weights,
                           rows=cubic_rows, limited=limited_cubic_sample, name=f"{dim}d_{t.name}")
