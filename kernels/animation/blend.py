"""Weights of blend shapes at moments of a frame, on the device, in float64: the formulas of
wsim/physics/animation/skinning.py (`shape_weights`, `part_weights`).

    animated      w(t) by keys, straight between them and held outside
    corrective    w = s^2 (3 - 2 s),  s = 1 - angle / width within 0 .. 1,  angle between the joint's rotation and its target
    parts         between the knots (0 and those with offsets) around w, straight: 1 - e and e; beyond the outermost on straight
"""

from functools import cache

import warp as wp

from wsim.kernels.animation.skeleton import SkeletonJoints, joint_key_interval
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import conjugate_rotation, multiply_rotations, rotation_logarithm, slerp

real, quat = wp.float64, wp.quatd
ANIMATED, NONE = -1, -2


@wp.struct
class BlendShapeTable:
    first: wp.array(dtype=int)                # knots of shape i, ascending: first[i] .. first[i + 1], (shapes + 1,)
    knot: wp.array(dtype=real)                # [1]
    part: wp.array(dtype=int)                 # of the weights, of each knot; -1 of 0, (knots,)
    joint: wp.array(dtype=int)                # among all joints; ANIMATED, NONE, (shapes,)
    turns: wp.array(dtype=int)                # whether that joint is animated, (shapes,)
    still: wp.array(dtype=quat)               # its rotation if it is not
    target: wp.array(dtype=quat)
    width: wp.array(dtype=real)               # [rad]
    column: wp.array(dtype=int)               # of the keys' values, (shapes,)
    time: wp.array(dtype=real)                # of keys [s]
    value: wp.array2d(dtype=real)             # (keys, columns)


@wp.func
def keyed_shape_weight(b: BlendShapeTable, i: int, t: real):
    """Weight by keys."""
    low = int(0)
    high = b.time.shape[0]
    while low < high:                         # the first key later than t
        middle = (low + high) // 2
        if b.time[middle] <= t:
            low = middle + 1
        else:
            high = middle
    c = b.column[i]
    if low == 0:
        return b.value[0, c]
    if low == b.time.shape[0]:
        return b.value[low - 1, c]
    s = (t - b.time[low - 1]) / (b.time[low] - b.time[low - 1])
    return (real(1.0) - s) * b.value[low - 1, c] + s * b.value[low, c]


@wp.func
def corrective_shape_weight(joints: SkeletonJoints, b: BlendShapeTable, i: int, t: real):
    """Weight by the joint that drives the shape."""
    j = b.joint[i]
    q = b.still[i]
    if b.turns[i] != 0:
        first, last, part = joint_key_interval(joints, joints.skeleton[j], t)
        e = joints.entry[j] + first * joints.width[j]
        f = joints.entry[j] + last * joints.width[j]
        q = slerp(joints.turn[e], joints.turn[f], part)
    angle = wp.length(rotation_logarithm(multiply_rotations(conjugate_rotation(b.target[i]), q)))
    s = wp.clamp(real(1.0) - angle / b.width[i], real(0.0), real(1.0))
    return s * s * (real(3.0) - real(2.0) * s)


@cache
def shape_weight_kernel(of, module):
    """Kernel over (moments, shapes): weights of their parts, (moments, parts), of the precision `of`."""
    t = types(of)

    def weigh_shapes(joints: SkeletonJoints, b: BlendShapeTable, start: wp.array(dtype=real), moment: wp.array(dtype=real),
                     weight_out: wp.array2d(dtype=t.scalar)):
        k, i = wp.tid()
        at = start[0] + moment[k]
        w = real(0.0)
        if b.joint[i] == ANIMATED:
            w = keyed_shape_weight(b, i, at)
        elif b.joint[i] != NONE:
            w = corrective_shape_weight(joints, b, i, at)
        first = b.first[i]
        last = b.first[i + 1]
        low = first
        for e in range(first, last):
            if b.part[e] >= 0:
                weight_out[k, b.part[e]] = of(0.0)
            if b.knot[e] <= w:
                low = e
        low = wp.min(low, last - 2)
        s = (w - b.knot[low]) / (b.knot[low + 1] - b.knot[low])
        if b.part[low] >= 0:
            weight_out[k, b.part[low]] = of(real(1.0) - s)
        if b.part[low + 1] >= 0:
            weight_out[k, b.part[low + 1]] = of(s)

    return wp.kernel(weigh_shapes, name=f"weigh_shapes_{t.name}", module=module, enable_backward=False)
