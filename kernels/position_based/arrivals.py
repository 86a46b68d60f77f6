"""Particles that come and go: a particle appears at its time, and one within a sink is gone. `there` of a point of the state:

    0  it has not come yet      1  it is there      2 + k  sink k has taken it

Rows of all that will come stand in the state from the start, where they appear (wsim/physics/particles/pouring.py). One that is
not there has the inverse mass 0, and neighbours leave it out (kernels/position_based/neighbours.py): nothing moves it or meets
it. One that comes late by s within a substep begins at x + s v, so that a stream keeps its spacing whatever the substeps are.

Which are there is decided where a substep begins, from `there` alone: a frame that is repeated, or a run that goes on from a
file, has the same bits.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.math.real import types
from wsim.kernels.position_based.neighbours import neighbour_structs

WAITS, THERE, TAKEN = wp.constant(0), wp.constant(1), wp.constant(2)
EARLY = 1e-6           # of a frame, by which rounding may bring a particle before its time
CROWDED = 0.9          # of the sum of two radii: what appears nearer to another is counted


@cache
def arrival_structs(real) -> SimpleNamespace:
    """Structs: ArrivalTable (what comes, by row), PresentTable (all particles, by row)."""
    t = types(real)

    @wp.struct
    class ArrivalTable:
        point: wp.array(dtype=int)         # place among the points of the state, (rows,)
        x: wp.array(dtype=t.vec3)          # where it appears, from the origin of its object [m]
        v: wp.array(dtype=t.vec3)          # [m/s]
        frame: wp.array(dtype=int)         # in which it comes
        age: wp.array(dtype=t.scalar)      # when, from where that frame begins [s]
        fresh: wp.array(dtype=int)         # 1: it has come in this substep
        now: wp.array(dtype=int)           # frame that runs, (1,)
        dt: t.scalar                       # of a frame [s]

    @wp.struct
    class PresentTable:
        point: wp.array(dtype=int)         # place among the points of the state, (rows,)
        inverse: wp.array(dtype=t.scalar)  # inverse mass of one that is there [1/kg], 0 of one that is held
        shift: wp.array(dtype=t.vec3)      # origin of its object from the corner of the sinks [m]
        world: wp.array(dtype=int)
        held: wp.array(dtype=int)          # 1: a world that is taken out, (worlds,)

    return SimpleNamespace(ArrivalTable=ArrivalTable, PresentTable=PresentTable)


@cache
def arrival_kernel(real, module):
    """Kernel over what comes: those whose time has come where a substep begins, `passed` [s] after its frame."""
    t, S = types(real), arrival_structs(real)

    def bring_particles(rows: S.ArrivalTable, passed: real, there: wp.array(dtype=int), x: wp.array(dtype=t.vec3),
                        e: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3)):
        r = wp.tid()
        i = rows.point[r]
        rows.fresh[r] = 0
        if there[i] == WAITS:
            late = real(rows.now[0] - rows.frame[r]) * rows.dt + (passed - rows.age[r])
            if late >= -real(EARLY) * rows.dt:
                there[i] = THERE
                rows.fresh[r] = 1
                x[i] = rows.x[r] + late * rows.v[r]
                e[i] = t.vec3()
                v[i] = rows.v[r]

    return wp.kernel(bring_particles, name=f"arrivals_bring_{t.name}", module=module, enable_backward=False)


@cache
def departure_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over all particles: those within a sink at `time` [s] of a frame are gone; inverse masses. kinds: of the sinks'
    shapes, none where there are no sinks."""
    t, S, Colliders = types(real), arrival_structs(real), collider_type(real)
    ask, sinking = (collider_queries(kinds, real) if kinds else None), bool(kinds)

    def take_particles(rows: S.PresentTable, sinks: Colliders, time: real, there: wp.array(dtype=int),
                       x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), w: wp.array(dtype=real)):
        r = wp.tid()
        i = rows.point[r]
        if wp.static(sinking):
            if there[i] == THERE:
                for k in range(sinks.kind.shape[0]):
                    if there[i] == THERE:
                        if ask.signed(sinks, k, x[i] + rows.shift[r], time) < real(0.0):
                            there[i] = TAKEN + k
                            v[i] = t.vec3()
        w[i] = wp.where(there[i] == THERE and rows.held[rows.world[r]] == 0, rows.inverse[r], real(0.0))

    name = f"arrivals_take_{'_'.join(kinds)}_{t.name}"
    return wp.kernel(take_particles, name=name, module=module, enable_backward=False)


@cache
def crowding_kernel(real, module):
    """Kernel over what comes: how many have appeared where others are. number: of each among the particles that are searched,
    -1: none; radius: by place among the points of the state [m]."""
    t, S, N = types(real), arrival_structs(real), neighbour_structs(real)

    def count_crowded_arrivals(rows: S.ArrivalTable, number: wp.array(dtype=int), search: N.ParticleTable, c: N.CellTable,
                               lists: N.PairLists, radius: wp.array(dtype=real), x: wp.array(dtype=t.vec3),
                               crowded: wp.array(dtype=int)):
        r = wp.tid()
        p = number[r]
        if rows.fresh[r] == 0 or p < 0:
            return
        i = rows.point[r]
        k = c.place[p]
        y = x[i] + search.shift[p]
        for s in range(lists.count[k]):
            o = c.order[lists.other[s * lists.size + k]]
            j = search.point[o]
            least = real(CROWDED) * (radius[i] + radius[j])
            if wp.length_sq(y - x[j] - search.shift[o]) < least * least:
                wp.atomic_add(crowded, 0, 1)
                return

    return wp.kernel(count_crowded_arrivals, name=f"arrivals_crowd_{t.name}", module=module, enable_backward=False)
