"""Adjoints of what kernels/fluid/grid.py reads between rows: of  v = sum_i W_i(s) q_i

    q_i += W_i v,    s += v sum_i q_i grad W_i

with a bar over each but the weights: a cotangent v is spread over the rows by `linear` and `cubic`, which return the slope of
what was read. Where s was moved into the grid along an axis the slope along it is 0; on a row, where pieces of the polynomial
meet, it is that of the piece beyond. Rows that several threads spread to are summed by atomics: in one order on the CPU, on a
GPU in any, so that sums agree to rounding there.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.math.real import types


@cache
def interpolation_adjoints(dim: int, real) -> SimpleNamespace:
    """linear, cubic (q, shape, periodic, s, v, q_out) -> slope; extreme(q, shape, periodic, s, most, v, q_out): to the least or
    the greatest row; velocity(g, u, x, v, u_out) -> slope of v . u."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)
    deep = dim == 3

    @wp.func
    def unclamped_slope(slope: t.vec3, at: t.vec3, shape: wp.vec3i, periodic: wp.vec3i):
        found = t.vec3(slope[0], slope[1], slope[2])
        for a in range(wp.static(dim)):
            if periodic[a] == 0 and (at[a] < real(0.0) or at[a] > real(shape[a] - 1)):
                found[a] = real(0.0)
        return found

    @wp.func
    def scatter_linear(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3, v: real,
                       q_out: wp.array(dtype=real)):
        s = f.held(at, shape, periodic)
        i = int(wp.floor(s[0]))
        j = int(wp.floor(s[1]))
        k = int(0)
        fx = s[0] - real(i)
        fy = s[1] - real(j)
        fz = real(0.0)
        if wp.static(deep):
            k = int(wp.floor(s[2]))
            fz = s[2] - real(k)
        slope = t.vec3()
        for m in range(wp.static(2 ** dim)):
            a = m % 2
            b = (m // 2) % 2
            d = m // 4
            wx = wp.where(a == 1, fx, real(1.0) - fx)
            wy = wp.where(b == 1, fy, real(1.0) - fy)
            wz = wp.where(d == 1, fz, real(1.0) - fz)
            c = f.row(i + a, j + b, k + d, shape, periodic)
            wp.atomic_add(q_out, c, v * wx * wy * wz)
            slope += q[c] * t.vec3(wp.where(a == 1, wy * wz, -wy * wz), wp.where(b == 1, wx * wz, -wx * wz),
                                   wp.where(d == 1, wx * wy, -wx * wy))
        return unclamped_slope(slope, at, shape, periodic)

    @wp.func
    def cubic_weight_slopes(x: real):
        """Derivatives of `weights`."""
        p = real(3.0) * x * x
        return t.vec4((real(6.0) * x - p - real(2.0)) / real(6.0), (p - real(4.0) * x - real(1.0)) * real(0.5),
                      (real(2.0) * x - p + real(2.0)) * real(0.5), (p - real(1.0)) / real(6.0))

    @wp.func
    def scatter_cubic_line(q: wp.array(dtype=real), first: int, k: wp.types.vector(4, int), w: t.vec4, d: t.vec4, v: real,
                           q_out: wp.array(dtype=real)):
        """(sum, slope) of a line of four rows, to which v is spread."""
        sum = real(0.0)
        slope = real(0.0)
        for m in range(4):
            c = first + k[m]
            wp.atomic_add(q_out, c, v * w[m])
            sum += w[m] * q[c]
            slope += d[m] * q[c]
        return sum, slope

    @wp.func
    def scatter_cubic(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3, v: real,
                      q_out: wp.array(dtype=real)):
        s = f.held(at, shape, periodic)
        i = int(wp.floor(s[0]))
        j = int(wp.floor(s[1]))
        wx = f.weights(s[0] - real(i))
        wy = f.weights(s[1] - real(j))
        dx = cubic_weight_slopes(s[0] - real(i))
        dy = cubic_weight_slopes(s[1] - real(j))
        ix = f.rows(i, shape[0], periodic[0])
        jy = f.rows(j, shape[1], periodic[1])
        slope = t.vec3()
        if wp.static(deep):
            k = int(wp.floor(s[2]))
            wz = f.weights(s[2] - real(k))
            dz = cubic_weight_slopes(s[2] - real(k))
            kz = f.rows(k, shape[2], periodic[2])
            for a in range(4):
                for b in range(4):
                    sum, ahead = scatter_cubic_line(q, (ix[a] * shape[1] + jy[b]) * shape[2], kz, wz, dz, v * wx[a] * wy[b],
                                                    q_out)
                    slope += t.vec3(dx[a] * wy[b] * sum, wx[a] * dy[b] * sum, wx[a] * wy[b] * ahead)
        else:
            for a in range(4):
                sum, ahead = scatter_cubic_line(q, ix[a] * shape[1], jy, wy, dy, v * wx[a], q_out)
                slope += t.vec3(dx[a] * sum, wx[a] * ahead, real(0.0))
        return unclamped_slope(slope, at, shape, periodic)

    @wp.func
    def scatter_extreme(q: wp.array(dtype=real), shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3, most: bool, v: real,
                        q_out: wp.array(dtype=real)):
        s = f.held(at, shape, periodic)
        i = int(wp.floor(s[0]))
        j = int(wp.floor(s[1]))
        k = int(0)
        if wp.static(deep):
            k = int(wp.floor(s[2]))
        at_row = f.row(i, j, k, shape, periodic)
        for m in range(1, wp.static(2 ** dim)):
            c = f.row(i + m % 2, j + (m // 2) % 2, k + m // 4, shape, periodic)
            if (most and q[c] > q[at_row]) or (not most and q[c] < q[at_row]):
                at_row = c
        wp.atomic_add(q_out, at_row, v)

    @wp.func
    def scatter_velocity(g: S.Grid, u: S.Faces, x: t.vec3, v: t.vec3, u_out: S.Faces):
        slope = scatter_linear(u.x, f.faces(g, 0), g.periodic, x - f.offset(0), v[0], u_out.x) * v[0]
        slope += scatter_linear(u.y, f.faces(g, 1), g.periodic, x - f.offset(1), v[1], u_out.y) * v[1]
        if wp.static(deep):
            slope += scatter_linear(u.z, f.faces(g, 2), g.periodic, x - f.offset(2), v[2], u_out.z) * v[2]
        return slope

    return SimpleNamespace(linear=scatter_linear, cubic=scatter_cubic, extreme=scatter_extreme, velocity=scatter_velocity,
                           slopes=cubic_weight_slopes)
