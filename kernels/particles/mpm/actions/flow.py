"""Particles that come and go: what pours in wakes at its time, what is within a sink is gone. `there` of the particles:

    0  it has not come yet      1  it is there      2 + k  sink k has taken it

Rows of all that will come stand in the tables from the start, at the places where they come
(wsim/physics/mpm/sources/pouring.py). One that comes late by s within a step begins at x + s v, so that a stream keeps its
spacing whatever the steps are. Until it comes, it bounds the steps of its frame as one that is there.
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.cpu.atomics import real_raise
from wsim.kernels.particles.mpm.motion import motion_functions
from wsim.kernels.particles.mpm.tables import point_tables

WAITS, THERE, TAKEN = wp.constant(0), wp.constant(1), wp.constant(2)


@cache
def birth_table(real):
    """Struct: particles in the order in which they come."""
    @wp.struct
    class BirthRows:
        row: wp.array(dtype=int)
        frame: wp.array(dtype=int)         # in which each comes
        age: wp.array(dtype=real)          # when, from where that frame begins [s]
        first: wp.array(dtype=int)         # of each frame, (frames + 1,)
        now: wp.array(dtype=int)           # frame that runs
        dt: real                           # of a frame [s]

    return BirthRows


@cache
def birth_kernels(laws: tuple[str, ...], waves: bool, real, module, team: bool = False) -> SimpleNamespace:
    """Kernels over as many threads as come in two frames. measure_births: the steps that what comes in this frame needs,
    before its first; wake_particles: at the start of a step, those that have come before it. waves: steps are as short as waves
    need. team: threads of a CPU share them."""
    t, T, B, f = types(real), point_tables(real), birth_table(real), motion_functions(laws, real)
    raise_pace = real_raise(real)

    @wp.func
    def waiting_row(b: B, thread: int):
        """Place in the table of what may come to a thread; -1: none. Last frame's last step has left some."""
        frames = b.first.shape[0] - 1
        now = wp.min(b.now[0], frames - 1)
        k = b.first[wp.max(now - 1, 0)] + thread
        if b.now[0] > frames or k >= b.first[now + 1]:
            return -1
        return k

    @wp.func
    def birth_rate(points: T.PointRows, materials: T.MaterialRows, p: int, dx: real):
        row = points.row[p]
        m = materials.numbers[row]
        return f.step_rate(points.a[p], materials.density[row], m[7], points.C[p], points.v[p], dx)

    def measure_births(points: T.PointRows, materials: T.MaterialRows, b: B, dx: real, pace: wp.array(dtype=real)):
        k = waiting_row(b, wp.tid())
        if k >= 0:
            if points.there[b.row[k]] == WAITS:
                wp.atomic_max(pace, 0, birth_rate(points, materials, b.row[k], dx))

    def wake_particles(points: T.PointRows, materials: T.MaterialRows, b: B, dx: real, clock: wp.array(dtype=real),
                       pace: wp.array(dtype=real)):
        k = waiting_row(b, wp.tid())
        if k >= 0:
            p = b.row[k]
            if points.there[p] == WAITS:
                late = clock[1] + real(b.now[0] - b.frame[k]) * b.dt - b.age[k]
                if late >= real(0.0):
                    points.there[p] = THERE
                    f.shift_particle(points, p, points.i[p], points.j[p], points.k[p], points.o[p], (late / dx) * points.v[p])
                elif wp.static(waves and team):
                    raise_pace(pace, 1, birth_rate(points, materials, p, dx))
                elif wp.static(waves):
                    wp.atomic_max(pace, 1, birth_rate(points, materials, p, dx))

    form = "waves_" * waves + "team_" * team
    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'_'.join(laws)}_{form}{t.name}", module=module,
                                    enable_backward=False)
            for k in (measure_births, wake_particles)}
    return SimpleNamespace(**made)


@cache
def sink_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over particles, sinks, clock: those within a sink at the start of a step are gone."""
    t, T, Colliders = types(real), point_tables(real), collider_type(real)
    ask = collider_queries(kinds, real)

    def take_particles(points: T.PointRows, sinks: Colliders, dx: real, clock: wp.array(dtype=real)):
        p = wp.tid()
        if points.there[p] == THERE:
            y = dx * (t.vec3(real(points.i[p]), real(points.j[p]), real(points.k[p])) + points.o[p])
            for k in range(sinks.kind.shape[0]):
                if ask.signed(sinks, k, y, clock[1]) < real(0.0):
                    points.there[p] = TAKEN + k
                    points.v[p] = t.vec3()
                    return

    return wp.kernel(take_particles, name=f"mpm_take_particles_{'_'.join(kinds)}_{t.name}", module=module,
                     enable_backward=False)
