"""Constraints: value C and gradient G of each, and what kernels need to know of them. The table of kinds:
wsim/physics/cloth/kind.py.

Displacement form: a constraint sees its points relative to its first, X_k = (x_k - x_0) + (d_k - d_0) [m], k >= 1, so
that small displacements d far from the origin lose nothing. X has these as rows; a formula returns C and G with rows
G_k = dC/dX_k, k >= 1. C does not change under translation, so G_0 is minus the sum of the others: momentum is kept.

A constraint with compliance alpha [unit of C per unit of its multiplier] stores the energy C^2 / (2 alpha)
(Macklin, Mueller, Chentanez 2016, eq. 2). No formula divides by zero: where a direction is not defined, its G is 0.
"""

import math
from dataclasses import dataclass
from typing import Any

import warp as wp

FLAT = 1.0e-24         # of two squared heights [m^4], below which a hinge has no angle


@wp.func
def inverse_or_zero(s: Any):
    """1 / s for s > 0, else 0."""
    r = type(s)(0.0)
    if s > type(s)(0.0):
        r = type(s)(1.0) / s
    return r


@wp.func
def wrap_angle(angle: Any):
    """The angle [rad] in [-2 pi, 2 pi] brought to [-pi, pi]."""
    pi = type(angle)(wp.static(math.pi))
    r = angle
    if angle > pi:
        r = angle - type(angle)(2.0) * pi
    if angle < -pi:
        r = angle + type(angle)(2.0) * pi
    return r


@wp.func
def arctangent(y: wp.float64, x: wp.float64):
    """Angle [rad] of the point (x, y), in [-pi, pi]."""
    return wp.atan2(y, x)


@wp.func
def arctangent(y: wp.float32, x: wp.float32):  # noqa: F811 - an overload
    """Angle [rad] of the point (x, y), in [-pi, pi]; 0 at the origin. Error below 2 units in the last place.

    atan z = z + z u P(u), u = z^2, z in [0, 1]; P minimises the largest relative error, 1.7e-8. Half the time of the
    library's function on a CPU, and the same formula on every device.
    """
    ax = wp.abs(x)
    ay = wp.abs(y)
    z = wp.float32(0.0)
    if wp.max(ax, ay) > 0.0:
        z = wp.min(ax, ay) / wp.max(ax, ay)
    u = z * z
    P = -0.0163679108 + 0.00292068769 * u
    P = 0.0432118343 + P * u
    P = -0.0755221217 + P * u
    P = 0.106660037 + P * u
    P = -0.142110551 + P * u
    P = 0.199937728 + P * u
    P = -0.333331527 + P * u
    r = z + z * u * P
    if ay > ax:
        r = wp.static(math.pi / 2.0) - r
    if x < 0.0:
        r = wp.static(math.pi) - r
    if y < 0.0:
        r = -r
    return r


@wp.func
def distance_constraint(X: Any, l0: Any):
    """C = |x1 - x0| - l0 [m]. Coincident points: G = 0."""
    L = wp.length(X[0])
    return L - l0, inverse_or_zero(L) * X


@wp.func
def dihedral_constraint(X: Any, theta0: Any):
    """C = theta - theta0 [rad] at the hinge x0-x1 between the triangles (x0, x1, x2) and (x1, x0, x3); flat: theta = 0.

    theta > 0 when the hinge folds away from the side that the normals point to (a ridge, seen from there). With E = X1,
    N2 = E x X2, N3 = X3 x E (normals, twice the areas long), t_k = X_k.E / |E|^2 the foot of each height and
    H_k = |N_k|^2 / |E|^2 its square:

        theta = atan2(-|E| X3.N2, N2.N3),   G_k = -N_k / (|E| H_k),   G_1 = -(t_2 G_2 + t_3 G_3)

    (Tamstorf, Grinspun 2013, section 3; N2 x N3 = -(X3.N2) E.) Nothing is normalised, so it holds at every scale.
    A triangle lower than a micrometre has no angle: C = 0, G = 0; 1 / (|E| H2 H3) would leave the range of float32.
    """
    E = X[0]
    X2 = X[1]
    X3 = X[2]
    N2 = wp.cross(E, X2)
    N3 = wp.cross(X3, E)
    LL = wp.dot(E, E)
    q = inverse_or_zero(LL)
    H2 = q * wp.dot(N2, N2)
    H3 = q * wp.dot(N3, N3)
    both = H2 * H3
    C = type(theta0)(0.0)
    G1 = type(E)()
    G2 = type(E)()
    G3 = type(E)()
    if both > type(theta0)(wp.static(FLAT)):
        L = wp.sqrt(LL)
        s = -q * L / both                              # -1 / (|E| H2 H3): one division serves both
        C = wrap_angle(arctangent(-L * wp.dot(X3, N2), wp.dot(N2, N3)) - theta0)
        G2 = (s * H3) * N2
        G3 = (s * H2) * N3
        G1 = -(q * wp.dot(E, X2)) * G2 - (q * wp.dot(E, X3)) * G3
    return C, wp.matrix_from_rows(G1, G2, G3)


@wp.func
def cross_and_normal(Fu: Any, Fv: Any):
    """|F_u x F_v| and a unit normal of both; where they are parallel, one of the normals of the longer."""
    N = wp.cross(Fu, Fv)
    s = wp.length(N)
    n = inverse_or_zero(s) * N
    uu = wp.dot(Fu, Fu)
    vv = wp.dot(Fv, Fv)
    if s < type(s)(1.0e-3) * (uu + vv):              # rounding may have turned N: make it normal again
        e = inverse_or_zero(wp.sqrt(uu)) * Fu
        if vv > uu:
            e = inverse_or_zero(wp.sqrt(vv)) * Fv
        if s == type(s)(0.0):
            n = wp.cross(e, type(e)(type(s)(0.0), type(s)(1.0), type(s)(0.0)))
            if wp.abs(e[1]) > type(s)(0.9):
                n = wp.cross(e, type(e)(type(s)(1.0), type(s)(0.0), type(s)(0.0)))
        n = wp.normalize(n - wp.dot(n, e) * e)
    return s, n


@wp.func
def polar_rows(Fu: Any, Fv: Any):
    """Rows r_u, r_v of the rotation R^T of F = R U, a unit normal, |F_u x F_v| and 1 / tr U: see `membrane_constraint`."""
    s, n = cross_and_normal(Fu, Fv)
    t = wp.sqrt(wp.dot(Fu, Fu) + wp.dot(Fv, Fv) + type(s)(2.0) * s)
    q = inverse_or_zero(t)
    ru = q * (Fu + wp.cross(Fv, n))
    rv = q * (Fv + wp.cross(n, Fu))
    if t == type(s)(0.0):
        ru[0] = type(s)(1.0)
        rv[1] = type(s)(1.0)
    return ru, rv, n, s, q


@wp.func
def membrane_constraint(X: Any, B: Any):
    """C = (U_uu - 1, U_vv - 1, 2 U_uv), strains of warp and weft and their shear; rows of G1, G2 are those of C.

    F = [X1 X2] B = R U, B = Dm^-1 [1/m] with the rest edges in (u, v) as columns of Dm; R turns, U = sqrt(F^T F). With
    the unit normal n and t = tr U = sqrt(|F_u|^2 + |F_v|^2 + 2 |F_u x F_v|), the plane polar decomposition is closed:

        R = [F_u + F_v x n,  F_v + n x F_u] / t,   dU = R^T dF - w J U,   w = (r_v.dF_u - r_u.dF_v) / t

    (J the quarter turn; Sifakis, Barbic 2012, appendix.) U grows linearly and its gradients stay independent however far
    a triangle is stretched, sheared or flattened; those of |F_u|, |F_v| and F_u.F_v (Baraff, Witkin 1998) become dependent,
    and the 3 x 3 solve then throws points away. With the compliance of plane stress, rest area A [m^2],

        alpha = [[1, -nu s, 0], [-nu s, s^2, 0], [0, 0, stretch / shear]] / (stretch A)   [1/J],  s^2 = stretch / weft

    the energy 1/2 C alpha^-1 C is A psi of `wsim.scene.fabric`. A turned or mirrored triangle (in a plane: inverted) is at
    rest. A triangle shrunk to a point opens in the plane of x and y.
    """
    X1 = X[0]
    X2 = X[1]
    Fu = B[0, 0] * X1 + B[1, 0] * X2
    Fv = B[0, 1] * X1 + B[1, 1] * X2
    ru, rv, _n, s, q = polar_rows(Fu, Fv)
    one = type(s)(1.0)
    two = type(s)(2.0)
    Uuu = wp.dot(ru, Fu)
    Uvv = wp.dot(rv, Fv)
    Uuv = wp.dot(ru, Fv)
    m = q * Uuv
    C = wp.vector(Uuu - one, Uvv - one, two * Uuv)
    Au = ru + m * rv                                 # dC / dF_u and dC / dF_v, row by row
    Bu = -m * ru
    Av = -m * rv
    Bv = rv + m * ru
    As = (two * q * Uvv) * rv
    Bs = (two * q * Uuu) * ru
    G1 = wp.matrix_from_rows(B[0, 0] * Au + B[0, 1] * Bu, B[0, 0] * Av + B[0, 1] * Bv, B[0, 0] * As + B[0, 1] * Bs)
    G2 = wp.matrix_from_rows(B[1, 0] * Au + B[1, 1] * Bu, B[1, 0] * Av + B[1, 1] * Bv, B[1, 0] * As + B[1, 1] * Bs)
    return C, G1, G2


@wp.func
def membrane_response(C: Any, B: Any, w0: Any, w1: Any, w2: Any):
    """S = sum_k w_k G_k G_k^T of `membrane_constraint`, from its C: in the axes of R the gradients are known from U alone, and
    M = sum_k w_k b b^T, b the row of B of point k (minus the sum of the others for the first), does the rest.
    """
    one = type(w0)(1.0)
    two = type(w0)(2.0)
    q = inverse_or_zero(C[0] + C[1] + two)
    m = q * C[2] / two
    b = two * q * (C[1] + one)
    g = two * q * (C[0] + one)
    u0 = B[0, 0] + B[1, 0]
    v0 = B[0, 1] + B[1, 1]
    Muu = w0 * u0 * u0 + w1 * B[0, 0] * B[0, 0] + w2 * B[1, 0] * B[1, 0]
    Muv = w0 * u0 * v0 + w1 * B[0, 0] * B[0, 1] + w2 * B[1, 0] * B[1, 1]
    Mvv = w0 * v0 * v0 + w1 * B[0, 1] * B[0, 1] + w2 * B[1, 1] * B[1, 1]
    mm = m * m * (Muu + Mvv) - two * m * Muv
    S01 = -m * m * (Muu + Mvv) + two * m * Muv
    S02 = Muu * m * b + Muv * g - Mvv * m * g
    S12 = -Muu * m * b + Muv * b + Mvv * m * g
    return wp.matrix_from_rows(wp.vector(Muu + mm, S01, S02), wp.vector(S01, Mvv + mm, S12),
                               wp.vector(S02, S12, Muu * b * b + Mvv * g * g))


@wp.func
def membrane_slender(B: Any):
    """(p, q): p / q = longest edge / its height at rest, from B = Dm^-1, whose rows are 1 / height long, det B = 1 / (2 area).

    It bounds the linearised step of C that sweeps stand. Of a shear s, [F_u F_v] = [[1, 0], [s, 1]], U_vv is
    (1 + s^2/4)^(-1/2): undoing a part z s of it changes U_vv by z s^2/4 in the gradient, (z - z^2/2) s^2/4 in truth. The
    solve then shortens the edge along v by the rest, (z s)^2/8, and where the neighbours across its height do not follow,
    they are sheared anew by p/q (z s)^2/8: more than z s, and growing, from z s = 8 q/p on. A quarter of that leaves a
    quarter; half a square (p/q = 2), which stands any step, goes free: 2 / (p/q - 2). Stretch is linear in C: a bound on it
    would bound the force that needles carry, and a seam with more weight below it than that opens without end.
    """
    uu = B[0, 0] * B[0, 0] + B[0, 1] * B[0, 1]
    vv = B[1, 0] * B[1, 0] + B[1, 1] * B[1, 1]
    uv = B[0, 0] * B[1, 0] + B[0, 1] * B[1, 1]
    return wp.vector(wp.max(wp.max(uu, vv), uu + vv + (uv + uv)), wp.abs(B[0, 0] * B[1, 1] - B[0, 1] * B[1, 0]))


@wp.func
def membrane_shear(B: Any, dC: Any):
    """Shear of a change dC of C between the longest edge and its height, the axes that `membrane_slender` compares: with n the
    unit vector along the height, m across it, 2 m.dU n. n goes with the longest gradient of a barycentric coordinate."""
    a = B[0, 0]
    b = B[0, 1]
    if B[1, 0] * B[1, 0] + B[1, 1] * B[1, 1] > a * a + b * b:
        a = B[1, 0]
        b = B[1, 1]
    c = B[0, 0] + B[1, 0]
    d = B[0, 1] + B[1, 1]
    if c * c + d * d > a * a + b * b:
        a = c
        b = d
    two = type(a)(2.0)
    return (two * a * b * (dC[1] - dC[0]) + (a * a - b * b) * dC[2]) * inverse_or_zero(a * a + b * b)


@dataclass(frozen=True)
class Constraint:
    """Formula (X, rest) -> C, G of a kind, and what the kernels made of it need to know; its name is in theirs."""

    name: str
    formula: wp.Function
    points: int
    rows: int                  # values of C
    unit: str                  # of C
    compliance: str            # unit of alpha
    unilateral: bool = False   # hard, and only C > 0 is corrected: rest is the largest value allowed
    anchored: bool = False     # the first point is not moved, so that points which share it need no colours


DISTANCE = Constraint("distance", distance_constraint, 2, 1, "m", "m/N")
LIMIT = Constraint("limit", distance_constraint, 2, 1, "m", "0", unilateral=True)
TETHER = Constraint("tether", distance_constraint, 2, 1, "m", "0", unilateral=True, anchored=True)
DIHEDRAL = Constraint("dihedral", dihedral_constraint, 4, 1, "rad", "rad/(N m)")
MEMBRANE = Constraint("membrane", membrane_constraint, 3, 3, "1", "1/J")
