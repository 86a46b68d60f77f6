"""Substeps of strands on a GPU, a launch for each part of an iteration: strains, contacts and moves by a thread a point, the
elimination from point to point by LANES threads a strand (lanes.py; iteration.py has the parts).

A strand's points come one after another in the elimination alone, of which a thread waits for each result. A strand waits for
no other: one that has solved its substep goes on with its next. Launches go over a list of strands: all, then those that are on
when half of them have ended, and the last few are finished by a warp each, in one launch. A strand stands anywhere in the list,
in the order of threads: nothing that is computed knows its place.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.rods.contact import Colliders
from wsim.kernels.rods.gpu_elimination.desk import strand_lane_barrier, warp_memory_barrier
from wsim.kernels.rods.gpu_elimination.iteration import apply_edge_correction, begin_strand_point, iteration_functions
from wsim.kernels.rods.gpu_elimination.lanes import lane_elimination_func
from wsim.kernels.rods.gpu_elimination.parts import LANES, RodParts
from wsim.kernels.rods.tables import RodMotion, RodPins, RodTable, RodTrial

GOING, LEFT = 0, 1               # words: 1, launches go on; strands that have not ended their frame
WARP = 32


@cache
def apart_step_kernels(kinds: tuple[str, ...], airy: bool, module: str, last: str):
    """Kernels over points (tid: point number * strands + place in the list) or strands: begin substeps (points), touch
    colliders with edges (points; launched only where there are any), measure (points), solve (place * LANES + lane), take
    (points), end substeps (points), finish (place * WARP + lane), enlist (strands). said: as `march.strands` has it. kinds: of
    colliders. airy: with air. few: strands at which a kind of launches ends. last: module of the kernel that finishes:
    NVRTC takes as long for it as for all others, and does both at once."""
    meets, parts, eliminate = bool(kinds), iteration_functions(kinds, airy), lane_elimination_func(bool(kinds), airy)
    touch, measure, judge, move, end = parts.meet, parts.measure, parts.judge, parts.move, parts.end
    apart = iteration_functions(kinds, airy, called=True)
    touch_alone, measure_alone, end_alone = apart.meet, apart.measure, apart.end

    @wp.kernel(enable_backward=False, module=module)
    def begin_points(S: RodTable, H: RodPins, Q: RodMotion, T: RodTrial, A: RodParts, few: int, words: wp.array(dtype=int)):
        m = S.points.shape[0]
        i = wp.tid() / m
        if wp.tid() == 0:
            words[GOING] = wp.where(words[LEFT] > few, 1, 0)
        if wp.tid() % m >= A.listed[0]:
            return
        k = A.list[wp.tid() % m]
        if A.done[k] == 1 and A.on[k] == 1 and i < S.points[k]:
            begin_strand_point(S, H, Q, T, A, i, k)

    @wp.kernel(enable_backward=False, module=module, launch_bounds=(32, 16))       # few go on past their points' distances
    def touch_edges(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, A: RodParts):
        if wp.static(meets):
            m = S.points.shape[0]
            i = wp.tid() / m
            if wp.tid() % m >= A.listed[0]:
                return
            k = A.list[wp.tid() % m]
            if A.on[k] == 1:
                touch(S, C, Q, T, A, i, k)

    @wp.kernel(enable_backward=False, module=module)
    def measure_points(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, A: RodParts, words: wp.array(dtype=int)):
        m = S.points.shape[0]
        i = wp.tid() / m
        if wp.tid() == 0:
            words[LEFT] = 0
        if wp.tid() % m >= A.listed[0]:
            return
        k = A.list[wp.tid() % m]
        if A.on[k] == 1 and i < S.points[k]:
            measure(S, C, Q, T, A, i, k)

    @wp.kernel(enable_backward=False, module=module, launch_bounds=(32, 10))       # registers for 12 blocks a multiprocessor
    def solve_strands(S: RodTable, T: RodTrial, A: RodParts, words: wp.array(dtype=int), said: wp.array2d(dtype=wp.float64)):
        place = wp.tid() / wp.static(LANES)
        lane = wp.tid() % wp.static(LANES)
        if place >= A.listed[0]:
            return
        k = A.list[place]
        on = A.on[k]
        strand_lane_barrier()
        if lane == 0:
            A.moved[k] = on
        if on == 0:
            return
        n = S.points[k]
        z = eliminate(T, A, n, lane, k)
        if lane == 0:
            judge(T, A, z, k, said)
            if A.on[k] == 1:
                wp.atomic_add(words, LEFT, 1)
        strand_lane_barrier()
        for j in range((n + wp.static(LANES - 1)) / wp.static(LANES)):
            i = j * wp.static(LANES) + lane
            if i < n:
                move(T, A, i, k)

    @wp.kernel(enable_backward=False, module=module)
    def apply_point_corrections(S: RodTable, T: RodTrial, A: RodParts):
        m = S.points.shape[0]
        i = wp.tid() / m
        if wp.tid() % m >= A.listed[0]:
            return
        k = A.list[wp.tid() % m]
        if A.moved[k] == 0 or i >= S.points[k]:
            return
        apply_edge_correction(S, T, A, i, k)

    @wp.kernel(enable_backward=False, module=module)
    def end_points(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, A: RodParts, said: wp.array2d(dtype=wp.float64)):
        m = S.points.shape[0]
        i = wp.tid() / m
        if wp.tid() % m >= A.listed[0]:
            return
        k = A.list[wp.tid() % m]
        if A.moved[k] == 1 and A.done[k] == 1 and i < S.points[k]:
            deep = end(S, C, Q, T, A, i, k)
            if deep > wp.float64(0.0):
                wp.atomic_max(said, k, 2, deep)

    @wp.kernel(enable_backward=False, module=last, launch_bounds=(32, 8))          # 10: a quarter slower, for want of registers
    def finish_strands(S: RodTable, H: RodPins, C: Colliders, Q: RodMotion, T: RodTrial, A: RodParts,
                       said: wp.array2d(dtype=wp.float64)):
        place = wp.tid() / wp.static(WARP)
        lane = wp.tid() % wp.static(WARP)
        if place >= A.listed[0]:
            return
        k = A.list[place]
        n = S.points[k]
        on = A.on[k]
        warp_memory_barrier()
        while on == 1:
            for i in range(lane, n, wp.static(WARP)):
                if wp.static(meets):
                    touch_alone(S, C, Q, T, A, i, k)
                measure_alone(S, C, Q, T, A, i, k)
            warp_memory_barrier()
            if lane < wp.static(LANES):
                z = eliminate(T, A, n, lane, k)
                if lane == 0:
                    judge(T, A, z, k, said)
            warp_memory_barrier()
            for i in range(lane, n, wp.static(WARP)):
                move(T, A, i, k)
            warp_memory_barrier()
            for i in range(lane, n, wp.static(WARP)):
                apply_edge_correction(S, T, A, i, k)
                if A.done[k] == 1:
                    deep = end_alone(S, C, Q, T, A, i, k)
                    if deep > wp.float64(0.0):
                        wp.atomic_max(said, k, 2, deep)
            warp_memory_barrier()
            on = A.on[k]
            if A.done[k] == 1 and on == 1:
                for i in range(lane, n, wp.static(WARP)):
                    begin_strand_point(S, H, Q, T, A, i, k)
            warp_memory_barrier()

    @wp.kernel(enable_backward=False, module=module)
    def enlist_strands(A: RodParts, few: int, words: wp.array(dtype=int)):
        k = wp.tid()
        if k == 0:
            words[GOING] = wp.where(words[LEFT] > few, 1, 0)
        if A.on[k] == 1:
            A.list[wp.atomic_add(A.listed, 0, 1)] = k

    return (begin_points, touch_edges, measure_points, solve_strands, apply_point_corrections, end_points, finish_strands,
            enlist_strands)
