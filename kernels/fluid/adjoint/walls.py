"""Adjoint of cubics that go on beyond walls to which air sticks, `walled` of kernels/fluid/advection.py: a row beyond is

    a + b q_row,   b = 1 or -1,   a of the walls' velocities:   q_row += W b v,   walls += W v da,   s += v grad W (a + b q)

with a bar over q, walls and s.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.adjoint.grid import spreads
from wsim.kernels.fluid.grid import beside, flat, functions, structs
from wsim.kernels.math.real import types


@cache
def walled(dim: int, real):
    """Function (g, axis, q, shape, s, v, q_out, air_out) -> slope of a component at s rows, to whose rows and walls v is
    spread; air_out: of the rows of `Grid.air`, three numbers each."""
    t, S, f, spread = types(real), structs(real), functions(dim, real), spreads(dim, real)

    @wp.func
    def mirrored(g: S.Grid, axis: int, b: int, j: int, n: int):
        row = beside(j, n, g.periodic[b])
        side = int(0)
        if g.periodic[b] == 0 and row != j:
            bit = wp.where(j < 0, 1, 2)
            if (g.outside[b] & bit) == 0:
                side = bit
                row = wp.where(j < 0, -1 - j, 2 * n - 1 - j)
                if b == axis:
                    row = wp.where(j < 0, -j, 2 * (n - 1) - j)
        return row, side

    @wp.func
    def one(g: S.Grid, axis: int, q: wp.array(dtype=real), shape: wp.vec3i, at: wp.vec3i, by: real,
            q_out: wp.array(dtype=real), air_out: wp.array(dtype=wp.float64)):
        """Value of the row at a place, within or beyond, to which `by` is spread."""
        value = real(1.0)
        wall = real(0.0)
        row = wp.vec3i()
        sides = wp.vec3i()
        for b in range(wp.static(dim)):
            j, side = mirrored(g, axis, b, at[b], shape[b])
            row[b] = j
            if side != 0 and b != axis:
                sides[b] = 2 * b + side
                v = g.air[2 * b + side]
                wall = real(2.0) * v[axis] - wall
                value = -value
        c = flat(row, shape)
        wp.atomic_add(q_out, c, by * value)
        left = wp.float64(2.0) * wp.float64(by)
        for k in range(wp.static(dim)):
            b = wp.static(dim) - 1 - k
            if sides[b] != 0:
                wp.atomic_add(air_out, 3 * sides[b] + axis, left)
                left = -left
        return wall + value * q[c]

    @wp.func
    def walled(g: S.Grid, axis: int, q: wp.array(dtype=real), shape: wp.vec3i, at: t.vec3, by: real,
               q_out: wp.array(dtype=real), air_out: wp.array(dtype=wp.float64)):
        s = t.vec3(at[0], at[1], at[2])
        loose = t.vec3(real(1.0), real(1.0), real(1.0))
        for b in range(wp.static(dim)):
            if g.periodic[b] == 0:
                low = wp.where(b != axis and (g.outside[b] & 1) == 0, real(-0.5), real(0.0))
                high = real(shape[b] - 1) + wp.where(b != axis and (g.outside[b] & 2) == 0, real(0.5), real(0.0))
                if at[b] < low or at[b] > high:
                    loose[b] = real(0.0)
                s[b] = wp.clamp(s[b], low, high)
        i = f.floors(s)
        if f.inner(i, shape):
            return spread.cubic(q, shape, g.periodic, s, by, q_out)
        part = s - t.vec3(real(i[0]), real(i[1]), real(i[2]))
        wx = f.weights(part[0])
        wy = f.weights(part[1])
        wz = f.weights(part[2])
        dx = spread.slopes(part[0])
        dy = spread.slopes(part[1])
        dz = spread.slopes(part[2])
        slope = t.vec3()
        first = i - wp.vec3i(1, 1, 1)
        count = int(wp.static(4 ** dim))
        for m in range(count):
            a = m & 3
            b = (m >> 2) & 3
            c = m >> 4
            place = first + wp.vec3i(a, b, c)
            if wp.static(dim == 3):
                value = one(g, axis, q, shape, place, by * wx[a] * wy[b] * wz[c], q_out, air_out)
                slope += value * t.vec3(dx[a] * wy[b] * wz[c], wx[a] * dy[b] * wz[c], wx[a] * wy[b] * dz[c])
            else:
                value = one(g, axis, q, shape, place, by * wx[a] * wy[b], q_out, air_out)
                slope += value * t.vec3(dx[a] * wy[b], wx[a] * dy[b], real(0.0))
        return wp.cw_mul(slope, loose)

    return walled
