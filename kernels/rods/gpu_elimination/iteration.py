"""Parts of an iteration of Newton's method, by point or by strand, of strands that are each in a substep of their own: contacts
of edges (`meet`), strains and contacts of points (`measure`), what a strand's greatest correction says (`judge`), the move
(`move`, `apply_edge_correction`), the end of a substep and the beginning of the next (`end`, `begin_strand_point`).
kernels/rods/march.py takes the same steps in one thread."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rods.air import air_force_on_edge
from wsim.kernels.rods.contact import MET, Colliders, expect_all
from wsim.kernels.rods.edges.edge_contact_law import EdgeForces
from wsim.kernels.rods.edges.inside import inside_edge_functions
from wsim.kernels.rods.element import orthogonal_director, rotated_director, transport_director
from wsim.kernels.rods.forces import edge_tension
from wsim.kernels.rods.gpu_elimination.parts import (
    LAST,
    MORE,
    RIGHT,
    SYMMETRIC,
    TOUCH,
    RodParts,
    inside_own,
    keep_bend,
    keep_edge,
    keep_inside,
    keep_symmetric,
    numbers_per_point,
    store_point_vector,
)
from wsim.kernels.rods.march import MOST, TOLERANCE, begin_point, eased_newton_share, finish_point
from wsim.kernels.rods.system import TINY, add_stiffness, corrected_edge_tension, point_angle_vector, point_block_func, strains
from wsim.kernels.rods.tables import RodMotion, RodPins, RodStep, RodTable, RodTrial


@wp.func
def begin_strand_point(S: RodTable, H: RodPins, Q: RodMotion, T: RodTrial, A: RodParts, i: int, k: int):
    """A first guess of a point in its strand's next substep."""
    begin_point(S, H, Q, T, A.h, A.at[k], i, k)
    if i == 0:
        A.before[k] = A.least[k]
        A.share[k] = wp.float64(1.0)
        A.count[k] = 0


@wp.func
def apply_edge_correction(S: RodTable, T: RodTrial, A: RodParts, i: int, k: int):
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
    T.pull[i, k] = corrected_edge_tension(S, old, (z1 - z0) / A.taken[k], i, k)
    if S.clamped[i, k] == 0:
        t = wp.normalize(e)
        T.d[i, k] = rotated_director(t, orthogonal_director(t, transport_director(wp.normalize(old), t, T.d[i, k])), z0[3])
        T.turn[i, k] = T.turn[i, k] + z0[3]


@cache
def iteration_functions(kinds: tuple[str, ...], airy: bool, called: bool = False) -> SimpleNamespace:
    """Functions of the parts. kinds: of colliders. airy: with air. called: long ones stand by themselves
    (kernels/math/marks.py)."""
    meets = bool(kinds)
    point, finish = point_block_func(kinds, airy, False), finish_point(kinds)
    clear, touch = (inside_edge_functions(kinds).clear, inside_edge_functions(kinds).touch) if meets else (None, None)

    @wp.func
    def touch_strand_edge(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, A: RodParts, i: int, k: int):
        """What colliders give the edge behind a point, before `measure_strand_point`, which has its first point's part of
        it."""
        if i + 1 < S.points[k]:
            if S.hold[i, k] < 0 or S.hold[i + 1, k] < 0:
                had = T.edge[i, k]
                if clear(C, S, T, A.at[k], i, k):
                    if had >= MET:
                        keep_inside(A, wp.static(numbers_per_point(airy)), i, k, EdgeForces())
                else:
                    keep_inside(A, wp.static(numbers_per_point(airy)), i, k, touch(C, S, Q, T, A.h * A.h, A.at[k], i, k))
                    if T.edge[i, k] == MET:
                        A.edges[k] = 1

    @wp.func
    def measure_strand_point(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, A: RodParts, i: int, k: int):
        """Numbers that a point leaves for the elimination."""
        n = S.points[k]
        p = RodStep()
        p.h = A.h
        p.at = A.at[k]
        D, r = point(S, C, Q, T, p, i, k)
        if wp.static(meets):
            if T.edge[i, k] == MET and S.hold[i, k] < 0:
                K, pressing = inside_own(A, wp.static(numbers_per_point(airy) + TOUCH), i, k)
                D = add_stiffness(D, K)
                r = r + point_angle_vector(pressing, wp.float64(0.0))
        keep_symmetric(A.part, wp.static(SYMMETRIC), i, k, wp.vec3d(D[0, 0], D[0, 1], D[0, 2]),
                       wp.vec3d(D[1, 0], D[1, 1], D[1, 2]), wp.vec3d(D[2, 0], D[2, 1], D[2, 2]))
        A.part[wp.static(LAST), i, k] = D[3, 3]
        store_point_vector(A.part, wp.static(RIGHT), i, k, wp.vec3d(r[0], r[1], r[2]))
        A.part[wp.static(RIGHT + 3), i, k] = r[3]
        if i == 0:
            A.done[k] = 0
        if i + 1 < n:
            e = T.x[i + 1, k] - T.x[i, k]
            length = wp.length(e)
            t = e / wp.max(length, TINY)
            keep_edge(T, A, i, k, t, length, edge_tension(S, Q, T, p, t, length, i, k))
            if wp.static(airy):
                gust, damp = air_force_on_edge(S, Q, T, p, i, k)
                store_point_vector(A.part, wp.static(MORE), i, k, gust)
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
    def judge_strand_step(T: RodTrial, A: RodParts, z: wp.float64, k: int, said: wp.array2d(dtype=wp.float64)):
        """Part of the greatest correction z [m] that is taken, and whether the substep ends."""
        short = A.least[k]
        share = eased_newton_share(A.share[k], z, A.before[k], A.count[k])
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
    def move_strand_point(T: RodTrial, A: RodParts, i: int, k: int):
        """A point by its part of the correction, which is kept in its place."""
        s = T.z[i, k] * A.taken[k]
        T.z[i, k] = s
        T.x[i, k] = T.x[i, k] + wp.vec3d(s[0], s[1], s[2])

    @wp.func
    def end_strand_point(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, A: RodParts, i: int, k: int):
        """A point at the end of the substep that was; how deep it is in a collider [m]."""
        p = RodStep()
        p.h = A.h
        p.at = A.at[k] - 1
        return finish(S, C, Q, T, p, i, k)

    if called:
        for function in (touch_strand_edge, measure_strand_point, end_strand_point):
            standalone_function(function)
    return SimpleNamespace(meet=touch_strand_edge if meets else None, measure=measure_strand_point, judge=judge_strand_step,
                           move=move_strand_point, end=end_strand_point)
