"""The substep of kernels/rigid/passes.py in three launches, between which points push bodies (kernels/rigid/touch/points.py).

    begin     impacts, forces, and the impulses that the substep before has left
    sweep     bodies against each other and against colliders, in turn with the points
    end       places, and sweeps without bias

If joints hold bodies that bounce, impacts are a launch of their own (kernels/rigid/joint/impacts.py). A fourth kernel computes
the lever arms and gaps that this launch needs.
"""

from collections.abc import Callable, Sequence
from functools import cache

import warp as wp

from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.impact import impact_func
from wsim.kernels.rigid.kinds import SERIAL, ConstraintKind, acts_of_kind, at_once_func, by_colour, walk_in_turn_func
from wsim.kernels.rigid.passes import over_bodies


def touch_step(kinds: Sequence[ConstraintKind], real, module, meet: Callable, threads: int = 0, cluster: int = 0,
               bouncing: bool = False, linked: bool = False) -> list:
    """Kernels begin and end, and `ready` if linked bodies bounce, for substep steps[0] of a frame, of h [s]; the other
    arguments as of `passes.substeps`."""
    Rig, act = rig_type(real), [acts_of_kind(kind, real) for kind in kinds]
    begun, placed, ended = over_bodies(real)
    prepare = walk_in_turn_func([at_once_func(kind, a.prepare, real) for kind, a in zip(kinds, act, strict=True)], real)
    warm = walk_in_turn_func([by_colour(kind, a.warm, meet, real) for kind, a in zip(kinds, act, strict=True)], real)
    solve = walk_in_turn_func([by_colour(kind, a.solve, meet, real) for kind, a in zip(kinds, act, strict=True)], real)
    apart = bouncing and linked
    if bouncing and not apart:
        impact_step_or_none = impact_func(kinds[-1], meet, real)
    else:
        @wp.func
        def impact_step_or_none(i: int, threads: int, k: int, h: real, rig: Rig):
            return

    def rigid_touch_begin(steps: wp.vec3i, h: real, threads: int, rig: Rig):
        i = wp.tid()
        k = steps[0]
        placed(i, threads, k, rig)
        meet()
        prepare(i, threads, k, h, 1, rig)
        meet()
        impact_step_or_none(i, threads, k, h, rig)
        begun(i, threads, h, rig)
        meet()
        warm(i, threads, k, h, 1, rig)

    def rigid_touch_ready(steps: wp.vec3i, h: real, threads: int, rig: Rig):
        i = wp.tid()
        placed(i, threads, steps[0], rig)
        meet()
        prepare(i, threads, steps[0], h, 1, rig)

    def rigid_touch_end(steps: wp.vec3i, h: real, threads: int, rig: Rig):
        i = wp.tid()
        k = steps[0]
        ended(i, threads, k, h, rig)
        meet()
        prepare(i, threads, k + 1, h, 0, rig)
        meet()
        solve(i, threads, k, h, 0, rig)

    passes = rigid_touch_begin, rigid_touch_end, *[rigid_touch_ready] * apart
    return [block_launch_kernel(each, module, threads, cluster) for each in passes]


def block_launch_kernel(function, module, threads: int, cluster: int):
    """A kernel of threads that meet."""
    more = {"launch_bounds": threads} if threads else {}
    more |= {"cluster_dim": cluster} if cluster else {}
    return wp.kernel(function, name=function.__name__, module=module, enable_backward=False, grid_stride=False, **more)


def touch_sweep(kinds: Sequence[ConstraintKind], real, module, meet: Callable, threads: int = 0, cluster: int = 0,
                bouncing=False):
    """Kernel of steps[2] sweeps of substep steps[0]; the other arguments as of `touch_step`."""
    Rig, act = rig_type(real), [acts_of_kind(kind, real) for kind in kinds]
    solve = walk_in_turn_func([by_colour(kind, a.solve, meet, real) for kind, a in zip(kinds, act, strict=True)], real)

    def rigid_touch_sweep(steps: wp.vec3i, h: real, threads: int, rig: Rig):
        for _sweep in range(steps[2]):
            solve(wp.tid(), threads, steps[0], h, 1, rig)

    return block_launch_kernel(rigid_touch_sweep, module, threads, cluster)


@cache
def world_sweep_func(kinds: Sequence[ConstraintKind], real, together, threads: int):
    """Function: a sweep over the constraints of a world, colour by colour."""
    Rig = rig_type(real)

    def sweep_of_kind(kind: ConstraintKind):
        colours, start, item, solve = kind.colours, kind.start, kind.item, kind.solve

        @wp.func
        def sweep_world_constraints(w: int, lane: int, k: int, h: real, rig: Rig):
            for colour in range(colours(rig)):
                last = start(colour + 1, rig)
                slot = start(colour, rig) + lane
                stride = wp.static(threads)
                if colour >= SERIAL:
                    stride = 1
                    if lane > 0:
                        slot = last
                while slot < last:
                    j = item(slot, rig)
                    if rig.c.count[j] > 0:
                        if wp.max(rig.s.world[rig.c.a[j]], rig.s.world[rig.c.b[j]]) == w:
                            solve(j, k, h, 1, rig)
                    slot += stride
                together()

        return sweep_world_constraints

    return sweep_of_kind(kinds[-1])
