"""Shapes in a fluid, which move within a frame: signed distances and velocities.

    x(t) = p + V t,  R(t) = exp([W t]) R    of a frame that begins at (p, R)
    a mesh that deforms ("forming"): its points y + v t too, of the frame's begin; nearest to a place q is what is nearest to
    q - t v there, v the velocity of what is nearest to q

Places are relative to the low corner of the domain, along the world's axes. Of a flat fluid the grid's axes are two of those.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.mesh import SHEET, SOLID
from wsim.kernels.contact.shape import distance
from wsim.kernels.math.real import types


@cache
def structs(real) -> SimpleNamespace:
    t = types(real)

    @wp.struct
    class Shapes:
        kind: wp.array(dtype=int)          # as kernels/contact has it, (shapes,)
        size: wp.array(dtype=t.vec3)       # [m]
        mesh: wp.array(dtype=wp.uint64)    # of a surface
        thick: wp.array(dtype=real)        # added all around [m], so that a wall is not thinner than the grid tells
        place: wp.array(dtype=t.vec3)      # p [m] at the start of the frame
        turn: wp.array(dtype=t.quat)       # R, (x, y, z, w)
        speed: wp.array(dtype=t.vec3)      # V [m/s]
        spin: wp.array(dtype=t.vec3)       # W [rad/s]
        body: wp.array(dtype=int)          # number of the rigid body that it is a part of; -1: none
        axes: wp.vec3i                     # of the world, of each axis of the grid
        dx: real                           # [m] edge of a cell

    return SimpleNamespace(Shapes=Shapes)


@cache
def functions(dim: int, kinds: tuple[str, ...], real) -> SimpleNamespace:
    """spot(shapes, x) -> place [m] of x cells; signed(shapes, k, y, t) -> distance [m] of a place to shape k, t [s] after the
    frame began; rate(shapes, k, y, t) -> its velocity there [m/s]."""
    t, S = types(real), structs(real)
    convex = distance(tuple(k for k in kinds if k not in ("solid", "sheet", "forming")) or ("sphere",))
    solid, sheet, forming = ("solid" in kinds, "sheet" in kinds, "forming" in kinds)

    @wp.func
    def shifted(mesh: wp.uint64, q: wp.vec3f, time: real):
        """How far what is nearest to q has gone, [m]."""
        near = wp.mesh_query_point_no_sign(mesh, q, float(1.0e9))
        way = wp.vec3f()
        if near.result:
            way = float(time) * wp.mesh_eval_velocity(mesh, near.face, near.u, near.v)
        return way

    @wp.func
    def spot(shapes: S.Shapes, x: t.vec3):
        y = shapes.dx * x
        if wp.static(dim == 2):
            y = t.vec3(real(0.5) * shapes.dx, real(0.5) * shapes.dx, real(0.5) * shapes.dx)
            y[shapes.axes[0]] = shapes.dx * x[0]
            y[shapes.axes[1]] = shapes.dx * x[1]
        return y

    @wp.func
    def turned(shapes: S.Shapes, k: int, time: real):
        way = time * shapes.spin[k]
        angle = wp.length(way)
        q = shapes.turn[k]
        if angle > real(0.0):
            q = wp.quat_from_axis_angle(way / angle, angle) * q
        return q

    @wp.func
    def signed(shapes: S.Shapes, k: int, y: t.vec3, time: real):
        q = wp.quat_rotate_inv(turned(shapes, k, time), y - shapes.place[k] - time * shapes.speed[k])
        kind = shapes.kind[k]
        phi = real(1.0e9)
        if wp.static(solid):
            if kind == SOLID:
                at = wp.vec3f(q)
                if wp.static(forming):
                    at = at - shifted(shapes.mesh[k], at, time)
                near = wp.mesh_query_point_sign_normal(shapes.mesh[k], at, float(1.0e9))
                if near.result:
                    p = wp.mesh_eval_position(shapes.mesh[k], near.face, near.u, near.v)
                    phi = real(near.sign * wp.length(at - p))
        if wp.static(sheet):
            if kind == SHEET:
                at = wp.vec3f(q)
                if wp.static(forming):
                    at = at - shifted(shapes.mesh[k], at, time)
                near = wp.mesh_query_point_no_sign(shapes.mesh[k], at, float(1.0e9))
                if near.result:
                    p = wp.mesh_eval_position(shapes.mesh[k], near.face, near.u, near.v)
                    phi = real(wp.length(at - p))
        if kind < SOLID:
            found, n = convex(kind, shapes.size[k], q)
            phi = found
        return phi - shapes.thick[k]

    @wp.func
    def rate(shapes: S.Shapes, k: int, y: t.vec3, time: real):
        r = y - shapes.place[k] - time * shapes.speed[k]
        v = shapes.speed[k] + wp.cross(shapes.spin[k], r)
        if wp.static(forming):
            if shapes.kind[k] >= SOLID:
                q = turned(shapes, k, time)
                own = shifted(shapes.mesh[k], wp.vec3f(wp.quat_rotate_inv(q, r)), real(1.0))
                v += wp.quat_rotate(q, t.vec3(real(own[0]), real(own[1]), real(own[2])))
        if wp.static(dim == 2):
            return t.vec3(v[shapes.axes[0]], v[shapes.axes[1]], real(0.0))
        return v

    return SimpleNamespace(spot=spot, turned=turned, shifted=shifted, signed=signed, rate=rate,
                           name=f"{dim}d_{'_'.join(kinds)}_{t.name}")


@cache
def follow(real, module):
    """Kernel over points of a mesh: places and velocities of the points of the state that it is made of."""
    t = types(real)

    def follow(row: wp.array(dtype=int), x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3),
               place_out: wp.array(dtype=wp.vec3f), rate_out: wp.array(dtype=wp.vec3f)):
        k = wp.tid()
        place_out[k] = wp.vec3f(x[row[k]])
        rate_out[k] = wp.vec3f(v[row[k]])

    return wp.kernel(follow, name=f"follow_{t.name}", module=module, enable_backward=False)
