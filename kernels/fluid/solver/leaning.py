"""The impulse on a body that the equation of the pressure lacks (kernels/fluid/solver/floating.py): J^T q, with for q the
gradient of p times the way from the centre of a cell to the surface that covers it. It is of the size of a layer of cells of
fluid.

What it is where the fluid is at rest, p_n - p_c = h g, is given before the solve; what p makes different behind it, and what
that changes is solved for in a second solve. A third would change as much less again.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.fluid.solver.floating import at_faces, body_covers
from wsim.kernels.math.real import types


@cache
def surface_pressure_kernels(dim: int, real, module):
    """Kernels over cells: at_rest (gravity, clock) -> q_out, the pressure on the surface of what covers a cell over that at its
    centre, of a fluid at rest; found (p) -> of p, over `rest`. solid: signed distance at the nodes [m], of `shape`; phi: of a
    liquid, None: all cells are fluid."""
    t, S, f, Cover, of = types(real), grid_structs(real), grid_functions(dim, real), body_covers(real), at_faces(dim, real)

    @wp.func
    def to_surface(g: S.Grid, shape: wp.vec3i, solid: wp.array(dtype=real), i: wp.vec3i):
        """In cells."""
        value = real(0.0)
        n = t.vec3()
        corners = int(wp.static(2 ** dim))                     # a variable: the loop is compiled once
        for m in range(corners):
            j = wp.vec3i(m % 2, (m // 2) % 2, m // 4)
            q = solid[flat_cell_index(i + j, shape)]
            value += q
            for a in range(wp.static(dim)):
                n[a] = n[a] + real(2 * j[a] - 1) * q
        size = wp.length(n)
        way = t.vec3()
        if size > real(0.0):
            way = -(value / (real(wp.static(2 ** dim)) * g.dx)) * n / size
        return way

    def hydrostatic_difference(g: S.Grid, cover: Cover, shape: wp.vec3i, solid: wp.array(dtype=real),
                               gravity: wp.array(dtype=real), clock: wp.array(dtype=real), q_out: wp.array(dtype=real)):
        c = wp.tid()
        if cover.mark[c] != 0:
            way = to_surface(g, shape, solid, f.place(c, g.n))
            sum = real(0.0)
            for a in range(wp.static(dim)):
                sum += way[a] * clock[0] * gravity[a]
            q_out[c] = sum

    def surface_pressure_excess(g: S.Grid, cover: Cover, shape: wp.vec3i, solid: wp.array(dtype=real),
                                phi: wp.array(dtype=real),
                                p: wp.array(dtype=real), rest: wp.array(dtype=real), q_out: wp.array(dtype=real)):
        c = wp.tid()
        if cover.mark[c] != 0:
            i = f.place(c, g.n)
            way = to_surface(g, shape, solid, i)
            sum = real(0.0)
            for a in range(wp.static(dim)):
                slope = real(0.0)
                count = real(0.0)
                for side in range(2):
                    j = wp.vec3i(i[0], i[1], i[2])
                    j[a] = i[a] + 2 * side - 1
                    b, closed = of.share(g, cover, i, a, side)
                    if j[a] >= 0 and j[a] < g.n[a] and wp.abs(closed) < real(1.0):
                        n = flat_cell_index(j, g.n)
                        wet = int(1)
                        if phi:
                            if phi[n] >= real(0.0):
                                wet = int(0)
                        if wet == 1:
                            slope += real(2 * side - 1) * (p[n] - p[c])
                            count += real(1.0)
                if count > real(0.0):
                    sum += way[a] * slope / count
            q_out[c] = sum - rest[c]

    return [wp.kernel(k, name=f"floating_lean_{k.__name__}_{f.name}", module=module, enable_backward=False)
            for k in (hydrostatic_difference, surface_pressure_excess)]


@cache
def cell_addition_kernel(real, module):
    """Kernel over cells: x_out += y."""

    def add_cell_values(y: wp.array(dtype=real), x_out: wp.array(dtype=real)):
        c = wp.tid()
        x_out[c] = x_out[c] + y[c]

    return wp.kernel(add_cell_values, name=f"floating_both_{types(real).name}", module=module, enable_backward=False)
