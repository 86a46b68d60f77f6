"""Substeps of strands on a GPU, a launch for each part of an iteration: strains, contacts and moves by a thread a point, the
elimination from point to point by a thread a strand (kernels/rods/march.py takes the same steps in one launch).

A strand's points come one after another in the elimination alone, of which a thread waits for each result; all else of a point
took nine tenths of its time. A strand that has ended waits for the others, which go on.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.rods.air import blow
from wsim.kernels.rods.contact import Colliders
from wsim.kernels.rods.element import transport, turned, upright
from wsim.kernels.rods.eliminate import Window, backward, eliminating
from wsim.kernels.rods.march import CALM, LEAST, MOST, TOLERANCE, begin_point, finish_point
from wsim.kernels.rods.system import TINY, Bend, flex, pointing, push, strains, stretch
from wsim.kernels.rods.tables import Holds, Motion, Step, Strands, Trial

GOING = 0                        # the word that says whether a strand goes on


@wp.struct
class Parts:
    """Table of what points leave for their strands, (points, strands), and the state of Newton's method, (strands,)."""

    D: wp.array2d(dtype=wp.mat44d)                  # diagonal block of a point, and its right-hand side
    r: wp.array2d(dtype=wp.vec4d)
    edge: wp.array2d(dtype=wp.vec4d)                # tangent and length [m]
    bend: wp.array2d(dtype=Bend)
    gust: wp.array2d(dtype=wp.vec3d)                # half the force of the air on an edge [N]; these two where there is air
    damp: wp.array2d(dtype=wp.mat33d)               # and its stiffness [N/m]
    least: wp.array(dtype=wp.float64)               # shortest edge [m]
    before: wp.array(dtype=wp.float64)              # greatest correction of the iteration before [m]
    share: wp.array(dtype=wp.float64)               # of a correction that is taken
    count: wp.array(dtype=int)                      # iterations
    on: wp.array(dtype=int)                         # 1: it goes on
    moved: wp.array(dtype=int)                      # 1: it has moved in this iteration


@cache
def apart(kinds: tuple[str, ...], airy: bool, module: str):
    """Kernels over points (tid: point number * strands + strand) or strands: begin a substep (points), measure (points), solve
    (strands), take (points), end (points). said: as `march.strands` has it. kinds: of colliders. airy: with air."""
    point, eliminate, end = pointing(kinds, airy, False), eliminating(False), finish_point(kinds)

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
        A.D[i, k] = D
        A.r[i, k] = r
        if i + 1 < n:
            e = T.x[i + 1, k] - T.x[i, k]
            length = wp.length(e)
            t = e / wp.max(length, TINY)
            A.edge[i, k] = wp.vec4d(t[0], t[1], t[2], length)
            if wp.static(airy):
                gust, damp = blow(S, Q, T, p, i, k)
                A.gust[i, k] = gust
                A.damp[i, k] = damp
            if i > 0:
                if S.clamped[i - 1, k] + S.clamped[i, k] < 2:
                    e0 = T.x[i, k] - T.x[i - 1, k]
                    l0 = wp.length(e0)
                    f = strains(e0 / wp.max(l0, TINY), t, wp.max(l0, TINY), wp.max(length, TINY), T.d[i - 1, k], T.d[i, k],
                                T.phi[i, k])
                    T.phi[i, k] = f.s[2]
                    A.bend[i, k] = f

    @wp.kernel(enable_backward=False, module=module)
    def solve_strands(S: Strands, T: Trial, A: Parts, words: wp.array(dtype=int), said: wp.array2d(dtype=wp.float64)):
        k = wp.tid()
        A.moved[k] = A.on[k]
        if A.on[k] == 0:
            return
        n = S.points[k]
        w = Window()
        for j in range(n + 2):
            i = j - 2
            if j < n:
                w.D2 = A.D[j, k]
                w.r2 = A.r[j, k]
            if i >= 0 and i + 1 < n:
                e = A.edge[i, k]
                w = stretch(S, w, wp.vec3d(e[0], e[1], e[2]), e[3], i, k)
                if wp.static(airy):
                    w = push(S, w, A.gust[i, k], A.damp[i, k], i, k)
            if i >= 0 and i + 2 < n:
                if S.clamped[i, k] + S.clamped[i + 1, k] < 2:
                    w = flex(S, w, A.bend[i + 1, k], i + 1, k)
            w = eliminate(T, w, i, k)
        z = backward(S, T, k)
        short = A.least[k]
        share = A.share[k]
        if z > (wp.float64(1.0) - CALM * share) * A.before[k]:
            share = wp.max(wp.float64(0.5) * share, LEAST)
        else:
            share = wp.min(wp.float64(2.0) * share, wp.float64(1.0))
        part = share * wp.min(wp.float64(1.0), short / wp.max(z, short * wp.float64(1e-12)))
        for i in range(n):
            s = T.z[i, k] * part
            T.z[i, k] = s
            T.x[i, k] = T.x[i, k] + wp.vec3d(s[0], s[1], s[2])
        A.share[k] = share
        A.before[k] = z
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
        if S.clamped[i, k] == 0:
            z0 = T.z[i, k]
            z1 = T.z[i + 1, k]
            e = T.x[i + 1, k] - T.x[i, k]
            old = e - (wp.vec3d(z1[0], z1[1], z1[2]) - wp.vec3d(z0[0], z0[1], z0[2]))
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
