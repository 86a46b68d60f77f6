"""The substep of kernels/rigid/complementarity/converged.py in four launches, between which a recording looks.

    placed    arms, gaps      thrown    a round of impacts
    held    forces, sweeps with bias        loosed    places, sweeps without
"""

from collections.abc import Callable, Sequence

import warp as wp

from wsim.kernels.rigid.complementarity.converged import FINE, converged_sweep_func
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.kinds import ConstraintKind
from wsim.kernels.rigid.passes import constraint_walks, over_bodies


def converged_parts(kinds: Sequence[ConstraintKind], real, module, meet: Callable, threads: int = 0, cluster: int = 0,
                    bouncing: bool = False) -> list:
    """Kernels placed, thrown, held, loosed of substep steps[0], of h [s]; others as `converged`. thrown: a round of impacts."""
    Rig, w = rig_type(real), constraint_walks(kinds, real, meet, bouncing, met=FINE, timed=True, rounds=1)
    begun, placed, ended = over_bodies(real)
    prepare, warm, thrown = w.prepare, w.warm, w.thrown
    solved = converged_sweep_func(kinds, real, meet, w.solve)

    def rigid_met_placed(steps: wp.vec3i, h: real, threads: int, tolerance: real, rig: Rig):
        i = wp.tid()
        placed(i, threads, steps[0], rig)
        meet()
        prepare(i, threads, steps[0], h, 1, rig)

    def rigid_met_thrown(steps: wp.vec3i, h: real, threads: int, tolerance: real, rig: Rig):
        thrown(wp.tid(), threads, steps[0], h, rig)

    def rigid_met_held(steps: wp.vec3i, h: real, threads: int, tolerance: real, rig: Rig):
        i = wp.tid()
        k = steps[0]
        begun(i, threads, h, rig)
        meet()
        warm(i, threads, k, h, 1, rig)
        solved(i, threads, k, h, 1, tolerance, rig)

    def rigid_met_loosed(steps: wp.vec3i, h: real, threads: int, tolerance: real, rig: Rig):
        i = wp.tid()
        k = steps[0]
        ended(i, threads, k, h, rig)
        meet()
        prepare(i, threads, k + 1, h, 0, rig)
        meet()
        solved(i, threads, k, h, 0, tolerance, rig)

    more = {"launch_bounds": threads} if threads else {}
    more |= {"cluster_dim": cluster} if cluster else {}
    return [wp.kernel(each, name=each.__name__, module=module, enable_backward=False, grid_stride=False, **more)
            for each in (rigid_met_placed, rigid_met_thrown, rigid_met_held, rigid_met_loosed)]
