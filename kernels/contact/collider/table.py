"""The table of colliders on the device, and what is asked of one: at any time t [s] of a frame, whichever method asks.

    signed(c, k, y, t)                distance [m] of a place y to collider k, less the thickness that it keeps; below 0 within.
                                      An open mesh has no inside: its distance is that to either side
    closest(c, k, y, t)               (that distance, unit normal there towards y or out of the solid, the nearest place) [m]
    rate(c, k, y, t)                  velocity of the collider at a place [m/s]
    first_hit(c, k, a, ta, b, tb, skin)  (part of the way from a at ta to b at tb that a point may go, normal of what it meets,
                                      towards its side); kernels/contact/collider/segment.py
    between(c, k, a, ta, b, tb, slack)  whether the collider stands between two places, each at its time, by more than slack [m]
    local(c, k, y, t), world(c, k, q, t)  into the frame of its shape as the frame began, and back

Where a collider is that begins a frame at (p, R), with the velocity V and the spin W through it:

    x(t) = p + V t,  R(t) = exp([W t]) R
    x(t) = p + J(W t) V t    of a `screw`: what moves as one body goes by one screw, so that no gap opens between its parts;
                             J(f) = I + a [f] + b [f]^2,  a = (1 - cos |f|) / |f|^2,  b = (|f| - sin |f|) / |f|^3
    a mesh that deforms ("forming"): its points y + v t too, of the frame's begin. What has come to q is found by fixed point
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider import segment
from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.nearest import nearest_shape_func
from wsim.kernels.contact.mesh import SOLID
from wsim.kernels.math.real import types

FIXED = 3                # steps of the fixed point: each leaves the part of a place that a mesh stretches by in a frame


@cache
def collider_queries(kinds: tuple[str, ...], real) -> SimpleNamespace:
    """The functions of the file's docstring. kinds: of shapes, "solid" and "sheet" of meshes, "forming" where points move."""
    t, C, shape = types(real), collider_type(real), segment.segment_queries(kinds, real)
    near, forming = nearest_shape_func(kinds, real), "forming" in kinds

    @wp.func
    def shift_of_nearest(mesh: wp.uint64, q: wp.vec3f, time: real):
        """How far what is nearest to q has gone, [m]."""
        found = wp.mesh_query_point_no_sign(mesh, q, float(1.0e9))
        way = wp.vec3f()
        if found.result:
            way = float(time) * wp.mesh_eval_velocity(mesh, found.face, found.u, found.v)
        return way

    @wp.func
    def collider_orientation(c: C, k: int, time: real):
        way = time * c.spin[k]
        angle = wp.length(way)
        q = wp.transform_get_rotation(c.pose[0, k])
        if angle > real(0.0):
            q = wp.quat_from_axis_angle(way / angle, angle) * q
        return q

    @wp.func
    def collider_center_at(c: C, k: int, time: real):
        """Where a shape's origin is [m]."""
        way = time * c.speed[k]
        if c.screw != 0:
            f = time * c.spin[k]
            angle = wp.length(f)
            half = real(0.5) * angle
            square = angle * angle
            a = real(0.5) - square * (real(1.0 / 24.0) - square / real(720.0))
            b = real(1.0 / 6.0) - square * (real(1.0 / 120.0) - square / real(5040.0))
            if angle > real(0.03):
                a = real(0.5) * (wp.sin(half) / half) * (wp.sin(half) / half)
                b = (angle - wp.sin(angle)) / (angle * angle * angle)
            turn = wp.cross(f, way)
            way = way + a * turn + b * wp.cross(f, turn)
        return wp.transform_get_translation(c.pose[0, k]) + way

    @wp.func(inline=False)
    def to_collider_frame(c: C, k: int, y: t.vec3, time: real):
        q = wp.quat_rotate_inv(collider_orientation(c, k, time), y - collider_center_at(c, k, time))
        if wp.static(forming):
            if c.kind[k] >= SOLID:
                way = wp.vec3f()
                steps = int(FIXED)                             # a variable: the loop is compiled once
                for _ in range(steps):
                    way = shift_of_nearest(c.mesh[k], wp.vec3f(q) - way, time)
                q = q - t.vec3(real(way[0]), real(way[1]), real(way[2]))
        return q

    @wp.func(inline=False)
    def from_collider_frame(c: C, k: int, q: t.vec3, time: real):
        r = q
        if wp.static(forming):
            if c.kind[k] >= SOLID:
                way = shift_of_nearest(c.mesh[k], wp.vec3f(q), time)
                r = q + t.vec3(real(way[0]), real(way[1]), real(way[2]))
        return collider_center_at(c, k, time) + wp.quat_rotate(collider_orientation(c, k, time), r)

    @wp.func
    def closest_collider_place(c: C, k: int, y: t.vec3, time: real):
        turn = collider_orientation(c, k, time)
        q = wp.quat_rotate_inv(turn, y - collider_center_at(c, k, time))
        if wp.static(forming):
            if c.kind[k] >= SOLID:
                way = shift_of_nearest(c.mesh[k], wp.vec3f(q), time)
                q = q - t.vec3(real(way[0]), real(way[1]), real(way[2]))
        phi, m, face, u, v = near(c.kind[k], c.size[k], c.mesh[k], q)
        n = wp.quat_rotate(turn, m)
        return phi - c.thick[k], n, y - phi * n

    @wp.func
    def collider_distance_at(c: C, k: int, y: t.vec3, time: real):
        phi, n, p = closest_collider_place(c, k, y, time)
        return phi

    @wp.func
    def collider_velocity_at(c: C, k: int, y: t.vec3, time: real):
        r = y - collider_center_at(c, k, time)
        v = c.speed[k] + wp.cross(c.spin[k], r)
        if c.screw != 0:
            v = c.speed[k] + wp.cross(c.spin[k], y - wp.transform_get_translation(c.pose[0, k]))
        if wp.static(forming):
            if c.kind[k] >= SOLID:
                q = collider_orientation(c, k, time)
                own = shift_of_nearest(c.mesh[k], wp.vec3f(wp.quat_rotate_inv(q, r)), real(1.0))
                v += wp.quat_rotate(q, t.vec3(real(own[0]), real(own[1]), real(own[2])))
        return v

    @wp.func
    def first_collider_hit(c: C, k: int, a: t.vec3, ta: real, b: t.vec3, tb: real, skin: real):
        s, n = shape.first_hit(c.kind[k], c.size[k], c.mesh[k], to_collider_frame(c, k, a, ta), to_collider_frame(c, k, b, tb),
                               skin)
        return s, wp.quat_rotate(collider_orientation(c, k, ta + s * (tb - ta)), n)

    @wp.func
    def collider_stands_between(c: C, k: int, a: t.vec3, ta: real, b: t.vec3, tb: real, slack: real):
        return shape.between(c.kind[k], c.size[k], c.mesh[k], to_collider_frame(c, k, a, ta), to_collider_frame(c, k, b, tb),
                             slack)

    return SimpleNamespace(shifted=shift_of_nearest, turned=collider_orientation, center=collider_center_at,
                           local=to_collider_frame, world=from_collider_frame, signed=collider_distance_at,
                           rate=collider_velocity_at,
                           closest=closest_collider_place, first_hit=first_collider_hit, between=collider_stands_between)


@cache
def mesh_follow_kernel(real, module):
    """Kernel over points of a mesh: places and velocities of the points of the state that it is made of."""
    t = types(real)

    def follow_state_points(row: wp.array(dtype=int), x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3),
                            place_out: wp.array(dtype=wp.vec3f), rate_out: wp.array(dtype=wp.vec3f)):
        k = wp.tid()
        place_out[k] = wp.vec3f(x[row[k]])
        rate_out[k] = wp.vec3f(v[row[k]])

    return wp.kernel(follow_state_points, name=f"follow_{t.name}", module=module, enable_backward=False)


@cache
def mesh_rate_kernel(real, module):
    """Kernel over points of a mesh: velocities with which they go, in a frame of dt [s], from where they were to where the
    points of the state are now."""
    t = types(real)

    def measure_mesh_rates(row: wp.array(dtype=int), x: wp.array(dtype=t.vec3), dt: float, place: wp.array(dtype=wp.vec3f),
                           rate_out: wp.array(dtype=wp.vec3f)):
        k = wp.tid()
        rate_out[k] = (wp.vec3f(x[row[k]]) - place[k]) / dt

    return wp.kernel(measure_mesh_rates, name=f"measure_rates_{t.name}", module=module, enable_backward=False)
