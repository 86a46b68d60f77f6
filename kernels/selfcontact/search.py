"""Search for near pairs: points against triangles, and edges against edges, by a tree over the boxes of each (Warp's).

A pair is listed where its two sides, as far as their tubes lead (kernels/selfcontact/tubes.py), may come nearer than what it
keeps and the radii of its tubes: by where its points are half way, and how far they leave that beside the first. Pairs that
share a point touch always, and are none. A pair keeps the sum of the half thicknesses of its sides, and at most REST times its
distance in the rest shape: what is near by construction is not pushed apart, so that a flat cloth less thick than a third of
its edges lists no pairs. No pair whose tubes meet is left out for being near at rest.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import closest, pairs
from wsim.kernels.selfcontact.tubes import frames

REST = 0.4
ROUND = 1.005          # of tubes, for rounding


@cache
def tube_of(real):
    """Function: corners of the box about the tube of a point."""
    t = types(real)
    Frames = frames(real)

    @wp.func
    def tube(f: Frames, i: int):
        a = f.start[i]
        b = a + real(f.lead[i]) * f.way[i]
        r = t.vec3(f.beta[i], f.beta[i], f.beta[i])
        low = wp.min(a, b) - r
        high = wp.max(a, b) + r
        return wp.vec3f(float(low[0]), float(low[1]), float(low[2])), wp.vec3f(float(high[0]), float(high[1]), float(high[2]))

    return tube


@cache
def boxes(real, module):
    """Kernels: boxes about the axes of the points of triangles, and of edges."""
    Surfaces, Frames = pairs.surfaces(real), frames(real)

    tube = tube_of(real)

    @wp.kernel(module=module, enable_backward=False)
    def triangle_boxes(s: Surfaces, f: Frames, low: wp.array(dtype=wp.vec3f), high: wp.array(dtype=wp.vec3f)):
        i = wp.tid()
        c = s.triangle[i]
        a0, a1 = tube(f, c[0])
        b0, b1 = tube(f, c[1])
        c0, c1 = tube(f, c[2])
        low[i] = wp.min(a0, wp.min(b0, c0))
        high[i] = wp.max(a1, wp.max(b1, c1))

    @wp.kernel(module=module, enable_backward=False)
    def edge_boxes(s: Surfaces, f: Frames, low: wp.array(dtype=wp.vec3f), high: wp.array(dtype=wp.vec3f)):
        i = wp.tid()
        c = s.edge[i]
        a0, a1 = tube(f, c[0])
        b0, b1 = tube(f, c[1])
        low[i] = wp.min(a0, b0)
        high[i] = wp.max(a1, b1)

    return triangle_boxes, edge_boxes


@cache
def listing(real):
    """Function: appends a pair to the list, if it may come near enough."""
    t = types(real)
    Surfaces, Frames, Pairs = pairs.surfaces(real), frames(real), pairs.lists(real)
    weights = closest.weights(real)

    @wp.func
    def distance(kind: int, p1: t.vec3, p2: t.vec3, p3: t.vec3):
        """Function of a pair whose first point is at 0."""
        b = weights(kind, t.vec3(), p1, p2, p3)
        return wp.length(b[1] * p1 + b[2] * p2 + b[3] * p3)

    @wp.func
    def sides(kind: int, a0: real, a1: real, a2: real, a3: real):
        """Greatest numbers of both sides, their sum."""
        other = wp.max(a2, a3)
        if kind == closest.POINT:
            return a0 + wp.max(other, a1)
        return wp.max(a0, a1) + other

    @wp.func
    def leaves(f: Frames, i: int, o: int, half: real):
        """How far point i may be from where it is expected half way, beside what point o does."""
        if half > real(0.0):
            return real(ROUND) * f.beta[i] + half * wp.length(f.way[i] - f.way[o])
        return real(ROUND) * f.beta[i] + real(f.lead[i]) * wp.length(f.way[i])

    @wp.func
    def append(s: Surfaces, f: Frames, kind: int, ids: wp.vec4i, near: Pairs):
        i, j, k, o = ids[1], ids[2], ids[3], ids[0]
        keep = sides(kind, s.reach[o], s.reach[i], s.reach[j], s.reach[k])
        lead = f.lead[o]
        half = real(0.0)
        if lead == f.lead[i] and lead == f.lead[j] and lead == f.lead[k]:
            half = real(0.5) * real(lead)
        tubes = sides(kind, leaves(f, o, o, half), leaves(f, i, o, half), leaves(f, j, o, half), leaves(f, k, o, half))
        b = s.body[o]
        same = s.tied > 0 or (b == s.body[i] and b == s.body[j] and b == s.body[k])
        c = f.start[o] + half * f.way[o]
        p1 = (f.start[i] + half * f.way[i]) - c
        p2 = (f.start[j] + half * f.way[j]) - c
        p3 = (f.start[k] + half * f.way[k]) - c
        now = real(0.0)
        step = int(0)
        while step < 2:                                   # half way, and at rest: a loop, so that it is compiled once
            away = distance(kind, p1, p2, p3)
            if step == 0:
                if away > keep + tubes:
                    return
                now = away
            else:
                keep = wp.min(keep, real(REST) * away)
            step += 1
            if not same:
                step = 2
            c = s.rest[o]
            p1 = s.rest[i] - c
            p2 = s.rest[j] - c
            p3 = s.rest[k] - c
        if now > keep + tubes:
            return
        slot = wp.atomic_add(near.count, 0, 1)
        if slot < near.capacity:
            near.kind[slot] = kind
            near.ids[slot] = ids
            near.keep[slot] = keep
            near.bad[slot] = 0
            near.push[slot] = t.vec3()

    return append


@cache
def reach(real, module):
    """Kernel: points against triangles, or edges against edges of a greater number. start: of the first of the points (edges),
    and of the triangles (edges) of the tree; tree, root: of the boxes of these, and its nodes by world."""
    Surfaces, Frames, Pairs = pairs.surfaces(real), frames(real), pairs.lists(real)
    append, tube = listing(real), tube_of(real)

    @wp.kernel(module=module, enable_backward=False)
    def search_pairs(s: Surfaces, f: Frames, kind: int, start: wp.vec2i, tree: wp.uint64, root: wp.array(dtype=int),
                     widest: float, near: Pairs):
        own = start[0] + wp.tid()
        a, b = int(0), int(0)
        if kind == closest.POINT:
            a = s.point[own]
            b = a
        else:
            a = s.edge[own][0]
            b = s.edge[own][1]
        a0, a1 = tube(f, a)
        b0, b1 = tube(f, b)
        more = wp.vec3f(widest, widest, widest)
        low = wp.min(a0, b0) - more
        high = wp.max(a1, b1) + more
        leaf = int(0)
        query = wp.bvh_query_aabb(tree, low, high, root[s.world[a]])
        while wp.bvh_query_next(query, leaf):
            k = start[1] + leaf
            ids = wp.vec4i(a, a, a, a)
            if kind == closest.POINT:
                c = s.triangle[k]
                ids = wp.vec4i(a, c[0], c[1], c[2])
            elif k > own:
                e = s.edge[k]
                ids = wp.vec4i(a, b, e[0], e[1])
            if ids[2] != a and ids[3] != a and ids[1] != ids[2] and ids[1] != ids[3] and (kind == closest.EDGES or ids[1] != a):
                append(s, f, kind, ids, near)

    return search_pairs


@cache
def listed(real, module):
    """Kernel: a list was made: whether it holds pairs, and how many times so far. begins 1: before a substep, by its
    prediction: A is 1 until it ends."""
    Frames = frames(real)

    @wp.kernel(module=module, enable_backward=False)
    def list_made(count: wp.array(dtype=int), begins: int, f: Frames, words: wp.array(dtype=int)):
        if begins > 0:
            f.frame[1] = wp.transform_identity(dtype=real)
        words[pairs.SOON] = 0
        words[pairs.AGE] = 0
        words[pairs.NEAR] = wp.min(count[0], 1)
        words[pairs.MADE] = words[pairs.MADE] + 1

    return list_made
