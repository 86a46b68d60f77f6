"""Quadratic B-splines of a cell about a node, and the moments of them that transfers use (Steffen, Kirby, Berzins 2008).

    N(r) = 3/4 - r^2 for |r| <= 1/2,  (3/2 - |r|)^2 / 2 up to 3/2;  r [cells] from node to particle

They sum to 1; their first moment about the particle is 0 and the second 1/4, so that D = dx^2 / 4 (Jiang et al. 2015).
"""

from typing import Any

import warp as wp


@wp.func
def spline_weight(r: Any):
    """N(r)."""
    a = wp.abs(r)
    half = type(r)(0.5)
    found = type(r)(0.75) - a * a
    if a > half:
        b = wp.max(type(r)(1.5) - a, half - half)
        found = half * b * b
    return found


@wp.func
def spline_rows(o: Any):
    """Row n: weights of the three nodes along each axis at n - 1, of a particle at the offset o [cells] from the middle one."""
    half = type(o[0])(0.5)
    a = type(o)(half - o[0], half - o[1], half - o[2])
    b = type(o)(half + o[0], half + o[1], half + o[2])
    quarters = type(o)(half + half * half, half + half * half, half + half * half)
    return wp.matrix_from_rows(half * wp.cw_mul(a, a), quarters - wp.cw_mul(o, o), half * wp.cw_mul(b, b))
