"""Room for what sources give: never more particles than a closed region of the domain holds at their density at rest.

    room        region that obstacles and closed sides seal (kernels/fluid/solver/islands.py: its root cell is its number); one
                with an open side has no limit
    capacity    2^dim sum of o over its cells, o: part of a cell outside of obstacles; whole parts of 1 / UNIT
    offers      particles that come into each cell, in the order of cells; none into cells that obstacles cover. In a room that
                lacks space those behind its limit stay out. Offers of several rooms are counted together, so that never too
                many come into one

Sums are of integers: the same in every run.
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.fluid.solver.islands import Forest
from wsim.kernels.particles.volume import open_fraction

UNIT = 1 << 20           # parts of a cell that capacities are counted in
ALMOST = 1e-3            # of a particle, which is not worth more than rounding


@wp.struct
class ParticleRooms:
    capacity: wp.array(dtype=wp.int64)     # of a root: parts of cells
    held: wp.array(dtype=int)              # of a root: particles
    wanted: wp.array(dtype=int)            # of a root: particles that are offered


@cache
def room_counter_kernels(dim: int, obstacles: bool, real, module) -> SimpleNamespace:
    """Kernels over cells: measure (capacities), clear (what a
    step counts, and offers that are in no room), count (particles held and wanted), limit (offers that find room)."""
    S, f, part_of = grid_structs(real), grid_functions(dim, real), open_fraction(dim, real)

    def measure_room_capacity(g: S.Grid, shape: wp.vec3i, solid: wp.array(dtype=real), of: Forest, out: ParticleRooms):
        c = wp.tid()
        r = of.label[c]
        if r >= 0:
            o = wp.float64(1.0)
            if wp.static(obstacles):
                o = part_of(g.dx, shape, solid, f.place(c, g.n))
            wp.atomic_add(out.capacity, r, wp.int64(wp.rint(o * wp.float64(UNIT))))

    def clear_room_counts(of: Forest, out: ParticleRooms, offers_out: wp.array(dtype=int)):
        c = wp.tid()
        if of.label[c] < 0:
            offers_out[c] = 0
        out.held[c] = 0
        out.wanted[c] = 0

    def count_room_particles(first: wp.array(dtype=int), offers: wp.array(dtype=int), of: Forest, out: ParticleRooms):
        c = wp.tid()
        r = of.label[c]
        if r >= 0:
            n = first[c + 1] - first[c]
            if n > 0:
                wp.atomic_add(out.held, r, n)
            if offers[c] > 0:
                wp.atomic_add(out.wanted, r, offers[c])

    def limit_room_offers(offers: wp.array(dtype=int), before: wp.array(dtype=int), of: Forest, rooms: ParticleRooms,
                          out: wp.array(dtype=int)):
        c = wp.tid()
        n = offers[c]
        r = of.label[c]
        if n > 0 and r >= 0:
            if of.vented[r] == 0:
                most = wp.float64(rooms.capacity[r]) * wp.float64(wp.static(2 ** dim)) / wp.float64(UNIT)
                left = int(wp.floor(most + wp.float64(ALMOST))) - rooms.held[r]
                if left < rooms.wanted[r]:
                    n = wp.clamp(left - before[c], 0, n)
                if left <= 0:
                    n = 0
        out[c] = n

    name = f"{'obstacles_' * obstacles}{f.name}"
    make = [wp.kernel(k, name=f"rooms_{k.__name__}_{name}", module=module, enable_backward=False)
            for k in (measure_room_capacity, clear_room_counts, count_room_particles, limit_room_offers)]
    return SimpleNamespace(measure=make[0], clear=make[1], count=make[2], limit=make[3])
