"""A V-cycle for the equation of kernels/fluid/pressure.py: what it makes of a residual is close to A^-1 of it, and
symmetric, so that conjugate gradients take it (Tatebe 1993; McAdams, Sifakis, Teran 2010 for fluids).

    sweeps      red cells, then black ones: x_c = (b_c + sum k x_n) / sum k; behind the coarse grid in the opposite order
    restrict    b of a coarse cell = sum of the residuals b - A x of its fine ones
    prolong     x += that of the coarse cell: piecewise constant, the exact transpose
    coarse k    half of the sum of the k of the fine faces in a coarse face (whole along an axis that is not halved): an area
                of four faces over twice the distance, openings as their mean

Linear interpolation with another restriction stalls at obstacles, where this one keeps its pace. An axis is halved while it has
more than one cell, where periodic while half of it is even: so that no two red cells are beside each other.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat, functions
from wsim.kernels.fluid.pressure import levels, stencil
from wsim.kernels.math.real import types


@cache
def coloured(dim: int):
    """Function (c, color, n) -> place of cell c of half of them; the last axis may be n: none."""

    @wp.func
    def coloured(c: int, color: int, n: wp.vec3i):
        if wp.static(dim == 3):
            half = (n[2] + 1) // 2
            m = c // half
            i = m // n[1]
            j = m - i * n[1]
            return wp.vec3i(i, j, 2 * (c - m * half) + ((i + j + color) & 1))
        half = (n[1] + 1) // 2
        i = c // half
        return wp.vec3i(i, 2 * (c - i * half) + ((i + color) & 1), 0)

    return coloured


@cache
def sweep(dim: int, fractions: bool | int, fresh: bool, real, module):
    """Kernel over half of the cells: x of those of a colour. fresh: all others are taken for 0."""
    Level, s, where = levels(real), stencil(dim, fractions, real), coloured(dim)

    def sweep(level: Level, b: wp.array(dtype=real), color: int, x: wp.array(dtype=real), x_out: wp.array(dtype=real)):
        i = where(wp.tid(), color, level.n)
        if i[wp.static(dim - 1)] < level.n[wp.static(dim - 1)]:
            c = flat(i, level.n)
            own = real(0.0)
            sum = real(0.0)
            if wp.static(fresh):
                own = s.diagonal(level, i)
            else:
                own, sum = s.beside(level, x, i)
            value = real(0.0)
            if own > real(0.0):
                value = (b[c] + sum) / own
            x_out[c] = value

    return wp.kernel(sweep, name=f"sweep{'_fresh' * fresh}_{s.name}", module=module, enable_backward=False)


@cache
def restrict(dim: int, fractions: bool | int, real, module):
    """Kernel over coarse cells: b_out of the residuals of the fine ones. halved: by which factor each axis is."""
    Level, s, f = levels(real), stencil(dim, fractions, real), functions(dim, real)

    def restrict(level: Level, coarse: wp.vec3i, halved: wp.vec3i, b: wp.array(dtype=real), x: wp.array(dtype=real),
                 b_out: wp.array(dtype=real)):
        c = wp.tid()
        at = f.place(c, coarse)
        sum = real(0.0)
        for i in range(at[0] * halved[0], wp.min((at[0] + 1) * halved[0], level.n[0])):
            for j in range(at[1] * halved[1], wp.min((at[1] + 1) * halved[1], level.n[1])):
                for k in range(at[2] * halved[2], wp.min((at[2] + 1) * halved[2], level.n[2])):
                    here = wp.vec3i(i, j, k)
                    sum += b[flat(here, level.n)] - s.product(level, x, here)
        b_out[c] = sum

    return wp.kernel(restrict, name=f"restrict_{s.name}", module=module, enable_backward=False)


@cache
def prolong(dim: int, real, module):
    """Kernel over fine cells: x_out = x + that of the coarse cell."""
    f = functions(dim, real)

    def prolong(n: wp.vec3i, coarse: wp.vec3i, halved: wp.vec3i, y: wp.array(dtype=real), x: wp.array(dtype=real),
                x_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, n)
        x_out[c] = x[c] + y[flat(wp.vec3i(i[0] // halved[0], i[1] // halved[1], i[2] // halved[2]), coarse)]

    return wp.kernel(prolong, name=f"prolong_{f.name}", module=module, enable_backward=False)


@cache
def even(dim: int, fractions: bool | int, real, module):
    """Kernel of one thread over the coarsest cells, of a sealed region: b less its mean, or no x has that residual."""
    Level, s, f = levels(real), stencil(dim, fractions, real), functions(dim, real)

    @wp.func
    def open(level: Level, c: int):
        i = f.place(c, level.n)
        own = real(0.0)
        for a in range(wp.static(dim)):
            low, high = s.couplings(level, i, a)
            own += low + high
        return own > real(0.0)

    def even(level: Level, cells: int, b_out: wp.array(dtype=real)):
        sum = real(0.0)
        count = real(0.0)
        for c in range(cells):
            if open(level, c):
                sum += b_out[c]
                count += real(1.0)
        for c in range(cells):
            if open(level, c):
                b_out[c] = b_out[c] - sum / count

    return wp.kernel(even, name=f"even_{s.name}", module=module, enable_backward=False)


@cache
def coarsen(dim: int, axis: int, real, module):
    """Kernel over the coarse faces of an axis: k_out of the fine k, which has shape `fine`; of shape `coarse`."""
    f, t = functions(dim, real), types(real)

    def coarsen(coarse: wp.vec3i, fine: wp.vec3i, halved: wp.vec3i, k: wp.array(dtype=real), k_out: wp.array(dtype=real)):
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
                    sum += k[flat(wp.vec3i(i, j, m), fine)]
        k_out[c] = sum / real(halved[wp.static(axis)])

    return wp.kernel(coarsen, name=f"coarsen_{'xyz'[axis]}_{dim}d_{t.name}", module=module, enable_backward=False)


@cache
def collect(dim: int, real, module):
    """Kernel over coarse cells of a free surface: their own coupling, of the fine ones as `coarsen` has it of faces."""
    f, t = functions(dim, real), types(real)

    def collect(coarse: wp.vec3i, fine: wp.vec3i, halved: wp.vec3i, own: wp.array(dtype=real), own_out: wp.array(dtype=real)):
        c = wp.tid()
        at = f.place(c, coarse)
        sum = real(0.0)
        for i in range(at[0] * halved[0], wp.min((at[0] + 1) * halved[0], fine[0])):
            for j in range(at[1] * halved[1], wp.min((at[1] + 1) * halved[1], fine[1])):
                for k in range(at[2] * halved[2], wp.min((at[2] + 1) * halved[2], fine[2])):
                    sum += own[flat(wp.vec3i(i, j, k), fine)]
        own_out[c] = sum / real(wp.max(halved[0], wp.max(halved[1], halved[2])))

    return wp.kernel(collect, name=f"collect_{dim}d_{t.name}", module=module, enable_backward=False)
