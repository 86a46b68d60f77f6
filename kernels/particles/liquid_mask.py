"""The surface of a liquid beside bodies that move, where particles have not followed yet: as air, such a cell would have a
pressure of 0 for a step, and the body would feel a hole (Bridson 2015, section 8.3: the distance to the surface goes on into
solids).

    a cell that is air becomes liquid    where its centre is covered, if a cell across an open face is liquid
                                         where its centre is less than a cell away, if more of those are liquid than are air
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.particles.surface import surface_functions


@cache
def wet_surface_kernel(dim: int, real, module):
    """Kernel over cells: phi_out of phi. solid: signed distances of the obstacles at the nodes [m], of that shape."""
    S, f, at = grid_structs(real), grid_functions(dim, real), surface_functions(dim, real)

    @wp.func
    def obstacle_center_distance(g: S.Grid, shape: wp.vec3i, solid: wp.array(dtype=real), i: wp.vec3i):
        """Signed distance of the centre in cells."""
        sum = real(0.0)
        corners = int(wp.static(2 ** dim))                     # a variable: the loop is compiled once
        for m in range(corners):
            sum += solid[flat_cell_index(i + wp.vec3i(m % 2, (m // 2) % 2, m // 4), shape)]
        return sum / (real(wp.static(2 ** dim)) * g.dx)

    def wet_moving_surface(g: S.Grid, shape: wp.vec3i, solid: wp.array(dtype=real), open: S.Faces, phi: wp.array(dtype=real),
                           phi_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        own = obstacle_center_distance(g, shape, solid, i)
        if phi[c] >= real(0.0) and own < real(1.0):
            least = real(0.0)
            count = int(0)
            around = int(wp.static(2 * dim))                   # a variable: the loop is compiled once
            for m in range(around):
                a = m // 2
                j = at.beside(g, i, a, 2 * (m % 2) - 1)
                if j[a] >= 0:
                    if at.opening(g, open, i, a, m % 2) > real(0.0):
                        other = phi[flat_cell_index(j, g.n)]
                        if other < real(0.0):
                            least = wp.min(least, other)
                            count += 1
                        elif own >= real(0.0):
                            count -= 1
            if count > 0:
                phi_out[c] = least

    return wp.kernel(wet_moving_surface, name=f"particles_wet_{f.name}", module=module, enable_backward=False)
