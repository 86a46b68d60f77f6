"""Contact of strands' edges with each other: the law of kernels/rods/contact.py between two edges, pair by pair.

    y = sum_c b_c x_c,   e = keep - n . y,   N(e) and friction as there,   f_c = b_c f,   K_cd = b_c b_d (k n n^T + friction's)

b and n are weights and normal of the closest points where the substep begins (kernels/contact/selfcontact/closest.py), b
positive on the first edge and negative on the second, so that forces of a pair cancel; keep is the sum of both radii, of edges
of one strand at most a part of the length between them, and of edges that began nearer what they had, growing by `climb` a
substep.

    k = max(STIFF m / h^2, E A / d):    what is pressed by a tension T sinks by about the strain T / (E A), in diameters

Points know the pairs of their edges (`of`), in the order of the pairs' points and not of the list, and gather what these add
up: the same bits from run to run. Of a closed strand pairs name the points themselves, so that search and proof know no seam;
what its last edge puts on the first point is gathered in the row of that point's copy, which is behind the last one
(kernels/rods/seam.py): blocks of the strand stay beside their diagonal, and the seam's forces carry it to the point.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.rods.contact import SOFT, STIFF, RodTouch, add_bristle_friction
from wsim.kernels.rods.tables import EdgePairs

REAL = wp.float64
NearPairs, Surfaces = pairs.pair_type(REAL), pairs.surface_type(REAL)
FREE = wp.constant(wp.float64(1e-12))      # of what pairs keep: what is less is no distance yet


@wp.struct
class PointPaths:
    """Where points are: in the trial, where the substep begins [m], and their velocities there [m/s]; h [s]."""

    x: wp.array(dtype=wp.vec3d)
    x0: wp.array(dtype=wp.vec3d)
    v: wp.array(dtype=wp.vec3d)
    h: wp.float64


@wp.struct
class EdgePointConstants:
    """What never changes, by point."""

    m: wp.array(dtype=wp.float64)                  # [kg]
    hard: wp.array(dtype=wp.float64)               # E A / d [N/m]
    strand: wp.array(dtype=int)
    gravity: wp.array(dtype=wp.vec3d)              # [m/s^2], by strand


@wp.func
def pair_point_row(ids: wp.vec4i, c: int, next: int):
    """Row in flat arrays of what point c of a pair gathers; next: from a point to the one behind it there."""
    if c % 2 == 1:
        return ids[c - 1] + next
    return ids[c]


@cache
def edge_list_kernels(module: str):
    """Kernels that make `of` anew behind a search, and carry over what pairs had that were listed before. A point without room
    for all of its pairs would push others and not be pushed: then there are no pairs, and no lists, until the frame ends."""
    @wp.func
    def entry_stands_before(near: NearPairs, a: int, b: int):
        """True if entry a stands before entry b."""
        p = near.ids[a / 4]
        q = near.ids[b / 4]
        if p[0] != q[0]:
            return p[0] < q[0]
        if p[2] != q[2]:
            return p[2] < q[2]
        return a < b

    @wp.kernel(module=module, enable_backward=False)
    def enlist_edge_pairs(near_at: wp.array(dtype=NearPairs), next: int, to: EdgePairs):
        near = near_at[0]
        i = wp.tid()
        if i < wp.min(near.count[0], near.capacity):
            to.kept[i] = wp.float64(-1.0)
            to.stick[i] = wp.vec3d()
            to.load[i] = wp.float64(0.0)
            for c in range(4):
                p = pair_point_row(near.ids[i], c, next)
                slot = wp.atomic_add(to.many, p, 1)
                if slot < to.of.shape[1]:
                    to.of[p, slot] = 4 * i + c

    @wp.kernel(module=module, enable_backward=False)
    def order_edge_entries(row: wp.array(dtype=int), near_at: wp.array(dtype=NearPairs), word: int, to: EdgePairs,
                           said: wp.array(dtype=int), words: wp.array(dtype=int)):
        near = near_at[0]
        p = row[wp.tid()]
        if to.many[p] > to.of.shape[1]:
            wp.atomic_max(said, word, to.many[p])
            wp.atomic_max(words, pairs.LACKED, 1)
        for i in range(1, wp.min(to.many[p], to.of.shape[1])):
            own = to.of[p, i]
            j = i
            while j > 0 and entry_stands_before(near, own, to.of[p, wp.max(j - 1, 0)]):
                to.of[p, j] = to.of[p, j - 1]
                j -= 1
            to.of[p, j] = own

    @wp.kernel(module=module, enable_backward=False)
    def drop_crowded_lists(row: wp.array(dtype=int), near_at: wp.array(dtype=NearPairs), to: EdgePairs,
                           words: wp.array(dtype=int)):
        near = near_at[0]
        if words[pairs.LACKED] > 0:
            to.many[row[wp.tid()]] = 0
            near.count[0] = 0
            words[pairs.NEAR] = 0
            words[pairs.SOON] = 0

    @wp.kernel(module=module, enable_backward=False)
    def recall_edge_pairs(near_at: wp.array(dtype=NearPairs), old: EdgePairs, ids: wp.array(dtype=wp.vec4i), to: EdgePairs):
        near = near_at[0]
        i = wp.tid()
        if i >= wp.min(near.count[0], near.capacity):
            return
        own = near.ids[i]
        for j in range(wp.min(old.many[own[0]], old.of.shape[1])):
            k = old.of[own[0], j] / 4
            if ids[k][0] == own[0] and ids[k][2] == own[2]:
                to.kept[i] = old.kept[k]
                to.stick[i] = old.stick[k]
                to.load[i] = old.load[k]

    return enlist_edge_pairs, order_edge_entries, drop_crowded_lists, recall_edge_pairs


@cache
def ready_pair_kernel(module: str):
    """Kernel where a substep begins: what pairs keep, and how hard they are. first: 1 in the first frame."""
    @wp.kernel(module=module, enable_backward=False)
    def ready_pairs(near_at: wp.array(dtype=NearPairs), side: EdgePointConstants, climb: wp.float64, hh: wp.float64,
                    first: wp.array(dtype=int), to: EdgePairs):
        near = near_at[0]
        i = wp.tid()
        if i >= wp.min(near.count[0], near.capacity):
            return
        ids = near.ids[i]
        m = side.m[ids[0]]
        hard = side.hard[ids[0]]
        for c in range(1, 4):
            m = wp.min(m, side.m[ids[c]])
            hard = wp.min(hard, side.hard[ids[c]])
        to.k[i] = wp.max(STIFF * m / hh, hard)
        kept = to.kept[i] + climb
        if to.kept[i] < wp.float64(0.0):
            kept = near.keep[i]
            if first[0] == 1:
                kept = near.away[i]
        to.kept[i] = wp.clamp(kept, FREE * near.keep[i], near.keep[i])

    return ready_pairs


@cache
def edge_press_kernel(module: str):
    """Kernel: forces and stiffnesses of pairs; active[0] 1 where a pair presses."""
    @wp.kernel(module=module, enable_backward=False)
    def press_edges(s: Surfaces, near_at: wp.array(dtype=NearPairs), side: EdgePointConstants, way: PointPaths, to: EdgePairs,
                    active: wp.array(dtype=int)):
        near = near_at[0]
        i = wp.tid()
        if i >= wp.min(near.count[0], near.capacity):
            return
        ids = near.ids[i]
        b = near.b[i]
        n = near.n[i]
        o = ids[0]
        y = wp.vec3d()
        slid = wp.vec3d()
        speed = wp.vec3d()
        mu = wp.vec2d()
        for c in range(4):
            q = ids[c]
            y += b[c] * ((way.x[q] - way.x[o]) + (s.shift[q] - s.shift[o]))
            slid += b[c] * (way.x[q] - way.x0[q])
            speed += b[c] * way.v[q]
            mu += wp.float64(0.5) * wp.abs(b[c]) * s.friction[q]
        t = RodTouch()
        k = to.k[i]
        w = SOFT * to.kept[i]
        deep = to.kept[i] - wp.dot(n, y)
        if deep > -w:
            e = wp.min(deep + w, w + w)
            slope = k * e / (w + w)
            t.N = slope * wp.float64(0.5) * e + k * wp.max(deep - w, wp.float64(0.0))
            t.f = n * t.N
            t.K = wp.outer(n, n) * slope
            load = to.load[i]
            if load == wp.float64(0.0):
                blow = wp.abs(wp.dot(n, speed)) / way.h + wp.length(side.gravity[side.strand[o]])
                load = wp.min(t.N, wp.float64(2.0) * wp.min(side.m[o], side.m[ids[2]]) * blow)
            slip = to.stick[i] + slid
            lean = wp.normalize(slip - n * wp.dot(n, slip)) * wp.float64(1 - wp.min(to.rough[s.world[o]], 1))
            t = add_bristle_friction(t, n, slip, load, k, mu, lean)
            wp.atomic_max(active, 0, 1)
        to.f[i] = t.f
        to.K[i] = t.K
        to.s[i] = t.s
        to.N[i] = t.N

    return press_edges


@cache
def edge_gather_kernel(module: str):
    """Kernel over rows of points: which pairs press them, and what they add up there."""
    @wp.kernel(module=module, enable_backward=False)
    def gather_pairs(row: wp.array(dtype=int), s: Surfaces, near_at: wp.array(dtype=NearPairs), P: EdgePairs,
                     f_out: wp.array(dtype=wp.vec3d), K_out: wp.array(dtype=wp.mat33d), along_out: wp.array(dtype=wp.mat33d)):
        near = near_at[0]
        p = row[wp.tid()]
        f = wp.vec3d()
        K = wp.mat33d()
        along = wp.mat33d()
        n = int(0)
        if s.w[p] > wp.float64(0.0):
            many = wp.min(P.many[p], P.of.shape[1])
            for j in range(0, many, wp.static(4)):               # four at a time: a GPU waits for all of them once
                e = wp.vec4i()
                N = wp.vec4d()
                for k in range(wp.static(4)):
                    e[k] = P.of[p, wp.min(j + k, many - 1)]
                for k in range(wp.static(4)):
                    N[k] = P.N[e[k] / 4]
                for k in range(wp.static(4)):
                    if j + k < many and N[k] > wp.float64(0.0):
                        P.on[p, n] = e[k]
                        n += 1
            for j in range(n):
                entry = P.on[p, j]
                i = entry / 4
                c = entry - 4 * i
                b = near.b[i]
                f += P.f[i] * b[c]
                K += P.K[i] * (b[c] * b[c])
                if c == 0 or c == 2:
                    if s.w[near.ids[i][c + 1]] > wp.float64(0.0):
                        along += P.K[i] * (b[c] * b[c + 1])
        P.ons[p] = n
        f_out[p] = f
        K_out[p] = K
        along_out[p] = along

    return gather_pairs


@cache
def edge_cross_kernel(module: str):
    """Kernel: K by what each edge of a pair moves, of motions p (blocks of 4) of points."""
    @wp.kernel(module=module, enable_backward=False)
    def cross_pairs(s: Surfaces, near_at: wp.array(dtype=NearPairs), p: wp.array(dtype=wp.vec4d), to: EdgePairs):
        near = near_at[0]
        i = wp.tid()
        if i >= wp.min(near.count[0], near.capacity):
            return
        if to.N[i] == wp.float64(0.0):                          # points read those that press alone
            return
        ids = near.ids[i]
        b = near.b[i]
        first = wp.vec3d()
        second = wp.vec3d()
        for c in range(4):
            q = ids[c]
            if s.w[q] > wp.float64(0.0):
                move = wp.vec3d(p[q][0], p[q][1], p[q][2]) * b[c]
                if c < 2:
                    first += move
                else:
                    second += move
        to.cross[i, 0] = to.K[i] * first
        to.cross[i, 1] = to.K[i] * second

    return cross_pairs


@cache
def edge_memory_kernel(module: str):
    """Kernel where a substep ends: what pairs remember of it."""
    @wp.kernel(module=module, enable_backward=False)
    def keep_pairs(near_at: wp.array(dtype=NearPairs), to: EdgePairs):
        near = near_at[0]
        i = wp.tid()
        if i < wp.min(near.count[0], near.capacity):
            to.stick[i] = to.s[i]
            to.load[i] = to.N[i]

    return keep_pairs
