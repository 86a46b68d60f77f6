"""Coordinates of a joint: where the frame b stands in the frame a, and the rows of their rates. All of it float64.

    d     = A^T (p_b - p_a)                       shifts along the axes of a [m]
    R_ab  = A^T B = exp(s) exp(phi x),  s . x = 0      swing s = (0, s_y, s_z) and twist phi about x [rad]

    d'    = A^T u,  u = v_b + omega_b x r_b - v_a - omega_a x r_a,   r_a and r_b both lead to p_b
    omega = R_s x phi' + E(s) s',  E = 1 + (1 - cos t)/t^2 [s] + (t - sin t)/t^3 [s]^2,  t = |s|      (omega_b - omega_a, in a)

so that (phi', s_y', s_z') = M^-1 omega with the columns R_s x, E y, E z of M. Nothing of it is linearised: twist has no
singular place, swing one at half a turn. A row's impulse is a force along the row of A^T at p_b, on both bodies in one place,
or a torque along a row of M^-1 A^T: momentum and angular momentum stay, whatever the error is.

Two other forms. Distance: row 0 is n = (p_b - p_a) / |p_b - p_a|, its coordinate the distance. Cone: the coordinate of row 4 is
what is left to the elliptic cone f = |(s_y / c_y, s_z / c_z)| <= 1, as min(c_y, c_z) (1 - f) [rad].

(Swing and twist: Dobrowolski 2015, Swing-twist decomposition in Clifford algebra; E, the left Jacobian of SO(3): Sola 2018,
A micro Lie theory, equation 145.)
"""

import warp as wp

from wsim.kernels.math.rotation import conjugate_rotation, multiply_rotations, rotation_logarithm, rotation_to_matrix

GENERAL, DISTANCE, CONE = wp.constant(0), wp.constant(1), wp.constant(2)
FARTHEST = wp.constant(wp.float64(3.1))      # [rad] of a swing for its rows: at half a turn they have no end
PI = wp.constant(wp.float64(3.141592653589793))


@wp.struct
class JointFrames:
    """Frames of a joint on both sides, places from one origin."""
    p_a: wp.vec3d
    p_b: wp.vec3d
    c_a: wp.vec3d            # centres of mass
    c_b: wp.vec3d
    Q_a: wp.quatd
    Q_b: wp.quatd


@wp.struct
class JointCoordinates:
    """Coordinates (shift, turned = (phi, s_y, s_z)) and their rows in the world: rates = axis u, turn omega."""
    shift: wp.vec3d
    turned: wp.vec3d
    axis: wp.mat33d
    turn: wp.mat33d


@wp.func
def swing_twist_angles(q: wp.quatd):
    """(phi, s_y, s_z) and the quaternion of the swing."""
    x = q[0]
    w = q[3]
    if w < wp.float64(0.0):
        x = -x
        w = -w
    size = wp.sqrt(x * x + w * w)
    phi = wp.float64(0.0)
    twist = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    if size > wp.float64(1.0e-12):
        phi = wp.float64(2.0) * wp.atan2(x, w)
        twist = wp.quatd(x / size, wp.float64(0.0), wp.float64(0.0), w / size)
    swing = multiply_rotations(q, conjugate_rotation(twist))
    s = rotation_logarithm(swing)
    return wp.vec3d(phi, s[1], s[2]), swing


@wp.func(inline=False)
def swing_twist_rate_matrix(s: wp.vec3d, swing: wp.quatd):
    """M^-1 of a swing (0, s_y, s_z)."""
    one = wp.float64(1.0)
    v = wp.vec3d(wp.float64(0.0), s[1], s[2])
    t = wp.length(v)
    x = rotation_to_matrix(swing) * wp.vec3d(one, wp.float64(0.0), wp.float64(0.0))
    if t > FARTHEST:
        v = v * (FARTHEST / t)
        t = FARTHEST
        n = wp.skew(v / t)
        x = wp.vec3d(one, wp.float64(0.0), wp.float64(0.0))
        x = x + wp.sin(t) * (n * x) + (one - wp.cos(t)) * (n * (n * x))
    tt = t * t
    first = wp.float64(0.5) - tt / wp.float64(24.0)
    second = one / wp.float64(6.0) - tt / wp.float64(120.0)
    if tt > wp.float64(1.0e-4):
        first = (one - wp.cos(t)) / tt
        second = (t - wp.sin(t)) / (tt * t)
    X = wp.skew(v)
    E = wp.identity(n=3, dtype=wp.float64) + first * X + second * (X * X)
    M = wp.matrix_from_cols(x, wp.vec3d(E[0, 1], E[1, 1], E[2, 1]), wp.vec3d(E[0, 2], E[1, 2], E[2, 2]))
    return wp.inverse(M)


@wp.func
def distance_direction(to: wp.vec3d, A: wp.mat33d):
    """Direction of a distance; where it is 0, the x axis of a."""
    size = wp.length(to)
    n = wp.vec3d(A[0, 0], A[1, 0], A[2, 0])
    if size > wp.float64(0.0):
        n = to / size
    return n


@wp.func(inline=False)
def joint_coordinates(e: JointFrames, form: int, cone: wp.vec2d):
    """The `JointCoordinates` of both frames; cone: 1 / c_y, 1 / c_z."""
    zero = wp.float64(0.0)
    found = JointCoordinates()
    A = rotation_to_matrix(e.Q_a)
    to = e.p_b - e.p_a
    found.axis = wp.transpose(A)
    found.shift = found.axis * to
    if form == DISTANCE:
        n = distance_direction(to, A)
        found.shift = wp.vec3d(wp.length(to), zero, zero)
        found.axis = wp.matrix_from_rows(n, wp.vec3d(), wp.vec3d())
    s, swing = swing_twist_angles(multiply_rotations(conjugate_rotation(e.Q_a), e.Q_b))
    found.turned = s
    found.turn = swing_twist_rate_matrix(s, swing) * wp.transpose(A)
    if form == CONE:
        y = s[1] * cone[0]
        z = s[2] * cone[1]
        f = wp.sqrt(y * y + z * z)
        size = wp.float64(1.0) / wp.max(cone[0], cone[1])
        way = wp.vec2d(wp.float64(1.0), zero)
        if f > wp.float64(1.0e-9):
            way = -size * wp.vec2d(y * cone[0] / f, z * cone[1] / f)
        found.turned = wp.vec3d(s[0], size * (wp.float64(1.0) - f), zero)
        found.turn = wp.matrix_from_rows(found.turn[0], way[0] * found.turn[1] + way[1] * found.turn[2], wp.vec3d())
    return found


@wp.func
def unwind_twist_angle(phi: wp.float64, quarters: int):
    """phi and as many whole turns as bring it next to so many quarter turns."""
    near = wp.float64(quarters) * wp.float64(0.5) * PI
    return phi + wp.float64(2.0) * PI * wp.round((near - phi) / (wp.float64(2.0) * PI))
