"""Gradients by how colliders move, from those of the points that touch them (kernels/contact/search_adjoint.py).

Of a collider with the frame (R, o) at either end of the substep, shifted by s and turned about o by a small turn w: with G the
gradient by where the point is seen from it, y = x - o, N that by the normal, W that by the way of its surface, whose arm is z,

    by s    -G +- W            by w    -y x G +- z x W (+ n x N at the end)       + at the end, - at the start of a substep

A frame's shift and turn are linear in time between those where it begins and where it ends.

Of a mesh whose points move besides, each contact leaves its gradients by the corners of the faces that it was found on
(`corner_type`), in the mesh's own frame; sums over contacts are the host's, so that their order does not depend on threads.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.project_adjoint import motion_gradient_type
from wsim.kernels.math.real import types


@wp.func
def turned_back(step: Any, T0: Any, f: Any):
    """R0^T (R - 1)^T f of the turn of a step."""
    q = wp.transform_get_rotation(step)
    v = wp.vector(q[0], q[1], q[2])
    across = wp.cross(f, v)
    y = type(q[0])(2.0) * (q[3] * across + wp.cross(across, v))
    return wp.quat_rotate_inv(wp.transform_get_rotation(T0), y)


@wp.func
def gradients_in_frame(c: Any, row: int, k: int, N: Any, W: Any):
    """Gradients in the frame of a collider, in rows: by n, by where it is touched and by slip, from N and W."""
    R1 = wp.transform_get_rotation(c.of.pose[k + 1, row])
    back = turned_back(c.of.step[k, row], c.of.pose[k, row], W)
    return wp.matrix_from_rows(wp.quat_rotate_inv(R1, N), back, wp.quat_rotate_inv(R1, W))


@wp.func
def pose_slope(c: Any, row: int, k: int, x: Any, d: Any, G: Any, at: Any):
    """Gradients by the collider's motion in substep k, in parts of the frame: rows as in `motion_gradient_type`. Rows of G: by
    start and end of the path, by n and by the way; of at: n, where the surface is touched, and its own way."""
    T0 = c.of.pose[k, row]
    T1 = c.of.pose[k + 1, row]
    y0 = x - wp.transform_get_translation(T0)
    y1 = (x - wp.transform_get_translation(T1)) + d
    z0 = wp.quat_rotate(wp.transform_get_rotation(T0), at[1])
    z1 = wp.quat_rotate(wp.transform_get_rotation(T1), at[1] + at[2])
    s0 = -G[0] - G[3]
    s1 = -G[1] + G[3]
    w0 = -wp.cross(y0, G[0]) - wp.cross(z0, G[3])
    w1 = -wp.cross(y1, G[1]) + wp.cross(z1, G[3]) + wp.cross(at[0], G[2])
    one = type(x[0])(1.0)
    part = one / type(x[0])(c.of.pose.shape[0] - 1)
    b0 = part * type(x[0])(k)
    b1 = part * type(x[0])(k + 1)
    e0 = one - b0
    e1 = one - b1
    return wp.matrix_from_rows(e0 * s0 + e1 * s1, e0 * w0 + e1 * w1, b0 * s0 + b1 * s1, b0 * w0 + b1 * w1)


@cache
def corner_type(real):
    """Struct of gradients by corners of meshes, (substeps, slots): row of the table of colliders or -1, faces as
    `mesh.look` has them, and in rows those by X, V and Y of kernels/contact/mesh.py [1/m]."""

    @wp.struct
    class CornerGradients:
        row: wp.array2d(dtype=int)
        face: wp.array2d(dtype=wp.vec3i)
        by: wp.array2d(dtype=wp.types.matrix((9, 3), real))

    return CornerGradients


@cache
def collider_gradient_sum_kernel(real, module):
    """Kernel over (objects, rows of an object, lanes): sums over the points of an object, start[o] .. start[o + 1], of what was
    gathered of its colliders' motions, which is zero then; each lane takes every `lanes`-th."""
    Ways = motion_gradient_type(real)

    def sum_collider_gradients(start: wp.array(dtype=int), points: int, motion: wp.array(dtype=Ways),
                               sum_out: wp.array3d(dtype=Ways)):
        o, row, lane = wp.tid()
        found = Ways()
        for i in range(start[o] + lane, start[o + 1], sum_out.shape[2]):
            found += motion[row * points + i]
            motion[row * points + i] = Ways()
        sum_out[o, row, lane] = found

    return wp.kernel(sum_collider_gradients, name=f"sum_motion_{types(real).name}", module=module, enable_backward=False)
