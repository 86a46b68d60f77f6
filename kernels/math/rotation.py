"""Rotations: quaternions, matrices and rotation vectors, and the rotation of a deformation gradient.

Quaternions are (x, y, z, w), unit, and act as q v q*; q and -q are one rotation. A rotation vector is axis times angle [rad].
The first half has the names and the formulas of wsim/geometry/rotation.py, which does the same on the host in float64:

    exponential(u) = (sin(a / 2) u / a, cos(a / 2)),  a = |u|         logarithm(q) = 2 atan2(|v|, w) v / |v|,  w >= 0
    slerp          = p exponential(s logarithm(p* q))                 integrated   = exponential(h omega) q

(Sola 2017, Quaternion kinematics, sections 2.4, 2.7 and 4.6.) The second half is the rotation of a deformation gradient: R
turns F most nearly, with the largest tr(R^T F) of all proper rotations. Then S = R^T F is symmetric, F = R S, and of its
eigenvalues (the signed stretches) no two sum below 0; at most one is negative, where det F < 0 (Irving, Teran, Fedkiw 2004,
section 5). With the quaternion q of R, tr(R^T F) = q^T K q (Horn 1987, section 4.A): on the unit sphere such a form has one
maximum (and its opposite), everything else that is stationary is a saddle or the minimum. Two ways to it:

    Newton   B = R^T F, G = tr(B) - sym(B), w = G^-1 axl(B - B^T), R <- R exp [w]x      cubic, as tr(exp [w]x S) is even in w
    Jacobi   the eigenvector of the largest eigenvalue of K; any F, also 0, flat, mirrored or half a turn away

Newton is taken from the last rotation as long as G is positive definite: it then ends in the maximum, whatever the sign of
det F.
"""

from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_four, identity_like, machine_epsilon

ITERATIONS = wp.constant(6)     # of Newton before Jacobi: cubic, so that what needs more does not converge


@wp.func
def multiply_rotations(p: Any, q: Any):
    """Quaternion of the rotation q, then p (Hamilton)."""
    return p * q


@wp.func
def conjugate_rotation(q: Any):
    """Quaternion of the rotation back."""
    return type(q)(-q[0], -q[1], -q[2], q[3])


@wp.func
def unit_quaternion(q: Any):
    """q / |q|; no rotation, (0, 0, 0, 1), where q is 0."""
    zero = type(q[0])(0.0)
    size = wp.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    found = type(q)(zero, zero, zero, type(q[0])(1.0))
    if size > zero:
        found = type(q)(q[0] / size, q[1] / size, q[2] / size, q[3] / size)
    return found


@wp.func
def rotate_vector(q: Any, v: Any):
    """q v q* = v + w t + u x t, t = 2 u x v with q = (u, w): a small turn keeps its digits."""
    u = type(v)(q[0], q[1], q[2])
    t = type(q[0])(2.0) * wp.cross(u, v)
    return v + q[3] * t + wp.cross(u, t)


@wp.func
def rotation_to_matrix(q: Any):
    """R of a unit quaternion."""
    D = matrix_minus_identity(q)
    return identity_like(D) + D


@wp.func
def matrix_to_quaternion(R: Any):
    """Components (x, y, z, w), as a vector, with w >= 0 of a rotation, from the largest of the four squares (Shepperd 1978)."""
    one = type(R[0, 0])(1.0)
    s = wp.vector(one + R[0, 0] - R[1, 1] - R[2, 2], one - R[0, 0] + R[1, 1] - R[2, 2],
                  one - R[0, 0] - R[1, 1] + R[2, 2], one + R[0, 0] + R[1, 1] + R[2, 2])
    a = R[2, 1]
    b = R[0, 2]
    c = R[1, 0]
    p = R[1, 2]
    q = R[2, 0]
    r = R[0, 1]
    found = wp.vector(s[0], c + r, b + q, a - p)
    if s[3] > s[0] and s[3] > s[1] and s[3] > s[2]:
        found = wp.vector(a - p, b - q, c - r, s[3])
    elif s[2] > s[0] and s[2] > s[1]:
        found = wp.vector(b + q, a + p, s[2], c - r)
    elif s[1] > s[0]:
        found = wp.vector(c + r, s[1], a + p, b - q)
    found = found / wp.length(found)
    if found[3] < one - one:
        found = -found
    return found


@wp.func
def rotation_about_axis(axis: Any, angle: Any):
    """I + sin K + (1 - cos) K K, rotation by an angle [rad] about a unit axis (Rodrigues), K K without the products by zero."""
    one = type(angle)(1.0)
    s = wp.sin(angle)
    c = one - wp.cos(angle)
    x = axis[0]
    y = axis[1]
    z = axis[2]
    xy = c * (x * y)
    xz = c * (x * z)
    yz = c * (y * z)
    return wp.matrix_from_rows(wp.vector(one - c * (y * y + z * z), xy - s * z, xz + s * y),
                               wp.vector(xy + s * z, one - c * (x * x + z * z), yz - s * x),
                               wp.vector(xz - s * y, yz + s * x, one - c * (x * x + y * y)))


@wp.func
def rotation_exponential(u: Any):
    """Components (x, y, z, w), as a vector, of the quaternion of a rotation vector [rad]; by a series below 0.01 rad."""
    one = type(u[0])(1.0)
    aa = wp.dot(u, u)
    a = wp.sqrt(aa)
    k = type(one)(0.5) - aa / type(one)(48.0) + aa * aa / type(one)(3840.0)       # sin(a / 2) / a
    if aa > type(one)(1.0e-4):
        k = wp.sin(type(one)(0.5) * a) / a
    return wp.vector(k * u[0], k * u[1], k * u[2], wp.cos(type(one)(0.5) * a))


@wp.func
def rotation_logarithm(q: Any):
    """Rotation vector [rad] of a unit quaternion, the short way: |u| <= pi. Half a turn goes about q's own axis."""
    zero = type(q[0])(0.0)
    v = wp.vector(q[0], q[1], q[2])
    c = q[3]
    if c < zero:
        v = -v
        c = -c
    s = wp.length(v)
    tt = s / wp.max(c, type(c)(1.0e-3))
    tt = tt * tt
    k = type(c)(2.0) / wp.max(c, type(c)(1.0e-3)) * (type(c)(1.0) - tt / type(c)(3.0) + tt * tt / type(c)(5.0))
    if tt > type(c)(1.0e-5):
        k = type(c)(2.0) * wp.atan2(s, c) / s
    return k * v


@wp.func
def slerp(p: Any, q: Any, s: Any):
    """Rotation a part s of the short way from p to q, at constant speed about a fixed axis."""
    e = rotation_exponential(s * rotation_logarithm(multiply_rotations(conjugate_rotation(p), q)))
    return multiply_rotations(p, type(p)(e[0], e[1], e[2], e[3]))


@wp.func
def mean_angular_velocity(p: Any, q: Any, h: Any):
    """Angular velocity [rad/s], in world axes, that turns p into q in h [s], the short way."""
    return rotation_logarithm(multiply_rotations(q, conjugate_rotation(p))) / h


@wp.func
def integrate_orientation(q: Any, omega: Any, h: Any):
    """Orientation q after h [s] at the angular velocity omega [rad/s] in world axes."""
    e = rotation_exponential(h * omega)
    return unit_quaternion(multiply_rotations(type(q)(e[0], e[1], e[2], e[3]), q))


@wp.func
def twice_axis(B: Any):
    """b with B - B^T = [b]x."""
    return wp.vector(B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1])


@wp.func
def matrix_minus_identity(q: Any):
    """R - 1 of a unit quaternion: 2 w [v]x + 2 [v]x^2, so that a small turn keeps its digits."""
    two = type(q[0])(2.0)
    x = two * q[0]
    y = two * q[1]
    z = two * q[2]
    xx = x * q[0]
    yy = y * q[1]
    zz = z * q[2]
    xy = x * q[1]
    xz = x * q[2]
    yz = y * q[2]
    wx = x * q[3]
    wy = y * q[3]
    wz = z * q[3]
    return wp.matrix_from_rows(wp.vector(-yy - zz, xy - wz, xz + wy), wp.vector(xy + wz, -xx - zz, yz - wx),
                               wp.vector(xz - wy, yz + wx, -xx - yy))


@wp.func
def horn_matrix(F: Any):
    """K with tr(R^T F) = q^T K q for the rotation R of q = (x, y, z, w)."""
    xy = F[0, 1] + F[1, 0]
    xz = F[0, 2] + F[2, 0]
    yz = F[1, 2] + F[2, 1]
    b = twice_axis(F)
    return wp.matrix_from_rows(wp.vector(F[0, 0] - F[1, 1] - F[2, 2], xy, xz, b[0]),
                               wp.vector(xy, F[1, 1] - F[0, 0] - F[2, 2], yz, b[1]),
                               wp.vector(xz, yz, F[2, 2] - F[0, 0] - F[1, 1], b[2]),
                               wp.vector(b[0], b[1], b[2], F[0, 0] + F[1, 1] + F[2, 2]))


@wp.func
def rotation_anew(F: Any, q: Any):
    """Quaternion of the rotation of any F with |F_ij| <= 2. Where several are as good (a line, a mirror), the nearest to q.

    K has the eigenvalues s1 + s2 + s3, s1 - s2 - s3, s2 - s1 - s3, s3 - s1 - s2: the largest stands alone while s2 + s3 > 0.
    """
    D, V = eigen_four(horn_matrix(F))
    one = type(q[0])(1.0)
    most = wp.max(wp.max(D[0, 0], D[1, 1]), wp.max(D[2, 2], D[3, 3]))
    near = type(q)(one - one, one - one, one - one, one - one)
    best = type(q)(one - one, one - one, one - one, one)
    for k in range(4):
        v = type(q)(V[0, k], V[1, k], V[2, k], V[3, k])
        if D[k, k] == most:
            best = v
        if D[k, k] >= most - type(one)(16.0) * machine_epsilon(one) * most:
            near += wp.dot(q, v) * v
    r = best
    if wp.dot(near, near) > type(one)(1.0e-6):
        r = near
    return wp.normalize(r)


@wp.func
def turn_step(H: Any, q: Any, scale: Any):
    """(w, least): Newton's step [rad] at q, and the least pivot of G over its trace; < 0: no maximum near."""
    one = type(scale)(1.0)
    D = matrix_minus_identity(q)
    X = scale * (H - D)                                    # B = R^T F = scale + R^T scale (H - D), D = R - 1
    X = X + wp.transpose(D) * X
    b = twice_axis(X)
    t = wp.trace(X) + type(scale)(3.0) * scale
    g0 = t - X[0, 0] - scale
    g10 = type(scale)(-0.5) * (X[0, 1] + X[1, 0])
    g20 = type(scale)(-0.5) * (X[0, 2] + X[2, 0])
    g21 = type(scale)(-0.5) * (X[1, 2] + X[2, 1])
    w = type(scale)(0.0) * b
    least = g0 / (t + t)
    if t > type(scale)(0.0) and g0 > type(scale)(1.0e-3) * t:
        l10 = g10 / g0
        l20 = g20 / g0
        g1 = t - X[1, 1] - scale - l10 * g10
        g21 = g21 - l20 * g10
        least = wp.min(least, g1 / (t + t))
        if g1 > type(scale)(1.0e-3) * t:
            l21 = g21 / g1
            g2 = t - X[2, 2] - scale - l20 * g20 - l21 * g21
            least = wp.min(least, g2 / (t + t))
            if g2 > type(scale)(1.0e-3) * t:
                y1 = b[1] - l10 * b[0]
                w2 = (b[2] - l20 * b[0] - l21 * y1) / g2
                w1 = y1 / g1 - l21 * w2
                w = wp.vector(b[0] / g0 - l10 * w1 - l20 * w2, w1, w2)
                return w, least
    return w, -one


@wp.func
def polar_rotation(H: Any, warm: Any):
    """Quaternion (x, y, z, w) of the rotation of F = 1 + H, from that of a nearby F, `warm`; 0 stands for none.

    Always a proper rotation, for every finite H; of F = 0 it is `warm`. Right to 5 units of rounding times s1 / (s2 + s3), the
    condition of the problem. Measured on a CPU, float32: 65 ns where F turned less than 5 mrad since `warm` (one step), 150 ns
    with two, 1400 ns on average for random F from nothing, half of them inverted.
    """
    one = type(H[0, 0])(1.0)
    zero = type(H[0, 0])(0.0)
    q = type(warm)(zero, zero, zero, one)
    if wp.dot(warm, warm) > zero:
        q = wp.normalize(warm)
    first = q
    scale = one
    size = wp.max(wp.max(wp.max(wp.abs(H[0])), wp.max(wp.abs(H[1]))), wp.max(wp.abs(H[2])))
    if size > one:
        scale = one / size
    done = bool(False)
    most = int(ITERATIONS)                           # a variable: unrolled, this took 0.7 s of a processor to compile
    for _k in range(most):
        w, least = turn_step(H, q, scale)
        if least < zero:
            break
        half = type(one)(0.5) * w
        q = wp.normalize(q * type(warm)(half[0], half[1], half[2], one))      # an angle of 2 atan(|w| / 2)
        ww = wp.dot(w, w)
        if ww * wp.sqrt(ww) <= machine_epsilon(one) * least:                  # the next step: below |w|^3 / least
            done = True
            break
    if not done:
        F = scale * H + scale * identity_like(H)
        q = first
        if wp.ddot(F, F) > zero:
            q = rotation_anew(F, first)
    return q
