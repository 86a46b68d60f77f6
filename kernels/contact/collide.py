"""Where a moving point meets a collider, in the collider's own frame.

    q0 q1  the point at the start and at the end of a substep [m], each in the collider's frame of that time, so that
           dq = q1 - q0 is the motion relative to the collider        r   distance kept free [m]
    C      gap of q1 to the contact plane [m], r taken off            n   its unit normal, out of the solid
    s0     gap at the start; negative: it started too near            p   where the surface is touched

Convex shapes. phi (kernels/contact/collider/shape.py) is convex along a line, so its tangent lies below it, and Newton's method
for phi(q0 + tau dq) = r,

    tau' = tau - (phi - r) / (n.dq),

started outside never passes the first root, and there is no root where a slope is >= 0 or a tangent stays positive up
to tau = 1. The plane at any iterate supports the body, so stopping early is safe too. No speed tunnels.

Meshes: kernels/contact/mesh.py.
"""

# Device code: int(0) makes a variable of what would be a constant, and an outer `if` on a Python bool drops its branch
# before it is compiled.
# ruff: noqa: SIM102, SIM108, UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.collider import shape
from wsim.kernels.contact.collider.shape import CONVEX, convex_distance_func
from wsim.kernels.contact.mesh import SOLID, mesh_touch_func
from wsim.kernels.math.real import types

KINDS = (*CONVEX, "solid", "sheet", "balls")         # the position is the kind's number, see `collider_kind_code`
NEWTON_LIMIT = 16      # steps of a sweep; 3 to 5 are usual, grazing takes more and may stop early (see above)
TOUCHING = 1e-4        # part of |dq| that a sweep ends within


def collider_kind_code(kind: str) -> int:
    """By which kernels tell the kinds."""
    return KINDS.index(kind) if kind in KINDS else shape.shape_code(kind)


def split_convex_and_meshes(kinds: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Convex shapes and meshes among `kinds`."""
    return tuple(k for k in kinds if k not in KINDS[SOLID:]), tuple(k for k in kinds if k in KINDS[SOLID:])


@wp.func
def sweep_is_done(tau: Any, s: Any, length: Any, margin: Any):
    """Whether a sweep ends: at the end of the path, touching, or too far for the whole path; s = phi - r at tau."""
    return tau == type(s)(1.0) or s <= type(s)(TOUCHING) * length or s > margin + length


@wp.func
def newton_sweep_step(tau: Any, s: Any, fall: Any):
    """tau' of Newton's method, fall = -n.dq; 1 where no root is left."""
    one = type(s)(1.0)
    if fall * (one - tau) > s:
        return tau + s / fall
    return one


@cache
def convex_touch_func(kinds: tuple[str, ...], real):
    """Function (kind, size, q0, q1, r, margin, width) -> (C, n, p, s0): the plane that the point must stay outside of.

    A point that starts within `width` has the plane of where it starts: the force of a potential there is along its normal.

    C    gap [m] of q1 to that plane, r taken off; larger than margin: no contact       n   its outward unit normal
    p    where the collider's surface is touched       s0  gap at the start, negative: the point started too near"""
    formula = convex_distance_func(kinds)

    @wp.func
    def sweep_convex_contact(kind: int, size: Any, q0: Any, q1: Any, r: Any, margin: Any, width: Any):
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
            if sweep_is_done(tau, s, length, margin) or s0 < width:
                break
            tau = newton_sweep_step(tau, s, -wp.dot(n, dq))
            i += 1
        return s + (real(1.0) - tau) * wp.dot(n, dq), n, q - (s + r) * n, s0

    return sweep_convex_contact


@cache
def collider_touch_func(kinds: tuple[str, ...], real):
    """Function (kind, size, mesh, deep, q0, q1, r, reach: margin and width) -> (C, n, p, s0, slip) over all of `kinds`."""
    t = types(real)
    shapes, meshes = split_convex_and_meshes(kinds)
    convex, surface = bool(shapes), bool(meshes)
    of_convex, of_mesh = convex_touch_func(shapes, real), mesh_touch_func(meshes, real)

    @wp.func
    def touch_any_collider(kind: int, size: t.vec3, mesh: wp.uint64, deep: int, q0: t.vec3, q1: t.vec3, r: real, reach: t.vec2):
        C = real(1.0e30)
        s0 = real(0.0)
        n = t.vec3()
        p = t.vec3()
        slip = t.vec3()
        if convex:
            if kind < SOLID:
                C, n, p, s0 = of_convex(kind, size, q0, q1, r, reach[0], reach[1])
        if surface:
            if kind >= SOLID:
                C, n, p, s0, slip = of_mesh(kind, mesh, deep, size[0], q0, q1, r, reach[0])
        return C, n, p, s0, slip

    return touch_any_collider
