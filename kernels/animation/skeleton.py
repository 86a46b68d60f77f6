"""Transforms of joint trees on the device, in float64: formulas and their order are those of
wsim/physics/animation/skinning.py.

    local     L = T R diag(s) of animated joints at each time: T, s linear between keys, R by slerp; else the rest transform
    compose   W_j = W_parent(j) L_j, one launch a level of the tree; W_root = L_root
    bones     A_j = W_j B_j^-1, rounded once

Joints of all skeletons stand one behind the other; a launch is for all times of a frame.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import rotation_to_matrix, slerp

real, mat44, vec3, quat = wp.float64, wp.mat44d, wp.vec3d, wp.quatd


@wp.struct
class SkeletonJoints:
    parent: wp.array(dtype=int)               # among all joints, -1 of a root, (joints,)
    skeleton: wp.array(dtype=int)             # (joints,)
    animated: wp.array(dtype=int)             # (joints,)
    entry: wp.array(dtype=int)                # of its first key in place, turn, scale, (joints,)
    width: wp.array(dtype=int)                # from there to the next key, (joints,)
    rest: wp.array(dtype=mat44)               # (joints,)
    unbind: wp.array(dtype=mat44)             # B^-1, (joints,)
    first: wp.array(dtype=int)                # keys of skeleton s: first[s] .. first[s + 1], (skeletons + 1,)
    time: wp.array(dtype=real)                # [s], (keys,)
    place: wp.array(dtype=vec3)               # T [m]
    turn: wp.array(dtype=quat)                # R, unit
    scale: wp.array(dtype=vec3)               # s [1]


@wp.func
def joint_key_interval(joints: SkeletonJoints, s: int, t: real):
    """Numbers, from the skeleton's first, of the key before t and of the one behind it, and the fraction of the way."""
    low = joints.first[s]
    high = joints.first[s + 1]
    end = high
    while low < high:                         # the first key later than t
        middle = (low + high) // 2
        if joints.time[middle] <= t:
            low = middle + 1
        else:
            high = middle
    b = wp.min(low, end - 1)
    a = wp.max(low - 1, joints.first[s])
    part = real(0.0)
    if b > a:
        part = (t - joints.time[a]) / (joints.time[b] - joints.time[a])
    return a - joints.first[s], b - joints.first[s], part


@cache
def local_joint_kernel(module):
    """Kernel over (moments, joints): L at times start + moment [s]. start: when the frame begins, (1,)."""

    def local_joints(joints: SkeletonJoints, start: wp.array(dtype=real), moment: wp.array(dtype=real),
                     world_out: wp.array2d(dtype=mat44)):
        k, j = wp.tid()
        s = joints.skeleton[j]
        L = joints.rest[j]
        if joints.animated[j] != 0:
            a, b, part = joint_key_interval(joints, s, start[0] + moment[k])
            e = joints.entry[j] + a * joints.width[j]
            f = joints.entry[j] + b * joints.width[j]
            T = joints.place[e]
            T = T + part * (joints.place[f] - T)
            z = joints.scale[e]
            z = z + part * (joints.scale[f] - z)
            R = rotation_to_matrix(slerp(joints.turn[e], joints.turn[f], part))
            zero = real(0.0)
            L = mat44(R[0, 0] * z[0], R[0, 1] * z[1], R[0, 2] * z[2], T[0],
                      R[1, 0] * z[0], R[1, 1] * z[1], R[1, 2] * z[2], T[1],
                      R[2, 0] * z[0], R[2, 1] * z[1], R[2, 2] * z[2], T[2], zero, zero, zero, real(1.0))
        world_out[k, j] = L

    return wp.kernel(local_joints, name="local_joints", module=module, enable_backward=False)


@cache
def joint_compose_kernel(module):
    """Kernel over (times, joints of a level): W, from L and W of the level above."""

    def compose_joints(joints: SkeletonJoints, level: wp.array(dtype=int), world: wp.array2d(dtype=mat44),
                       world_out: wp.array2d(dtype=mat44)):
        k, i = wp.tid()
        j = level[i]
        world_out[k, j] = world[k, joints.parent[j]] * world[k, j]

    return wp.kernel(compose_joints, name="compose_joints", module=module, enable_backward=False)


@cache
def skin_matrix_kernel(of, module):
    """Kernel over (times, joints): the three rows of A, of the precision `of`."""
    t = types(of)
    rows = wp.types.matrix((3, 4), of)

    def skin_joints(joints: SkeletonJoints, world: wp.array2d(dtype=mat44), A_out: wp.array2d(dtype=rows)):
        k, j = wp.tid()
        A = world[k, j] * joints.unbind[j]
        found = rows()
        for r in range(3):
            for c in range(4):
                found[r, c] = of(A[r, c])
        A_out[k, j] = found

    return wp.kernel(skin_joints, name=f"skin_joints_{t.name}", module=module, enable_backward=False)
