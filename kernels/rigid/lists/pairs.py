"""Which shapes may meet until the list is made anew: balls about them, grown by how far their bodies can go.

Of shapes i < j: not both of colliders, not of one body, of one world (or all), and

    |c_i - c_j| < ball_i + ball_j + way_i + way_j,    way = time (|v| + |a| time + |omega| arm) + a part of the size,

and boxes about them that overlap, which Warp's trees find: one of the shapes of bodies, built anew each time, one of colliders,
built once if they stand. A thread takes shape i of a body and counts, then, behind a scan, writes its partners and sorts them:
the list is sorted, and the same from run to run. Worlds lie in each other: each is a group of the tree. Where a world has few
shapes, a table of pairs takes the place of trees (world_pairs.py). What has no end (planes) is no leaf; all try it, by the
height above it. A body that goes farther than its way, after a blow, says so (`body_straying_func`): then the list of its world
is made anew before its time, and other worlds keep their pairs (worlds.py beside this).
Places are float64 sums of the bodies' origins and displacements; boxes are float32, from the first origin, and widened by what
that rounds.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import BOX
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.contact import rig_type, rigid_contact_structs
from wsim.kernels.rigid.lists.worlds import kept_pairs_func
from wsim.kernels.rigid.narrow.shape import MESH

ROWS = wp.constant(8)              # of a pair with a mesh: manifolds, as many normals
ROUNDED = wp.constant(wp.float32(1.0e-6))        # of a coordinate: some roundings of float32
SLACK = wp.constant(0.02)          # part of a ball's radius within which shapes count as near, however slow


@cache
def shape_tree_type(filtered: bool = False):
    """Struct of the trees of boxes [m] and of the shapes that have no end; filtered: and of what does not touch."""
    @wp.struct
    class ShapeTree:
        id: wp.uint64                          # of shapes of bodies
        grouped: int                           # 1: by worlds
        still: wp.uint64                       # of colliders; 0: none
        low: wp.array(dtype=wp.vec3f)          # of all shapes, bodies' first
        high: wp.array(dtype=wp.vec3f)
        up: wp.array(dtype=wp.vec3f)           # normals of planes
        endless: wp.array(dtype=int)

    @wp.struct
    class FilteredTree:
        id: wp.uint64
        grouped: int
        still: wp.uint64
        low: wp.array(dtype=wp.vec3f)
        high: wp.array(dtype=wp.vec3f)
        up: wp.array(dtype=wp.vec3f)
        endless: wp.array(dtype=int)
        group: wp.array(dtype=int)             # of a shape
        apart: wp.array2d(dtype=int)           # 1: groups that do not touch
        first: wp.array(dtype=int)             # shapes that a shape does not touch besides, and the end
        parted: wp.array(dtype=int)

    return FilteredTree if filtered else ShapeTree


def pair_filter_func(filtered: bool):
    """Function: whether shapes i and j are kept from touching."""
    Tree = shape_tree_type(filtered)
    if not filtered:
        @wp.func
        def pair_is_filtered(i: int, j: int, tree: Tree):
            return False
    else:
        @wp.func
        def pair_is_filtered(i: int, j: int, tree: Tree):
            found = bool(tree.apart[tree.group[i], tree.group[j]] == 1)
            for e in range(tree.first[i], tree.first[i + 1]):
                if tree.parted[e] == j:
                    found = True
            return found
    return pair_is_filtered


def shape_reach_kernel(real, module, filtered: bool = False):
    """Kernel of the centre, (ball, way) of every shape from `first` on: where it has no end, its ball is < 0. Also notes where
    bodies are. Colliders go as they are animated: they need no slack, and one may be a landscape."""
    t, Tree = types(real), shape_tree_type(filtered)
    Rig = rig_type(real)

    @wp.func
    def fastest_collider_speed(c: int, ball: real, rig: Rig):
        """Largest speed of a point of a collider in the frame [m/s]."""
        speed = real(0.0)
        for r in range(rig.still.v.shape[0]):
            speed = wp.max(speed, wp.length(rig.still.v[r, c]) + wp.length(rig.still.omega[r, c]) * wp.max(ball, real(0.0)))
        return speed

    def rigid_reach(rig: Rig, first: int, k: int, time: real, tree: Tree):
        i = first + wp.tid()
        f = rig.s.frame[i]
        n = rig.b.w.shape[0]
        x = t.vec3()
        q = t.quat()
        way = real(0.0)
        if f < n and rig.work.strayed[1 + wp.max(rig.s.world[i], 0)] == 0:
            return                                      # of a world whose list stays
        if f < n:
            x = rig.now.x[f]
            q = rig.now.q[f]
            way = time * rig.b.w[f] * (wp.length(rig.now.p[f]) + time * wp.length(rig.b.push[f]))
            spin = wp.length(wp.cw_mul(rig.b.inverse[f], wp.quat_rotate_inv(q, rig.now.L[f])))
            way += time * spin * rig.work.arm[f]
            rig.work.way[f] = way + rig.work.slack[f]
        else:
            row = k * rig.still.moving
            x = rig.still.x[row, f - n]
            q = rig.still.q[row, f - n]
            way = time * fastest_collider_speed(f - n, rig.s.ball[i], rig)
        rig.work.from_x[f] = x
        rig.work.from_q[f] = q
        p = x + wp.quat_rotate(q, wp.transform_get_translation(rig.s.place[i]))
        rig.work.center[i] = rig.s.origin[f] + wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))
        slack = real(0.0)
        if f < n:
            slack = real(SLACK) * rig.s.ball[i]
        rig.work.span[i] = t.vec2(rig.s.ball[i], way + slack)
        ball = rig.s.ball[i]
        half = t.vec3(ball, ball, ball)
        if rig.s.kind[i] == BOX or rig.s.kind[i] == MESH:
            R = rotation_to_matrix(q * wp.transform_get_rotation(rig.s.place[i]))
            half = t.vec3(wp.dot(wp.abs(R[0]), rig.s.size[i]), wp.dot(wp.abs(R[1]), rig.s.size[i]),
                          wp.dot(wp.abs(R[2]), rig.s.size[i]))
        if ball < real(0.0):
            half = t.vec3()
            R = rotation_to_matrix(q * wp.transform_get_rotation(rig.s.place[i]))
            tree.up[i] = wp.vec3f(wp.float32(R[0, 2]), wp.float32(R[1, 2]), wp.float32(R[2, 2]))
        from_first = rig.work.center[i] - rig.s.origin[0]
        at = wp.vec3f(wp.float32(from_first[0]), wp.float32(from_first[1]), wp.float32(from_first[2]))
        more = wp.float32(rig.work.span[i][1]) + ROUNDED * wp.max(wp.abs(at))
        wide = wp.vec3f(wp.float32(half[0]) + more, wp.float32(half[1]) + more, wp.float32(half[2]) + more)
        tree.low[i] = at - wide
        tree.high[i] = at + wide

    return wp.kernel(rigid_reach, name="rigid_reach", module=module, enable_backward=False)


def prefix_sum_kernel(module):
    """Kernel over threads with an equal part of the counts each: first_out[i] is the sum of count[0] .. count[i]. Without
    `write` each leaves the sum of its part in `sums`, with it the sums up to each place. One thread needs the second alone."""
    def rigid_summed(count: wp.array(dtype=int), threads: int, write: int, sums: wp.array(dtype=int),
                     first_out: wp.array(dtype=int)):
        t = wp.tid()
        each = (count.shape[0] + threads - 1) // threads
        sum = int(0)
        if write == 1:
            for before in range(t):
                sum += sums[before]
        for i in range(t * each, wp.min((t + 1) * each, count.shape[0])):
            sum += count[i]
            if write == 1:
                first_out[i] = sum
        if write == 0:
            sums[t] = sum

    return wp.kernel(rigid_summed, name="rigid_summed", module=module, enable_backward=False)


@cache
def pair_row_functions(real, filtered: bool = False):
    """append(i, j, at, write, tree, rig) -> how many rows the pair of shapes i < j takes, 0 where it cannot meet; they are
    written at their place then, where there is room. end(i, first, rig, wanted): rows behind the list hold no pair, by all
    threads i, and `wanted` how many rows there would be."""
    Rig, Tree, parted = rig_type(real), shape_tree_type(filtered), pair_filter_func(filtered)

    @wp.func(inline=False)
    def shape_above_plane(i: int, j: int, tree: Tree, rig: Rig):
        """Whether shape i is near enough to plane j; one that moves may turn."""
        d = rig.work.center[i] - rig.work.center[j]
        n = tree.up[j]
        height = d[0] * wp.float64(n[0]) + d[1] * wp.float64(n[1]) + d[2] * wp.float64(n[2])
        more = rig.work.span[i][0] + rig.work.span[i][1] + rig.work.span[j][1] + real(ROUNDED) * real(wp.length(d))
        return rig.still.moving == 1 or real(height) < more

    @wp.func(inline=False)
    def shapes_may_meet(i: int, j: int, tree: Tree, rig: Rig):
        bodies = rig.b.w.shape[0]
        fi = rig.s.frame[i]
        fj = rig.s.frame[j]
        if fi == fj or (fi >= bodies and fj >= bodies):
            return False
        if rig.s.world[i] != rig.s.world[j] and rig.s.world[i] >= 0 and rig.s.world[j] >= 0:
            return False
        one = rig.work.span[i]
        other = rig.work.span[j]
        if other[0] < real(0.0):
            return shape_above_plane(i, j, tree, rig)
        return real(wp.length(rig.work.center[i] - rig.work.center[j])) < one[0] + one[1] + other[0] + other[1]

    @wp.func
    def append_pair_rows(i: int, j: int, at: int, write: int, tree: Tree, rig: Rig):
        taken = int(0)
        if j > i:
            if shapes_may_meet(i, j, tree, rig) and not parted(i, j, tree):
                taken = 1
                if rig.s.kind[j] == MESH or rig.s.kind[i] == MESH:
                    taken = ROWS
                if write == 1:
                    for row in range(at, wp.min(at + taken, rig.c.a.shape[0])):
                        rig.c.a[row] = i
                        rig.c.b[row] = j
        return taken

    @wp.func
    def end_pair_rows(i: int, first: wp.array(dtype=int), rig: Rig, wanted: wp.array(dtype=int)):
        shapes = first.shape[0]
        all = first[shapes - 1]
        for m in range(all + i, rig.c.a.shape[0], shapes):
            rig.c.a[m] = -1
        if i == 0:
            wanted[0] = wp.max(wanted[0], all)

    return append_pair_rows, end_pair_rows


def pair_list_kernel(real, module, filtered: bool = False):
    """Kernel that counts the partners of a body's shape (write = 0), or writes them behind `first`, where there is room.
    filtered: less those that do not touch. aside: the list before, whose pairs worlds keep that are not listed; first: of this
    list, and of that one."""
    Rig, Tree, (append_rows, end_rows) = rig_type(real), shape_tree_type(filtered), pair_row_functions(real, filtered)
    Table, keep = rigid_contact_structs(real)[2], kept_pairs_func(real)

    @wp.func
    def sort_partners(first: int, last: int, b: wp.array(dtype=int)):
        """By insertion: partners of one shape are few."""
        for m in range(first + 1, last):
            j = int(b[m])
            e = int(m)
            while e > first and b[e - 1] > j:
                b[e] = b[e - 1]
                e -= 1
            b[e] = j

    @wp.func
    def list_partners(i: int, at: int, shapes: int, write: int, tree: Tree, rig: Rig):
        found = int(0)
        for e in range(tree.endless.shape[0]):
            found += append_rows(i, tree.endless[e], at + found, write, tree, rig)
        ids = int(2)
        for which in range(ids):
            id = tree.id
            root = int(-1)
            if which == 1:
                id = tree.still
            elif tree.grouped == 1:
                root = wp.bvh_get_group_root(id, rig.s.world[i])
            if id != wp.uint64(0):
                query = wp.bvh_query_aabb(id, tree.low[i], tree.high[i], root)
                e = int(0)
                while wp.bvh_query_next(query, e):
                    j = e + which * shapes
                    if rig.work.span[j][0] >= real(0.0):
                        found += append_rows(i, j, at + found, write, tree, rig)
        return found

    def rigid_pairs(rig: Rig, tree: Tree, aside: Table, first: wp.array2d(dtype=int), write: int, count: wp.array(dtype=int),
                    wanted: wp.array(dtype=int)):
        i = wp.tid()
        found = int(0)
        at = int(0)
        if write == 1 and i > 0:
            at = first[0, i - 1]
        if rig.work.strayed[1 + rig.s.world[i]] == 1:
            found = list_partners(i, at, first.shape[1], write, tree, rig)
        else:
            found = keep(i, at, write, count[i], aside, first[1], rig)
        if write == 0:
            count[i] = found
        else:
            sort_partners(at, wp.min(at + found, rig.c.a.shape[0]), rig.c.b)
            end_rows(i, first[0], rig, wanted)

    return wp.kernel(rigid_pairs, name="rigid_pairs", module=module, enable_backward=False)
