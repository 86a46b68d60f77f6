"""Two meshes: the faces of A in the bounds of B, and for each the faces of B near it (kernels/rigid/narrow/mesh_pair.py).

False ways out. A corner that is a little below one face may be far behind another, along which it stands out as well. A
contact i that is DEEPER times as deep as another, e, of another normal and not far away, is left out where A, lifted out of e,
is out of B at i too:

    a_i + (depth_e + LIFT depth_i) n_e  outside B        of a corner of A, and of edges
    b_i - (depth_e + LIFT depth_i) n_e  outside A        of a corner of B, and of edges

so that a body in a hollow keeps both the floor and the wall.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.block import warp_barrier
from wsim.kernels.math.eigen import identity_like
from wsim.kernels.math.marks import scratch, standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.lists.manifold import manifold_makers
from wsim.kernels.rigid.lists.mesh_rows import gather_func
from wsim.kernels.rigid.lists.pairs import ROWS
from wsim.kernels.rigid.lists.rows import posed_pair_type
from wsim.kernels.rigid.narrow.mesh import WIDER, mesh_type, relative_pose_func, surface_face_readers
from wsim.kernels.rigid.narrow.mesh_pair import MOST, OF_A, OF_B, contact_record_type, face_pair_func
from wsim.kernels.rigid.narrow.shape import hull_type

DEEPER = wp.constant(4.0)
LIFT = wp.constant(0.1)
NEXT = wp.constant(2.0)                # of a depth: contacts farther away than that know nothing of each other
OTHER = wp.constant(0.9)               # cosine: normals that differ
SHALLOW = wp.constant(1.0e-4)          # of the reach: less deep, a contact is always kept


@cache
def false_contact_func(real):
    """Function (m, posed, surfaces, R, c, rig): takes contacts of the rows from m on out that another one resolves."""
    t, Rig, Posed, Surfaces = types(real), rig_type(real), posed_pair_type(real)[0], mesh_type(real)

    @wp.func
    def place_is_outside(id: wp.uint64, x: t.vec3, far: real):
        found = wp.mesh_query_point_sign_normal(id, wp.vec3f(float(x[0]), float(x[1]), float(x[2])), float(far))
        outside = bool(True)
        if found.result:
            outside = found.sign > 0.0
        return outside

    @wp.func
    def contact_resolves_other(i: int, e: int, p: Posed, S: Surfaces, R: t.mat33, c: t.vec3, rig: Rig):
        """Whether point e of the rows resolves point i."""
        n = rig.c.n[i // 4]
        by = rig.c.n[e // 4]
        deep = -rig.c.gap[i]
        found = bool(False)
        if rig.c.gap[e] * real(DEEPER) > -deep and wp.dot(n, by) < real(OTHER):
            if wp.length(rig.c.first_a[e] - rig.c.first_a[i]) < real(NEXT) * deep:
                lift = (wp.max(-rig.c.gap[e], real(0.0)) + real(LIFT) * deep) * by
                x = rig.c.first_a[i]
                what = rig.c.key[i] % 4
                far = real(NEXT) * deep
                found = True
                if what != OF_B and S.sided[p.b.row] == 1:
                    found = place_is_outside(S.id[p.b.row], R * (x - (real(0.5) * deep) * n + lift) + c, far)
                if found and what != OF_A:
                    found = place_is_outside(S.id[p.a.row], x + (real(0.5) * deep) * n - lift, far)
        return found

    @standalone_function
    @wp.func
    def drop_false_contacts(m: int, p: Posed, S: Surfaces, R: t.mat33, c: t.vec3, shallow: real, rig: Rig):
        gone = scratch(shape=(32,), dtype=int)
        points = int(4) * ROWS
        for i in range(points):
            gone[i] = 0
            if i % 4 < rig.c.count[m + i // 4] and rig.c.gap[4 * m + i] < -shallow:
                for e in range(points):
                    if gone[i] == 0 and e % 4 < rig.c.count[m + e // 4] and i // 4 != e // 4:
                        if contact_resolves_other(4 * m + i, 4 * m + e, p, S, R, c, rig):
                            gone[i] = 1
        rows = int(ROWS)
        for r in range(rows):
            left = int(0)
            for k in range(rig.c.count[m + r]):
                if gone[4 * r + k] == 0:
                    j = 4 * (m + r) + left
                    o = 4 * (m + r) + k
                    rig.c.first_a[j] = rig.c.first_a[o]
                    rig.c.gap[j] = rig.c.gap[o]
                    rig.c.key[j] = rig.c.key[o]
                    left += 1
            rig.c.count[m + r] = left

    return drop_false_contacts


@cache
def mesh_pair_walk_func(real, lanes: int):
    """Function (m, lane, posed, hulls, surfaces, rig): rows of a pair of meshes from m on, in A's frame, by so many lanes."""
    t, Rig, Posed, Hulls, Surfaces = types(real), rig_type(real), posed_pair_type(real)[0], hull_type(real), mesh_type(real)
    Record, seen, pair = contact_record_type(real), relative_pose_func(real), face_pair_func(real)
    (corners, _normal), gathered, drop = surface_face_readers(real), gather_func(real, True), false_contact_func(real)
    single, most = manifold_makers(real)[0], MOST + 1

    @wp.func
    def start_of_query(id: wp.uint64, low: t.vec3, high: t.vec3):
        return wp.mesh_query_aabb(id, wp.vec3f(float(low[0]), float(low[1]), float(low[2])),
                                  wp.vec3f(float(high[0]), float(high[1]), float(high[2])))

    @wp.func
    def lower_corner(X: t.mat33):
        return wp.min(X[0], wp.min(X[1], X[2]))

    @wp.func
    def upper_corner(X: t.mat33):
        return wp.max(X[0], wp.max(X[1], X[2]))

    @standalone_function
    @wp.func
    def meet_face(where: wp.vec2i, S: Surfaces, R: t.mat33, c: t.vec3, span: t.vec3, found: wp.array(dtype=Record),
                  key: wp.array(dtype=int)):
        """Contacts of a face of A with all of B. where: (mesh B, face of A)."""
        X = corners(S, where[1], identity_like(R), t.vec3())
        there = X * wp.transpose(R)
        wide = wp.max(span[0], span[1])
        low = lower_corner(there) + c
        high = upper_corner(there) + c
        wide += real(WIDER) * (wp.length(c) + wp.length(high - low))
        more = t.vec3(wide, wide, wide)
        query = start_of_query(S.id[where[0]], low - more, high + more)
        face = int(0)
        while wp.mesh_query_aabb_next(query, face):
            other = S.first[where[0]] + face
            pair(S, wp.vec2i(where[1], other), X, corners(S, other, R, c), R, span, found, key)

    @wp.func
    def walk_two_meshes(m: int, lane: int, p: Posed, H: Hulls, S: Surfaces, rig: Rig):
        R, c = seen(p.pose_a, p.pose_b)
        reach = wp.min(S.reach[p.a.row], S.reach[p.b.row])
        span = t.vec3(reach, p.margin, real(S.sided[p.b.row]))
        wide = wp.max(reach, p.margin) + real(WIDER) * (wp.length(c) + wp.length(p.a.size) + wp.length(p.b.size))
        back = wp.transpose(R)
        half = t.vec3(wp.dot(wp.abs(back[0]), p.b.size), wp.dot(wp.abs(back[1]), p.b.size), wp.dot(wp.abs(back[2]), p.b.size))
        half += t.vec3(wide, wide, wide)
        middle = -(back * c)
        size = wp.min(wp.length(p.a.size), wp.length(p.b.size))
        query = start_of_query(S.id[p.a.row], middle - half, middle + half)
        found = scratch(shape=(MOST,), dtype=Record)
        key = scratch(shape=(wp.static(most),), dtype=int)
        face = int(0)
        left = bool(True)
        while left:
            mine = int(-1)
            taken = int(0)
            while left and taken < lanes:
                left = wp.mesh_query_aabb_next(query, face)
                if left:
                    if taken == lane:
                        mine = face
                    taken += 1
            key[MOST] = 0
            if mine >= 0:
                meet_face(wp.vec2i(p.b.row, S.first[p.a.row] + mine), S, R, c, span, found, key)
            for turn in range(taken):
                if turn == lane:
                    for i in range(key[MOST]):
                        f = found[i]
                        gathered(m, single(t.vec3(f[3], f[4], f[5]), t.vec3(f[0], f[1], f[2]), f[6], key[i]), 0, size, rig)
                warp_barrier()
        if lane == 0:
            drop(m, p, S, R, c, real(SHALLOW) * reach, rig)
        warp_barrier()

    return walk_two_meshes
