"""Manifolds of bodies with triangle meshes that stand: of a pair as many as there are normals, ROWS at most.

The first row of a pair has the threads: a warp of a GPU, or one. They walk the mesh's tree for the bounds of the shape, meet a
triangle each (kernels/rigid/narrow/triangle.py), and in turn put the points into the row whose normal is theirs to ALIKE, else
into a new one. Once all rows are taken, the row that is least deep makes room for what is deeper. A row keeps four of its
points, those of one place once: the corners of what the shape stands on, however many triangles it is cut into.

    key   a corner of A's face: its own number, so that it lasts from triangle to triangle; else that of the face with it
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import SPHERE
from wsim.kernels.math.block import warp_barrier
from wsim.kernels.math.eigen import identity_like
from wsim.kernels.math.marks import scratch, standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.impulse import impulse_formulas
from wsim.kernels.rigid.lists.core import cores_on_meshes
from wsim.kernels.rigid.lists.manifold import manifold_reduction_func, manifold_type
from wsim.kernels.rigid.lists.pairs import ROWS
from wsim.kernels.rigid.lists.renewal import LATER, STEPS, TOUCHES, manifold_need_func, twist_functions
from wsim.kernels.rigid.lists.rows import keep_row_func, last_list_type, posed_pair_type, row_writing_funcs
from wsim.kernels.rigid.narrow.clip import SIDES, WHOLE
from wsim.kernels.rigid.narrow.mesh import WIDER, mesh_type, relative_pose_func, shape_bounds_func, surface_face_readers
from wsim.kernels.rigid.narrow.shape import MESH, hull_type, shape_extent_funcs
from wsim.kernels.rigid.narrow.triangle import triangle_func

ALIKE = wp.constant(0.9995)            # cosine, 1.8 degrees: triangles of one plane, and of what is nearly one
SAME = wp.constant(1.0e-3)             # of the shape's size: points nearer than that are one


@cache
def gather_func(real):
    """(gathered, key_of). gathered(m, mm, face, size, rig): the points of a triangle's manifold, in A's frame, into the rows
    from m on, whose normals are in A's frame and whose places are in `first_a` meanwhile."""
    vec3, Rig, Manifold = types(real).vec3, rig_type(real), manifold_type(real)
    reduce = manifold_reduction_func(real, True)

    @wp.func
    def key_of(key: int, face: int):
        """A number for a point; see the head of the file."""
        edge = (key // 64) % 64
        other = key % 64
        found = key
        if key == 0 or (key < 1073741824 and edge < SIDES) or (key >= 1073741824 and other != WHOLE):
            found = (key * 31 + face * 7919) % 1073741824 - 1073741824             # below 0
        return found

    @wp.func
    def least_row_gap(row: int, rig: Rig):
        gap = rig.c.gap[4 * row]
        for i in range(1, rig.c.count[row]):
            gap = wp.min(gap, rig.c.gap[4 * row + i])
        return gap

    @wp.func
    def row_for_normal(m: int, n: vec3, gap: real, rig: Rig):
        """The row for a normal: emptied, if it was another's; -1: none."""
        row = int(-1)
        best = real(ALIKE)
        free = int(-1)
        shallow = int(-1)
        most = gap
        rows = int(ROWS)
        for r in range(rows):
            if rig.c.count[m + r] > 0:
                alike = wp.dot(rig.c.n[m + r], n)
                if alike > best:
                    best = alike
                    row = m + r
                if least_row_gap(m + r, rig) > most:
                    most = least_row_gap(m + r, rig)
                    shallow = m + r
            elif free < 0:
                free = m + r
        if row < 0:
            row = free
            if row < 0:
                row = shallow
            if row >= 0:
                rig.c.count[row] = 0
                rig.c.n[row] = n
        return row

    @standalone_function
    @wp.func
    def gather_triangle_points(m: int, mm: Manifold, face: int, size: real, rig: Rig):
        gap_m = mm.gap[0]
        for i in range(1, mm.count):
            gap_m = wp.min(gap_m, mm.gap[i])
        row = row_for_normal(m, mm.n, gap_m, rig)
        if row >= 0:
            P = scratch(shape=(8,), dtype=vec3)
            gap = scratch(shape=(8,), dtype=real)
            key = scratch(shape=(8,), dtype=int)
            count = int(rig.c.count[row])
            for i in range(count):
                P[i] = rig.c.first_a[4 * row + i]
                gap[i] = rig.c.gap[4 * row + i]
                key[i] = rig.c.key[4 * row + i]
            for i in range(mm.count):
                twin = int(-1)
                for e in range(count):
                    if wp.length_sq(P[e] - mm.x[i]) < real(SAME) * real(SAME) * size * size:
                        twin = e
                number = key_of(mm.key[i], face)
                if twin < 0:
                    P[count] = mm.x[i]
                    gap[count] = mm.gap[i]
                    key[count] = number
                    count += 1
                else:
                    gap[twin] = wp.min(gap[twin], mm.gap[i])
                    key[twin] = wp.max(key[twin], number)
            kept = reduce(rig.c.n[row], P, gap, key, count, size)
            rig.c.count[row] = kept.count
            for i in range(kept.count):
                rig.c.first_a[4 * row + i] = kept.x[i]
                rig.c.gap[4 * row + i] = kept.gap[i]
                rig.c.key[4 * row + i] = kept.key[i]

    return gather_triangle_points


@cache
def mesh_walk_func(kinds: frozenset[str], real, lanes: int):
    """Function (m, lane, posed, hulls, surfaces, rig): rows of a pair from m on, in A's frame, by so many lanes of a warp."""
    t, Rig, Posed, Manifold = types(real), rig_type(real), posed_pair_type(real)[0], manifold_type(real)
    bound, seen, met = shape_bounds_func(kinds, real), relative_pose_func(real), triangle_func(kinds, real)
    (corners, _normal), size_of = surface_face_readers(real), shape_extent_funcs(real)[1]
    Hulls, Surfaces, gathered = hull_type(real), mesh_type(real), gather_func(real)

    @wp.func
    def plane_within_margin(low: t.vec3, high: t.vec3, X: t.mat33, margin: real):
        """Whether bounds in A's frame come within the margin of the plane of a triangle there, from either side."""
        n = wp.normalize(wp.cross(X[1] - X[0], X[2] - X[0]))
        middle = real(0.5) * (low + high)
        half = real(0.5) * (high - low)
        return wp.abs(wp.dot(n, middle - X[0])) <= wp.dot(wp.abs(n), half) + margin

    @wp.func
    def walk_mesh_tree(m: int, lane: int, p: Posed, H: Hulls, S: Surfaces, rig: Rig):
        R, c = seen(p.pose_a, p.pose_b)
        low, high = bound(p.a, H, R)
        own_low, own_high = bound(p.a, H, identity_like(R))
        size = size_of(p.a, H)
        more = p.margin + real(WIDER) * (wp.length(c) + wp.length(high - low))
        low += c - t.vec3(more, more, more)
        high += c + t.vec3(more, more, more)
        query = wp.mesh_query_aabb(S.id[p.b.row], wp.vec3f(float(low[0]), float(low[1]), float(low[2])),
                                   wp.vec3f(float(high[0]), float(high[1]), float(high[2])))
        face = int(0)
        first = S.first[p.b.row]
        left = bool(True)
        while left:
            mine = int(-1)
            taken = int(0)
            while left and taken < lanes:
                left = wp.mesh_query_aabb_next(query, face)
                if left:
                    if plane_within_margin(own_low, own_high, corners(S, first + face, R, c), p.margin):
                        if taken == lane:
                            mine = face
                        taken += 1
            mm = Manifold()
            if mine >= 0:
                mm = met(p.a, H, S, wp.vec2i(p.b.row, first + mine), R, c, p.margin)
            for turn in range(taken):
                if turn == lane and mm.count > 0:
                    gathered(m, mm, mine, size, rig)
                warp_barrier()

    return walk_mesh_tree


@cache
def approach_func(real):
    """Function (m, twist, posed, rig) -> (least gap, time until the first point of the rows of a pair touches; < 0: none does).
    Rows are in A's frame."""
    Rig, Posed, of = rig_type(real), posed_pair_type(real)[0], twist_functions(real)
    Twist, closing = of.Twist, of.closing

    @wp.func
    def mesh_row_approach(m: int, both: Twist, p: Posed, rig: Rig):
        q = wp.transform_get_rotation(p.pose_a)
        o = wp.transform_get_translation(p.pose_a)
        least = real(1.0e30)
        soonest = real(-1.0)
        rows = int(ROWS)
        for r in range(rows):
            n = wp.quat_rotate(q, rig.c.n[m + r])
            for i in range(rig.c.count[m + r]):
                j = 4 * (m + r) + i
                least = wp.min(least, rig.c.gap[j])
                rate = closing(n, wp.quat_rotate(q, rig.c.first_a[j]) + o, both, p)
                if rate < real(0.0):
                    after = -rig.c.gap[j] / rate
                    if soonest < real(0.0) or after < soonest:
                        soonest = after
        return least, soonest

    return mesh_row_approach


def collide_mesh(kinds: frozenset[str], real, module, lanes: int = 1):
    """Kernel over the rows of a list, so many threads each, behind `rigid_collide`; kinds: of the shapes that meet meshes; h as
    there. lanes: 1, or 32 on a GPU."""
    t, Rig, Last, Hulls, Surfaces = types(real), rig_type(real), last_list_type(real), hull_type(real), mesh_type(real)
    write, (Posed, posed), walk = row_writing_funcs(real), posed_pair_type(real), mesh_walk_func(kinds, real, lanes)
    known, point, poses, keep, approaching = write.known, write.point, write.poses, keep_row_func(real), approach_func(real)
    needed, of, prepare = manifold_need_func(real), twist_functions(real), impulse_formulas(real)[1]
    block, twist, advanced, hurried, margin, size = cores_on_meshes(real), of.twist, of.advanced, of.hurried, of.margin, of.size

    @wp.func
    def first_of_its_pair(m: int, rig: Rig):
        first = rig.s.kind[rig.c.b[m]] == MESH
        if first and m > 0:
            first = rig.c.a[m - 1] != rig.c.a[m] or rig.c.b[m - 1] != rig.c.b[m]
        return first

    @wp.func
    def mesh_rows_awake(m: int, rig: Rig):
        rows = int(ROWS)
        found = bool(True)
        for r in range(rows):
            if rig.c.count[m + r] < 0:
                found = False
        return found

    @wp.func(inline=False)
    def empty_mesh_rows(m: int, lane: int, rig: Rig):
        warp_barrier()
        for r in range(lane, ROWS, lanes):
            rig.c.count[m + r] = 0
        warp_barrier()

    @wp.func(inline=False)
    def write_mesh_rows(m: int, lane: int, k: int, row: int, p: Posed, last: Last, rig: Rig):
        """Rows of a pair from A's frame into the world's axes, with their impulses."""
        q = wp.transform_get_rotation(p.pose_a)
        o = wp.transform_get_translation(p.pose_a)
        for r in range(lane, ROWS, lanes):
            rig.c.colour[m + r] = -1
            if row >= 0:
                rig.c.colour[m + r] = last.colour[row + r]
            rig.c.n[m + r] = wp.quat_rotate(q, rig.c.n[m + r])
            rig.work.renewed[m + r] = 1
            rig.c.skin[m + r] = t.vec2(rig.s.skin[rig.c.a[m]], real(0.0))
            poses(m + r, p, rig)
            for i in range(rig.c.count[m + r]):
                j = 4 * (m + r) + i
                point(m + r, i, wp.quat_rotate(q, rig.c.first_a[j]) + o, rig.c.gap[j], row, p, last, rig)
            prepare(m + r, k, rig)

    def rigid_collide_mesh(rig: Rig, H: Hulls, S: Surfaces, k: int, h: real, last: Last):
        m = wp.tid() // lanes
        lane = wp.tid() % lanes
        a = rig.c.a[m]
        if a >= 0 and m + ROWS <= rig.c.a.shape[0]:
            if first_of_its_pair(m, rig):
                whole_list = rig.work.strayed[0]
                make = whole_list == 1
                if not make and mesh_rows_awake(m, rig):
                    make = needed(m, k, rig)
                if make:
                    row = int(m)
                    if whole_list == 1:
                        row = known(m, last, rig)
                    else:
                        for r in range(lane, ROWS, lanes):
                            keep(m + r, rig.c, last)
                    p = posed(m, k, rig)
                    both = twist(m, k, h, rig)
                    p.margin = margin(both, h, m, p, rig)
                    q = p
                    fast = hurried(both, h, m, rig)
                    time = real(0.0)
                    steps = int(STEPS)
                    for _step in range(steps):
                        q = advanced(p, both, time, m, rig)
                        empty_mesh_rows(m, lane, rig)
                        walk(m, lane, q, H, S, rig)
                        if not fast:
                            break
                        least, more = approaching(m, both, q, rig)
                        if least <= real(TOUCHES) * size(m, rig) or more < real(0.0) or time + more > real(LATER) * h:
                            break
                        time += more
                    if fast and rig.s.kind[a] != SPHERE and lane == 0:
                        block(m, q, both, h, S, rig)
                    warp_barrier()
                    write_mesh_rows(m, lane, k, row, q, last, rig)
        elif a >= 0 and rig.s.kind[rig.c.b[m]] == MESH:
            rig.c.count[m] = 0                          # no room for all rows of its pair

    return wp.kernel(rigid_collide_mesh, name="rigid_collide_mesh", module=module, enable_backward=False)
