"""Walks over the faces of a mesh that come near a shape, by the lanes of a warp or one thread; what touches comes into the rows
of the pair (mesh_rows.py beside this).

A convex shape A walks the tree of mesh B for its bounds and meets a triangle each (kernels/rigid/narrow/triangle.py). Of a mesh
that a body has, B may come first or be a plane.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.block import warp_barrier
from wsim.kernels.math.eigen import identity_like
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.lists.manifold import manifold_makers, manifold_type
from wsim.kernels.rigid.lists.mesh_rows import gather_func
from wsim.kernels.rigid.lists.pairs import ROWS
from wsim.kernels.rigid.lists.rows import posed_pair_type
from wsim.kernels.rigid.narrow.mesh import WIDER, mesh_type, relative_pose_func, shape_bounds_func, surface_face_readers
from wsim.kernels.rigid.narrow.shape import hull_type, shape_extent_funcs
from wsim.kernels.rigid.narrow.triangle import normal_region_funcs, triangle_func


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
def flipped_walk_func(kinds: frozenset[str], real, lanes: int):
    """As `mesh_walk_func`, of a mesh and a convex shape that comes after it: rows in the mesh's frame."""
    Rig, Posed, Hulls, Surfaces = rig_type(real), posed_pair_type(real)[0], hull_type(real), mesh_type(real)
    walk, seen = mesh_walk_func(kinds, real, lanes), relative_pose_func(real)

    @wp.func
    def walk_flipped_pair(m: int, lane: int, p: Posed, H: Hulls, S: Surfaces, rig: Rig):
        q = p
        q.a = p.b
        q.b = p.a
        q.pose_a = p.pose_b
        q.pose_b = p.pose_a
        walk(m, lane, q, H, S, rig)
        R, c = seen(q.pose_a, q.pose_b)
        for r in range(lane, ROWS, lanes):
            rig.c.n[m + r] = -(R * rig.c.n[m + r])
            for j in range(4 * (m + r), 4 * (m + r) + rig.c.count[m + r]):
                rig.c.first_a[j] = R * rig.c.first_a[j] + c
        warp_barrier()

    return walk_flipped_pair


@cache
def plane_walk_func(real, lanes: int):
    """As `mesh_walk_func`, of a mesh and a plane: what stands out of the mesh within the margin of the plane."""
    t, Rig, Posed, Manifold = types(real), rig_type(real), posed_pair_type(real)[0], manifold_type(real)
    Hulls, Surfaces, gathered = hull_type(real), mesh_type(real), gather_func(real, True)
    at_corner, single, seen = normal_region_funcs(real)[1], manifold_makers(real)[0], relative_pose_func(real)

    @wp.func
    def walk_over_plane(m: int, lane: int, p: Posed, H: Hulls, S: Surfaces, rig: Rig):
        R, o = seen(p.pose_b, p.pose_a)
        n = R * t.vec3(real(0.0), real(0.0), real(1.0))
        size = wp.length(p.a.size)
        last = S.first[p.a.row + 1]
        face = S.first[p.a.row]
        corners = int(3)
        while face < last:
            for k in range(corners):
                mm = Manifold()
                if face + lane < last:
                    if S.corner[face + lane][k] == 1:
                        v = S.face[face + lane][k]
                        gap = wp.dot(n, S.point[v] - o)
                        if gap <= p.margin:
                            if at_corner(S, v, identity_like(R), -n):
                                mm = single(n, S.point[v] - (real(0.5) * gap) * n, gap, 4 * v)
                for turn in range(lanes):
                    if turn == lane and mm.count > 0:
                        gathered(m, mm, 0, size, rig)
                    warp_barrier()
            face += lanes

    return walk_over_plane
