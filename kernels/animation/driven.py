"""Joints that rigid bodies drive, and what hangs on their meshes, on the device and within frames, in float64.

    W_j(t) = M(t)^-1 Y(t) C_j,   C_j = Y(0)^-1 M(0) W_j(0)        Y: frame of a body's centre of mass to world, as it goes from
                                                                  where a frame begins to where it ends
    Y(t)   = (slerp(q_a, q_b, s), x_a + s (x_b - x_a))            s: part of the frame, as keys at frames would have it
    place  = M(t) (u x0 + v x1 + (1 - u - v) x2 + h n) - o        of pins, on skinned triangles; o: origin of the points

Formulas of the host: wsim/physics/animation/driven.py, `skinning.placed`. Turns of a frame are the short way: less than half a
turn.
"""

from functools import cache

import warp as wp

from wsim.kernels.animation.pinned import MORE, fastest_half_frame_speed
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import rotation_to_matrix, slerp, unit_quaternion

real, mat33, mat44, vec3, quat = wp.float64, wp.mat33d, wp.mat44d, wp.vec3d, wp.quatd


@wp.func
def affine_matrix(A: mat33, p: vec3):
    """Matrix of a linear part and a place."""
    zero = real(0.0)
    return mat44(A[0, 0], A[0, 1], A[0, 2], p[0], A[1, 0], A[1, 1], A[1, 2], p[1], A[2, 0], A[2, 1], A[2, 2], p[2],
                 zero, zero, zero, real(1.0))


@wp.struct
class DrivenJoints:
    joint: wp.array(dtype=int)                # among all joints, (driven,)
    skeleton: wp.array(dtype=int)             # (driven,)
    body: wp.array(dtype=int)                 # row of the bodies, (driven,)
    origin: wp.array(dtype=vec3)              # of that body [m], (driven,)
    bound: wp.array(dtype=mat44)              # C, (driven,)
    motion: wp.array(dtype=int)               # row of A and p, of each skeleton
    A: wp.array2d(dtype=mat33)                # motion of the skeletons, (skeletons, times): M = (A S, p)
    p: wp.array2d(dtype=vec3)
    stretch: wp.array(dtype=mat33)            # S, of each skeleton
    part: wp.array(dtype=real)                # s, (times,)


@cache
def body_pose_type(of):
    """Struct of where bodies are: x [m], its remainder, q and its remainder, of the precision `of`."""
    t = types(of)

    @wp.struct
    class BodyPoses:
        x: wp.array(dtype=t.vec3)
        e: wp.array(dtype=t.vec3)
        q: wp.array(dtype=t.quat)
        o: wp.array(dtype=t.quat)

    return BodyPoses


@cache
def driven_joint_kernel(of, module):
    """Kernel over (times, driven joints of a level): W. a, b: bodies where the frame begins and where it ends."""
    Where = body_pose_type(of)

    @wp.func
    def driving_body_place(at: Where, k: int):
        x = at.x[k]
        e = at.e[k]
        return vec3(real(x[0]) + real(e[0]), real(x[1]) + real(e[1]), real(x[2]) + real(e[2]))

    @wp.func
    def driving_body_turn(at: Where, k: int):
        q = at.q[k]
        o = at.o[k]
        return unit_quaternion(quat(real(q[0]) + real(o[0]), real(q[1]) + real(o[1]), real(q[2]) + real(o[2]),
                                    real(q[3]) + real(o[3])))

    def drive_joints(driven: DrivenJoints, level: wp.array(dtype=int), a: Where, b: Where, world_out: wp.array2d(dtype=mat44)):
        k, i = wp.tid()
        j = level[i]
        body = driven.body[j]
        s = driven.part[k]
        x = driving_body_place(a, body)
        x = driven.origin[j] + x + s * (driving_body_place(b, body) - x)
        R = rotation_to_matrix(slerp(driving_body_turn(a, body), driving_body_turn(b, body), s))
        Y = affine_matrix(R, x)
        own = driven.skeleton[j]
        m = driven.motion[own]
        back = wp.inverse(affine_matrix(driven.A[m, k] * driven.stretch[own], driven.p[m, k]))
        world_out[k, driven.joint[j]] = back * Y * driven.bound[j]

    return wp.kernel(drive_joints, name=f"drive_joints_{types(of).name}", module=module, enable_backward=False)


@wp.struct
class HungPoints:
    corner: wp.array(dtype=wp.vec3i)          # among the skinned points, (places,)
    place: wp.array(dtype=vec3)               # u, v [1], h [m], (places,)
    ends: wp.array(dtype=wp.vec2i)            # places of which a column is the middle, twice one: that one, (columns,)
    origin: vec3                              # o [m]
    motion: int                               # row of A and p
    A: wp.array2d(dtype=mat33)                # M, (motions, times)
    p: wp.array2d(dtype=vec3)
    first: int                                # column of the targets
    pin: int                                  # number among the speeds


@cache
def hung_place(of):
    """Function: where column i of a pin is put at time k [m], in the world. of: precision of the skinned points."""
    t = types(of)

    @wp.func
    def widened_skin_point(x: t.vec3):
        return vec3(real(x[0]), real(x[1]), real(x[2]))

    @wp.func
    def place_on_skin_triangle(hung: HungPoints, x: wp.array2d(dtype=t.vec3), k: int, i: int):
        corner = hung.corner[i]
        x0 = widened_skin_point(x[k, corner[0]])
        x1 = widened_skin_point(x[k, corner[1]])
        x2 = widened_skin_point(x[k, corner[2]])
        p = hung.place[i]
        n = wp.normalize(wp.cross(x1 - x0, x2 - x0))
        local = p[0] * x0 + p[1] * x1 + (real(1.0) - p[0] - p[1]) * x2 + p[2] * n
        return hung.A[hung.motion, k] * local + hung.p[hung.motion, k]

    def middle_of_hung_ends(hung: HungPoints, x: wp.array2d(dtype=t.vec3), k: int, i: int):
        ends = hung.ends[i]
        return real(0.5) * (place_on_skin_triangle(hung, x, k, ends[0]) + place_on_skin_triangle(hung, x, k, ends[1]))

    return wp.func(middle_of_hung_ends, name=f"hung_place_{t.name}")


@cache
def hung_pin_kernel(of, out, module):
    """Kernel over (times, columns of a pin): where its points are put [m], of the precision `out`. of: of skinned points."""
    t, o, middle = types(of), types(out), hung_place(of)

    def hang_pins(hung: HungPoints, x: wp.array2d(dtype=t.vec3), target_out: wp.array2d(dtype=o.vec3)):
        k, i = wp.tid()
        y = middle(hung, x, k, i) - hung.origin
        target_out[k, hung.first + i] = o.vec3(out(y[0]), out(y[1]), out(y[2]))

    return wp.kernel(hang_pins, name=f"hang_pins_{t.name}_{o.name}", module=module, enable_backward=False)


@cache
def hung_pull_kernel(of, module):
    """Kernel over columns of a pin: its greatest speed [m/s], at the last three times (pinned.py)."""
    t, middle = types(of), hung_place(of)

    def pull_hung(hung: HungPoints, x: wp.array2d(dtype=t.vec3), dt: real, speed_out: wp.array(dtype=real)):
        i = wp.tid()
        k = x.shape[0] - MORE
        wp.atomic_max(speed_out, hung.pin,
                      fastest_half_frame_speed(middle(hung, x, k, i), middle(hung, x, k + 1, i), middle(hung, x, k + 2, i), dt))

    return wp.kernel(pull_hung, name=f"pull_hung_{t.name}", module=module, enable_backward=False)
