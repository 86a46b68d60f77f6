"""Logarithms and exponentials near 1 and 0, of numbers and of small symmetric matrices, right to some units of rounding.

    log(1 + B) = B - B^2/2 + B^3/3 - B^4/4 + B^5/5 - B^6/6,   exp(X) - 1 = X + X^2/2 + X^3/6 + X^4/24 + X^5/120 + X^6/720

in three products (Paterson, Stockmeyer 1973). No axes are looked for: sand takes a half of the time that these cost.
"""

# ruff: noqa: UP018

from typing import Any

import warp as wp

from wsim.kernels.math.eigen import machine_epsilon


@wp.func
def log_one_plus(x: Any):
    """log(1 + x), right to some units of rounding for small x (Goldberg 1991, theorem 4)."""
    one = type(x)(1.0)
    u = one + x
    found = x
    if u != one:
        found = wp.log(u) * x / (u - one)
    return found


@wp.func
def exp_less_one(x: Any):
    """exp(x) - 1, right to some units of rounding for small x (Higham 2002, section 1.14.1)."""
    one = type(x)(1.0)
    u = wp.exp(x)
    found = x
    if u < type(x)(1.0e-30):
        found = -one
    elif u != one:
        found = (u - one) * x / wp.log(u)
    return found


@wp.func
def small_strain(one: Any):
    """Largest |B| for which the six terms of log(1 + B) are right to a rounding: |B|^6 / 7; 0.1 in single precision."""
    return wp.pow(type(one)(7.0) * machine_epsilon(one), type(one)(1.0 / 6.0))


@wp.func
def log_matrix(B: Any):
    """log(1 + B) of a small symmetric B."""
    one = type(B[0, 0])(1.0)
    B2 = B * B
    B3 = B2 * B
    far = type(one)(0.2) * B2 - type(one)(0.25) * B - type(one)(1.0 / 6.0) * B3
    return B - type(one)(0.5) * B2 + type(one)(1.0 / 3.0) * B3 + B3 * far


@wp.func
def exp_matrix(X: Any):
    """exp(X) - 1 of a small symmetric X."""
    one = type(X[0, 0])(1.0)
    X2 = X * X
    X3 = X2 * X
    far = type(one)(1.0 / 24.0) * X + type(one)(1.0 / 120.0) * X2 + type(one)(1.0 / 720.0) * X3
    return X + type(one)(0.5) * X2 + type(one)(1.0 / 6.0) * X3 + X3 * far
