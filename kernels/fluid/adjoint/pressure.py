"""Adjoint of the projection, kernels/fluid/pressure.py. It was  u' = u - G A^-1 b,  b = D u + (1 - o) u_solid + e dx,  so

    A y = -G^T u',    u += u' + D^T y,    u_solid += (1 - o) D^T y,    e += dx y

with a bar over each but y: A is symmetric, and the same solver finds y to its residual. What sums to nothing in sealed regions
does so in y. Of a face that an obstacle covers, which took the obstacle's velocity, u' goes there.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.fluid.pressure import poisson_stencil, pressure_levels
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def covered_face_function(dim: int, fractions: bool, real):
    """Function (g, sides, o, i, c, axis) -> whether face i of an axis, of row c, has the velocity of what covers it."""
    t, S = types(real), grid_structs(real)

    @wp.func
    def face_is_covered(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), i: wp.vec3i, c: int, axis: int):
        found = bool(False)
        if wp.static(fractions):
            if o[c] == real(0.0):
                found = True
                if g.periodic[axis] == 0:
                    if i[axis] == 0 and low[axis] == real(0.0):
                        found = False
                    if i[axis] == g.n[axis] and high[axis] == real(0.0):
                        found = False
        return found

    return face_is_covered


@cache
def gradient_transpose_kernel(dim: int, fractions: bool, real, module):
    """Kernel over cells: r_out = -G^T by, of the faces that are not covered."""
    t, S, f, over = types(real), grid_structs(real), grid_functions(dim, real), covered_face_function(dim, fractions, real)

    @wp.func
    def face_flux_adjoint(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), by: wp.array(dtype=real), i: wp.vec3i,
                          axis: int):
        shape = f.faces(g, axis)
        far = wp.vec3i(i[0], i[1], i[2])
        far[axis] = i[axis] + 1
        ahead = real(1.0)
        behind = real(1.0)
        if g.periodic[axis] == 0:
            if i[axis] == 0:
                behind = low[axis]
            if far[axis] == g.n[axis]:
                ahead = high[axis]
        elif far[axis] == g.n[axis]:
            far[axis] = 0
        a = flat_cell_index(i, shape)
        b = flat_cell_index(far, shape)
        sum = real(0.0)
        if not over(g, low, high, o, i, a, axis):
            sum -= behind * by[a]
        if not over(g, low, high, o, far, b, axis):
            sum += ahead * by[b]
        return sum

    def gradient_transpose(g: S.Grid, low: t.vec3, high: t.vec3, o: S.Faces, by: S.Faces, r_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        sum = face_flux_adjoint(g, low, high, o.x, by.x, i, 0) + face_flux_adjoint(g, low, high, o.y, by.y, i, 1)
        if wp.static(dim == 3):
            sum += face_flux_adjoint(g, low, high, o.z, by.z, i, 2)
        r_out[c] = sum

    name = f"project_adjoint{'_fractions' * fractions}_{f.name}"
    return wp.kernel(gradient_transpose, name=name, module=module, enable_backward=False)


@cache
def closed_cell_kernel(dim: int, real, module):
    """Kernel over cells: y_out is 0 where a cell has no open face: its right-hand side was none."""
    Level, s, f = pressure_levels(real), poisson_stencil(dim, True, real), grid_functions(dim, real)

    def clear_closed_cells(level: Level, y_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, level.n)
        own = real(0.0)
        for a in range(wp.static(dim)):
            low, high = s.couplings(level, i, a)
            own += low + high
        if own == real(0.0):
            y_out[c] = real(0.0)

    return wp.kernel(clear_closed_cells, name=f"shut_adjoint_{f.name}", module=module, enable_backward=False)


@cache
def projection_adjoint_kernel(dim: int, axis: int, fractions: bool, moving: bool, real, module):
    """Kernel over the faces of an axis: by_out from the cotangent of u' to that of u; solid_out adds that of what covers."""
    t, S, f, over = types(real), grid_structs(real), grid_functions(dim, real), covered_face_function(dim, fractions, real)

    def project_faces_adjoint(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), y: wp.array(dtype=real),
                              by_out: wp.array(dtype=real), solid_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, f.faces(g, wp.static(axis)))
        before = wp.vec3i(i[0], i[1], i[2])
        before[wp.static(axis)] = i[wp.static(axis)] - 1
        drop = real(0.0)
        if g.periodic[wp.static(axis)] != 0:
            if i[wp.static(axis)] == 0:
                before[wp.static(axis)] = g.n[wp.static(axis)] - 1
            drop = y[flat_cell_index(i, g.n)] - y[flat_cell_index(before, g.n)]
        elif i[wp.static(axis)] == 0:
            drop = y[flat_cell_index(i, g.n)]
        elif i[wp.static(axis)] == g.n[wp.static(axis)]:
            drop = -y[flat_cell_index(before, g.n)]
        else:
            drop = y[flat_cell_index(i, g.n)] - y[flat_cell_index(before, g.n)]
        open = real(1.0)
        if wp.static(fractions):
            open = o[c]
        v = by_out[c]
        if over(g, low, high, o, i, c, wp.static(axis)):
            if wp.static(moving):
                solid_out[c] = solid_out[c] + v
            v = real(0.0)
        if wp.static(moving):
            solid_out[c] = solid_out[c] + (real(1.0) - open) * drop
        by_out[c] = v + open * drop

    name = f"divergence_adjoint_{'xyz'[axis]}{'_fractions' * fractions}{'_moving' * moving}_{f.name}"
    return wp.kernel(project_faces_adjoint, name=name, module=module, enable_backward=False)


@cache
def side_adjoint_kernel(dim: int, axis: int, real, module):
    """Kernel over blocks of threads, which go over both sides of an axis: parts of the sums of by at closed ones, low and high;
    by_out is 0 there."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    def closed_side_parts(g: S.Grid, low: t.vec3, high: t.vec3, by_out: wp.array(dtype=real),
                          part_out: wp.array(dtype=wp.vec2d)):
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        shape[wp.static(axis)] = 2
        first = wp.float64(0.0)
        second = wp.float64(0.0)
        for c in range(wp.tid(), shape[0] * shape[1] * shape[2], part_out.shape[0] * wp.block_dim()):
            i = f.place(c, shape)
            side = i[wp.static(axis)]
            i[wp.static(axis)] = side * g.n[wp.static(axis)]
            at = flat_cell_index(i, f.faces(g, wp.static(axis)))
            if side == 0 and low[wp.static(axis)] == real(0.0):
                first += wp.float64(by_out[at])
                by_out[at] = real(0.0)
            if side == 1 and high[wp.static(axis)] == real(0.0):
                second += wp.float64(by_out[at])
                by_out[at] = real(0.0)
        first = block_sum(first)
        second = block_sum(second)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(first, second)

    return wp.kernel(closed_side_parts, name=f"sides_adjoint_{'xyz'[axis]}_{f.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def adjoint_residual_kernel(module):
    """Kernel of one thread: worst_out is at least |r| / |b|, of the parts of r . r and b . b of a solve; part: (sum, -)."""

    def worst_adjoint_residual(S: wp.array(dtype=wp.float64), part: wp.array(dtype=wp.vec2d), size: int,
                               worst_out: wp.array(dtype=float)):
        sum = wp.float64(0.0)
        for k in range(part.shape[0]):
            both = part[k]
            sum += both[0]
        if S[size] > wp.float64(0.0):
            worst_out[0] = wp.max(worst_out[0], float(wp.sqrt(sum / S[size])))

    return wp.kernel(worst_adjoint_residual, name="residual_adjoint", module=module, enable_backward=False)
