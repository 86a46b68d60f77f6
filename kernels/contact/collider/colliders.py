"""The struct of the table of colliders, one row each, which all methods fill alike (`wsim.physics.contact.collider.rows`), and
the way into a row's frame. What is asked of it: at any time of a frame kernels/contact/collider/table.py; at its moments, which
are the ends of substeps, kernels/contact/search.py and kernels/rods/contact.py.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.collider.shape import PLANE
from wsim.kernels.math.block import runs_on_cpu
from wsim.kernels.math.real import types


@cache
def collider_type(real):
    """Struct of the table. Places count from an origin that its owner chooses."""
    t = types(real)

    @wp.struct
    class Colliders:
        kind: wp.array(dtype=int)             # number in kernels/contact/collide.py, (rows,)
        size: wp.array(dtype=t.vec3)          # [m], see kernels/contact/collider/shape.py; meshes: greatest depth inside
        mesh: wp.array(dtype=wp.uint64)       # of a surface; of strands one of each moment, (moments rows,)
        thick: wp.array(dtype=real)           # distance that it keeps all around [m]
        friction: wp.array(dtype=t.vec2)      # static, dynamic [1]
        restitution: wp.array(dtype=real)     # [1]
        owner: wp.array(dtype=int)            # number of the rigid body that it is a part of; -1: none
        pose: wp.array2d(dtype=t.transform)   # at moments of the frame, of which the first is its start, (moments, rows)
        step: wp.array2d(dtype=t.transform)   # translation and turn from each moment to the next; where there are several
        speed: wp.array(dtype=t.vec3)         # [m/s] from the first moment on; this and below where times between are asked for
        spin: wp.array(dtype=t.vec3)          # [rad/s]
        screw: int                            # 1: they go by screws

    return Colliders


@wp.func
def into_pose_frame(T: Any, x: Any):
    """A place in the frame of a pose."""
    return wp.quat_rotate_inv(wp.transform_get_rotation(T), x - wp.transform_get_translation(T))


@wp.func
def plane_is_far(c: Any, k: int, row: int, x: Any, bound: Any):
    """Whether a point at x does not come near a plane in substep k, which may be moved then, but not turned. c: rows with their
    table `of`; bound: twice the point's way, and what it keeps from planes [m]. False of another collider, and on a GPU, where
    kernels that ask for it would round otherwise than each other."""
    if not runs_on_cpu() or c.of.kind[row] != PLANE:
        return False
    turn = wp.transform_get_rotation(c.of.step[k, row])
    if turn[0] != type(x[0])(0.0) or turn[1] != type(x[0])(0.0) or turn[2] != type(x[0])(0.0):
        return False
    way = c.of.thick[row] + c.stride[k, row] + wp.length(wp.transform_get_translation(c.of.step[k, row]))
    return into_pose_frame(c.of.pose[k + 1, row], x)[2] > bound + way


@cache
def collider_frame_funcs(real):
    """(inside, outside), functions that lead into the frame of a collider that goes from T0 to T1, and back.

    inside  (T0, T1, x, d) -> (q0, q1), a point that moves by d
    outside (T0, T1, step, m, p, slip) -> (n, way), a normal, and how far the surface moves that is touched at p. With
            y = R0 p and the turn (v, w) of the step, (R - 1) y = 2 w (v x y) + 2 v x (v x y), without cancellation."""
    t = types(real)

    @wp.func
    def path_in_collider_frame(T0: t.transform, T1: t.transform, x: t.vec3, d: t.vec3):
        q0 = into_pose_frame(T0, x)
        q1 = wp.quat_rotate_inv(wp.transform_get_rotation(T1), (x - wp.transform_get_translation(T1)) + d)
        return q0, q1

    @wp.func
    def contact_in_world(T0: t.transform, T1: t.transform, step: t.transform, m: t.vec3, p: t.vec3, slip: t.vec3):
        R1 = wp.transform_get_rotation(T1)
        y = wp.quat_rotate(wp.transform_get_rotation(T0), p)
        turn = wp.transform_get_rotation(step)
        v = t.vec3(turn[0], turn[1], turn[2])
        across = wp.cross(v, y)
        rigid = real(2.0) * (turn[3] * across + wp.cross(v, across)) + wp.transform_get_translation(step)
        return wp.quat_rotate(R1, m), rigid + wp.quat_rotate(R1, slip)

    return path_in_collider_frame, contact_in_world


@wp.func
def first_body_slot(c: Any, s: Any, i: int):
    """Slot of the first contact of point i with a rigid body, 0 where there is none: rows of bodies stand behind those of
    colliders, so that contacts from there on and round have bodies first."""
    for slot in range(s.count[i]):
        if c.of.owner[s.row[slot * s.points + i]] >= 0:
            return slot
    return int(0)
