"""Volume of a liquid on its grid.

    V = sum over cells of  o g dx^dim,      g = 1 where the cell and all cells beside it are liquid (f > 1/2), else min(f, 1)

    o   part of a cell outside of obstacles: of a plane through the mean and the gradient of the distances at its corners
        (Scardovelli, Zaleski 2000), exact of planes
    f   how full the cell is of particles (kernels/particles/fill.py)

Inside the liquid V is a volume of space, whatever the number of particles there; at its surface, and in spray, the volume of
the particles that room is left for. Both agree where the particles have their density at rest.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import particle_structs
from wsim.kernels.particles.surface import surface_functions
from wsim.kernels.particles.walls import RAY
from wsim.kernels.solver.pcg import block_sum

AMOUNT, PLACES, OF_PARTICLES = 0, 1, 2            # volumes [cells]: of liquid, outside of obstacles, of particles at rest


@wp.func
def plane_cut_volume(x: wp.float64, y: wp.float64, z: wp.float64, t: wp.float64):
    """Part of a unit cube with n.r < t, r from the corner where that is least; n >= 0, its components x, y, z sum to 1."""
    a = wp.min(x, wp.min(y, z))
    c = wp.max(x, wp.max(y, z))
    b = wp.float64(1.0) - a - c
    s = wp.clamp(wp.min(t, wp.float64(1.0) - t), wp.float64(0.0), wp.float64(0.5))
    three, six = wp.float64(3.0), wp.float64(6.0)
    part = wp.float64(0.0)
    if s < a:
        part = s * s * s / (six * a * b * c)
    elif s < b:
        part = s * (s - a) / (wp.float64(2.0) * b * c) + a * a / (six * b * c)
    elif s < wp.min(a + b, c):
        part = (s * s * (three * (a + b) - s) + a * a * (a - three * s) + b * b * (b - three * s)) / (six * a * b * c)
    elif a + b <= c:
        part = (wp.float64(2.0) * s - a - b) / (wp.float64(2.0) * c)
    else:
        part = (s * s * (three - wp.float64(2.0) * s) + a * a * (a - three * s) + b * b * (b - three * s)
                + c * c * (c - three * s)) / (six * a * b * c)
    return wp.where(t > wp.float64(0.5), wp.float64(1.0) - part, part)


@cache
def open_fraction(dim: int, real):
    """Function (dx, shape, solid, i) -> part of cell i outside of obstacles, of distances [m] at nodes of shape `shape`."""

    @wp.func
    def open_cell_part(dx: real, shape: wp.vec3i, solid: wp.array(dtype=real), i: wp.vec3i):
        mean = wp.float64(0.0)
        slope = wp.vec3d()
        corners = int(wp.static(2 ** dim))                     # a variable: the loop is compiled once
        for m in range(corners):
            at = wp.vec3i(m % 2, (m // 2) % 2, m // 4)
            q = wp.float64(solid[flat_cell_index(i + at, shape)])
            mean += q
            for b in range(wp.static(dim)):
                slope[b] = slope[b] + wp.float64(2 * at[b] - 1) * q
        mean = mean / wp.float64(corners)
        n = wp.vec3d(wp.abs(slope[0]), wp.abs(slope[1]), wp.abs(slope[2])) / wp.float64(corners // 2)
        size = n[0] + n[1] + n[2]                              # most of the distances' difference across the cell
        part = wp.where(mean > wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
        if wp.abs(mean) < wp.float64(0.5) * size:
            part = plane_cut_volume(n[0] / size, n[1] / size, n[2] / size, wp.float64(0.5) + mean / size)
        return part

    return open_cell_part


@cache
def liquid_volume_kernel(dim: int, obstacles: bool, thin: bool, real, module):
    """Kernel over blocks of threads: parts of (AMOUNT, PLACES, OF_PARTICLES). rest: particles of a full cell. Of cells beside
    a thin wall the particles count."""
    S, T, f, at, part_of = (grid_structs(real), particle_structs(real), grid_functions(dim, real), surface_functions(dim, real),
                            open_fraction(dim, real))

    @wp.func
    def surrounded_by_liquid(g: S.Grid, fill: wp.array(dtype=real), open: S.Faces, i: wp.vec3i):
        """Whether a cell and all beside it are liquid."""
        found = fill[flat_cell_index(i, g.n)] > real(0.5)
        around = int(wp.static(2 * dim))
        for m in range(around):
            a = m // 2
            n = at.beside(g, i, a, 2 * (m % 2) - 1)
            if n[a] >= 0:
                o = real(1.0)
                if wp.static(obstacles):
                    o = at.opening(g, open, i, a, m % 2)
                if o > real(0.0) and fill[flat_cell_index(n, g.n)] <= real(0.5):
                    found = bool(False)
        return found

    def liquid_volume_parts(g: S.Grid, fill: wp.array(dtype=real), shape: wp.vec3i, solid: wp.array(dtype=real), open: S.Faces,
                            cells: T.Cells, rest: real, part_out: wp.array(dtype=wp.vec3d)):
        liquid = wp.float64(0.0)
        places = wp.float64(0.0)
        particles = wp.float64(0.0)
        for c in range(wp.tid(), fill.shape[0], part_out.shape[0] * wp.block_dim()):
            i = f.place(c, g.n)
            o = wp.float64(1.0)
            if wp.static(obstacles):
                o = part_of(g.dx, shape, solid, i)
            full = wp.float64(wp.clamp(fill[c], real(0.0), real(1.0)))
            if surrounded_by_liquid(g, fill, open, i):
                full = wp.float64(1.0)
            if wp.static(thin):
                near = cells.clear[c]
                if near[1] < real(RAY) * g.dx:
                    full = wp.float64(fill[c] * cells.share[c])
            liquid += o * full
            places += o
            particles += wp.float64(cells.first[c + 1] - cells.first[c])
        sums = wp.vec3d(block_sum(liquid), block_sum(places), block_sum(particles) / wp.float64(rest))
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = sums

    return wp.kernel(liquid_volume_parts, name=f"particles_volume{'_obstacles' * obstacles}{'_thin' * thin}_{f.name}",
                     module=module, enable_backward=False, grid_stride=False)


@cache
def liquid_volume_sum_kernel(real, module):
    """Kernel over one block of threads: the sums of the parts; words of a frame (tell_out): volume of liquid and of particles
    [cells / 8, rounded]."""

    def sum_liquid_volumes(part: wp.array(dtype=wp.vec3d), whole_out: wp.array(dtype=wp.vec3d), tell_out: wp.array(dtype=int)):
        x = wp.float64(0.0)
        y = wp.float64(0.0)
        z = wp.float64(0.0)
        for k in range(wp.tid(), part.shape[0], wp.block_dim()):
            p = part[k]
            x += p[0]
            y += p[1]
            z += p[2]
        x = block_sum(x)
        y = block_sum(y)
        z = block_sum(z)
        if wp.tid() == 0:
            whole_out[0] = wp.vec3d(x, y, z)
            tell_out[0] = int(wp.rint(wp.float64(8.0) * x))
            tell_out[1] = int(wp.rint(wp.float64(8.0) * z))

    return wp.kernel(sum_liquid_volumes, name=f"particles_volumes_{types(real).name}", module=module, enable_backward=False,
                     grid_stride=False)
