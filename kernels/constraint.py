"""Constraints: value C and gradient G of each. The table at the end names them.

Displacement form: a constraint sees its points relative to its first, X_k = (x_k - x_0) + (d_k - d_0) [m], k >= 1, so
that small displacements d far from the origin lose nothing. A formula returns C and G_k = dC/dX_k for k >= 1; since C
does not change under translation, G_0 = -(sum of the others): momentum is kept exactly.

A constraint with compliance alpha [unit of C per unit of its multiplier] stores the energy C^2 / (2 alpha)
(Macklin, Mueller, Chentanez 2016, eq. 2). No formula divides by zero: where its direction is not defined, G = 0.
"""

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
    "distance": Constraint(distance, 2, 1, "m", "m/N"),
    "limit": Constraint(limit, 2, 1, "m", "0: hard", unilateral=True),
}
