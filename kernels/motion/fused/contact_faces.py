"""Contacts of points with colliders of which some are meshes with lists of candidates, within frames of one launch: the threads
of a point share the faces of its list (lanes.py). What is found is what kernels/contact/search.py finds.

All threads of a warp call these, with `on` not 0 where there is something to do. Lists are made, and slots written, by the
first thread of a point; the others wait for lists.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact import candidates, collide
from wsim.kernels.contact.collider.colliders import collider_frame_funcs
from wsim.kernels.contact.mesh import (
    INSIDE,
    SOLID,
    corner_readers,
    crossing_func,
    entered_face,
    feature_distance,
    mesh_plane_func,
    nearest_feature,
    triangle_normal,
)
from wsim.kernels.contact.project import SUNK, contact_tables, slot_type
from wsim.kernels.contact.search import FURTHER, SUNK_FROM, ball_is_reachable, meets_again, slides_on
from wsim.kernels.math.real import types
from wsim.kernels.motion.fused.lanes import face_list_functions, synchronise_warp, warp_lane_functions
from wsim.kernels.motion.fused.own import thread_points


@cache
def listed_touch_function(kinds: tuple[str, ...], real, lanes: int):
    """Function (c, L, at: row, point and thread, deep, on, ends, reach: r and margin), as `candidates.listed_touch_func`."""
    t, Rows, (corners, steps), formula = types(real), contact_tables(real)[0], corner_readers(real), mesh_plane_func(real)
    cross, enter = crossing_func(real), entered_face(real)
    has_solid, (nearest, side, hit), anywhere = ("solid" in kinds, face_list_functions(lanes),
                                                 warp_lane_functions(lanes, real)[3])

    @wp.func
    def crossed_face(c: Rows, L: Any, at: wp.vec4i, way: t.mat33, X: t.mat33, V: t.mat33, what: int):
        """(Y, front) of the face that is crossed. at: row, point, thread and nearest face, -1: none; way: rows q0, q1, and the
        side with how far faces are looked for."""
        Y, front, start, length, goes, dist = t.mat33(), real(0.0), way[0], real(0.0), int(0), real(0.0)
        q1 = way[1]
        if at[3] >= 0:
            gap, _n, slip = feature_distance(X, V, what, way[2][0], q1)
            dist = gap
            start = way[0] + slip
            length = wp.length(q1 - start)
            goes = wp.where(wp.abs(dist) < length, 1, 0)
        if anywhere(goes) != 0:
            kind, mesh, place = c.of.kind[at[0]], c.of.mesh[at[0]], wp.vec3i(L.slot[at[0]], at[1], at[2])
            face = hit(mesh, L, place, wp.vec3f(start), wp.vec3f((q1 - start) / length), float(length), goes)
            if goes != 0 and face >= 0:
                Y, front = cross(kind, mesh, face, q1 - start)
            if has_solid:
                asks = goes != 0 and kind == SOLID and front == real(0.0) and (face >= 0 or dist < real(0.0))
                within = float(way[2][1] - length)
                if anywhere(wp.where(asks, 1, 0)) != 0:
                    began, _far = nearest(mesh, L, place[0], place[1], wp.vec3f(start), within, place[2], wp.where(asks, 1, 0))
                    if asks and began >= 0 and not (what == INSIDE and began == at[3]):
                        Y, front = enter(mesh, began, start, q1)
        return Y, front

    @wp.func
    def touch_listed_faces(c: Rows, L: Any, at: wp.vec3i, deep: int, on: int, ends: wp.types.matrix((2, 3), real),
                           reach: t.vec2):
        kind, mesh, s = c.of.kind[at[0]], c.of.mesh[at[0]], L.slot[at[0]]
        place = wp.vec3i(s, at[1], at[2])
        q1 = ends[1]
        most = float(reach[0] + reach[1])
        q = wp.vec3f(q1)
        C = real(1.0e30)
        s0 = C
        n = q1
        p = q1
        slip = t.vec3()
        sign = float(1.0)
        sunk = kind == SOLID and deep != 0
        face, near = nearest(mesh, L, s, at[1], q, most, at[2], wp.where(sunk, 0, on))
        if has_solid:
            if on != 0 and sunk:
                wound = wp.mesh_query_point_sign_winding_number(mesh, q, wp.max(most, float(c.of.size[at[0]][0])))
                if wound.result:
                    face = wound.face
                    sign = wound.sign
        X, V, what, behind = t.mat33(), t.mat33(), int(INSIDE), bool(False)
        if face >= 0:
            what, first = nearest_feature(corners(mesh, face, 0), q1)
            X = corners(mesh, face, first)
            V = steps(mesh, face, first)
            behind = what == INSIDE and wp.dot(triangle_normal(X), q1 - X[0]) < real(0.0)
        if has_solid:
            unsure = face >= 0 and kind == SOLID and deep == 0
            if unsure:
                sign = wp.where(behind, float(-1.0), float(1.0))
            asks = wp.where(unsure and what != INSIDE, 1, 0)
            if anywhere(asks) != 0:
                told = side(mesh, L, place, q, face, near, asks)
                sign = wp.where(asks != 0, told, sign)
        gap = wp.where(behind, -real(sign), real(sign))
        way = wp.matrix_from_rows(ends[0], ends[1], t.vec3(gap, reach[0] + reach[1], real(0.0)))
        Y, front = crossed_face(c, L, wp.vec4i(at[0], at[1], at[2], face), way, X, V, what)
        if face >= 0:
            C, n, p, s0, slip = formula(X, V, Y, what, t.vec2(gap, front), ends, reach[0])
        return C, n, p, s0, slip

    return touch_listed_faces


@cache
def lane_collider_function(kinds: tuple[str, ...], real, lanes: int):
    """Function (c, points, at: row, i, k and thread, deep, on, x, d), as `touch_collider_lanes` of
    kernels/contact/search.py."""
    t, (shapes, meshes), (Rows, Points) = types(real), collide.split_convex_and_meshes(kinds), contact_tables(real)
    touch, (inside, outside) = collide.collider_touch_func(shapes, real), collider_frame_funcs(real)
    among, refresh, anywhere = (listed_touch_function(meshes, real, lanes), candidates.list_refresh_func(real),
                                warp_lane_functions(lanes, real)[3])

    @wp.func
    def touch_collider_lanes(c: Rows, points: Points, at: wp.vec4i, deep: int, on: int, x: t.vec3, d: t.vec3):
        row, i, k = at[0], at[1], at[2]
        T0 = c.of.pose[k, row]
        T1 = c.of.pose[k + 1, row]
        q0, q1 = inside(T0, T1, x, d)
        margin = wp.length(q1 - q0) + c.skin + c.stride[k, row]
        r = points.reach[i] + c.of.thick[row] - c.width                     # the hard contact behind a potential
        C, m, p, s0, slip = touch(c.of.kind[row], c.of.size[row], c.of.mesh[row], deep, q0, q1, r, t.vec2(margin, c.width))
        listed = wp.where(c.of.kind[row] >= SOLID, on, 0)
        if anywhere(listed) != 0:
            ends = wp.matrix_from_rows(q0, q1)
            if listed != 0 and at[3] == 0:
                refresh(c, points, row, i, k, ends, margin + r)
            synchronise_warp()
            C1, m1, p1, s1, slip1 = among(c, points, wp.vec3i(row, i, at[3]), deep, listed, ends, t.vec2(r, margin))
            if listed != 0:
                C, m, p, s0, slip = C1, m1, p1, s1, slip1
        n, way = t.vec3(), t.vec3()
        if on != 0 and C < margin:
            n, way = outside(T0, T1, c.of.step[k, row], m, p, slip)
        return C, margin, s0, n, way

    return touch_collider_lanes


@cache
def lane_finding_function(kinds: tuple[str, ...], real, lanes: int):
    """Function (c, points, s, own, before, k, push) -> carried, as `find_lane_contacts` of kernels/contact/search.py, of a
    point that has moved from the displacement `before`; d is known by its first thread."""
    t, Own, Slots, (Rows, Points) = types(real), thread_points(real), slot_type(real), contact_tables(real)
    meet, (_, _, _, anywhere, of_lane), vectors = (lane_collider_function(kinds, real, lanes), warp_lane_functions(lanes, real),
                                                   wp.array(dtype=t.vec3))

    @wp.func
    def find_lane_contacts(c: Rows, points: Points, s: Slots, own: wp.ref[Own], before: t.vec3, k: int, push: vectors):
        i = wp.max(own.point, 0)
        x0 = own.x + before
        d0 = of_lane(own.d, 0) - (x0 - own.x)
        count, mark, carried, first, end, bound = int(0), int(0), t.vec3(), int(0), int(0), real(0.0)
        d, last, turn = t.vec3(d0), t.vec3(), int(0)         # along faces that the point has met, see kernels/contact/search.py
        deep = (s.mark[i] & SUNK) | wp.where(k == 0, c.deep[0], 0)
        if own.point >= 0:
            if own.lane == 0:
                candidates.expire_lists(points, i, k)
            if points.w[i] > real(0.0):
                first = c.first[points.object[i]]
                end = c.first[points.object[i] + 1]
                bound = real(2.0) * wp.length(d0) + points.reach[i] + c.skin
        while anywhere(wp.where(first < end, 1, 0)) != 0:
            on = int(0)
            if first < end:
                if ball_is_reachable(c.ball[k, first], x0, bound):
                    on = 1
            C, margin, s0, n, way = meet(c, points, wp.vec4i(wp.where(on != 0, first, 0), i, k, own.lane), deep, on,
                                         x0 + carried, d)
            over, more = wp.max(-s0, real(0.0)), bool(False)
            if on != 0 and wp.where(turn == 0, C < margin, meets_again(c, points, i, first, C, wp.dot(n, last))):
                out = wp.min(over, c.recovery * c.h)         # of the overlap; the rest may stay for now
                if over > real(SUNK_FROM) * c.skin:
                    mark = mark | SUNK
                if count < s.capacity and own.lane == 0:
                    j = count * s.points + i
                    s.row[j] = first
                    s.n[j] = n
                    s.b[j] = C + over - out - wp.dot(n, d + carried)
                    s.u[j] = way / c.h
                    push[j] = t.vec3()
                carried += out * n
                count += 1
                more = turn < FURTHER and slides_on(c, points, wp.vec3i(first, i, k), C, margin, over)
            d, last, turn = wp.where(more, d - (C + over) * n, d0), n, wp.where(more, turn + 1, 0)
            first = wp.where(more, first, first + 1)
        if own.point >= 0 and own.lane == 0:
            if count > s.capacity:
                wp.atomic_max(s.wanted, 0, count)
            s.count[i] = wp.min(count, s.capacity)
            s.mark[i] = mark
        return carried

    return find_lane_contacts
