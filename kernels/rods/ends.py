"""Ends of substeps of strands that press each other: what a proof may have changed (wsim/physics/selfcontact/guarantee.py), and
velocities behind it (kernels/rods/march.py)."""

from functools import cache

import warp as wp

from wsim.kernels.rods.contact import Colliders
from wsim.kernels.rods.coupled import FIRST, Coupled
from wsim.kernels.rods.element import transport, upright
from wsim.kernels.rods.march import finish
from wsim.kernels.rods.tables import Motion, Pressed, Step, Strands, Trial


@cache
def ends(kinds: tuple[str, ...], module: str):
    """Kernels: displacements of points, for the proof; places that it left, with their directors (breaks: 1 where
    worlds that it moves start anew); what a substep leaves; whether worlds step by backward Euler next. kinds: of colliders."""
    end = finish(kinds)

    @wp.kernel(module=module, enable_backward=False)
    def displace_strands(S: Strands, Q: Motion, T: Trial, d_out: wp.array2d(dtype=wp.vec3d)):
        k = wp.tid()
        for i in range(S.points[k]):
            d_out[i, k] = T.x[i, k] - Q.x[i, k]

    @wp.kernel(module=module, enable_backward=False)
    def settle_strands(S: Strands, Q: Motion, d: wp.array2d(dtype=wp.vec3d), breaks: int, T: Trial, G: Coupled):
        k = wp.tid()
        G.sum[k] = wp.float64(0.0)
        old = T.x[0, k]
        for i in range(S.points[k]):
            now = T.x[i, k]
            moved = d[i, k] - (now - Q.x[i, k])
            if wp.length_sq(moved) > wp.float64(0.0):
                G.sum[k] = wp.float64(breaks)
                T.x[i, k] = Q.x[i, k] + d[i, k]
            if i > 0:
                if S.clamped[i - 1, k] == 0:
                    t = wp.normalize(T.x[i, k] - T.x[i - 1, k])
                    T.d[i - 1, k] = upright(t, transport(wp.normalize(now - old), t, T.d[i - 1, k]))
            old = now

    @wp.kernel(module=module, enable_backward=False)
    def end_strands_touching(S: Strands, C: Colliders, Q: Motion, T: Trial, P: Pressed, G: Coupled, p: Step,
                             said: wp.array2d(dtype=wp.float64)):
        k = wp.tid()
        deep = end(S, C, Q, T, p, k)
        m = G.world.shape[0]
        touched = G.sum[k]
        for i in range(S.points[k]):
            point = i * m + k
            if Q.begun[i, k] == 0:
                touched = wp.float64(1.0)
            if P.many:
                for j in range(wp.min(P.many[point], P.of.shape[1])):
                    if P.load[P.of[point, j] / 4] > wp.float64(0.0):
                        touched = wp.float64(1.0)
        G.sum[k] = touched
        said[k, 0] = wp.max(said[k, 0], wp.float64(G.count[G.world[k]]))
        said[k, 1] = wp.max(said[k, 1], wp.max(G.left[k], G.body[G.world[k]]))
        said[k, 2] = wp.max(said[k, 2], deep)

    @wp.kernel(module=module, enable_backward=False)
    def touch_worlds(G: Coupled, words: wp.array(dtype=int)):
        k = wp.tid()
        words[FIRST] = 0
        G.touched[k] = 0
        for j in range(G.first[k], G.first[k + 1]):
            if G.sum[j] > wp.float64(0.0):
                G.touched[k] = 1

    @wp.kernel(module=module, enable_backward=False)
    def remember_strands(S: Strands, G: Coupled, Q: Motion):
        k = wp.tid()
        for i in range(S.points[k]):
            Q.begun[i, k] = 1 - G.touched[G.world[k]]

    return displace_strands, settle_strands, end_strands_touching, touch_worlds, remember_strands
