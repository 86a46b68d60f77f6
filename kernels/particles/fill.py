"""How full cells are of particles, and where the surface of the liquid is.

    f       sum of the weights of the particles about a cell's centre (kernels/particles/transfers.py), over what they are where
            the liquid is at rest: the part of the hat about that centre which is liquid; 1 inside
    phi     signed distance to the surface over dx, of a plane across an axis at s cells from the centre:
            f = 1/2 + s - s |s| / 2,  so  phi = -s = -sign(f - 1/2) (1 - sqrt(1 - 2 |f - 1/2|)),  kept within -1 .. 1

An obstacle takes a part of that hat, the same function of its own signed distance; f is of what is left. The hat of a cell at a
side of the grid ends there (kernels/particles/transfers.py), and what an obstacle takes of it is summed over the cells beside:
a collider that lies against a side takes nothing.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import particle_structs
from wsim.kernels.particles.transfers import transfer_stencils
from wsim.kernels.particles.volume import open_fraction

LEAST = 0.1              # of a hat that obstacles leave: below it f is of this part


@cache
def hat_sum_function(dim: int, thin: bool, real):
    """Function (g, particles, cells, i) -> sum of weights about the centre of cell i; thin: of particles that see it,
    over what they have of all that they see (walls.py)."""
    t, S, T, s = types(real), grid_structs(real), particle_structs(real), transfer_stencils(dim, real)

    @wp.func
    def sum_hat_weights(g: S.Grid, particles: T.Particles, cells: T.Cells, i: wp.vec3i):
        at = t.vec3(real(i[0]), real(i[1]), real(i[2]))
        sum = real(0.0)
        depth = int(wp.static(int(dim == 3)))
        for a in range(i[0] - 1, i[0] + 2):
            for b in range(i[1] - 1, i[1] + 2):
                for d in range(i[2] - depth, i[2] + depth + 1):
                    j, shift = s.image(g, wp.vec3i(a, b, d))
                    if j[0] >= 0:
                        c = flat_cell_index(j, g.n)
                        for k in range(cells.first[c], cells.first[c + 1]):
                            away = at - shift - s.rows(g, -1, particles.x[cells.order[k]])
                            w = s.hat(away[0]) * s.hat(away[1])
                            if wp.static(dim == 3):
                                w *= s.hat(away[2])
                            if wp.static(thin):
                                p = cells.order[k]
                                if s.sees(particles.seen[p], -1, s.corner(away)) and w > real(0.0):
                                    w = w / particles.reach[p]
                                else:
                                    w = real(0.0)
                            sum += w
        return sum

    return sum_hat_weights


@cache
def cell_fill_kernel(dim: int, obstacles: bool, thin: bool, real, module):
    """Kernel over cells: f_out, phi_out. rest: weights of a full cell, of shape `nodes` the obstacles' distances phi [m]."""
    S, T, f = grid_structs(real), particle_structs(real), grid_functions(dim, real)
    hats_of, s, part_of = hat_sum_function(dim, thin, real), transfer_stencils(dim, real), open_fraction(dim, real)

    @wp.func
    def cell_is_at_side(g: S.Grid, i: wp.vec3i):
        found = bool(False)
        for b in range(wp.static(dim)):
            if g.periodic[b] == 0 and (i[b] == 0 or i[b] + 1 == g.n[b]):
                found = bool(True)
        return found

    @wp.func
    def left_at_side(g: S.Grid, shape: wp.vec3i, solid: wp.array(dtype=real), i: wp.vec3i):
        """As `hat_outside_obstacles`, of a cell at a side, beyond which there is no part of its hat."""
        sum = wp.float64(0.0)
        count = int(wp.static(3 ** dim))
        for m in range(count):
            step = wp.vec3i(m % 3 - 1, (m // 3) % 3 - 1, (m // 9) % 3 - 1)
            if wp.static(dim == 2):
                step[2] = 0
            weight = wp.float64(1.0)
            for b in range(wp.static(dim)):
                if step[b] == 0:
                    sides = int(0)
                    if g.periodic[b] == 0:
                        sides = int(i[b] == 0) + int(i[b] + 1 == g.n[b])
                    weight *= wp.float64(0.75) + wp.float64(0.125) * wp.float64(sides)
                else:
                    weight *= wp.float64(0.125)
            j, _ = s.image(g, i + step)
            if j[0] >= 0:
                sum += weight * part_of(g.dx, shape, solid, j)
        return wp.max(real(sum), real(LEAST))

    @wp.func
    def hat_outside_obstacles(g: S.Grid, shape: wp.vec3i, solid: wp.array(dtype=real), i: wp.vec3i):
        """Part of the hat that is outside of obstacles."""
        sum = real(0.0)
        corners = int(wp.static(2 ** dim))                     # a variable: the loop is compiled once
        for m in range(corners):
            sum += solid[flat_cell_index(i + wp.vec3i(m % 2, (m // 2) % 2, m // 4), shape)]
        d = wp.clamp(sum / (real(wp.static(2 ** dim)) * g.dx), real(-1.0), real(1.0))
        if d < real(1.0) and cell_is_at_side(g, i):
            return left_at_side(g, shape, solid, i)
        return wp.max(real(0.5) + d - real(0.5) * d * wp.abs(d), real(LEAST))

    def compute_cell_fill(g: S.Grid, particles: T.Particles, cells: T.Cells, rest: real, shape: wp.vec3i,
                          solid: wp.array(dtype=real), f_out: wp.array(dtype=real), phi_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        part = hats_of(g, particles, cells, i) / rest
        if wp.static(obstacles):
            part = part / hat_outside_obstacles(g, shape, solid, i)
        if wp.static(thin):
            part = part / wp.max(cells.share[c], real(LEAST))
        away = real(1.0) - wp.sqrt(wp.max(real(1.0) - real(2.0) * wp.abs(part - real(0.5)), real(0.0)))
        f_out[c] = part
        phi_out[c] = wp.where(part > real(0.5), -away, away)

    return wp.kernel(compute_cell_fill, name=f"particles_fill{'_obstacles' * obstacles}{'_thin' * thin}_{f.name}",
                     module=module, enable_backward=False)
