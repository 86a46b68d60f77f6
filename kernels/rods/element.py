"""Strains of a discrete elastic rod and their gradients. Bergou, Wardetzky, Robinson, Audoly, Grinspun 2008; Bergou, Audoly,
Vouga, Wardetzky, Grinspun 2010 (section 4).

    e, t, m1, m2   edge [m], its unit tangent, its material directors (m2 = t x m1)
    kb = 2 t0 x t1 / (1 + t0.t1)                               curvature binormal of the point between edges 0 and 1
    kappa = ((m2_0 + m2_1).kb / 2, -(m1_0 + m1_1).kb / 2)      integrated curvatures, 2 tan(half of the turn) [1]
    twist                                                      angle from m1_0, transported along, to m1_1 [rad]

Energies are those of integrated strains over the length that a point stands for: B |kappa - rest|^2 / (2 l), C (twist -
rest)^2 / (2 l), and of an edge A (|e| / l - 1)^2 l / 2. Damping: kernels/rods/forces.py. Edges that fold back (t0.t1 = -1)
have no curvature; it is held at FOLD.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

FOLD = wp.constant(wp.float64(1e-3))     # least 1 + t0.t1: a turn of 177 degrees at a point


@wp.func
def transport_director(a: wp.vec3d, b: wp.vec3d, v: wp.vec3d):
    """The vector v turned by the least rotation from unit tangent a to b (parallel transport)."""
    k = wp.cross(a, b)
    c = wp.max(wp.float64(1.0) + wp.dot(a, b), FOLD)
    return v + wp.cross(k, v) + wp.cross(k, wp.cross(k, v)) / c


@wp.func
def orthogonal_director(t: wp.vec3d, m: wp.vec3d):
    """The director m made a unit vector across t again."""
    return wp.normalize(m - t * wp.dot(t, m))


@wp.func
def rotated_director(t: wp.vec3d, m: wp.vec3d, angle: wp.float64):
    """The director m across t, turned about t by an angle [rad]."""
    return m * wp.cos(angle) + wp.cross(t, m) * wp.sin(angle)


@wp.func
def unwrapped_angle(angle: wp.float64, last: wp.float64):
    """The angle [rad] plus the whole turns that bring it nearest to the last one: twist beyond half a turn a point is kept."""
    turn = wp.float64(6.283185307179586)
    return angle + turn * wp.round((last - angle) / turn)


@wp.func
def director_twist_angle(t0: wp.vec3d, t1: wp.vec3d, m0: wp.vec3d, m1: wp.vec3d, last: wp.float64):
    """Twist [rad] from edge 0 to edge 1, nearest to the last one."""
    p = transport_director(t0, t1, m0)
    return unwrapped_angle(wp.atan2(wp.dot(wp.cross(p, m1), t1), wp.dot(p, m1)), last)


@wp.func
def bending_spin_stiffness(s: wp.vec3d, rest: wp.vec3d):
    """Part of the stiffness of bending that the angles of two edges have, over B: the gradient of kappa 1 and 2 by either
    [1/rad], and what adds to the stiffness of each against itself.

    With kappa turned by the mean angle a, E / B = |kappa|^2 / 2 - kappa . rest + ..: of the first part the angle changes
    nothing, of the second J = d kappa / da turns into the turned rest. So d2E / da2 = kappa . rest, d2E / da dx = (d kappa /
    dx)^T J rest, where Gauss and Newton's product has |kappa|^2 and kappa: a straight rod that is bent resists its spin so,
    which converges by a factor of 0.6 to 0.8 then. Here rest is taken c times, c = kappa . rest / |rest|^2 within 0 and 1, and
    kappa . rest where that is positive: c^2 |rest|^2 <= kappa . rest, the block stays positive."""
    zero = wp.float64(0.0)
    like = wp.max(rest[0] * s[0] + rest[1] * s[1], zero)
    size = rest[0] * rest[0] + rest[1] * rest[1]
    c = wp.min(like / wp.max(size, wp.float64(1e-30)), wp.float64(1.0))
    half = wp.float64(0.5)
    return wp.vec3d(half * c * rest[1], -half * c * rest[0], half * (like - c * c * size))


@wp.func
def spinning_damped(turn: wp.vec3d, u: wp.vec3d, w: wp.vec3d, gain: wp.float64):
    """`bending_spin_stiffness` with damping, whose stiffness is `gain` times the elastic one; u, w: gradients of the strains by
    both angles.

    Damping has the mean d of these gradients, elasticity c of `turn`. c^2 + gain d^2 = (1 + gain) g^2 + gain (c - d)^2 / (1 +
    gain), g their weighed mean; what stands last acts on the sum of both angles, and counts twice for each."""
    half, one = wp.float64(0.5), wp.float64(1.0)
    d = wp.vec3d(half * (u[0] + w[0]), half * (u[1] + w[1]), turn[2])
    off = turn - d
    g = (turn + d * gain) / (one + gain)
    return wp.vec3d(g[0], g[1], turn[2] + wp.float64(2.0) * gain / (one + gain) * (off[0] * off[0] + off[1] * off[1]))


@cache
def rod_strain_functions() -> SimpleNamespace:
    """Struct Bend (strains of a point and their gradients), functions strains(t0, t1, l0, l1, m0, m1, last) -> Bend, rates."""

    @wp.struct
    class BendStrains:
        s: wp.vec3d            # kappa 1, kappa 2, twist
        a: wp.mat33d           # rows: gradient of each by e0 [1/m]
        b: wp.mat33d           # rows: by e1
        u: wp.vec3d            # by the angle of edge 0 [1/rad]
        w: wp.vec3d            # by that of edge 1

    @wp.func
    def discrete_rod_strains(t0: wp.vec3d, t1: wp.vec3d, l0: wp.float64, l1: wp.float64, m0: wp.vec3d, m1: wp.vec3d,
                             last: wp.float64):
        half = wp.float64(0.5)
        n0 = wp.cross(t0, m0)
        n1 = wp.cross(t1, m1)
        c = wp.max(wp.float64(1.0) + wp.dot(t0, t1), FOLD)
        kb = wp.cross(t0, t1) * (wp.float64(2.0) / c)
        t = (t0 + t1) / c
        m = (m0 + m1) / c
        n = (n0 + n1) / c
        k1 = half * wp.dot(n0 + n1, kb)
        k2 = -half * wp.dot(m0 + m1, kb)
        f = BendStrains()
        f.s = wp.vec3d(k1, k2, director_twist_angle(t0, t1, m0, m1, last))
        f.a = wp.matrix_from_rows((wp.cross(t1, n) - t * k1) / l0, (-wp.cross(t1, m) - t * k2) / l0, kb * (half / l0))
        f.b = wp.matrix_from_rows((-wp.cross(t0, n) - t * k1) / l1, (wp.cross(t0, m) - t * k2) / l1, kb * (half / l1))
        f.u = wp.vec3d(-half * wp.dot(kb, m0), -half * wp.dot(kb, n0), wp.float64(-1.0))
        f.w = wp.vec3d(-half * wp.dot(kb, m1), -half * wp.dot(kb, n1), wp.float64(1.0))
        return f

    @wp.func
    def strain_rates(f: BendStrains, v0: wp.vec3d, v1: wp.vec3d, v2: wp.vec3d, w0: wp.float64, w1: wp.float64):
        """Rates of the strains [1/s], of velocities of three points and spins of two edges."""
        return f.a * (v1 - v0) + f.b * (v2 - v1) + f.u * w0 + f.w * w1

    return SimpleNamespace(Bend=BendStrains, strains=discrete_rod_strains, rates=strain_rates)
