"""Search for near pairs: points against triangles, and edges against edges, by a tree over the boxes of each (Warp's).

A pair is listed where the axes of its two sides (kernels/selfcontact/tubes.py) may come nearer than what it keeps and two tubes'
radii. Pairs that share a point touch always, and are none. A pair keeps the sum of the half thicknesses of its sides, and at most
REST times its distance in the rest shape: what is near by construction is not pushed apart. That limits forces only; no pair is
left out of the proof for being near at rest.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import closest, pairs
from wsim.kernels.selfcontact.tubes import frames

REST = 0.4


@cache
def boxes(real, module):
    """Kernels: boxes about the axes of the points of triangles, and of edges."""
    vec3 = types(real).vec3
    Surfaces, Frames = pairs.surfaces(real), frames(real)

    @wp.func
    def under(f: Frames, i: int):
        a = wp.min(f.start[i], f.goal[i])
        return wp.vec3f(float(a[0]), float(a[1]), float(a[2]))

    @wp.func
    def over(f: Frames, i: int):
        a = wp.max(f.start[i], f.goal[i])
        return wp.vec3f(float(a[0]), float(a[1]), float(a[2]))

    @wp.kernel(module=module, enable_backward=False)
    def triangle_boxes(s: Surfaces, f: Frames, low: wp.array(dtype=wp.vec3f), high: wp.array(dtype=wp.vec3f)):
        i = wp.tid()
        c = s.triangle[i]
        low[i] = wp.min(under(f, c[0]), wp.min(under(f, c[1]), under(f, c[2])))
        high[i] = wp.max(over(f, c[0]), wp.max(over(f, c[1]), over(f, c[2])))

    @wp.kernel(module=module, enable_backward=False)
    def edge_boxes(s: Surfaces, f: Frames, low: wp.array(dtype=wp.vec3f), high: wp.array(dtype=wp.vec3f)):
        i = wp.tid()
        c = s.edge[i]
        low[i] = wp.min(under(f, c[0]), under(f, c[1]))
        high[i] = wp.max(over(f, c[0]), over(f, c[1]))

    return triangle_boxes, edge_boxes


@cache
def listing(real):
    """Function: appends a pair to the list, if it may come near enough."""
    t = types(real)
    Surfaces, Frames, Pairs = pairs.surfaces(real), frames(real), pairs.lists(real)
    weights = closest.weights(real)

    @wp.func
    def distance(kind: int, p0: t.vec3, p1: t.vec3, p2: t.vec3, p3: t.vec3):
        b = weights(kind, p0, p1, p2, p3)
        return wp.length(b[0] * p0 + b[1] * p1 + b[2] * p2 + b[3] * p3)

    @wp.func
    def length(f: Frames, i: int):
        return wp.length(f.goal[i] - f.start[i])

    @wp.func
    def append(s: Surfaces, f: Frames, kind: int, ids: wp.vec4i, near: Pairs):
        o = f.start[ids[0]]
        away = distance(kind, f.start[ids[0]] - o, f.start[ids[1]] - o, f.start[ids[2]] - o, f.start[ids[3]] - o)
        first = length(f, ids[0])
        other = wp.max(length(f, ids[2]), length(f, ids[3]))
        own = s.reach[ids[0]]
        its = wp.max(s.reach[ids[2]], s.reach[ids[3]])
        if kind == closest.POINT:
            other = wp.max(other, length(f, ids[1]))
            its = wp.max(its, s.reach[ids[1]])
        else:
            first = wp.max(first, length(f, ids[1]))
            own = wp.max(own, s.reach[ids[1]])
        keep = own + its
        if away > keep + s.radius + first + other:
            return
        b = s.body[ids[0]]
        if s.tied > 0 or (b == s.body[ids[1]] and b == s.body[ids[2]] and b == s.body[ids[3]]):
            c = s.rest[ids[0]]
            keep = wp.min(keep, real(REST) * distance(kind, t.vec3(), s.rest[ids[1]] - c, s.rest[ids[2]] - c,
                                                      s.rest[ids[3]] - c))
        slot = wp.atomic_add(near.count, 0, 1)
        if slot < near.capacity:
            near.kind[slot] = kind
            near.ids[slot] = ids
            near.keep[slot] = keep
            near.bad[slot] = 0
            near.on[slot] = 0
            near.push[slot] = t.vec3()

    return append


@cache
def reach(real, module):
    """Kernels: points against triangles, edges against edges of a greater number. tree, root: of the boxes of triangles
    (edges), and its nodes by world."""
    t = types(real)
    Surfaces, Frames, Pairs = pairs.surfaces(real), frames(real), pairs.lists(real)
    append = listing(real)

    @wp.func
    def corner(a: t.vec3, more: real):
        return wp.vec3f(float(a[0] + more), float(a[1] + more), float(a[2] + more))

    @wp.kernel(module=module, enable_backward=False)
    def search_points(s: Surfaces, f: Frames, tree: wp.uint64, root: wp.array(dtype=int), widest: real, near: Pairs):
        i = s.point[wp.tid()]
        low = corner(wp.min(f.start[i], f.goal[i]), -widest)
        high = corner(wp.max(f.start[i], f.goal[i]), widest)
        k = int(0)
        query = wp.bvh_query_aabb(tree, low, high, root[s.world[i]])
        while wp.bvh_query_next(query, k):
            c = s.triangle[k]
            if c[0] != i and c[1] != i and c[2] != i:
                append(s, f, closest.POINT, wp.vec4i(i, c[0], c[1], c[2]), near)

    @wp.kernel(module=module, enable_backward=False)
    def search_edges(s: Surfaces, f: Frames, tree: wp.uint64, root: wp.array(dtype=int), widest: real, near: Pairs):
        i = wp.tid()
        c = s.edge[i]
        a = c[0]
        b = c[1]
        low = corner(wp.min(wp.min(f.start[a], f.goal[a]), wp.min(f.start[b], f.goal[b])), -widest)
        high = corner(wp.max(wp.max(f.start[a], f.goal[a]), wp.max(f.start[b], f.goal[b])), widest)
        k = int(0)
        query = wp.bvh_query_aabb(tree, low, high, root[s.world[a]])
        while wp.bvh_query_next(query, k):
            if k > i:
                e = s.edge[k]
                if e[0] != a and e[0] != b and e[1] != a and e[1] != b:
                    append(s, f, closest.EDGES, wp.vec4i(a, b, e[0], e[1]), near)

    return search_points, search_edges


@cache
def listed(module):
    """Kernel: a list was made: whether it holds pairs, and how many times so far."""
    @wp.kernel(module=module, enable_backward=False)
    def list_made(count: wp.array(dtype=int), words: wp.array(dtype=int)):
        words[pairs.SOON] = 0
        words[pairs.NEAR] = wp.min(count[0], 1)
        words[pairs.MADE] = words[pairs.MADE] + 1

    return list_made
