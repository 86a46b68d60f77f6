"""Rotations between rotations on the device: nlerp, squad and its angular velocity, the mean. Names and formulas are those of
wsim/geometry/rotation_spline.py, which does the same on the host; quaternions are (x, y, z, w), unit.

    nlerp   normalized((1 - s) p + s q), the short way            squad   slerp(slerp(q0, q1, s), slerp(a, b, s), 2 s (1 - s))
    mean    the eigenvector of the largest eigenvalue of a sum of w q q^T                           (Markley et al. 2007)

Shoemake 1987. Sola 2017, Quaternion kinematics, equations 183 and 184: right Jacobians.
"""

from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_four
from wsim.kernels.math.rotation import (
    conjugate_rotation,
    multiply_rotations,
    rotate_vector,
    rotation_exponential,
    rotation_logarithm,
    slerp,
    unit_quaternion,
)


@wp.func
def normalized_lerp(p: Any, q: Any, s: Any):
    """From p to q the short way, fraction s; no rotation where they are opposite and s is 1/2."""
    zero = type(s)(0.0)
    sign = type(s)(1.0)
    if p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3] < zero:
        sign = -sign
    return unit_quaternion(type(p)(p[0] + s * (sign * q[0] - p[0]), p[1] + s * (sign * q[1] - p[1]),
                                   p[2] + s * (sign * q[2] - p[2]), p[3] + s * (sign * q[3] - p[3])))


@wp.func
def squad_rotation(q0: Any, a: Any, b: Any, q1: Any, s: Any):
    """From q0 to q1, inner quaternions a and b, fraction s of the time."""
    return slerp(slerp(q0, q1, s), slerp(a, b, s), type(s)(2.0) * s * (type(s)(1.0) - s))


@wp.func
def rotation_right_jacobian(w: Any, v: Any):
    """Rate about own axes of exponential(w), where the rotation vector w [rad] changes by v a second."""
    one = type(w[0])(1.0)
    aa = wp.dot(w, w)
    second = type(one)(0.5) - aa / type(one)(24.0) + aa * aa / type(one)(720.0)
    third = one / type(one)(6.0) - aa / type(one)(120.0) + aa * aa / type(one)(5040.0)
    if aa > type(one)(1.0e-4):
        a = wp.sqrt(aa)
        second = (one - wp.cos(a)) / aa
        third = (a - wp.sin(a)) / (a * aa)
    c = wp.cross(w, v)
    return v - second * c + third * wp.cross(w, c)


@wp.func
def rotation_inverse_jacobian(w: Any, v: Any):
    """Rate of the rotation vector w [rad], |w| < 2 pi, of a rotation that turns by v a second about own axes."""
    one = type(w[0])(1.0)
    half = type(one)(0.5)
    aa = wp.dot(w, w)
    third = one / type(one)(12.0) + aa / type(one)(720.0) + aa * aa / type(one)(30240.0)
    if aa > type(one)(1.0e-4):
        a = half * wp.sqrt(aa)
        third = (one - a * wp.cos(a) / wp.sin(a)) / aa
    c = wp.cross(w, v)
    return v + half * c + third * wp.cross(w, c)


@wp.func
def squad_angular_rate(q0: Any, a: Any, b: Any, q1: Any, s: Any):
    """(squad, its angular velocity about own axes [rad a unit of s]), exact."""
    one = type(s)(1.0)
    u = rotation_logarithm(multiply_rotations(conjugate_rotation(q0), q1))
    v = rotation_logarithm(multiply_rotations(conjugate_rotation(a), b))
    p = slerp(q0, q1, s)
    r = slerp(a, b, s)
    E = multiply_rotations(conjugate_rotation(p), r)
    w = rotation_logarithm(E)
    h = type(s)(2.0) * s * (one - s)
    dw = rotation_inverse_jacobian(w, v - rotate_vector(conjugate_rotation(E), u))
    e = rotation_exponential(h * w)
    turn = type(q0)(e[0], e[1], e[2], e[3])
    return (multiply_rotations(p, turn), rotate_vector(conjugate_rotation(turn), u)
            + rotation_right_jacobian(h * w, (type(s)(2.0) - type(s)(4.0) * s) * w + h * dw))


@wp.func
def mean_rotation(K: Any):
    """Of rotations, by K, the sum of w q q^T (4 x 4): a unit quaternion with w >= 0."""
    D, V = eigen_four(K)
    best = int(0)
    for i in range(1, 4):
        if D[i, i] > D[best, best]:
            best = i
    sign = type(K[0, 0])(1.0)
    if V[3, best] < sign - sign:
        sign = -sign
    return wp.quaternion(sign * V[0, best], sign * V[1, best], sign * V[2, best], sign * V[3, best])
