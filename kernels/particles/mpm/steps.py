"""Steps of a frame: each as short as the particle needs that needs most, by what it was after the step before.

    pace    rates [1/s] that particles need: 0 as the step begins, 1 as it ends, and no less than SLOWER of the former
    clock   h, time in the frame [s]
    word    of the frame's status: blocks, particles of a cell, a particle (+ 1) that has left the grid, steps, and 100 times
            what a step was too long by
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.blocks import CROWD
from wsim.kernels.particles.mpm.motion import motion_functions
from wsim.kernels.particles.mpm.tables import point_tables

WORDS = 5
MOST = wp.constant(100000)         # steps of a frame
SLOWER = wp.constant(0.9)          # steps grow by no more; few particles then compete for the greatest rate
TOO_LONG = wp.constant(1.5)        # rate of what a step leaves over its own, from which the frame is repeated


@cache
def step_kernels(laws: tuple[str, ...], real, module, flow: bool = False) -> SimpleNamespace:
    """Kernels: measure_pace over `threads` that take particles a stride apart; begin_steps, next_step, of one thread. flow:
    particles come and go (actions/flow.py)."""
    t, T, f = types(real), point_tables(real), motion_functions(laws, real)

    def measure_pace(points: T.PointRows, materials: T.MaterialRows, dx: real, dt: real, threads: int,
                     pace: wp.array(dtype=real)):
        most = real(0.0)
        for p in range(wp.tid(), points.row.shape[0], threads):
            if wp.static(flow):
                if points.there[p] != 1:
                    continue
            row = points.row[p]
            m = materials.numbers[row]
            g = dt * wp.length(materials.gravity[materials.world[row]])
            v = points.v[p]
            speed = wp.length(v) + g
            most = wp.max(most, f.step_rate(points.a[p], materials.density[row], m[7], points.C[p],
                                            t.vec3(speed, real(0.0), real(0.0)), dx))
        wp.atomic_max(pace, 0, most)

    @wp.func
    def fit_step(left: real, rate: real, clock: wp.array(dtype=real)):
        """A step of which whole numbers make up the time that is left [s]."""
        clock[0] = left / wp.max(wp.ceil(left * rate), real(1.0))

    def begin_steps(dt: real, more: wp.array(dtype=real), pace: wp.array(dtype=real), clock: wp.array(dtype=real),
                    going: wp.array(dtype=int)):
        fit_step(dt, more[0] * pace[0], clock)
        clock[1] = real(0.0)
        pace[1] = real(SLOWER) * pace[0]
        going[0] = 1

    def next_step(dt: real, room: int, more: wp.array(dtype=real), pace: wp.array(dtype=real), clock: wp.array(dtype=real),
                  going: wp.array(dtype=int), word: wp.array(dtype=int)):
        word[3] = word[3] + 1
        clock[1] = clock[1] + clock[0]
        left = dt - clock[1]
        if pace[1] * clock[0] > real(TOO_LONG):
            word[4] = int(wp.min(wp.ceil(real(100.0) * pace[1] * clock[0]), real(1.0e9)))
        if left < real(0.5) * clock[0] or word[3] >= MOST or word[4] > 0 or word[2] > 0 or word[0] > room or word[1] > CROWD:
            going[0] = 0
        else:
            fit_step(left, more[0] * pace[1], clock)
            pace[0] = pace[1]
            pace[1] = real(SLOWER) * pace[1]

    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{'_'.join(laws)}_{'flow_' * flow}{t.name}", module=module,
                                    enable_backward=False)
            for k in (measure_pace, begin_steps, next_step)}
    return SimpleNamespace(**made)


@cache
def energy_kernel(laws: tuple[str, ...], real, module):
    """Kernel over particles: elastic energy [J]."""
    t, T, f = types(real), point_tables(real), motion_functions(laws, real)

    def measure_energy(points: T.PointRows, materials: T.MaterialRows, energy_out: wp.array(dtype=real)):
        p = wp.tid()
        row = points.row[p]
        energy_out[p] = points.volume[p] * f.energy(materials.law[row], f.read_strain(points, p), points.q[p],
                                                    materials.numbers[row])

    return wp.kernel(measure_energy, name=f"mpm_measure_energy_{'_'.join(laws)}_{t.name}", module=module,
                     enable_backward=False)
