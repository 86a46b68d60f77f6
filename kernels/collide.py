"""Where a moving point meets a collider, in the collider's own frame.

    q0 q1  the point at the start and at the end of a substep [m], each in the collider's frame of that time, so that
           dq = q1 - q0 is the motion relative to the collider        r   distance kept free [m]
    C      gap of q1 to the contact plane [m], r taken off            n   its unit normal, out of the solid
    s0     gap at the start; negative: it started too near            p   where the surface is touched

Convex shapes. phi (kernels/distance.py) is convex along a line, so its tangent lies below it, and Newton's method for
phi(q0 + tau dq) = r,

    tau' = tau - (phi - r) / (n.dq),

started outside never passes the first root, and there is no root where a slope is >= 0 or a tangent stays positive up
to tau = 1. The plane at any iterate supports the body, so stopping early is safe too. No speed tunnels.

Meshes. Nearest point at q1 with the sign of the angle-weighted pseudo normal (Baerentzen, Aanaes 2005), exact
for closed meshes and as cheap as no sign; a ray q0 -> q1 where the nearest point is nearer than |dq|, since
only then can a crossing be; and, where `deep` is set, inside or outside by the winding number (Barill et al.
2018), which survives self-intersection but costs ten times as much: the host asks for it when points may start
inside. Warp's mesh queries are float32; the point on the triangle is computed again in the precision of the
run.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, SIM108, UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.distance import CONVEX, distance
from wsim.kernels.real import types

SOLID, SHEET = len(CONVEX), len(CONVEX) + 1          # closed mesh; open mesh, two-sided
KINDS = (*CONVEX, "solid", "sheet")                  # the position is the kind's number
NEWTON_LIMIT = 16      # steps of a sweep; 3 to 5 are usual, grazing takes more and may stop early (see above)
EDGE = 1e-6            # barycentric weight under which the nearest point counts as on an edge: rounding of float32


@cache
def touch_convex(kinds: tuple[str, ...], real):
    """Function (kind, size, q0, q1, r, margin) -> (C, n, p, s0): the plane that the point must stay outside of.

    C    gap [m] of q1 to that plane, r taken off; larger than margin: no contact       n   its outward unit normal
    p    where the collider's surface is touched       s0  gap at the start, negative: the point started too near"""
    formula = distance(kinds)

    @wp.func
    def touch_convex(kind: int, size: Any, q0: Any, q1: Any, r: Any, margin: Any):
        dq = q1 - q0
        length = wp.length(dq)
        tau = real(0.0)
        s0 = real(0.0)
        s = real(0.0)
        q = q0
        n = q0
        i = int(0)
        while i < NEWTON_LIMIT:
            q = q0 + tau * dq
            phi, n = formula(kind, size, q)
            s = phi - r
            if i == 0:
                s0 = s
            # at the end; or touching (to a relative 1e-4 of the path); or too far for the whole path
            if tau == real(1.0) or s <= real(1.0e-4) * length or s > margin + length:
                break
            fall = -wp.dot(n, dq)
            if fall * (real(1.0) - tau) > s:
                tau += s / fall
            else:
                tau = real(1.0)
            i += 1
        return s + (real(1.0) - tau) * wp.dot(n, dq), n, q - (s + r) * n, s0

    return touch_convex


@cache
def nearest(kinds: tuple[str, ...]):
    """Function (kind, mesh, q, most, deep, depth) -> (face or -1, sign, u, v): nearest point within `most` [m]."""
    has_solid, has_sheet = "solid" in kinds, "sheet" in kinds

    @wp.func
    def nearest(kind: int, mesh: wp.uint64, q: wp.vec3f, most: float, deep: int, depth: float):
        face = int(-1)
        sign = float(1.0)
        u = float(0.0)
        v = float(0.0)
        if has_sheet:
            if kind == SHEET:
                found = wp.mesh_query_point_no_sign(mesh, q, most)
                if found.result:
                    face = found.face
                    u = found.u
                    v = found.v
        if has_solid:
            if kind == SOLID:
                if deep != 0:
                    wound = wp.mesh_query_point_sign_winding_number(mesh, q, wp.max(most, depth))
                    if wound.result:
                        face = wound.face
                        sign = wound.sign
                        u = wound.u
                        v = wound.v
                else:
                    near = wp.mesh_query_point_sign_normal(mesh, q, most)
                    if near.result:
                        face = near.face
                        sign = near.sign
                        u = near.u
                        v = near.v
        return face, sign, u, v

    return nearest


@cache
def triangle(real):
    """Function (mesh, face) -> (a, b, c, n): corners [m] of a face and its unit normal, 0 where it has no area."""
    t = types(real)

    @wp.func
    def corner(mesh: wp.uint64, index: int):
        p = wp.mesh_get_point(mesh, index)
        return t.vec3(real(p[0]), real(p[1]), real(p[2]))

    @wp.func
    def triangle(mesh: wp.uint64, face: int):
        a = corner(mesh, 3 * face)
        b = corner(mesh, 3 * face + 1)
        c = corner(mesh, 3 * face + 2)
        return a, b, c, wp.normalize(wp.cross(b - a, c - a))

    return triangle


@cache
def touch_mesh(kinds: tuple[str, ...], real):
    """Function (kind, mesh, deep, depth, q0, q1, r, margin) -> (C, n, p, s0, slip), as `touch_convex`.

    depth   no inside point is further from the surface [m]       slip   motion of the surface in its own frame [m]
    A mesh that deforms carries the displacement of its points in this substep as its velocities, so that q0 + slip is
    where the point was as the touched part of the surface sees it."""
    t, search, face_of = types(real), nearest(kinds), triangle(real)

    @wp.func
    def touch_mesh(kind: int, mesh: wp.uint64, deep: int, depth: real, q0: t.vec3, q1: t.vec3, r: real, margin: real):
        far = real(1.0e30)
        face, sign, u, v = search(kind, mesh, wp.vec3f(q1), float(margin + r), deep, float(depth))
        if face < 0:
            return far, q1, q1, far, t.vec3()
        a, b, c, m = face_of(mesh, face)
        w = float(1.0) - u - v
        p = real(u) * a + real(v) * b + real(w) * c
        slip = t.vec3(wp.mesh_eval_velocity(mesh, face, u, v))
        dq = q1 - q0 - slip
        away = q1 - p
        dist = wp.length(away)
        height = wp.dot(m, away)
        n = m
        if height < real(0.0):
            n = -m
        if wp.min(u, wp.min(v, w)) > EDGE and wp.dot(m, m) > real(0.5):
            dist = wp.abs(height)                   # inside the face: its normal is exact, `away` is rounding near it
        elif dist > real(0.0):
            n = away / dist
        if sign < float(0.0):
            dist = -dist
            n = -n
        C = dist - r
        length = wp.length(dq)
        if wp.abs(dist) < length:
            start = q0 + slip
            ray = wp.mesh_query_ray(mesh, wp.vec3f(start), wp.vec3f(dq / length), float(length))
            if ray.result:
                a, b, c, m = face_of(mesh, ray.face)
                fall = -wp.dot(m, dq)
                if fall < real(0.0) and kind == SHEET:
                    m = -m
                    fall = -fall
                if fall > real(0.0):                # a solid is entered through the front of a face
                    n = m
                    C = wp.dot(m, q1 - a) - r
                    p = start + (real(ray.t) / length) * dq
        return C, n, p, C - wp.dot(n, dq), slip

    return touch_mesh


@cache
def touch(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, deep, q0, q1, r, margin) -> (C, n, p, s0, slip) over all of `kinds`."""
    t = types(real)
    convex, surface = any(k in kinds for k in KINDS[:SOLID]), any(k in kinds for k in KINDS[SOLID:])
    of_convex = touch_convex(tuple(k for k in kinds if k in KINDS[:SOLID]), real)
    of_mesh = touch_mesh(tuple(k for k in kinds if k in KINDS[SOLID:]), real)

    @wp.func
    def touch(kind: int, size: t.vec3, mesh: wp.uint64, deep: int, q0: t.vec3, q1: t.vec3, r: real, margin: real):
        C = real(1.0e30)
        s0 = real(0.0)
        n = t.vec3()
        p = t.vec3()
        slip = t.vec3()
        if convex:
            if kind < SOLID:
                C, n, p, s0 = of_convex(kind, size, q0, q1, r, margin)
        if surface:
            if kind >= SOLID:
                C, n, p, s0, slip = of_mesh(kind, mesh, deep, size[0], q0, q1, r, margin)
        return C, n, p, s0, slip

    return touch
