"""Cubic pieces of a curve over the fraction s in 0 .. 1 of the way between two keys. Operators alone, so that one source is the
host's formula (NumPy arrays) and, as a `wp.func`, the device's.

    value = a + s (b + s (c + s d))        rate = b + s (2 c + 3 s d)  per unit of s

Of values p, q and slopes m, n per unit of s at both ends (Hermite):

    a = p,  b = m,  c = 3 (q - p) - 2 m - n,  d = m + n - 2 (q - p)

Exact: value(0) = p, rate(0) = m; value(1) = q to rounding. No float literals: any precision.
"""

from typing import Any


def cubic_piece_value(a: Any, b: Any, c: Any, d: Any, s: Any):
    """a + b s + c s^2 + d s^3, by Horner's rule."""
    return a + s * (b + s * (c + s * d))


def cubic_piece_rate(b: Any, c: Any, d: Any, s: Any):
    """Derivative of `cubic_piece_value` with respect to s."""
    return b + s * (c + c + s * (d + d + d))


def hermite_coefficients(p: Any, q: Any, m: Any, n: Any):
    """Coefficients (a, b, c, d) of the piece from p with slope m to q with slope n, slopes per unit of s."""
    way = q - p
    return p, m, way + way + way - m - m - n, m + n - way - way
