"""The equation of the pressure on a staggered grid, and its projection (Chorin 1968; openings of faces: Batty, Bertails,
Bridson 2007; Ng, Min, Gibou 2009).

    (A p)_c = sum over faces  k (p_c - p_n) = - sum over faces of (o u + (1 - o) u_solid) out of c  + e dx
    u -= (p_n - p_c) / d

    p   pressure times h / (density dx) [m/s]
    e   expansion [1/s]
    o   opening of a face, 0 solid to 1
    d   distance to the other centre over dx: 1; 1/2 to an open side, where p_n = 0
    k   o / d; 0 at a closed side

A is symmetric and, but for a constant in each sealed region, positive. A level of the multigrid solver is such an equation too:
there k comes of the faces of the level below, see kernels/fluid/solver/multigrid.py.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.fluid.solver.level import FREE, pressure_levels
from wsim.kernels.math.real import types


@cache
def poisson_stencil(dim: int, fractions: bool | int, real) -> SimpleNamespace:
    """Functions of a cell i: couplings(level, i, axis) -> (k low, k high), 0 where there is no neighbour beyond but one of
    pressure 0 too; beside(level, x, i) -> (sum of k, sum of k x of the neighbours); product(level, x, i) -> (A x)_i;
    diagonal(level, i) -> sum of k."""
    t, Level, free = types(real), pressure_levels(real), fractions == FREE

    @wp.func
    def face_couplings(level: Level, i: wp.vec3i, axis: int):
        low = level.k[axis]
        high = level.k[axis]
        if wp.static(fractions):
            shape = wp.vec3i(level.n[0], level.n[1], level.n[2])
            shape[axis] = level.n[axis] + 1 - level.periodic[axis]
            c = flat_cell_index(i, shape)
            step = int(1)
            if axis == 0:
                step = shape[1] * shape[2]
            if axis == 1:
                step = shape[2]
            if level.periodic[axis] != 0 and i[axis] + 1 == level.n[axis]:
                step = -i[axis] * step
            if axis == 0:
                low = level.x[c]
                high = level.x[c + step]
            elif axis == 1:
                low = level.y[c]
                high = level.y[c + step]
            else:
                low = level.z[c]
                high = level.z[c + step]
        if i[axis] == 0:
            low = low * level.low[axis]
        if i[axis] + 1 == level.n[axis]:
            high = high * level.high[axis]
        if level.n[axis] == 1 and level.periodic[axis] != 0:
            low = real(0.0)
            high = real(0.0)
        return low, high

    @wp.func
    def cell_is_inner(level: Level, i: wp.vec3i):
        all = i[0] > 0 and i[0] + 1 < level.n[0] and i[1] > 0 and i[1] + 1 < level.n[1]
        if wp.static(dim == 3):
            all = all and i[2] > 0 and i[2] + 1 < level.n[2]
        return all

    @wp.func
    def inner_neighbor_sum(level: Level, x: wp.array(dtype=real), i: wp.vec3i):
        """`neighbor_sum` of a cell that is at no side."""
        c = flat_cell_index(i, level.n)
        one = level.n[1] * level.n[2]
        two = level.n[2]
        own = real(0.0)
        sum = real(0.0)
        if wp.static(fractions):
            m = c + i[0] * level.n[2] * (1 - level.periodic[1])
            a = level.x[c]
            b = level.x[c + one]
            d = level.y[m]
            e = level.y[m + two]
            own = a + b + d + e
            sum = a * x[c - one] + b * x[c + one] + d * x[c - two] + e * x[c + two]
            if wp.static(dim == 3):
                m = c + (i[0] * level.n[1] + i[1]) * (1 - level.periodic[2])
                a = level.z[m]
                b = level.z[m + 1]
                own += a + b
                sum += a * x[c - 1] + b * x[c + 1]
        else:
            own = level.k[0] + level.k[1]
            sum = level.k[0] * (x[c - one] + x[c + one]) + level.k[1] * (x[c - two] + x[c + two])
            if wp.static(dim == 3):
                own += level.k[2]
                sum += level.k[2] * (x[c - 1] + x[c + 1])
            own = real(2.0) * own
        return own, sum

    @wp.func
    def side_neighbor_sum(level: Level, x: wp.array(dtype=real), i: wp.vec3i):
        own = real(0.0)
        sum = real(0.0)
        c = flat_cell_index(i, level.n)
        for a in range(wp.static(dim)):
            low, high = face_couplings(level, i, a)
            own += low + high
            step = int(1)
            if a == 0:
                step = level.n[1] * level.n[2]
            if a == 1:
                step = level.n[2]
            if i[a] > 0:
                sum += low * x[c - step]
            elif level.periodic[a] != 0:
                sum += low * x[c + (level.n[a] - 1) * step]
            if i[a] + 1 < level.n[a]:
                sum += high * x[c + step]
            elif level.periodic[a] != 0:
                sum += high * x[c - (level.n[a] - 1) * step]
        return own, sum

    @wp.func
    def neighbor_sum(level: Level, x: wp.array(dtype=real), i: wp.vec3i):
        own = real(0.0)
        sum = real(0.0)
        if cell_is_inner(level, i):
            own, sum = inner_neighbor_sum(level, x, i)
        else:
            own, sum = side_neighbor_sum(level, x, i)
        if wp.static(free):
            own += level.own[flat_cell_index(i, level.n)]
        return own, sum

    @wp.func
    def poisson_diagonal(level: Level, i: wp.vec3i):
        own = real(0.0)
        if wp.static(not fractions) and cell_is_inner(level, i):
            own = level.k[0] + level.k[1]
            if wp.static(dim == 3):
                own += level.k[2]
            own = real(2.0) * own
        else:
            for a in range(wp.static(dim)):
                low, high = face_couplings(level, i, a)
                own += low + high
            if wp.static(free):
                own += level.own[flat_cell_index(i, level.n)]
        return own

    @wp.func
    def poisson_product(level: Level, x: wp.array(dtype=real), i: wp.vec3i):
        own, sum = neighbor_sum(level, x, i)
        return own * x[flat_cell_index(i, level.n)] - sum

    return SimpleNamespace(couplings=face_couplings, beside=neighbor_sum, product=poisson_product, diagonal=poisson_diagonal,
                           name=f"{dim}d{'_fractions' * bool(fractions)}{'_free' * free}_{t.name}")


@cache
def pressure_gradient_function(dim: int, axis: int, fractions: bool, moving: bool, real):
    """Function (g, sides, p, o, s, c, u) -> the component u of face c with the gradient of p taken off; of a face that is
    closed the velocity of what closes it. sides: as low and high of `pressure_levels`."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    @wp.func
    def subtract_pressure_gradient(g: S.Grid, low: t.vec3, high: t.vec3, p: wp.array(dtype=real), o: wp.array(dtype=real),
                                   s: wp.array(dtype=real), c: int, u: real):
        i = f.place(c, f.faces(g, wp.static(axis)))
        before = wp.vec3i(i[0], i[1], i[2])
        before[wp.static(axis)] = i[wp.static(axis)] - 1
        drop = real(0.0)
        value = u
        first = i[wp.static(axis)] == 0
        last = i[wp.static(axis)] == g.n[wp.static(axis)]
        if first and g.periodic[wp.static(axis)] != 0:
            before[wp.static(axis)] = g.n[wp.static(axis)] - 1
            first = False
        if first:
            drop = low[wp.static(axis)] * p[flat_cell_index(i, g.n)]
        elif last:
            drop = -high[wp.static(axis)] * p[flat_cell_index(before, g.n)]
        else:
            drop = p[flat_cell_index(i, g.n)] - p[flat_cell_index(before, g.n)]
        value -= drop
        if wp.static(fractions):
            if o[c] == real(0.0) and not ((first and low[wp.static(axis)] == real(0.0))
                                          or (last and high[wp.static(axis)] == real(0.0))):
                value = real(0.0)
                if wp.static(moving):
                    value = s[c]
        return value

    return subtract_pressure_gradient


@cache
def projection_kernel(dim: int, axis: int, fractions: bool, moving: bool, real, module):
    """Kernel over the faces of an axis: u_out = u - grad p."""
    t, S = types(real), grid_structs(real)
    take = pressure_gradient_function(dim, axis, fractions, moving, real)

    def project_face_velocity(g: S.Grid, low: t.vec3, high: t.vec3, p: wp.array(dtype=real), o: wp.array(dtype=real),
                              s: wp.array(dtype=real), u: wp.array(dtype=real), u_out: wp.array(dtype=real)):
        c = wp.tid()
        u_out[c] = take(g, low, high, p, o, s, c, u[c])

    name = f"project_{'xyz'[axis]}{'_fractions' * fractions}{'_moving' * moving}_{dim}d_{t.name}"
    return wp.kernel(project_face_velocity, name=name, module=module, enable_backward=False)


@cache
def closed_side_kernel(dim: int, axis: int, real, module):
    """Kernel over a side's faces times two: what is across a closed side (low or high 0) has the velocity of that side, of
    g.air rows 1 + 2 axis and 2 + 2 axis."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    def set_closed_sides(g: S.Grid, low: t.vec3, high: t.vec3, u_out: wp.array(dtype=real)):
        c = wp.tid()
        n = g.n[wp.static(axis)]
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        shape[wp.static(axis)] = 2
        i = f.place(c, shape)
        side = i[wp.static(axis)]
        i[wp.static(axis)] = side * n
        kind = low[wp.static(axis)]
        if side == 1:
            kind = high[wp.static(axis)]
        if kind == real(0.0):
            v = g.air[wp.static(1 + 2 * axis) + side]
            u_out[flat_cell_index(i, f.faces(g, wp.static(axis)))] = v[wp.static(axis)]

    return wp.kernel(set_closed_sides, name=f"sides_{'xyz'[axis]}_{f.name}", module=module, enable_backward=False)
