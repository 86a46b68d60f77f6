"""Beginnings and ends of substeps of strands that are solved together, by point: first guesses, what a proof may have changed
(wsim/physics/contact/selfcontact/guarantee.py), and velocities behind it (kernels/rods/march.py). Point i of strand k is thread
i * strands + k."""

from functools import cache

import warp as wp

from wsim.kernels.rods.contact import Colliders
from wsim.kernels.rods.coupled_newton.coupled import ACTIVE, FIRST, GOING, CoupledRods
from wsim.kernels.rods.element import orthogonal_director, transport_director
from wsim.kernels.rods.march import begin_point, finish_point
from wsim.kernels.rods.seam import copy_ring_point
from wsim.kernels.rods.tables import (
    EdgePairs,
    RodMotion,
    RodPins,
    RodStep,
    RodTable,
    RodTrial,
    is_own_point,
    point_of_copy,
)


@wp.func
def settled_strand_place(S: RodTable, Q: RodMotion, T: RodTrial, d: wp.array2d(dtype=wp.vec3d), i: int, k: int):
    """Where a point is that is displaced by d [m], and 1 if the proof has moved it. Copies go as what they are copies of."""
    x = T.x[i, k]
    way = d[point_of_copy(S, i, k), k]
    if wp.length_sq(way - (x - Q.x[i, k])) > wp.float64(0.0):
        return Q.x[i, k] + way, 1
    return x, 0


@cache
def coupled_begin_kernels(module: str):
    """Kernels where a substep begins: points; worlds; displacements of points."""
    @wp.kernel(module=module, enable_backward=False)
    def begin_points_touching(S: RodTable, H: RodPins, Q: RodMotion, T: RodTrial, h: wp.float64, at: int):
        i = wp.tid() / S.points.shape[0]
        k = wp.tid() - i * S.points.shape[0]
        if i < S.points[k]:
            begin_point(S, H, Q, T, h, at, i, k)

    @wp.kernel(module=module, enable_backward=False)
    def begin_worlds(G: CoupledRods, words: wp.array(dtype=int)):
        k = wp.tid()
        G.on[k] = 1
        G.count[k] = 0
        G.back[k] = 0
        G.rough[k] = 0
        G.touched[k] = 0
        words[GOING] = 1
        words[ACTIVE] = 0

    @wp.kernel(module=module, enable_backward=False)
    def displace_points(S: RodTable, Q: RodMotion, T: RodTrial, d_out: wp.array2d(dtype=wp.vec3d)):
        i = wp.tid() / S.points.shape[0]
        k = wp.tid() - i * S.points.shape[0]
        if i < S.points[k]:
            d_out[i, k] = T.x[i, k] - Q.x[i, k]

    return begin_points_touching, begin_worlds, displace_points


@cache
def coupled_end_kernels(kinds: tuple[str, ...], module: str):
    """Kernels where a substep ends: directors of edges, as the proof leaves their points (breaks: 1 where worlds that it moves
    start anew); points themselves; what a substep leaves; whether points carry on. kinds: of colliders."""
    end = finish_point(kinds)

    @wp.kernel(module=module, enable_backward=False)
    def settle_edges(S: RodTable, Q: RodMotion, d: wp.array2d(dtype=wp.vec3d), breaks: int, T: RodTrial, G: CoupledRods):
        i = wp.tid() / S.points.shape[0]
        k = wp.tid() - i * S.points.shape[0]
        if i >= S.points[k]:
            return
        x0, moved = settled_strand_place(S, Q, T, d, i, k)
        if moved == 1 and breaks == 1:
            wp.atomic_max(G.touched, G.world[k], 1)
        if i + 1 < S.points[k]:
            if S.clamped[i, k] == 0:
                x1, _ = settled_strand_place(S, Q, T, d, i + 1, k)
                t = wp.normalize(x1 - x0)
                T.d[i, k] = orthogonal_director(t, transport_director(wp.normalize(T.x[i + 1, k] - T.x[i, k]), t, T.d[i, k]))

    @wp.kernel(module=module, enable_backward=False)
    def settle_points(S: RodTable, Q: RodMotion, d: wp.array2d(dtype=wp.vec3d), T: RodTrial):
        i = wp.tid() / S.points.shape[0]
        k = wp.tid() - i * S.points.shape[0]
        if i < S.points[k]:
            x, _ = settled_strand_place(S, Q, T, d, i, k)
            T.x[i, k] = x

    @wp.kernel(module=module, enable_backward=False)
    def end_points_touching(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, P: EdgePairs, G: CoupledRods, p: RodStep,
                            said: wp.array2d(dtype=wp.float64)):
        m = S.points.shape[0]
        i = wp.tid() / m
        k = wp.tid() - i * m
        if i >= S.points[k]:
            return
        world = G.world[k]
        deep = end(S, C, Q, T, p, i, k)
        if deep > wp.float64(0.0):
            wp.atomic_max(said, k, 2, deep)
        if i == 0:
            said[k, 0] = wp.max(said[k, 0], wp.float64(G.count[world]))
            said[k, 1] = wp.max(said[k, 1], wp.max(G.left[k], G.body[world]))
        touched = 1 - Q.begun[i, k]
        if P.many:
            for j in range(wp.min(P.many[wp.tid()], P.of.shape[1])):
                if P.load[P.of[wp.tid(), j] / 4] > wp.float64(0.0):
                    touched = int(1)
        if touched == 1:
            wp.atomic_max(G.touched, world, 1)

    @wp.kernel(module=module, enable_backward=False)
    def remember_points(S: RodTable, G: CoupledRods, Q: RodMotion, words: wp.array(dtype=int)):
        i = wp.tid() / S.points.shape[0]
        k = wp.tid() - i * S.points.shape[0]
        if wp.tid() == 0:
            words[FIRST] = 0
        if i < S.points[k]:
            if not is_own_point(S, i, k):
                copy_ring_point(Q, i, i - S.own[k], k)
            Q.begun[i, k] = 1 - G.touched[G.world[k]]    # last: those that are copied write their own now

    return settle_edges, settle_points, end_points_touching, remember_points
