"""The right-hand side of the pressure: - sum over faces of (o u + (1 - o) u_solid) out of a cell, + e dx (see pressure.py).

Obstacles that bend and grow have velocities with a divergence of their own, and in the part f of a cell that they fill that is
no flow through their surface there (the theorem of Gauss):

    sum over faces of (1 - o) u_solid  -  f sum over faces of u_solid,    f = 1 - the mean of o

or a cell that is open by a slit would blow through it all that bends beside.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.fluid.pressure import poisson_stencil
from wsim.kernels.fluid.solver.level import pressure_levels


@cache
def divergence_kernel(dim: int, fractions: bool, moving: bool, expanding: bool, forming: bool, real, module):
    """Kernel over cells: the right-hand side [m/s]. open: of the faces, solid: velocities of what covers them (moving; forming:
    some bend), expansion [1/s] of the cells; 0 in cells without an open face."""
    S, f, Level = grid_structs(real), grid_functions(dim, real), pressure_levels(real)

    @wp.func
    def face_flux(u: wp.array(dtype=real), o: wp.array(dtype=real), s: wp.array(dtype=real), c: int):
        flux = u[c]
        if wp.static(fractions):
            flux = o[c] * u[c]
            if wp.static(moving):
                flux += (real(1.0) - o[c]) * s[c]
        return flux

    @wp.func
    def axis_outflow(g: S.Grid, axis: int, i: wp.vec3i, u: wp.array(dtype=real), o: wp.array(dtype=real),
                     s: wp.array(dtype=real)):
        shape = f.faces(g, axis)
        far = wp.vec3i(i[0], i[1], i[2])
        far[axis] = i[axis] + 1
        if far[axis] == shape[axis]:
            far[axis] = 0
        return face_flux(u, o, s, flat_cell_index(far, shape)) - face_flux(u, o, s, flat_cell_index(i, shape))

    s = poisson_stencil(dim, fractions, real)

    @wp.func
    def face_difference_sum(g: S.Grid, axis: int, i: wp.vec3i, a: wp.array(dtype=real)):
        """(difference, sum) of both faces of a cell."""
        shape = f.faces(g, axis)
        far = wp.vec3i(i[0], i[1], i[2])
        far[axis] = i[axis] + 1
        if far[axis] == shape[axis]:
            far[axis] = 0
        ahead = a[flat_cell_index(far, shape)]
        behind = a[flat_cell_index(i, shape)]
        return ahead - behind, ahead + behind

    @wp.func
    def obstacle_swelling(g: S.Grid, i: wp.vec3i, open: S.Faces, solid: S.Faces):
        _, free = face_difference_sum(g, 0, i, open.x)
        _, o = face_difference_sum(g, 1, i, open.y)
        free += o
        if wp.static(dim == 3):
            _, o = face_difference_sum(g, 2, i, open.z)
            free += o
        filled = real(1.0) - free / real(2 * dim)
        grows = real(0.0)
        if filled > real(0.0):
            x, _ = face_difference_sum(g, 0, i, solid.x)
            y, _ = face_difference_sum(g, 1, i, solid.y)
            grows = x + y
            if wp.static(dim == 3):
                z, _ = face_difference_sum(g, 2, i, solid.z)
                grows += z
        return filled * grows

    def velocity_divergence(g: S.Grid, u: S.Faces, open: S.Faces, solid: S.Faces, expansion: wp.array(dtype=real), level: Level,
                            b_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        sum = axis_outflow(g, 0, i, u.x, open.x, solid.x) + axis_outflow(g, 1, i, u.y, open.y, solid.y)
        if wp.static(dim == 3):
            sum += axis_outflow(g, 2, i, u.z, open.z, solid.z)
        if wp.static(forming):
            sum -= obstacle_swelling(g, i, open, solid)
        if wp.static(expanding):
            sum -= expansion[c] * g.dx
        if wp.static(fractions):
            if s.diagonal(level, i) == real(0.0):
                sum = real(0.0)
        b_out[c] = -sum

    what = f"{'_fractions' * fractions}{'_moving' * moving}{'_expanding' * expanding}{'_forming' * forming}"
    return wp.kernel(velocity_divergence, name=f"divergence{what}_{f.name}", module=module, enable_backward=False)
