"""Particles that come and go: sources keep their shape full, sinks empty theirs.

A cell has ACROSS parts along each axis. Where the middle of a part is within a source and no particle is near, one is put
there, with the velocity of the source: as many come as the flow makes room for. Near is, along every axis, less than
1/2 - d / 2 cells, d being how far the source's velocity goes in a step: what flows off is then 1/2 - d / 2 to 1/2 + d / 2 cells
apart, 1/2 on average. New ones are counted by cell, then put behind those that are there, in the order of cells: the same in
every run. A closed region takes no more than it holds (kernels/particles/rooms.py).

    strength    of each at the start and at the end of the frame; it acts while above 0
"""

# ruff: noqa: UP018, SIM102

from functools import cache

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import particle_structs
from wsim.kernels.particles.transfers import transfer_stencils

SINK = 1                 # what a source is; 0: it gives
LEAST = 0.25             # cells, however fast the source is


@cache
def emission_sources(real):
    t, S = types(real), moved.fluid_shape_structs(real)

    @wp.struct
    class EmissionSources:
        shapes: S.Shapes
        walls: S.Shapes                        # obstacles: what is within one gives nothing there
        what: wp.array(dtype=int)
        velocity: wp.array(dtype=t.vec3)       # [m/s], along the axes of the grid
        strength: wp.array(dtype=t.vec2)

    return EmissionSources


@wp.struct
class Coming:
    offers: wp.array(dtype=int)            # particles that sources would put into each cell
    first: wp.array(dtype=int)             # those that come, summed before each cell, (cells + 1,)
    numbers: wp.array(dtype=int)           # rows that are used, id of the next particle
    refused: wp.array(dtype=int)           # 1 of a source that gave less than it offered


@cache
def source_containing_function(dim: int, kinds: tuple[str, ...], real):
    """Function (sources, x, clock, what) -> which of that kind a place x [cells] is within; -1: none."""
    t, Sources, s = types(real), emission_sources(real), moved.shape_queries(dim, kinds, real)

    @wp.func
    def source_containing(sources: Sources, x: t.vec3, clock: wp.array(dtype=real), what: int):
        found = int(-1)
        at = clock[1] + clock[0]
        for k in range(sources.what.shape[0]):
            both = sources.strength[k]
            if sources.what[k] == what and both[0] + (both[1] - both[0]) * at / clock[3] > real(0.0):
                if s.signed(sources.shapes.of, k, s.spot(sources.shapes, x), at) < real(0.0):
                    found = k
        return found

    return source_containing


@cache
def particle_drain_kernel(dim: int, kinds: tuple[str, ...], real, module):
    """Kernel over rows: a particle within a sink is none any more."""
    T, Sources, within = particle_structs(real), emission_sources(real), source_containing_function(dim, kinds, real)

    def drain_particles(dx: real, of: Sources, clock: wp.array(dtype=real), particles: T.Particles,
                        id_out: wp.array(dtype=int)):
        p = wp.tid()
        if particles.id[p] >= 0:
            if within(of, particles.x[p] / dx, clock, SINK) >= 0:
                id_out[p] = -1

    return wp.kernel(drain_particles, name=f"particles_drain_{dim}d_{'_'.join(kinds)}_{types(real).name}", module=module,
                     enable_backward=False)


@cache
def vacancy_functions(dim: int, kinds: tuple[str, ...], walls: tuple[str, ...], real):
    """Functions: middle(i, m) -> place of part m of cell i [cells]; vacancies(g, particles, cells, of, clock, i) -> bits of the
    parts of cell i that lack a particle."""
    t, S, T, s = types(real), grid_structs(real), particle_structs(real), transfer_stencils(dim, real)
    Sources, within = emission_sources(real), source_containing_function(dim, kinds, real)
    solid = moved.shape_queries(dim, walls or kinds, real)

    @wp.func
    def inside_obstacle(of: Sources, x: t.vec3, time: real):
        """Whether a place [cells] is within an obstacle."""
        found = bool(False)
        if wp.static(len(walls) > 0):
            for k in range(of.walls.of.kind.shape[0]):
                if solid.signed(of.walls.of, k, solid.spot(of.walls, x), time) < real(1.0e-3) * of.walls.dx:
                    found = bool(True)
        return found

    @wp.func
    def cell_part_middle(i: wp.vec3i, m: int):
        x = t.vec3(real(i[0]) + real(0.25) + real(0.5) * real(m % 2),
                   real(i[1]) + real(0.25) + real(0.5) * real((m // 2) % 2), real(0.0))
        if wp.static(dim == 3):
            x[2] = real(i[2]) + real(0.25) + real(0.5) * real(m // 4)
        return x

    @wp.func
    def cell_part_is_free(g: S.Grid, particles: T.Particles, cells: T.Cells, i: wp.vec3i, x: t.vec3, least: real):
        """Whether no particle is near x, a place in cell i."""
        depth = int(wp.static(int(dim == 3)))
        for a in range(i[0] - 1, i[0] + 2):
            for b in range(i[1] - 1, i[1] + 2):
                for d in range(i[2] - depth, i[2] + depth + 1):
                    j, shift = s.image(g, wp.vec3i(a, b, d))
                    if j[0] >= 0:
                        c = flat_cell_index(j, g.n)
                        for k in range(cells.first[c], cells.first[c + 1]):
                            away = particles.x[cells.order[k]] / g.dx + shift - x
                            far = wp.max(wp.abs(away[0]), wp.abs(away[1]))
                            if wp.static(dim == 3):
                                far = wp.max(far, wp.abs(away[2]))
                            if far < least:
                                return False
        return True

    @wp.func
    def vacant_cell_parts(g: S.Grid, particles: T.Particles, cells: T.Cells, of: Sources, clock: wp.array(dtype=real),
                          i: wp.vec3i):
        bits = int(0)
        for m in range(wp.static(2 ** dim)):
            x = cell_part_middle(i, m)
            k = within(of, x, clock, 0)
            if k >= 0:
                way = wp.length(of.velocity[k]) * clock[0] / g.dx
                least = wp.max(real(0.5) - real(0.5) * way, real(LEAST))
                if cell_part_is_free(g, particles, cells, i, x, least) and not inside_obstacle(of, x, clock[1]):
                    bits = bits | (1 << m)
        return bits

    return cell_part_middle, vacant_cell_parts


@cache
def particle_offer_kernel(dim: int, kinds: tuple[str, ...], walls: tuple[str, ...], real, module):
    """Kernel over cells: how many particles come into each. walls: kinds of the obstacles."""
    S, T, f, Sources = grid_structs(real), particle_structs(real), grid_functions(dim, real), emission_sources(real)
    _, lacking = vacancy_functions(dim, kinds, walls, real)

    def offer_particles(g: S.Grid, particles: T.Particles, cells: T.Cells, of: Sources, clock: wp.array(dtype=real),
                        count_out: wp.array(dtype=int)):
        c = wp.tid()
        bits = lacking(g, particles, cells, of, clock, f.place(c, g.n))
        count = int(0)
        for m in range(wp.static(2 ** dim)):
            count += (bits >> m) & 1
        count_out[c] = count

    return wp.kernel(offer_particles, name=f"particles_offer_{dim}d_{'_'.join((*kinds, *walls))}_{types(real).name}",
                     module=module, enable_backward=False)


@cache
def particle_emission_kernel(dim: int, kinds: tuple[str, ...], walls: tuple[str, ...], affine: bool, real, module):
    """Kernel over cells: the particles that come into each, of those that were offered."""
    t, S, T, f, Sources = (types(real), grid_structs(real), particle_structs(real), grid_functions(dim, real),
                           emission_sources(real))
    middle, lacking = vacancy_functions(dim, kinds, walls, real)
    within = source_containing_function(dim, kinds, real)

    def emit_particles(g: S.Grid, particles: T.Particles, cells: T.Cells, of: Sources, clock: wp.array(dtype=real),
                       coming: Coming, out: T.Particles):
        c = wp.tid()
        if coming.offers[c] > 0:
            i = f.place(c, g.n)
            bits = lacking(g, particles, cells, of, clock, i)
            k = coming.first[c]
            for m in range(wp.static(2 ** dim)):
                if ((bits >> m) & 1) != 0:
                    row = coming.numbers[0] + k
                    x = middle(i, m)
                    source = within(of, x, clock, 0)
                    if k >= coming.first[c + 1]:
                        coming.refused[source] = 1
                    elif row < out.id.shape[0]:
                        out.x[row] = g.dx * x
                        out.v[row] = of.velocity[source]
                        if wp.static(affine):
                            out.C[row] = t.mat33()
                        out.id[row] = coming.numbers[1] + k
                    k += 1

    name = f"particles_emit{'_affine' * affine}_{dim}d_{'_'.join((*kinds, *walls))}_{types(real).name}"
    return wp.kernel(emit_particles, name=name, module=module, enable_backward=False)


@cache
def emission_count_kernels(module):
    """Kernels of one thread: used (first, last) -> numbers[0] where a frame begins; come (first, last, room) -> numbers after
    an emission, and the rows that it wanted."""

    def count_used_rows(first: wp.array(dtype=int), last: int, numbers_out: wp.array(dtype=int)):
        numbers_out[0] = first[last]

    def count_emitted_rows(first: wp.array(dtype=int), last: int, room: int, numbers_out: wp.array(dtype=int),
                           wanted_out: wp.array(dtype=int)):
        n = numbers_out[0] + first[last]
        wanted_out[0] = wp.max(wanted_out[0], n)
        numbers_out[0] = wp.min(n, room)
        numbers_out[1] = numbers_out[1] + first[last]

    return [wp.kernel(f, name=f"particles_{f.__name__}", module=module, enable_backward=False)
            for f in (count_used_rows, count_emitted_rows)]
