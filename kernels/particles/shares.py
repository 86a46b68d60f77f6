"""What a cell has of particles at their density at rest, beside walls that are thinner than the grid can tell (walls.py):

    share = integral of w / W over what the cell's centre sees [cells],    W: sum of the hats w of all centres seen from a place

The walls about a cell are planes here, which rays along the axes find, and all that is in front of them is seen. Of one wall
along the grid, d < 1 cells from the centre, the share is 1/2 + d. Shares of all cells sum to the volume of what they see, so
that particles fill it at the density that they have elsewhere. A cell all of whose faces are closed has none.
"""

# ruff: noqa: UP018, SIM102

from functools import cache

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.particles.surface import surface_functions
from wsim.kernels.particles.transfers import transfer_stencils
from wsim.kernels.particles.walls import FAR, RAY, SLACK

PARTS = 4                # of a cell's edge, of the sum that an integral is; exact of planes along the grid
SAME = 0.7               # cosine between normals from which on they are of one wall
LEAST = 0.1              # of a cell: no share is smaller, but 0


@cache
def plane_share_function(dim: int, real):
    """Function (planes, count) -> share of a cell that sees what is in front of so many planes: rows (normal towards the
    centre, distance from it [cells])."""
    t, hat = types(real), transfer_stencils(dim, real).hat
    planes = wp.types.matrix((6, 4), real)

    @wp.func
    def part_in_front(known: planes, count: int, x: t.vec3):
        """Part of a cube of edge 1 / PARTS about x that is in front of the planes; exact of one along the grid."""
        part = real(1.0)
        for j in range(count):
            n = t.vec3(known[j, 0], known[j, 1], known[j, 2])
            size = wp.abs(n[0]) + wp.abs(n[1]) + wp.abs(n[2])
            part *= wp.clamp(real(0.5) + real(PARTS) * (wp.dot(n, x) + known[j, 3]) / size, real(0.0), real(1.0))
        return part

    @wp.func
    def rows_in_front(known: planes, count: int):
        """Bits of the centres about this one, bit 13: itself."""
        bits = int(0)
        rows = int(27)                                         # variables: loops are compiled once
        for m in range(rows):
            r = t.vec3(real(m % 3 - 1), real((m // 3) % 3 - 1), real(m // 9 - 1))
            here = bool(True)
            for j in range(count):
                n = t.vec3(known[j, 0], known[j, 1], known[j, 2])
                if wp.dot(n, r) + known[j, 3] <= real(SLACK):
                    here = bool(False)
            if here:
                bits = bits | (1 << m)
        return bits

    @wp.func
    def share_of_hats(bits: int, x: t.vec3):
        """w / W of the centre at x [cells] from it."""
        first = t.vec3(wp.floor(x[0]), wp.floor(x[1]), real(0.0))
        if wp.static(dim == 3):
            first[2] = wp.floor(x[2])
        own = real(0.0)
        whole = real(0.0)
        corners = int(wp.static(2 ** dim))
        for m in range(corners):
            r = first + t.vec3(real(m % 2), real((m // 2) % 2), real(m // 4))
            w = hat(x[0] - r[0]) * hat(x[1] - r[1]) * hat(x[2] - r[2])
            at = int(r[0]) + 3 * int(r[1]) + 9 * int(r[2]) + 13
            if ((bits >> at) & 1) != 0:
                whole += w
            if at == 13:
                own = w
        return own / wp.max(whole, own)

    @wp.func(inline=False)
    def share_before_planes(known: planes, count: int):
        bits = rows_in_front(known, count)
        sum = real(0.0)
        edge = int(2 * PARTS)
        samples = int(wp.static((2 * PARTS) ** dim))
        for m in range(samples):
            x = t.vec3(real(m % edge), real((m // edge) % edge), real(m // (edge * edge)))
            x = (x + t.vec3(real(0.5), real(0.5), real(0.5))) / real(PARTS) - t.vec3(real(1.0), real(1.0), real(1.0))
            if wp.static(dim == 2):
                x[2] = real(0.0)
            part = part_in_front(known, count, x)
            if part > real(0.0):
                sum += part * share_of_hats(bits, x)
        return wp.max(sum / real(wp.static(PARTS ** dim)), real(LEAST))

    return planes, share_before_planes


@cache
def cell_share_kernel(dim: int, kinds: tuple[str, ...], real, module):
    """Kernel over cells: share_out."""
    t, G, S, f, s = (types(real), grid_structs(real), moved.fluid_shape_structs(real), grid_functions(dim, real),
                     moved.shape_queries(dim, kinds, real))
    opening = surface_functions(dim, real).opening
    planes, share_of = plane_share_function(dim, real)

    @wp.func(inline=False)
    def ray_wall_plane(shapes: S.Shapes, x: t.vec3, way: t.vec3, time: real):
        """Distance [cells] of the plane that a ray meets, and its normal along the axes of the grid."""
        least = real(2.0)
        n = t.vec3()
        y = s.spot(shapes, x)
        z = s.spot(shapes, x + way)
        for k in range(shapes.of.kind.shape[0]):
            if shapes.thin[k] != 0:
                part, normal = s.first_hit(shapes.of, k, y, time, z, time, real(0.0))
                if part < real(1.0) and part < least:
                    least = part
                    n = normal
        d = real(FAR)
        if least < real(1.0):
            d = least * wp.abs(wp.dot(z - y, n)) / shapes.dx
        if wp.static(dim == 2):
            n = t.vec3(n[shapes.axes[0]], n[shapes.axes[1]], real(0.0))
        return d, n

    @wp.func
    def is_shut(g: G.Grid, open: G.Faces, i: wp.vec3i):
        """Whether all faces of a cell are closed."""
        shut = bool(True)
        around = int(wp.static(2 * dim))
        for m in range(around):
            a = m // 2
            inside = g.periodic[a] != 0 or (i[a] + m % 2 > 0 and i[a] + m % 2 < g.n[a])
            if (inside or ((g.outside[a] >> (m % 2)) & 1) != 0) and opening(g, open, i, a, m % 2) > real(0.0):
                shut = bool(False)
        return shut

    @wp.func
    def planes_about(shapes: S.Shapes, x: t.vec3, time: real):
        """The walls that rays along the axes meet, one plane each, and their number."""
        known = planes()
        count = int(0)
        rays = int(wp.static(2 * dim))
        for m in range(rays):
            way = t.vec3()
            way[m // 2] = real(RAY) * real(2 * (m % 2) - 1)
            d, n = ray_wall_plane(shapes, x, way, time)
            row = int(-1)
            for j in range(count):
                if known[j, 0] * n[0] + known[j, 1] * n[1] + known[j, 2] * n[2] > real(SAME):
                    row = j
            if row < 0 and d < wp.abs(n[0]) + wp.abs(n[1]) + wp.abs(n[2]) + real(2.0 * SLACK):
                known[count, 0] = n[0]
                known[count, 1] = n[1]
                known[count, 2] = n[2]
                known[count, 3] = d
                count += 1
            elif row >= 0:
                known[row, 3] = wp.min(known[row, 3], d)
        return known, count

    def visible_cell_share(g: G.Grid, shapes: S.Shapes, clock: wp.array(dtype=real), clear: wp.array(dtype=t.vec2),
                           open: G.Faces, share_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        share = real(1.0)
        near = clear[c]
        if near[1] < real(RAY) * g.dx:
            if is_shut(g, open, i):
                share = real(0.0)
            else:
                x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(-1)
                known, count = planes_about(shapes, x, clock[0] + clock[1])
                if count > 0:
                    share = share_of(known, count)
        share_out[c] = share

    return wp.kernel(visible_cell_share, name=f"walls_share_{s.name}", module=module, enable_backward=False)
