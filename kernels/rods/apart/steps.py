"""Substeps of strands on a GPU, a launch for each part of an iteration: strains, contacts and moves by a thread a point, the
elimination from point to point by LANES threads a strand (lanes.py; kernels/rods/march.py takes the same steps in one launch).

A strand's points come one after another in the elimination alone, of which a thread waits for each result. A strand that has
ended waits for the others, which go on.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.rods.air import blow
from wsim.kernels.rods.apart.desk import meet
from wsim.kernels.rods.apart.lanes import eliminating
from wsim.kernels.rods.apart.parts import AIR, LANES, LAST, RIGHT, SYMMETRIC, Parts, keep, keep_bend, keep_edge, keep_symmetric
from wsim.kernels.rods.contact import Colliders, expect
from wsim.kernels.rods.element import transport, turned, upright
from wsim.kernels.rods.march import MOST, TOLERANCE, begin_point, eased, finish_point
from wsim.kernels.rods.system import TINY, pointing, pulled, strains
from wsim.kernels.rods.tables import Holds, Motion, Step, Strands, Trial

GOING = 0                        # the word that says whether a strand goes on


@cache
def apart(kinds: tuple[str, ...], airy: bool, module: str):
    """Kernels over points (tid: point number * strands + strand) or strands: begin a substep (points), measure (points), solve
    (strand * LANES + lane), take (points), end (points). said: as `march.strands` has it. kinds: of colliders. airy: with
    air."""
    meets = bool(kinds)
    point, eliminate, end = pointing(kinds, airy, False), eliminating(airy), finish_point(kinds)

    @wp.kernel(enable_backward=False, module=module)
    def begin_points(S: Strands, H: Holds, Q: Motion, T: Trial, A: Parts, h: wp.float64, at: int, words: wp.array(dtype=int)):
        m = S.points.shape[0]
        i = wp.tid() / m
        k = wp.tid() % m
        if i < S.points[k]:
            begin_point(S, H, Q, T, h, at, i, k)
        if i == 0:
            A.before[k] = A.least[k]
            A.share[k] = wp.float64(1.0)
            A.count[k] = 0
            A.on[k] = 1
            words[GOING] = 1

    @wp.kernel(enable_backward=False, module=module)
    def measure_points(S: Strands, C: Colliders, Q: Motion, T: Trial, A: Parts, h: wp.float64, at: int,
                       words: wp.array(dtype=int)):
        m = S.points.shape[0]
        i = wp.tid() / m
        k = wp.tid() % m
        if wp.tid() == 0:
            words[GOING] = 0
        n = S.points[k]
        if A.on[k] == 0 or i >= n:
            return
        p = Step()
        p.h = h
        p.at = at
        D, r = point(S, C, Q, T, p, i, k)
        keep_symmetric(A.part, wp.static(SYMMETRIC), i, k, wp.vec3d(D[0, 0], D[0, 1], D[0, 2]),
                       wp.vec3d(D[1, 0], D[1, 1], D[1, 2]), wp.vec3d(D[2, 0], D[2, 1], D[2, 2]))
        A.part[wp.static(LAST), i, k] = D[3, 3]
        keep(A.part, wp.static(RIGHT), i, k, wp.vec3d(r[0], r[1], r[2]))
        A.part[wp.static(RIGHT + 3), i, k] = r[3]
        if i + 1 < n:
            e = T.x[i + 1, k] - T.x[i, k]
            length = wp.length(e)
            t = e / wp.max(length, TINY)
            keep_edge(S, T, A, i, k, t, length)
            if wp.static(airy):
                gust, damp = blow(S, Q, T, p, i, k)
                keep(A.part, wp.static(AIR), i, k, gust)
                keep_symmetric(A.part, wp.static(AIR + 3), i, k, damp[0], damp[1], damp[2])
            if i > 0:
                if S.clamped[i - 1, k] + S.clamped[i, k] < 2:
                    e0 = T.x[i, k] - T.x[i - 1, k]
                    l0 = wp.length(e0)
                    f = strains(e0 / wp.max(l0, TINY), t, wp.max(l0, TINY), wp.max(length, TINY), T.d[i - 1, k], T.d[i, k],
                                T.phi[i, k])
                    T.phi[i, k] = f.s[2]
                    keep_bend(S, A, i, k, f)

    @wp.kernel(enable_backward=False, module=module, launch_bounds=(32, 10))       # registers for 12 blocks a multiprocessor
    def solve_strands(S: Strands, T: Trial, A: Parts, words: wp.array(dtype=int), said: wp.array2d(dtype=wp.float64)):
        k = wp.tid() / wp.static(LANES)
        lane = wp.tid() % wp.static(LANES)
        on = A.on[k]
        meet()
        if lane == 0:
            A.moved[k] = on
        if on == 0:
            return
        n = S.points[k]
        z = eliminate(T, A, n, lane, k)
        short = A.least[k]
        share = eased(A.share[k], z, A.before[k], A.count[k])
        part = share * wp.min(wp.float64(1.0), short / wp.max(z, short * wp.float64(1e-12)))
        meet()
        for j in range((n + wp.static(LANES - 1)) / wp.static(LANES)):
            i = j * wp.static(LANES) + lane
            if i < n:
                if wp.static(meets):
                    expect(T, i, k)
                s = T.z[i, k] * part
                T.z[i, k] = s
                T.x[i, k] = T.x[i, k] + wp.vec3d(s[0], s[1], s[2])
        if lane == 0:
            A.share[k] = share
            A.taken[k] = part
            A.before[k] = z
            if wp.static(meets):
                z = wp.max(z, T.drawn[k])
                T.drawn[k] = wp.float64(0.0)
            count = A.count[k] + 1
            A.count[k] = count
            if count < MOST and z > TOLERANCE * short:
                words[GOING] = 1
            else:
                A.on[k] = 0
                said[k, 0] = wp.max(said[k, 0], wp.float64(count))
                said[k, 1] = wp.max(said[k, 1], z / short)

    @wp.kernel(enable_backward=False, module=module)
    def take_points(S: Strands, T: Trial, A: Parts):
        m = S.points.shape[0]
        i = wp.tid() / m
        k = wp.tid() % m
        if A.moved[k] == 0 or i + 1 >= S.points[k]:
            return
        z0 = T.z[i, k]
        z1 = T.z[i + 1, k]
        e = T.x[i + 1, k] - T.x[i, k]
        old = e - (wp.vec3d(z1[0], z1[1], z1[2]) - wp.vec3d(z0[0], z0[1], z0[2]))
        T.pull[i, k] = pulled(S, old, (z1 - z0) / A.taken[k], i, k)
        if S.clamped[i, k] == 0:
            t = wp.normalize(e)
            T.d[i, k] = turned(t, upright(t, transport(wp.normalize(old), t, T.d[i, k])), z0[3])
            T.turn[i, k] = T.turn[i, k] + z0[3]

    @wp.kernel(enable_backward=False, module=module)
    def end_points(S: Strands, C: Colliders, Q: Motion, T: Trial, h: wp.float64, at: int, said: wp.array2d(dtype=wp.float64)):
        m = S.points.shape[0]
        i = wp.tid() / m
        k = wp.tid() % m
        if i < S.points[k]:
            p = Step()
            p.h = h
            p.at = at
            deep = end(S, C, Q, T, p, i, k)
            if deep > wp.float64(0.0):
                wp.atomic_max(said, k, 2, deep)

    return begin_points, measure_points, solve_strands, take_points, end_points
