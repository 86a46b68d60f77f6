"""Search for near pairs: points against triangles, and edges against edges, by a tree over the boxes of each
(kernels/contact/selfcontact/tree.py).

A pair is listed where its two sides, as far as their tubes lead (kernels/contact/selfcontact/motion_bounds.py), may come nearer
than what it keeps and the radii of its tubes: along the normal n that it has half way they stay min(g, g') apart, g the gap
where tubes begin and g' where they end, since n . (p_i - p_j) goes linearly. What slides past does not count. Pairs that share
a point touch always, and are none. A pair keeps the sum of the half thicknesses of its sides, and at most REST times its
distance in the rest shape: what is near by construction is not pushed apart, so that a flat cloth less thick than a third of
its edges lists no pairs. Strands of rods keep each other off by a law of their own (kernels/rods/edges/touch.py): two of them
keep nothing here, and are proven only. No pair whose tubes meet is left out for being near at rest.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import closest, pairs, tree
from wsim.kernels.contact.selfcontact.motion_bounds import MANY, NARROW, frame_type
from wsim.kernels.math.real import types

REST = 0.4
ROUND = 1.005          # of tubes, for rounding
AMONG = 2              # kind of edges that look for edges behind them
SIDE_BY_SIDE = 8       # what looks together on a CPU: it stands together
CANDIDATES = 3         # that there is more room for with each pair


@cache
def pair_append_func(real):
    """Function: appends a pair to the list, if it may come near enough."""
    t = types(real)
    Surfaces, Frames, Pairs = pairs.surface_type(real), frame_type(real), pairs.pair_type(real)
    weights, gap, absent = closest.closest_weights(real), closest.pair_gap_func(real), pairs.absent_ball_func(real)

    @wp.func
    def way_between_closest(kind: int, p1: t.vec3, p2: t.vec3, p3: t.vec3):
        """Way between the closest points of a pair whose first point is at 0."""
        b = weights(kind, t.vec3(), p1, p2, p3)
        return b[1] * p1 + b[2] * p2 + b[3] * p3

    @wp.func
    def greatest_side_sum(kind: int, a0: real, a1: real, a2: real, a3: real):
        """Greatest numbers of both sides, their sum."""
        other = wp.max(a2, a3)
        if kind == closest.POINT:
            return a0 + wp.max(other, a1)
        return wp.max(a0, a1) + other

    @wp.func
    def append_near_pair(s: Surfaces, f: Frames, kind: int, ids: wp.vec4i, near: Pairs):
        i, j, k, o = ids[1], ids[2], ids[3], ids[0]
        keep = greatest_side_sum(kind, s.reach[o], s.reach[i], s.reach[j], s.reach[k])
        tubes = real(ROUND) * greatest_side_sum(kind, f.beta[o], f.beta[i], f.beta[j], f.beta[k])
        half = real(0.5) * real(f.lead[0])
        part = f.part[0]
        b = s.body[o]
        if kind == closest.EDGES and wp.min(b, s.body[j]) >= pairs.STRANDS:
            keep = real(0.0)
        if kind == closest.POINT and s.role[i] == pairs.MET and s.role[o] != pairs.BALL or absent(s, o) or absent(s, j):
            return
        same = s.tied > 0 or (b == s.body[i] and b == s.body[j] and b == s.body[k])
        c = f.start[o]
        v = f.way[o]
        v1, v2, v3 = half * (f.way[i] - v), half * (f.way[j] - v), half * (f.way[k] - v)
        p1, p2, p3 = (f.start[i] - c) + v1, (f.start[j] - c) + v2, (f.start[k] - c) + v3
        n, zero = t.vec3(), t.vec3()
        step = int(0)
        while step < 2:                                   # half way, and at rest: a loop, so that it is compiled once
            way = way_between_closest(kind, p1, p2, p3)
            if step == 0:
                n = wp.normalize(way)
                now = wp.min(gap(kind, n, zero, p1 - v1, p2 - v2, p3 - v3), gap(kind, n, zero, p1 + v1, p2 + v2, p3 + v3))
                if now > part * keep + tubes:
                    return
            else:
                keep = wp.min(keep, real(REST) * wp.length(way))
            step += 1
            if not same:
                step = 2
            c = s.rest[o]
            p1 = s.rest[i] - c
            p2 = s.rest[j] - c
            p3 = s.rest[k] - c
        if now > part * keep + tubes:
            return
        slot = wp.atomic_add(near.count, 0, 1)
        if slot < near.capacity:
            near.kind[slot] = kind
            near.ids[slot] = ids
            near.keep[slot] = keep
            near.bad[slot] = 0
            near.n[slot] = n
            near.push[slot] = t.vec3()

    return append_near_pair


@cache
def box_candidate_kernel(real, module, levels=False):
    """Kernel: candidates, points and triangles or edges and edges whose boxes meet and that share no point. looks: who looks
    where, of which the edges of kind AMONG see those behind them; widest: what pairs keep at most [m]. levels: walks go level
    by level, SIDE_BY_SIDE at once, as is faster on a CPU. Else threads share a walk: each has what is below one of so many."""
    Surfaces, Frames = pairs.surface_type(real), frame_type(real)
    _, about = tree.tube_box_funcs(real)

    @wp.func
    def append_candidate(s: Surfaces, kind: int, i: int, a: int, b: int, item: int, out: pairs.BoxPairs):
        """One candidate, if it shares no point with points a, b of i."""
        c = wp.vec3i(0, 0, 0)
        k = item
        if kind == closest.POINT:
            c = s.triangle[k]
        else:
            c = wp.vec3i(s.edge[k][0], s.edge[k][1], s.edge[k][1])
            k = -1 - k
        if a != c[0] and a != c[1] and a != c[2] and b != c[0] and b != c[1]:
            slot = wp.atomic_add(out.count, 0, 1)
            if slot < out.capacity:
                out.pair[slot] = wp.vec2i(i, k)

    @wp.func
    def query_side_points(s: Surfaces, kind: int, i: int):
        """Points of what looks."""
        a = i
        b = i
        if kind != closest.POINT:
            a = s.edge[i][0]
            b = s.edge[i][1]
        return a, b

    @wp.func
    def query_group_box(s: Surfaces, f: Frames, look: tree.TreeQuery, first: int, world: int):
        """(box about what looks from `first` on and is of a world, where it ends): of SIDE by SIDE at most."""
        end = wp.min(first - first % SIDE_BY_SIDE + SIDE_BY_SIDE, look.order.shape[0])
        found = tree.Box()
        j = int(first)
        while j < end:
            i = look.order[j]
            if i >= 0:
                a, b = query_side_points(s, look.kind, i)
                if s.world[a] != world:
                    end = j
                elif j == first:
                    found = about(f, a, b, b)
                else:
                    found = tree.joined_swept_box(found, about(f, a, b, b))
            j += 1
        return found, end

    @wp.func
    def meet_beside(s: Surfaces, f: Frames, look: tree.TreeQuery, first: int, room: float, out: pairs.BoxPairs):
        """What looks from `first` on walks through the tree together; where it ends."""
        into = look.into
        a, b = query_side_points(s, look.kind, look.order[first])
        world = s.world[a]
        root = world * 2 * into.leaves
        box, end = query_group_box(s, f, look, first, world)
        among = look.kind == AMONG
        count = tree.count_leaves_met(box, into.box, root, into.leaves, wp.where(among, first % into.leaves, -1), room,
                                      into.front)
        for j in range(first, end):
            i = look.order[j]
            if i >= 0:
                a, b = query_side_points(s, look.kind, i)
                after = wp.where(among, j % into.leaves, -1)
                some = tree.filter_leaves_met(about(f, a, b, b), into.box, root, into.leaves, after, room, into.front, count)
                for m in range(some):
                    append_candidate(s, look.kind, i, a, b, into.item[root / 2 + into.front[into.leaves + m] - into.leaves],
                                     out)
        return end

    @wp.func
    def meet_alone(s: Surfaces, f: Frames, look: tree.TreeQuery, thread: int, room: float, out: pairs.BoxPairs):
        """The part of a walk that a thread of those that share it has."""
        into, shares, j = look.into, look.shares, thread % look.order.shape[0]
        i = look.order[j]
        if i < 0:
            return
        a, b = query_side_points(s, look.kind, i)
        ours = about(f, a, b, b)
        root = s.world[a] * 2 * into.leaves
        node = shares + thread / look.order.shape[0]      # the top of what this thread sees
        trail = int(0)
        leaf = into.leaves + j % into.leaves
        over = leaf / (into.leaves / shares)              # the node beside it that the leaf itself is below
        if look.kind == AMONG and node < over:
            return
        if look.kind == AMONG and node == over:
            trail = tree.trail_after_leaf(ours, into, root, leaf, node, room)
            node, trail = tree.next_walk_node(leaf, trail)
        elif tree.boxes_stay_apart(ours, tree.tree_node_box(into.box, root + node), room):
            return
        while node > 0:
            if node < into.leaves:
                met = tree.children_met(ours, into, root, node, room)
                if met > 0:
                    node = 2 * node + wp.where(met == 2, 1, 0)
                    trail = 2 * trail + wp.where(met == 3, 1, 0)
                else:
                    node, trail = tree.next_walk_node(node, trail)
            else:
                append_candidate(s, look.kind, i, a, b, into.item[root / 2 + node - into.leaves], out)
                node, trail = tree.next_walk_node(node, trail)

    @wp.kernel(module=module, enable_backward=False)
    def boxes_meet(s: Surfaces, f: Frames, looks: wp.array(dtype=tree.TreeQuery), widest: float,
                   out_at: wp.array(dtype=pairs.BoxPairs)):
        look = looks[tree.query_of_thread(looks, wp.tid())]
        room = (widest + look.margin) * float(f.part[0])
        thread = wp.tid() - look.first
        if wp.static(levels):
            j = thread * SIDE_BY_SIDE
            end = wp.min(j + SIDE_BY_SIDE, look.order.shape[0])
            while j < end:
                if look.order[j] >= 0:
                    j = meet_beside(s, f, look, j, room, out_at[0])
                else:
                    j += 1
        else:
            meet_alone(s, f, look, thread, room, out_at[0])

    return boxes_meet


@cache
def candidate_sift_kernel(real, module):
    """Kernel: the list, of candidates. Of two edges the one with the smaller number is the first."""
    Surfaces, Frames, Pairs = pairs.surface_type(real), frame_type(real), pairs.pair_type(real)
    append = pair_append_func(real)

    @wp.kernel(module=module, enable_backward=False)
    def sift_candidates(s: Surfaces, f: Frames, found_at: wp.array(dtype=pairs.BoxPairs), threads: int,
                        near_at: wp.array(dtype=Pairs)):
        found = found_at[0]
        near = near_at[0]
        j = wp.tid()
        while j < wp.min(found.count[0], found.capacity):
            i = found.pair[j][0]
            k = found.pair[j][1]
            kind = int(closest.POINT)
            ids = wp.vec4i(0, 0, 0, 0)
            if k >= 0:
                c = s.triangle[k]
                ids = wp.vec4i(i, c[0], c[1], c[2])
            else:
                kind = closest.EDGES
                a = s.edge[wp.min(i, -1 - k)]
                b = s.edge[wp.max(i, -1 - k)]
                ids = wp.vec4i(a[0], a[1], b[0], b[1])
            if k >= 0 or ids[2] != ids[3] or s.body[ids[0]] >= pairs.STRANDS:      # balls meet triangles, not their edges
                append(s, f, kind, ids, near)
            j += threads

    return sift_candidates


@cache
def list_made_kernel(real, module):
    """Kernel: a list was made: whether it holds pairs, and how many times so far. begins 1: before a substep, by its
    prediction: A is 1 until it ends. points: how many there are. One for a proof is made anew before the next substep. One that
    there was no room for holds none, since which of its pairs found room depends on the order of threads; words[LACKED] says
    how many there were, or, where there was no room for candidates, of how many they would be with as many candidates each:
    nothing in it depends on that order. The frame is repeated with room: until it ends no list is made any more, since what
    else it finds counts for nothing."""
    Frames, Pairs = frame_type(real), pairs.pair_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def list_made(found_at: wp.array(dtype=pairs.BoxPairs), begins: int, points: int, near_at: wp.array(dtype=Pairs),
                  f: Frames, words: wp.array(dtype=int)):
        found = found_at[0]
        near = near_at[0]
        if begins > 0:
            f.frame[1] = wp.transform_identity(dtype=real)
        wanted = near.count[0]
        if found.count[0] > found.capacity:
            over = float(found.count[0]) / float(found.capacity)
            more = (found.count[0] - found.capacity) / CANDIDATES
            wanted = near.capacity + wp.max(int((over - 1.0) * float(near.capacity)), more) + 1
        full = int(float(found.count[0]) / float(found.capacity) * float(near.capacity))
        words[pairs.LISTED] = wp.max(words[pairs.LISTED], wp.max(near.count[0], full))
        if wanted > near.capacity:
            words[pairs.LACKED] = wp.max(words[pairs.LACKED], wanted)
            near.count[0] = 0
        if f.part[0] == real(1.0):
            each = real(wanted) / (real(points) * f.least[0] * f.least[0] * f.least[0])
            f.dense[0] = wp.max(each / real(MANY), real(1.0))
        if begins > 0:
            words[pairs.NARROW] = wp.where(f.least[0] < real(NARROW), 2, wp.where(f.least[0] < real(1.0), 1, 0))
        words[pairs.PROOF] = wp.where(f.part[0] < real(1.0), 1, 0)
        words[pairs.SOON] = wp.where(words[pairs.LACKED] > 0, 0, words[pairs.PROOF])
        words[pairs.AGE] = 0
        words[pairs.NEAR] = wp.min(near.count[0], 1)
        words[pairs.MADE] = words[pairs.MADE] + 1

    return list_made
