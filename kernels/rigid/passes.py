"""The passes of a substep: over bodies, and over the constraints between them, kind by kind and colour by colour.

    impacts, forces, warm start, sweeps, places, sweeps without bias          see kernels/rigid/soft_step.py

All passes of many substeps are one launch of threads that meet after each: one thread on a CPU, a block, or a cluster of
blocks. Kinds (kernels/rigid/kinds.py) follow one another in a sweep in the order of their list. Each pass is called at one
place of the kernel, within loops: compilers put a function in wherever it is called, and take their time at each place.
"""

from collections.abc import Callable, Sequence
from types import SimpleNamespace

import warp as wp

from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.impact import impact_func
from wsim.kernels.rigid.kinds import ConstraintKind, acts_of_kind, at_once_func, by_colour, first_of_thread, walk_in_turn_func
from wsim.kernels.rigid.lists.worlds import body_straying_func, straying_reset_func
from wsim.kernels.rigid.soft_step import body_steps


def over_bodies(real):
    """(begun, placed, ended): functions of the bodies, what precedes the constraints' sweeps and what follows them."""
    Rig, (oriented, turned, forces, place), stray = rig_type(real), body_steps(real), body_straying_func(real)
    clear = straying_reset_func(real)

    @wp.func
    def begin_body_substep(i: int, threads: int, h: real, rig: Rig):
        clear(i, threads, rig)
        for b in range(first_of_thread(i, threads), rig.b.w.shape[0], threads):
            forces(b, h, rig)

    @wp.func
    def orient_body_frames(i: int, threads: int, k: int, last: int, rig: Rig):
        n = rig.b.w.shape[0]
        for f in range(first_of_thread(i, threads), last, threads):     # by the thread that places it
            if f < n:
                oriented(f, rig)
            else:
                turned(f, k, rig)

    @wp.func
    def place_body_frames(i: int, threads: int, k: int, rig: Rig):
        """Where substep k begins."""
        orient_body_frames(i, threads, k, rig.work.turn.shape[0], rig)

    @wp.func
    def end_body_substep(i: int, threads: int, k: int, h: real, rig: Rig):
        for b in range(first_of_thread(i, threads), rig.b.w.shape[0], threads):
            place(b, h, rig)
            stray(b, h, rig)
        last = rig.b.w.shape[0]
        if rig.still.moving == 1:                       # of colliders that stand, once is enough
            last = rig.work.turn.shape[0]
        orient_body_frames(i, threads, k + 1, last, rig)

    return begin_body_substep, place_body_frames, end_body_substep


def constraint_walks(kinds: Sequence[ConstraintKind], real, meet: Callable, bouncing: bool, **impact) -> SimpleNamespace:
    """prepare, warm, solve, thrown: functions of all constraints. bouncing: the last kind has impacts; impact: of
    `impact_func`."""
    Rig, act = rig_type(real), [acts_of_kind(kind, real) for kind in kinds]
    prepare = walk_in_turn_func([at_once_func(kind, a.prepare, real) for kind, a in zip(kinds, act, strict=True)], real)
    warm = walk_in_turn_func([by_colour(kind, a.warm, meet, real) for kind, a in zip(kinds, act, strict=True)], real)
    solve = walk_in_turn_func([by_colour(kind, a.solve, meet, real) for kind, a in zip(kinds, act, strict=True)], real)
    if bouncing:
        impact_pass_or_none = impact_func(kinds[-1], meet, real, **impact)
    else:
        @wp.func
        def impact_pass_or_none(i: int, threads: int, k: int, h: real, rig: Rig):
            return
    return SimpleNamespace(prepare=prepare, warm=warm, solve=solve, thrown=impact_pass_or_none)


def body_substep_kernel(kinds: Sequence[ConstraintKind], real, module, meet: Callable, threads: int = 0, cluster: int = 0,
                        bouncing: bool = False):
    """Kernel of substeps steps[0] .. steps[1] of a frame, of h [s], with steps[2] sweeps each, by so many threads that `meet`.
    Manifolds are those of steps[0], and prepared, unless that is 0.

    threads, cluster: of a block, and blocks of a cluster, on CUDA. bouncing: the last kind has impacts."""
    Rig, w = rig_type(real), constraint_walks(kinds, real, meet, bouncing)
    begun, placed, ended = over_bodies(real)
    prepare, warm, solve, thrown = w.prepare, w.warm, w.solve, w.thrown

    def rigid_substeps(steps: wp.vec3i, h: real, threads: int, rig: Rig):
        i = wp.tid()
        if steps[0] == 0:
            placed(i, threads, 0, rig)
        meet()
        for k in range(steps[0] - 1, steps[1]):              # before the first of a frame, arms alone
            if k >= steps[0]:
                thrown(i, threads, k, h, rig)
                begun(i, threads, h, rig)
                meet()
                warm(i, threads, k, h, 1, rig)
            for sweep in range(steps[2] + 1):                # the last without bias
                biased = int(1)
                if sweep == steps[2]:
                    biased = 0
                    if k >= steps[0]:
                        ended(i, threads, k, h, rig)
                        meet()
                    if k >= steps[0] or k < 0:
                        prepare(i, threads, k + 1, h, biased, rig)
                    meet()
                if k >= steps[0]:
                    solve(i, threads, k, h, biased, rig)

    more = {"launch_bounds": threads} if threads else {}
    return wp.kernel(rigid_substeps, name="rigid_substeps", module=module, enable_backward=False, grid_stride=False,
                     **more, **({"cluster_dim": cluster} if cluster else {}))
