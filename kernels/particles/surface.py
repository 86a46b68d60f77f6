"""The pressure of a liquid with a free surface, on the grid of kernels/fluid/pressure.py (Enright, Nguyen, Gibou, Fedkiw 2003;
Gibou, Fedkiw, Cheng, Kang 2002: pressure 0 at the surface, order 2).

    cell    liquid where phi < 0, else air, whose pressure is 0
    face    between two liquid cells: coupling k = o; of a liquid cell and air: o / theta on the liquid cell alone ("own"),
            theta = phi_l / (phi_l - phi_a): how far the surface is, in cells
    u -= (p_n - p_c),  at the surface  u -= (0 - p_c) / theta

Where no cell of a sealed box is air, `surface_diagonal_kernel` is GROUND everywhere: the equation has an answer, and p a mean
of 0.
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.fluid.pressure import FREE, poisson_stencil, pressure_levels
from wsim.kernels.math.real import types

THETA = 1e-3             # least part of a cell, which keeps the equation finite
GROUND = 1e-6
PACKED = 0.5             # most of a cell that a step makes room for


@cache
def surface_functions(dim: int, real) -> SimpleNamespace:
    """beside(g, i, axis, side) -> cell beyond a face (component -1: none); part(phi, c, n) -> theta of a liquid cell c and air
    n; face(g, i, axis, side) -> row of that face; opening(g, open, i, axis, side) -> its open part."""
    S, f = grid_structs(real), grid_functions(dim, real)

    @wp.func
    def adjacent_liquid_cell(g: S.Grid, i: wp.vec3i, axis: int, side: int):
        j = wp.vec3i(i[0], i[1], i[2])
        j[axis] = i[axis] + side
        if g.periodic[axis] != 0:
            if j[axis] < 0:
                j[axis] = g.n[axis] - 1
            if j[axis] >= g.n[axis]:
                j[axis] = 0
        elif j[axis] >= g.n[axis]:
            j[axis] = -1
        return j

    @wp.func
    def ghost_fluid_fraction(phi: wp.array(dtype=real), c: int, n: int):
        return wp.max(phi[c] / (phi[c] - phi[n]), real(THETA))

    @wp.func
    def cell_face_row(g: S.Grid, i: wp.vec3i, axis: int, side: int):
        """Row of a face of a cell; side 0 or 1."""
        j = wp.vec3i(i[0], i[1], i[2])
        j[axis] = i[axis] + side
        if g.periodic[axis] != 0 and j[axis] == g.n[axis]:
            j[axis] = 0
        return flat_cell_index(j, f.faces(g, axis))

    @wp.func
    def cell_face_opening(g: S.Grid, open: S.Faces, i: wp.vec3i, axis: int, side: int):
        """Open part of a face of a cell; side 0 or 1."""
        q = cell_face_row(g, i, axis, side)
        if axis == 0:
            return open.x[q]
        if axis == 1:
            return open.y[q]
        return open.z[q]

    return SimpleNamespace(beside=adjacent_liquid_cell, part=ghost_fluid_fraction, face=cell_face_row,
                           opening=cell_face_opening)


@cache
def surface_coupling_kernel(dim: int, obstacles: bool, real, module):
    """Kernel over the faces of an axis: k_out."""
    S, f, at = grid_structs(real), grid_functions(dim, real), surface_functions(dim, real)

    def couple_liquid_cells(g: S.Grid, axis: int, phi: wp.array(dtype=real), o: wp.array(dtype=real),
                            k_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, f.faces(g, axis))
        before = at.beside(g, i, axis, -1)
        both = real(1.0)
        if i[axis] < g.n[axis]:
            if phi[flat_cell_index(i, g.n)] >= real(0.0):
                both = real(0.0)
        if before[axis] >= 0:
            if phi[flat_cell_index(before, g.n)] >= real(0.0):
                both = real(0.0)
        if wp.static(obstacles):
            both *= o[c]
        k_out[c] = both

    name = f"surface_couple{'_obstacles' * obstacles}_{f.name}"
    return wp.kernel(couple_liquid_cells, name=name, module=module, enable_backward=False)


@cache
def surface_diagonal_kernel(dim: int, obstacles: bool, real, module):
    """Kernel over cells: own_out; air_out is 1 where some cell has one."""
    S, f, at = grid_structs(real), grid_functions(dim, real), surface_functions(dim, real)

    def ghost_fluid_diagonal(g: S.Grid, phi: wp.array(dtype=real), open: S.Faces, own_out: wp.array(dtype=real),
                             air_out: wp.array(dtype=int)):
        c = wp.tid()
        i = f.place(c, g.n)
        sum = real(0.0)
        if phi[c] < real(0.0):
            around = int(wp.static(2 * dim))                   # a variable: the loop is compiled once
            for m in range(around):
                a = m // 2
                n = at.beside(g, i, a, 2 * (m % 2) - 1)
                if n[a] >= 0:
                    other = flat_cell_index(n, g.n)
                    if phi[other] >= real(0.0):
                        o = real(1.0)
                        if wp.static(obstacles):
                            o = at.opening(g, open, i, a, m % 2)
                        sum += o / at.part(phi, c, other)
        own_out[c] = sum
        if sum > real(0.0):
            air_out[0] = 1

    return wp.kernel(ghost_fluid_diagonal, name=f"surface_own{'_obstacles' * obstacles}_{f.name}", module=module,
                     enable_backward=False)


@cache
def sealed_ground_kernel(real, module):
    """Kernel over cells of a sealed box: see GROUND."""

    def ground_sealed_liquid(air: wp.array(dtype=int), phi: wp.array(dtype=real), own_out: wp.array(dtype=real)):
        c = wp.tid()
        if air[0] == 0 and phi[c] < real(0.0):
            own_out[c] = real(GROUND)

    return wp.kernel(ground_sealed_liquid, name=f"surface_ground_{types(real).name}", module=module, enable_backward=False)


@cache
def liquid_outflow_kernel(dim: int, obstacles: bool, moving: bool, real, module):
    """Kernel over cells: the right-hand side [m/s] of the velocity in liquid cells, else 0."""
    S, f, at, Level = grid_structs(real), grid_functions(dim, real), surface_functions(dim, real), pressure_levels(real)
    s = poisson_stencil(dim, FREE, real)

    @wp.func
    def liquid_face_flux(u: wp.array(dtype=real), o: wp.array(dtype=real), v: wp.array(dtype=real), c: int):
        flux = u[c]
        if wp.static(obstacles):
            flux = o[c] * u[c]
            if wp.static(moving):
                flux += (real(1.0) - o[c]) * v[c]
        return flux

    @wp.func
    def liquid_axis_outflow(g: S.Grid, axis: int, i: wp.vec3i, u: wp.array(dtype=real), o: wp.array(dtype=real),
                            v: wp.array(dtype=real)):
        return liquid_face_flux(u, o, v, at.face(g, i, axis, 1)) - liquid_face_flux(u, o, v, at.face(g, i, axis, 0))

    def liquid_cell_outflow(g: S.Grid, u: S.Faces, open: S.Faces, solid: S.Faces, phi: wp.array(dtype=real), level: Level,
                            b_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        sum = real(0.0)
        if phi[c] < real(0.0) and s.diagonal(level, i) > real(0.0):
            sum = liquid_axis_outflow(g, 0, i, u.x, open.x, solid.x) + liquid_axis_outflow(g, 1, i, u.y, open.y, solid.y)
            if wp.static(dim == 3):
                sum += liquid_axis_outflow(g, 2, i, u.z, open.z, solid.z)
        b_out[c] = -sum

    name = f"surface_outflow{'_obstacles' * obstacles}{'_moving' * moving}_{f.name}"
    return wp.kernel(liquid_cell_outflow, name=name, module=module, enable_backward=False)


@cache
def density_correction_kernel(dim: int, thin: bool, real, module):
    """Kernel over cells: the right-hand side of a displacement [m] that makes room where f > 1 and, where all cells beside are
    liquid, takes it where f < 1 (Kugelstadt, Longva, Thuerey, Bender 2019). thin: cells beyond closed faces do not count, and
    what a cell makes room for is of its share (shares.py)."""
    S, f, at, Level = grid_structs(real), grid_functions(dim, real), surface_functions(dim, real), pressure_levels(real)
    s = poisson_stencil(dim, FREE, real)

    def density_correction(g: S.Grid, fill: wp.array(dtype=real), phi: wp.array(dtype=real), open: S.Faces,
                           share: wp.array(dtype=real), level: Level, b_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        b = real(0.0)
        if phi[c] < real(0.0) and s.diagonal(level, i) > real(0.0):
            b = -wp.clamp(fill[c] - real(1.0), real(-PACKED), real(PACKED)) * g.dx
            if wp.static(thin):
                b *= share[c]
            around = int(wp.static(2 * dim))
            for m in range(around):
                a = m // 2
                n = at.beside(g, i, a, 2 * (m % 2) - 1)
                o = real(1.0)
                if wp.static(thin):
                    o = at.opening(g, open, i, a, m % 2)
                if n[a] >= 0 and o > real(0.0):
                    if phi[flat_cell_index(n, g.n)] >= real(0.0):
                        b = wp.min(b, real(0.0))
        b_out[c] = -b

    return wp.kernel(density_correction, name=f"surface_crowding{'_thin' * thin}_{f.name}", module=module,
                     enable_backward=False)


@cache
def liquid_projection_kernel(dim: int, obstacles: bool, moving: bool, real, module):
    """Kernel over the faces of an axis: u_out = u less the gradient of p; known_out is 1 at faces of liquid, else 0. both: x
    their openings, y the velocities of what covers them."""
    S, f, at, Level = grid_structs(real), grid_functions(dim, real), surface_functions(dim, real), pressure_levels(real)

    def project_liquid_faces(g: S.Grid, axis: int, level: Level, p: wp.array(dtype=real), phi: wp.array(dtype=real),
                             both: S.Faces, u_out: wp.array(dtype=real), known_out: wp.array(dtype=int)):
        c = wp.tid()
        i = f.place(c, f.faces(g, axis))
        before = at.beside(g, i, axis, -1)
        there = i[axis] < g.n[axis]
        back = before[axis] >= 0
        n = int(-1)
        m = int(-1)
        if there:
            n = flat_cell_index(i, g.n)
            there = phi[n] < real(0.0)
        if back:
            m = flat_cell_index(before, g.n)
            back = phi[m] < real(0.0)
        drop = real(0.0)
        if there and back:
            drop = p[n] - p[m]
        elif there and m >= 0:
            drop = p[n] / at.part(phi, n, m)
        elif back and n >= 0:
            drop = -p[m] / at.part(phi, m, n)
        elif there:
            drop = level.low[axis] * p[n]
        elif back:
            drop = -level.high[axis] * p[m]
        known = int(0)
        if there or back:
            known = int(1)
        u = u_out[c] - drop
        if wp.static(obstacles):
            closed = (m < 0 and level.low[axis] == real(0.0)) or (n < 0 and level.high[axis] == real(0.0))
            if both.x[c] == real(0.0) and not closed:
                known = int(0)
                u = real(0.0)
                if wp.static(moving):
                    u = both.y[c]
        u_out[c] = u
        known_out[c] = known

    name = f"surface_push{'_obstacles' * obstacles}{'_moving' * moving}_{f.name}"
    return wp.kernel(project_liquid_faces, name=name, module=module, enable_backward=False)
