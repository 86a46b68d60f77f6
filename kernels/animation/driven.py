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

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import matrix, normalized, slerp

real, mat44, vec3, quat = wp.float64, wp.mat44d, wp.vec3d, wp.quatd


@wp.struct
class Driven:
    joint: wp.array(dtype=int)                # among all joints, (driven,)
    skeleton: wp.array(dtype=int)             # (driven,)
    body: wp.array(dtype=int)                 # row of the bodies, (driven,)
    origin: wp.array(dtype=vec3)              # of that body [m], (driven,)
    bound: wp.array(dtype=mat44)              # C, (driven,)
    back: wp.array2d(dtype=mat44)             # M^-1, (times, skeletons)
    part: wp.array(dtype=real)                # s, (times,)


@cache
def bodies(of):
    """Struct of where bodies are: x [m], its remainder, q and its remainder, of the precision `of`."""
    t = types(of)

    @wp.struct
    class Where:
        x: wp.array(dtype=t.vec3)
        e: wp.array(dtype=t.vec3)
        q: wp.array(dtype=t.quat)
        o: wp.array(dtype=t.quat)

    return Where


@cache
def drive(of, module):
    """Kernel over (times, driven joints of a level): W. a, b: bodies where the frame begins and where it ends."""
    Where = bodies(of)

    @wp.func
    def place(at: Where, k: int):
        x = at.x[k]
        e = at.e[k]
        return vec3(real(x[0]) + real(e[0]), real(x[1]) + real(e[1]), real(x[2]) + real(e[2]))

    @wp.func
    def turn(at: Where, k: int):
        q = at.q[k]
        o = at.o[k]
        return normalized(quat(real(q[0]) + real(o[0]), real(q[1]) + real(o[1]), real(q[2]) + real(o[2]),
                               real(q[3]) + real(o[3])))

    def drive_joints(driven: Driven, level: wp.array(dtype=int), a: Where, b: Where, world_out: wp.array2d(dtype=mat44)):
        k, i = wp.tid()
        j = level[i]
        body = driven.body[j]
        s = driven.part[k]
        x = place(a, body)
        x = driven.origin[j] + x + s * (place(b, body) - x)
        R = matrix(slerp(turn(a, body), turn(b, body), s))
        zero = real(0.0)
        Y = mat44(R[0, 0], R[0, 1], R[0, 2], x[0], R[1, 0], R[1, 1], R[1, 2], x[1], R[2, 0], R[2, 1], R[2, 2], x[2],
                  zero, zero, zero, real(1.0))
        world_out[k, driven.joint[j]] = driven.back[k, driven.skeleton[j]] * Y * driven.bound[j]

    return wp.kernel(drive_joints, name=f"drive_joints_{types(of).name}", module=module, enable_backward=False)


@wp.struct
class Hung:
    corner: wp.array(dtype=wp.vec3i)          # among the skinned points, (places,)
    place: wp.array(dtype=vec3)               # u, v [1], h [m], (places,)
    ends: wp.array(dtype=wp.vec2i)            # places of which a column is the middle, twice one: that one, (columns,)
    origin: vec3                              # o [m]
    motion: wp.array(dtype=mat44)             # M, (times,)
    first: int                                # column of the targets


@cache
def hang(of, module):
    """Kernel over (times, columns of a pin): where its points are put [m]."""
    t = types(of)

    @wp.func
    def wide(x: t.vec3):
        return vec3(real(x[0]), real(x[1]), real(x[2]))

    @wp.func
    def placed(hung: Hung, x: wp.array2d(dtype=t.vec3), k: int, i: int):
        corner = hung.corner[i]
        x0 = wide(x[k, corner[0]])
        x1 = wide(x[k, corner[1]])
        x2 = wide(x[k, corner[2]])
        p = hung.place[i]
        n = wp.normalize(wp.cross(x1 - x0, x2 - x0))
        local = p[0] * x0 + p[1] * x1 + (real(1.0) - p[0] - p[1]) * x2 + p[2] * n
        return wp.transform_point(hung.motion[k], local)

    def hang_pins(hung: Hung, x: wp.array2d(dtype=t.vec3), target_out: wp.array2d(dtype=t.vec3)):
        k, i = wp.tid()
        ends = hung.ends[i]
        y = real(0.5) * (placed(hung, x, k, ends[0]) + placed(hung, x, k, ends[1])) - hung.origin
        target_out[k, hung.first + i] = t.vec3(of(y[0]), of(y[1]), of(y[2]))

    return wp.kernel(hang_pins, name=f"hang_pins_{t.name}", module=module, enable_backward=False)
