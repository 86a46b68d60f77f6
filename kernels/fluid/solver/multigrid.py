"""A V-cycle for the equation of kernels/fluid/pressure.py: what it makes of a residual is close to A^-1 of it, and
symmetric, so that conjugate gradients take it (Tatebe 1993; McAdams, Sifakis, Teran 2010 for fluids).

    sweeps      red cells, then black ones: x_c = (b_c + sum k x_n) / sum k; behind the coarse grid in the opposite order
    restrict    b of a coarse cell = sum of the residuals b - A x of its fine ones: of the red ones, since the sweep over the
                black ones, the last, leaves them none
    rise        x += that of the coarse cell: piecewise constant, the exact transpose; and the first sweep behind, which reads
                only red cells, so that no x is written twice
    coarse k    half of the sum of the k of the fine faces in a coarse face (whole along an axis that is not halved): an area
                of four faces over twice the distance, openings as their mean

Linear interpolation with another restriction stalls at obstacles, where this one keeps its pace. An axis is halved while it has
more than one cell, where periodic while half of it is even: so that no two red cells are beside each other. Small levels are
all taken by one block of threads: kernels/fluid/solver/coarse.py.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions
from wsim.kernels.fluid.pressure import FREE, poisson_stencil, pressure_levels
from wsim.kernels.math.real import types


@cache
def vcycle_functions(dim: int, fractions: bool | int, real) -> SimpleNamespace:
    """Functions: coloured(c, color, n) -> place of cell c of half of them, whose last axis may be n: none. fresh, swept, risen
    -> x of a cell; residual(level, coarse cell, halved, b, x) -> b of a coarse cell."""
    Level, s = pressure_levels(real), poisson_stencil(dim, fractions, real)

    @wp.func
    def checkerboard_cell(c: int, color: int, n: wp.vec3i):
        if wp.static(dim == 3):
            half = (n[2] + 1) // 2
            m = c // half
            i = m // n[1]
            j = m - i * n[1]
            return wp.vec3i(i, j, 2 * (c - m * half) + ((i + j + color) & 1))
        half = (n[1] + 1) // 2
        i = c // half
        return wp.vec3i(i, 2 * (c - i * half) + ((i + color) & 1), 0)

    @wp.func
    def safe_quotient(b: real, own: real):
        value = real(0.0)
        if own > real(0.0):
            value = b / own
        return value

    @wp.func
    def first_gauss_seidel(level: Level, b: wp.array(dtype=real), i: wp.vec3i):
        """With 0 around."""
        return safe_quotient(b[flat_cell_index(i, level.n)], s.diagonal(level, i))

    @wp.func
    def gauss_seidel_value(level: Level, b: wp.array(dtype=real), x: wp.array(dtype=real), i: wp.vec3i):
        own, sum = s.beside(level, x, i)
        return safe_quotient(b[flat_cell_index(i, level.n)] + sum, own)

    @wp.func
    def first_sweep_value(level: Level, b: wp.array(dtype=real), i: wp.vec3i):
        """After the first sweep over the red cells, of a red cell; after that over the black ones too, of a black cell."""
        sum = real(0.0)
        own = real(0.0)
        if ((i[0] + i[1] + i[2]) & 1) != 0:
            for a in range(wp.static(dim)):
                low, high = s.couplings(level, i, a)
                own += low + high
                for side in range(2):
                    j = wp.vec3i(i[0], i[1], i[2])
                    j[a] = i[a] + 2 * side - 1
                    k = wp.where(side == 0, low, high)
                    if level.periodic[a] != 0:
                        j[a] = (j[a] + level.n[a]) % level.n[a]
                    if j[a] >= 0 and j[a] < level.n[a]:
                        sum += k * first_gauss_seidel(level, b, j)
        else:
            own = s.diagonal(level, i)
        return safe_quotient(b[flat_cell_index(i, level.n)] + sum, own)

    @wp.func
    def parent_coarse_cell(i: wp.vec3i, halved: wp.vec3i):
        """Coarse cell of a fine one."""
        return wp.vec3i(i[0] >> (halved[0] - 1), i[1] >> (halved[1] - 1), i[2] >> (halved[2] - 1))

    @wp.func
    def prolonged_value(level: Level, coarse: wp.vec3i, halved: wp.vec3i, b: wp.array(dtype=real), y: wp.array(dtype=real),
                        x: wp.array(dtype=real), i: wp.vec3i):
        """With x and that of the coarse cell, y, around."""
        own = real(0.0)
        if wp.static(fractions == FREE):
            own += level.own[flat_cell_index(i, level.n)]
        sum = real(0.0)
        for a in range(wp.static(dim)):
            low, high = s.couplings(level, i, a)
            own += low + high
            j = wp.vec3i(i[0], i[1], i[2])
            j[a] = i[a] - 1
            if i[a] == 0:
                j[a] = wp.where(level.periodic[a] != 0, level.n[a] - 1, i[a])
                low = wp.where(level.periodic[a] != 0, low, real(0.0))
            sum += low * (x[flat_cell_index(j, level.n)] + y[flat_cell_index(parent_coarse_cell(j, halved), coarse)])
            j[a] = i[a] + 1
            if j[a] == level.n[a]:
                j[a] = wp.where(level.periodic[a] != 0, 0, i[a])
                high = wp.where(level.periodic[a] != 0, high, real(0.0))
            sum += high * (x[flat_cell_index(j, level.n)] + y[flat_cell_index(parent_coarse_cell(j, halved), coarse)])
        return safe_quotient(b[flat_cell_index(i, level.n)] + sum, own)

    @wp.func
    def restricted_residual(level: Level, at: wp.vec3i, halved: wp.vec3i, b: wp.array(dtype=real), x: wp.array(dtype=real)):
        sum = real(0.0)
        for i in range(at[0] * halved[0], wp.min((at[0] + 1) * halved[0], level.n[0])):
            for j in range(at[1] * halved[1], wp.min((at[1] + 1) * halved[1], level.n[1])):
                for k in range(at[2] * halved[2], wp.min((at[2] + 1) * halved[2], level.n[2])):
                    if ((i + j + k) & 1) == 0:
                        here = wp.vec3i(i, j, k)
                        sum += b[flat_cell_index(here, level.n)] - s.product(level, x, here)
        return sum

    return SimpleNamespace(coloured=checkerboard_cell, fresh=first_gauss_seidel, begun=first_sweep_value,
                           swept=gauss_seidel_value, risen=prolonged_value, residual=restricted_residual,
                           diagonal=s.diagonal, name=s.name)


@cache
def gauss_seidel_kernel(dim: int, fractions: bool | int, fresh: bool, real, module):
    """Kernel over half of the cells: x of those of a colour. fresh: all others are taken for 0."""
    Level, p = pressure_levels(real), vcycle_functions(dim, fractions, real)

    def gauss_seidel_sweep(level: Level, b: wp.array(dtype=real), color: int, x: wp.array(dtype=real),
                           x_out: wp.array(dtype=real)):
        i = p.coloured(wp.tid(), color, level.n)
        if i[wp.static(dim - 1)] < level.n[wp.static(dim - 1)]:
            c = flat_cell_index(i, level.n)
            if wp.static(fresh):
                x_out[c] = p.fresh(level, b, i)
            else:
                x_out[c] = p.swept(level, b, x, i)

    return wp.kernel(gauss_seidel_sweep, name=f"sweep{'_fresh' * fresh}_{p.name}", module=module, enable_backward=False)


@cache
def first_sweep_kernel(dim: int, real, module):
    """Kernel over cells, without obstacles: x_out after the first sweep over both colours, from x = 0."""
    Level, p, f = pressure_levels(real), vcycle_functions(dim, False, real), grid_functions(dim, real)

    def sweep_from_zero(level: Level, b: wp.array(dtype=real), x_out: wp.array(dtype=real)):
        c = wp.tid()
        x_out[c] = p.begun(level, b, f.place(c, level.n))

    return wp.kernel(sweep_from_zero, name=f"sweep_begin_{p.name}", module=module, enable_backward=False)


@cache
def restriction_kernel(dim: int, fractions: bool | int, real, module):
    """Kernel over coarse cells: b_out of the residuals of the fine ones. halved: by which factor each axis is."""
    Level, p, f = pressure_levels(real), vcycle_functions(dim, fractions, real), grid_functions(dim, real)

    def restrict_residual(level: Level, coarse: wp.vec3i, halved: wp.vec3i, b: wp.array(dtype=real), x: wp.array(dtype=real),
                          b_out: wp.array(dtype=real)):
        c = wp.tid()
        b_out[c] = p.residual(level, f.place(c, coarse), halved, b, x)

    return wp.kernel(restrict_residual, name=f"restrict_{p.name}", module=module, enable_backward=False)


@cache
def prolongation_kernel(dim: int, fractions: bool | int, real, module):
    """Kernel over half of the fine cells: x_out of the black ones, with x + y around, y of the coarse cells."""
    Level, p = pressure_levels(real), vcycle_functions(dim, fractions, real)

    def prolong_and_sweep(level: Level, coarse: wp.vec3i, halved: wp.vec3i, b: wp.array(dtype=real), y: wp.array(dtype=real),
                          x: wp.array(dtype=real), x_out: wp.array(dtype=real)):
        i = p.coloured(wp.tid(), 1, level.n)
        if i[wp.static(dim - 1)] < level.n[wp.static(dim - 1)]:
            x_out[flat_cell_index(i, level.n)] = p.risen(level, coarse, halved, b, y, x, i)

    return wp.kernel(prolong_and_sweep, name=f"rise_{p.name}", module=module, enable_backward=False)


@cache
def face_coarsening_kernel(dim: int, axis: int, real, module):
    """Kernel over the coarse faces of an axis: k_out of the fine k, which has shape `fine`; of shape `coarse`."""
    f, t = grid_functions(dim, real), types(real)

    def coarsen_faces(coarse: wp.vec3i, fine: wp.vec3i, halved: wp.vec3i, k: wp.array(dtype=real), k_out: wp.array(dtype=real)):
        c = wp.tid()
        at = f.place(c, coarse)
        first = wp.vec3i(at[0] * halved[0], at[1] * halved[1], at[2] * halved[2])
        last = wp.vec3i(wp.min(first[0] + halved[0], fine[0]), wp.min(first[1] + halved[1], fine[1]),
                        wp.min(first[2] + halved[2], fine[2]))
        first[wp.static(axis)] = wp.min(first[wp.static(axis)], fine[wp.static(axis)] - 1)     # the side of an odd axis
        last[wp.static(axis)] = first[wp.static(axis)] + 1
        sum = real(0.0)
        for i in range(first[0], last[0]):
            for j in range(first[1], last[1]):
                for m in range(first[2], last[2]):
                    sum += k[flat_cell_index(wp.vec3i(i, j, m), fine)]
        k_out[c] = sum / real(halved[wp.static(axis)])

    return wp.kernel(coarsen_faces, name=f"coarsen_{'xyz'[axis]}_{dim}d_{t.name}", module=module, enable_backward=False)


@cache
def cell_coarsening_kernel(dim: int, real, module):
    """Kernel over coarse cells of a free surface: their own coupling, of the fine ones as `face_coarsening_kernel` has it of
    faces."""
    f, t = grid_functions(dim, real), types(real)

    def coarsen_cells(coarse: wp.vec3i, fine: wp.vec3i, halved: wp.vec3i, own: wp.array(dtype=real),
                      own_out: wp.array(dtype=real)):
        c = wp.tid()
        at = f.place(c, coarse)
        sum = real(0.0)
        for i in range(at[0] * halved[0], wp.min((at[0] + 1) * halved[0], fine[0])):
            for j in range(at[1] * halved[1], wp.min((at[1] + 1) * halved[1], fine[1])):
                for k in range(at[2] * halved[2], wp.min((at[2] + 1) * halved[2], fine[2])):
                    sum += own[flat_cell_index(wp.vec3i(i, j, k), fine)]
        own_out[c] = sum / real(wp.max(halved[0], wp.max(halved[1], halved[2])))

    return wp.kernel(coarsen_cells, name=f"collect_{dim}d_{t.name}", module=module, enable_backward=False)
