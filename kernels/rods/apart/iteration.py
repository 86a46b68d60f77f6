"""Parts of an iteration of Newton's method, by point or by strand, of strands that are each in a substep of their own: contacts
of edges (`meet`), strains and contacts of points (`measure`), what a strand's greatest correction says (`judge`), the move
(`move`, `take`), the end of a substep and the beginning of the next (`end`, `begin`). kernels/rods/march.py takes the same
steps in one thread."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.rods.air import blow
from wsim.kernels.rods.apart.parts import (
    LAST,
    MORE,
    RIGHT,
    SYMMETRIC,
    TOUCH,
    Parts,
    inside_own,
    keep,
    keep_bend,
    keep_edge,
    keep_inside,
    keep_symmetric,
    numbers,
)
from wsim.kernels.rods.contact import MET, Colliders, expect_all
from wsim.kernels.rods.edges.inside import inside
from wsim.kernels.rods.edges.sites import Inside
from wsim.kernels.rods.element import transport, turned, upright
from wsim.kernels.rods.forces import drawn
from wsim.kernels.rods.march import MOST, TOLERANCE, begin_point, eased, finish_point
from wsim.kernels.rods.system import TINY, add, pointing, pulled, split, strains
from wsim.kernels.rods.tables import Holds, Motion, Step, Strands, Trial


@wp.func
def begin(S: Strands, H: Holds, Q: Motion, T: Trial, A: Parts, i: int, k: int):
    """A first guess of a point in its strand's next substep."""
    begin_point(S, H, Q, T, A.h, A.at[k], i, k)
    if i == 0:
        A.before[k] = A.least[k]
        A.share[k] = wp.float64(1.0)
        A.count[k] = 0


@wp.func
def take(S: Strands, T: Trial, A: Parts, i: int, k: int):
    """A point's contact and the edge behind it after a move: its contact, its tension, and its director."""
    n = S.points[k]
    z0 = T.z[i, k]
    z1 = T.z[wp.min(i + 1, n - 1), k]
    if T.hit:
        expect_all(T, z0 / A.taken[k], z1 / A.taken[k], i, k)
    if i + 1 >= n:
        return
    e = T.x[i + 1, k] - T.x[i, k]
    old = e - (wp.vec3d(z1[0], z1[1], z1[2]) - wp.vec3d(z0[0], z0[1], z0[2]))
    T.pull[i, k] = pulled(S, old, (z1 - z0) / A.taken[k], i, k)
    if S.clamped[i, k] == 0:
        t = wp.normalize(e)
        T.d[i, k] = turned(t, upright(t, transport(wp.normalize(old), t, T.d[i, k])), z0[3])
        T.turn[i, k] = T.turn[i, k] + z0[3]


@cache
def iteration(kinds: tuple[str, ...], airy: bool) -> SimpleNamespace:
    """Functions of the parts. kinds: of colliders. airy: with air."""
    meets = bool(kinds)
    point, finish = pointing(kinds, airy, False), finish_point(kinds)
    clear, touch = (inside(kinds).clear, inside(kinds).touch) if meets else (None, None)

    @wp.func
    def meet(S: Strands, C: Colliders, Q: Motion, T: Trial, A: Parts, i: int, k: int):
        """What colliders give the edge behind a point, before `measure`, which has its first point's part of it."""
        if i + 1 < S.points[k]:
            if S.hold[i, k] < 0 or S.hold[i + 1, k] < 0:
                had = T.edge[i, k]
                if clear(C, S, T, A.at[k], i, k):
                    if had >= MET:
                        keep_inside(A, wp.static(numbers(airy)), i, k, Inside())
                else:
                    keep_inside(A, wp.static(numbers(airy)), i, k, touch(C, S, Q, T, A.h * A.h, A.at[k], i, k))
                    if T.edge[i, k] == MET:
                        A.edges[k] = 1

    @wp.func
    def measure(S: Strands, C: Colliders, Q: Motion, T: Trial, A: Parts, i: int, k: int):
        """Numbers that a point leaves for the elimination."""
        n = S.points[k]
        p = Step()
        p.h = A.h
        p.at = A.at[k]
        D, r = point(S, C, Q, T, p, i, k)
        if wp.static(meets):
            if T.edge[i, k] == MET and S.hold[i, k] < 0:
                K, pressing = inside_own(A, wp.static(numbers(airy) + TOUCH), i, k)
                D = add(D, K)
                r = r + split(pressing, wp.float64(0.0))
        keep_symmetric(A.part, wp.static(SYMMETRIC), i, k, wp.vec3d(D[0, 0], D[0, 1], D[0, 2]),
                       wp.vec3d(D[1, 0], D[1, 1], D[1, 2]), wp.vec3d(D[2, 0], D[2, 1], D[2, 2]))
        A.part[wp.static(LAST), i, k] = D[3, 3]
        keep(A.part, wp.static(RIGHT), i, k, wp.vec3d(r[0], r[1], r[2]))
        A.part[wp.static(RIGHT + 3), i, k] = r[3]
        if i == 0:
            A.done[k] = 0
        if i + 1 < n:
            e = T.x[i + 1, k] - T.x[i, k]
            length = wp.length(e)
            t = e / wp.max(length, TINY)
            keep_edge(T, A, i, k, t, length, drawn(S, Q, T, p, t, length, i, k))
            if wp.static(airy):
                gust, damp = blow(S, Q, T, p, i, k)
                keep(A.part, wp.static(MORE), i, k, gust)
                keep_symmetric(A.part, wp.static(MORE + 3), i, k, damp[0], damp[1], damp[2])
            if i > 0:
                if S.clamped[i - 1, k] + S.clamped[i, k] < 2:
                    e0 = T.x[i, k] - T.x[i - 1, k]
                    l0 = wp.length(e0)
                    f = strains(e0 / wp.max(l0, TINY), t, wp.max(l0, TINY), wp.max(length, TINY), T.d[i - 1, k], T.d[i, k],
                                T.phi[i, k])
                    T.phi[i, k] = f.s[2]
                    keep_bend(S, Q, T, A, p, i, k, f)

    @wp.func
    def judge(T: Trial, A: Parts, z: wp.float64, k: int, said: wp.array2d(dtype=wp.float64)):
        """Part of the greatest correction z [m] that is taken, and whether the substep ends."""
        short = A.least[k]
        share = eased(A.share[k], z, A.before[k], A.count[k])
        A.share[k] = share
        A.taken[k] = share * wp.min(wp.float64(1.0), short / wp.max(z, short * wp.float64(1e-12)))
        A.before[k] = z
        off = z
        if wp.static(meets):
            off = wp.max(z, T.drawn[k])
            T.drawn[k] = wp.float64(0.0)
            A.edges[k] = 0
        count = A.count[k] + 1
        A.count[k] = count
        if count >= MOST or off <= TOLERANCE * short:
            said[k, 0] = wp.max(said[k, 0], wp.float64(count))
            said[k, 1] = wp.max(said[k, 1], off / short)
            A.done[k] = 1
            A.at[k] = A.at[k] + 1
            if A.at[k] >= A.substeps:
                A.on[k] = 0

    @wp.func
    def move(T: Trial, A: Parts, i: int, k: int):
        """A point by its part of the correction, which is kept in its place."""
        s = T.z[i, k] * A.taken[k]
        T.z[i, k] = s
        T.x[i, k] = T.x[i, k] + wp.vec3d(s[0], s[1], s[2])

    @wp.func
    def end(S: Strands, C: Colliders, Q: Motion, T: Trial, A: Parts, i: int, k: int):
        """A point at the end of the substep that was; how deep it is in a collider [m]."""
        p = Step()
        p.h = A.h
        p.at = A.at[k] - 1
        return finish(S, C, Q, T, p, i, k)

    return SimpleNamespace(meet=meet if meets else None, measure=measure, judge=judge, move=move, end=end)
