"""Constraints: value C and gradient G of each. The table at the end names them.

Displacement form: a constraint sees its points relative to its first, X_k = (x_k - x_0) + (d_k - d_0) [m], k >= 1, so
that small displacements d far from the origin lose nothing. A formula returns C and G_k = dC/dX_k for k >= 1; since C
does not change under translation, G_0 = -(sum of the others): momentum is kept exactly.

A constraint with compliance alpha [unit of C per unit of its multiplier] stores the energy C^2 / (2 alpha)
(Macklin, Mueller, Chentanez 2016, eq. 2). No formula divides by zero: where its direction is not defined, G = 0.
"""

import math
from dataclasses import dataclass
from typing import Any

import warp as wp


@wp.func
def inverse(s: Any):
    """1 / s for s > 0, else 0."""
    r = type(s)(0.0)
    if s > type(s)(0.0):
        r = type(s)(1.0) / s
    return r


@wp.func
def distance(X1: Any, l0: Any):
    """C = |x1 - x0| - l0 [m]. Coincident points: G = 0."""
    L = wp.length(X1)
    return L - l0, inverse(L) * X1


@wp.func
def limit(X1: Any, longest: Any):
    """C = |x1 - x0| - longest [m], to be kept at or under 0; longest = (1 + limit) l0."""
    L = wp.length(X1)
    return L - longest, inverse(L) * X1


@wp.func
def wrap(angle: Any):
    """The angle [rad] in (-2 pi, 2 pi) brought to [-pi, pi]."""
    pi = type(angle)(wp.static(math.pi))
    turn = type(angle)(wp.static(2.0 * math.pi))
    r = angle
    if angle > pi:
        r = angle - turn
    if angle < -pi:
        r = angle + turn
    return r


@wp.func
def dihedral(X1: Any, X2: Any, X3: Any, theta0: Any):
    """C = theta - theta0 [rad] at the hinge x0-x1 between the triangles (x0, x1, x2) and (x1, x0, x3).

    theta = 0 when flat, positive when both normals lean away from each other (the side that they point to is convex).
    With E = X1, N2 = E x X2, N3 = X3 x E (twice the areas), t_k = X_k.E / |E|^2 the foot of a height:

        theta = atan2(|E| X3.N2 s, N2.N3),   G_k = |E| / |N_k|^2 N_k,   G_1 = -(t_2 G_2 + t_3 G_3)

    (Tamstorf, Grinspun 2013, sections 2 and 3; N2 x N3 = -(X3.N2) E.) Needs no normalisation, so holds at every scale.
    A triangle without area has no angle: C = 0, G = 0.
    """
    N2 = wp.cross(X1, X2)
    N3 = wp.cross(X3, X1)
    q2 = wp.dot(N2, N2)
    q3 = wp.dot(N3, N3)
    C = theta0 - theta0
    G1 = X1 - X1
    G2 = X1 - X1
    G3 = X1 - X1
    if wp.min(q2, q3) > type(theta0)(0.0):
        LL = wp.dot(X1, X1)
        L = wp.sqrt(LL)
        C = wrap(wp.atan2(-L * wp.dot(X3, N2), wp.dot(N2, N3)) - theta0)
        G2 = -(L / q2) * N2
        G3 = -(L / q3) * N3
        G1 = -(wp.dot(X1, X2) / LL) * G2 - (wp.dot(X1, X3) / LL) * G3
    return C, G1, G2, G3


@dataclass(frozen=True)
class Constraint:
    """A row of the table: what a projection kernel and a test need to know."""

    formula: wp.Function
    points: int
    rows: int                  # values of C
    unit: str                  # of C
    compliance: str            # unit of alpha
    unilateral: bool = False   # only C > 0 is corrected


TABLE = {
    "dihedral": Constraint(dihedral, 4, 1, "rad", "rad/(N m)"),
    "distance": Constraint(distance, 2, 1, "m", "m/N"),
    "limit": Constraint(limit, 2, 1, "m", "0: hard", unilateral=True),
}
