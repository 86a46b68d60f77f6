"""Rows of the table of colliders (kernels/contact/project.py) from motions that the device evaluated, in float64 and rounded
once, at the end.

    A, p   a collider's axes and place at the start of each substep and at the end of the last     o  origin of a row's object
    pose   (p - o, q(A))     step  (p1 - p0, q(A1 A0^T))     ball  about the middle of the way of the shape's c = A c0 + p

The radius of a ball holds half of the way |c1 - c0|, and as much as that again for what turns.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import matrix_to_quaternion

real, mat33, vec3, vec4 = wp.float64, wp.mat33d, wp.vec3d, wp.vec4d


@wp.struct
class MovingColliders:
    row: wp.array(dtype=int)                  # of the table of colliders, (movers,)
    motion: wp.array(dtype=int)               # number among those evaluated, (movers,)
    origin: wp.array(dtype=vec3)              # of the row's object [m], (movers,)
    ball: wp.array(dtype=vec4)                # centre in the shape's own frame, radius [m], (movers,)
    gap: wp.array(dtype=real)                 # distance that the collider keeps [m], (movers,)


@cache
def collider_pose_kernel(of, module):
    """Kernel over (movers, times), of the precision `of` of the table: pose, step, ball of the rows that move."""
    t = types(of)

    @wp.func
    def rounded_collider_pose(p: vec3, q: vec4):
        return t.transform(t.vec3(of(p[0]), of(p[1]), of(p[2])), t.quat(of(q[0]), of(q[1]), of(q[2]), of(q[3])))

    def place_moved_colliders(movers: MovingColliders, A: wp.array2d(dtype=mat33), p: wp.array2d(dtype=vec3),
                              pose_out: wp.array2d(dtype=t.transform),
                              step_out: wp.array2d(dtype=t.transform), ball_out: wp.array2d(dtype=t.vec4)):
        j, k = wp.tid()
        row = movers.row[j]
        m = movers.motion[j]
        o = movers.origin[j]
        A0 = A[m, k]
        p0 = p[m, k]
        pose_out[k, row] = rounded_collider_pose(p0 - o, matrix_to_quaternion(A0))
        if k + 1 < A.shape[1]:
            A1 = A[m, k + 1]
            p1 = p[m, k + 1]
            step_out[k, row] = rounded_collider_pose(p1 - p0, matrix_to_quaternion(A1 * wp.transpose(A0)))
            own = movers.ball[j]
            center = vec3(own[0], own[1], own[2])
            c0 = p0
            c1 = p1
            if wp.dot(center, center) > real(0.0):           # of a mesh
                c0 = A0 * center + p0
                c1 = A1 * center + p1
            c = real(0.5) * (c1 + c0) - o
            radius = own[3] + real(1.5) * wp.length(c1 - c0) + movers.gap[j]
            ball_out[k, row] = t.vec4(of(c[0]), of(c[1]), of(c[2]), of(radius))

    return wp.kernel(place_moved_colliders, name=f"place_colliders_{t.name}", module=module, enable_backward=False)
