"""Small dense systems."""

from typing import Any

import warp as wp


@wp.func
def pivot_reciprocal(s: Any, before: Any, tiny: Any):
    """1 / s, or 0 where elimination has left only rounding of what stood there `before`."""
    r = type(s)(0.0)
    if s > tiny * before:
        r = type(s)(1.0) / s
    return r


@wp.func
def solve_block(S: Any, r: Any, tiny: Any):
    """y with S y = r, S symmetric, definite or not quite (L D L^T). A row that depends on earlier ones gets y = 0."""
    q0 = pivot_reciprocal(S[0, 0], S[0, 0], tiny)
    l10 = S[1, 0] * q0
    l20 = S[2, 0] * q0
    q1 = pivot_reciprocal(S[1, 1] - l10 * S[1, 0], S[1, 1], tiny)
    s21 = S[2, 1] - l20 * S[1, 0]
    l21 = s21 * q1
    q2 = pivot_reciprocal(S[2, 2] - l20 * S[2, 0] - l21 * s21, S[2, 2], tiny)
    z1 = r[1] - l10 * r[0]
    z2 = r[2] - l20 * r[0] - l21 * z1
    y2 = z2 * q2
    y1 = z1 * q1 - l21 * y2
    y0 = r[0] * q0 - l10 * y1 - l20 * y2
    return wp.vector(y0, y1, y2)
