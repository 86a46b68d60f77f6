"""Walls that are thinner than the grid can tell, in a liquid: of both their sides no face and no particle knows the other.

    between     a wall stands between two places: the segment from one to the other meets it
    (kernels/contact/collider/segment.py) face        closed where a wall stands between the centres of its two cells; a path
    from cell to cell that avoids all
                closed faces never comes through a wall, however thin it is and however it lies
    cut         bits of a face: a wall stands between it and the next one along an axis, so that no velocity is extended there
    seen        bits of a particle: rows of the grid about it that no wall hides. Bit m: corner m of those of the cells, none of
                a cell all of whose faces are closed; then of each component in turn, bit b of m along axis b
    reach       of a particle: W = sum of its hats at the centres that it sees. Each of them has w / W of it, so that a particle
                counts as one wherever the wall lies in a cell; with a tenth of a hat left, ten would count as one
    share       of a cell: the integral of w / W over what it sees (shares.py)

Walls stand where they are at the step's end, and a particle stands to them as it did where the step begins.
"""

# ruff: noqa: UP018, SIM102

from functools import cache

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import particle_cell_function, particle_structs
from wsim.kernels.particles.transfers import transfer_stencils

FAR = 4.0                # cells: distances are told up to there
REACH = 2.7              # cells from the centre of a particle's cell to the furthest row about it
RAY = 1.75               # cells, sqrt(3): a plane nearer than 1 is met along an axis; no row is further from a particle
SLACK = 1.0e-3           # of a cell: what is so near to a wall stands on it


@cache
def wall_clearance_kernel(dim: int, kinds: tuple[str, ...], real, module):
    """Kernel over cells: clear_out, distance [m] of a cell's centre to the nearest shape and to the nearest thin wall, less the
    way that these go in the step; FAR cells at most."""
    t, G, S, f, s = (types(real), grid_structs(real), moved.fluid_shape_structs(real), grid_functions(dim, real),
                     moved.shape_queries(dim, kinds, real))

    def wall_clearance(g: G.Grid, shapes: S.Shapes, clock: wp.array(dtype=real), clear_out: wp.array(dtype=t.vec2)):
        c = wp.tid()
        i = f.place(c, g.n)
        y = s.spot(shapes, t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(-1))
        found = t.vec2(real(FAR) * g.dx, real(FAR) * g.dx)
        for k in range(shapes.of.kind.shape[0]):
            time = clock[0] + clock[1]
            d = wp.abs(s.signed(shapes.of, k, y, time)) - clock[0] * wp.length(s.rate(shapes, k, y, time))
            found[0] = wp.min(found[0], d)
            if shapes.thin[k] != 0:
                found[1] = wp.min(found[1], d)
        clear_out[c] = found

    return wp.kernel(wall_clearance, name=f"walls_clear_{s.name}", module=module, enable_backward=False)


@cache
def hidden_wall_function(dim: int, kinds: tuple[str, ...], real):
    """Function (shapes, a, b, time) -> whether a thin wall stands between places a and b [cells], or touches one."""
    t, S, s = types(real), moved.fluid_shape_structs(real), moved.shape_queries(dim, kinds, real)

    @wp.func(inline=False)
    def hidden_by_wall(shapes: S.Shapes, a: t.vec3, b: t.vec3, time: real):
        found = bool(False)
        for k in range(shapes.of.kind.shape[0]):
            if shapes.thin[k] != 0 and not found:
                found = s.between(shapes.of, k, s.spot(shapes, a), time, s.spot(shapes, b), time, -real(SLACK) * shapes.dx)
        return found

    return hidden_by_wall


@cache
def wall_closure_kernel(dim: int, kinds: tuple[str, ...], real, module):
    """Kernel over the faces of an axis: open_out 0 of those that a wall closes, and cut_out."""
    t, G, S, f = types(real), grid_structs(real), moved.fluid_shape_structs(real), grid_functions(dim, real)
    behind = hidden_wall_function(dim, kinds, real)

    def close_wall_faces(g: G.Grid, axis: int, shapes: S.Shapes, clock: wp.array(dtype=real), clear: wp.array(dtype=t.vec2),
                         open_out: wp.array(dtype=real), cut_out: wp.array(dtype=int)):
        c = wp.tid()
        i = f.place(c, f.faces(g, axis))
        j = wp.vec3i(wp.min(i[0], g.n[0] - 1), wp.min(i[1], g.n[1] - 1), wp.min(i[2], g.n[2] - 1))
        near = clear[flat_cell_index(j, g.n)]
        bits = int(0)
        if near[1] < real(REACH) * g.dx:
            at = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(axis)
            time = clock[0] + clock[1]
            half = t.vec3()
            half[axis] = real(0.5)
            if i[axis] > 0 and i[axis] < g.n[axis] or g.periodic[axis] != 0:
                if behind(shapes, at - half, at + half, time):
                    open_out[c] = real(0.0)
            for b in range(wp.static(dim)):
                next = at
                next[b] = at[b] + real(1.0)
                if behind(shapes, at, next, time):
                    bits = bits | (1 << b)
        cut_out[c] = bits

    return wp.kernel(close_wall_faces, name=f"walls_shut_{dim}d_{'_'.join(kinds)}_{t.name}", module=module,
                     enable_backward=False)


@cache
def particle_view_kernel(dim: int, kinds: tuple[str, ...], real, module):
    """Kernel over rows: seen_out and reach_out of each particle; share: of the cells."""
    t, G, S, T = types(real), grid_structs(real), moved.fluid_shape_structs(real), particle_structs(real)
    f, r, cell, s = (grid_functions(dim, real), transfer_stencils(dim, real), particle_cell_function(dim, real),
                     moved.shape_queries(dim, kinds, real))

    @wp.func
    def bits_hidden_by_wall(g: G.Grid, shapes: S.Shapes, k: int, x: t.vec3, start: real, end: real):
        """Bits of the rows about x [m] that wall k hides; a row on its surface is seen."""
        bits = int(0)
        y = s.spot(shapes, x / g.dx)
        phi, n, p = s.closest(shapes.of, k, y, start)
        slack = real(SLACK) * g.dx
        if phi < real(RAY) * g.dx + (end - start) * wp.length(s.rate(shapes, k, y, start)):
            corners = int(wp.static(2 ** dim))
            sets = int(wp.static(dim))                         # variables: the loops are compiled once
            for e in range(-1, sets):
                at = r.rows(g, e, x)
                base = t.vec3(wp.floor(at[0]), wp.floor(at[1]), real(0.0))
                if wp.static(dim == 3):
                    base[2] = wp.floor(at[2])
                for m in range(corners):
                    row = base + t.vec3(real(m % 2), real((m // 2) % 2), real(m // 4)) + f.offset(e)
                    if s.between(shapes.of, k, y, start, s.spot(shapes, row), end, slack):
                        bits = bits | (1 << ((e + 1) * corners + m))
        return bits

    @wp.func
    def visible_centers(g: G.Grid, share: wp.array(dtype=real), x: t.vec3, seen: int):
        """Bits of the rows about x [m] less those of closed cells, and the sum of the hats of centres that are left."""
        bits = seen
        sum = real(0.0)
        at = r.rows(g, -1, x)
        corners = int(wp.static(2 ** dim))
        for m in range(corners):
            row = wp.vec3i(int(wp.floor(at[0])) + m % 2, int(wp.floor(at[1])) + (m // 2) % 2, 0)
            w = r.hat(at[0] - real(row[0])) * r.hat(at[1] - real(row[1]))
            if wp.static(dim == 3):
                row[2] = int(wp.floor(at[2])) + m // 4
                w *= r.hat(at[2] - real(row[2]))
            if w > real(0.0) and r.sees(bits, -1, m):
                if share[f.row(row[0], row[1], row[2], g.n, g.periodic)] > real(0.0):
                    sum += w
                else:
                    bits = bits & ~(1 << m)
        return bits, sum

    def find_visible_rows(g: G.Grid, shapes: S.Shapes, clock: wp.array(dtype=real), clear: wp.array(dtype=t.vec2),
                          share: wp.array(dtype=real), particles: T.Particles, seen_out: wp.array(dtype=int),
                          reach_out: wp.array(dtype=real)):
        p = wp.tid()
        bits = int(-1)
        reach = real(1.0)
        if particles.id[p] >= 0:
            x = particles.x[p]
            near = clear[flat_cell_index(cell(g, x), g.n)]
            if near[1] < real(REACH) * g.dx:
                for k in range(shapes.of.kind.shape[0]):
                    if shapes.thin[k] != 0:
                        bits = bits & ~bits_hidden_by_wall(g, shapes, k, x, clock[1], clock[0] + clock[1])
                bits, reach = visible_centers(g, share, x, bits)
        seen_out[p] = bits
        reach_out[p] = reach

    return wp.kernel(find_visible_rows, name=f"walls_see_{dim}d_{'_'.join(kinds)}_{t.name}", module=module,
                     enable_backward=False)
