"""Adjoints of the laws of the material point method (`wsim.kernels.particles.mpm.laws`): from cotangents of what a law returns
to those of what it takes.

    x_back(B, q, m, by_B, by_q, by_tau) -> (cotangent of B, of q, of m)

Cotangents of B and tau are symmetric. An isotropic law is a function of principal values: B = V diag(d) V^T becomes
V diag(beta) V^T, tau = V diag(t) V^T, and

    by_d_i = sum_j H_jj dbeta_j/dd_i + K_jj dt_j/dd_i,        H = V^T by_B V,  K = V^T by_tau V
    Y_ii = by_d_i,   Y_ij = H_ij (beta_i - beta_j) / (d_i - d_j) + K_ij (t_i - t_j) / (d_i - d_j),   cotangent of B = V Y V^T

(Ogden 1984, section 6.1.4; Xu et al. 2015, section 4). Quotients are written out for each law, so that two equal stretches
divide nothing by zero: s_i - s_j = (d_i - d_j) / (s_i + s_j). At a kink (where flow begins) they are those of the side that
the step took. Sand stands in sand.py.
"""

# ruff: noqa: UP018

from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_three, identity_like
from wsim.kernels.particles.mpm.laws import (
    HARDENING,
    OPENED,
    determinant_strain,
    exp_less_one,
    hold_pressed,
    log_one_plus,
    snow_hardening,
    stretch_strain,
    volume_strain,
)


@wp.func
def strain_inverse(B: Any):
    """(1 + B)^-1 of a symmetric B."""
    return wp.inverse(identity_like(B) + B)


@wp.func
def neo_hookean_back(B_in: Any, q: Any, m: Any, by_B: Any, by_q: Any, by_tau: Any):
    half = type(q)(0.5)
    B = hold_pressed(B_in)
    log_J = half * log_one_plus(determinant_strain(B))
    trace = wp.trace(by_tau)
    by_m = type(q)(0.0) * m
    by_m[0] = wp.ddot(by_tau, B)
    by_m[1] = log_J * trace
    return by_B + m[0] * by_tau + (half * m[1] * trace) * strain_inverse(B), by_q, by_m


@wp.func
def other_stretches(r: Any):
    """J / s_i of s_i - 1: the derivative of J with respect to s_i."""
    one = type(r[0])(1.0)
    s = r
    for i in range(3):
        s[i] = one + r[i]
    return type(r)(s[1] * s[2], s[2] * s[0], s[0] * s[1])


@wp.func
def corotational_slope(r: Any, mu: Any, lam: Any, by_t: Any):
    """Cotangent of s_i - 1 from that of the principal Kirchhoff stresses."""
    one = type(mu)(1.0)
    change = volume_strain(r)
    trace = by_t[0] + by_t[1] + by_t[2]
    by_r = (lam * (one + change + change) * trace) * other_stretches(r)
    for i in range(3):
        by_r[i] = by_r[i] + (mu + mu) * (one + r[i] + r[i]) * by_t[i]
    return by_r


@wp.func
def with_quotients(by_d: Any, p: Any):
    """The symmetric matrix of by_d and, beside the diagonal, of p: (yz, zx, xy)."""
    return wp.matrix_from_rows(type(by_d)(by_d[0], p[2], p[1]), type(by_d)(p[2], by_d[1], p[0]),
                               type(by_d)(p[1], p[0], by_d[2]))


@wp.func
def corotational_back(B_in: Any, q: Any, m: Any, by_B: Any, by_q: Any, by_tau: Any):
    one = type(q)(1.0)
    d, V = eigen_three(hold_pressed(B_in))
    r = stretch_strain(d)
    K = wp.transpose(V) * by_tau * V
    by_t = wp.get_diag(K)
    by_d = corotational_slope(r, m[0], m[1], by_t)
    p = r
    for i in range(3):
        by_d[i] = by_d[i] / (one + one + r[i] + r[i])
        j = (i + 1) % 3
        k = (i + 2) % 3
        p[i] = K[j, k] * (m[0] + m[0]) * (one + r[j] + r[k]) / (one + one + r[j] + r[k])
    change = volume_strain(r)
    by_m = type(q)(0.0) * m
    for i in range(3):
        by_m[0] = by_m[0] + (one + one) * r[i] * (one + r[i]) * by_t[i]
    by_m[1] = change * (one + change) * (by_t[0] + by_t[1] + by_t[2])
    return by_B + from_back(V, by_d, p), by_q, by_m


@wp.func
def clamp_quotient(a: Any, b: Any, low: Any, high: Any):
    """(clamp(a) - clamp(b)) / (a - b)."""
    one = type(a)(1.0)
    found = one - one
    if a != b:
        found = (wp.clamp(a, low, high) - wp.clamp(b, low, high)) / (a - b)
    elif a > low and a < high:
        found = one
    return found


@wp.func
def snow_back(B: Any, q: Any, m: Any, by_B: Any, by_q: Any, by_tau: Any):
    zero = type(q)(0.0)
    one = type(q)(1.0)
    two = type(q)(2.0)
    d, V = eigen_three(B)
    r = stretch_strain(d)
    held = r
    for i in range(3):
        held[i] = wp.clamp(r[i], -m[2], m[3])
    after = volume_strain(held)
    plastic = q + (one + q) * (volume_strain(r) - after) / (one + after)
    hard = snow_hardening(plastic, m)
    H = wp.transpose(V) * by_B * V
    K = wp.transpose(V) * by_tau * V
    by_t = wp.get_diag(K)
    trace = by_t[0] + by_t[1] + by_t[2]
    by_m = zero * m
    shear = zero
    for i in range(3):
        shear += two * held[i] * (one + held[i]) * by_t[i]
    by_m[0] = hard * shear
    by_m[1] = hard * after * (one + after) * trace
    by_log = m[0] * by_m[0] + m[1] * by_m[1]                   # of the logarithm of `hard`
    by_plastic = by_q
    if wp.abs(m[4] * plastic) < type(q)(HARDENING):
        by_plastic = by_q - m[4] * by_log
        by_m[4] = -plastic * by_log
    by_held = corotational_slope(held, hard * m[0], hard * m[1], by_t)
    by_d = r
    p = r
    for i in range(3):
        by = by_held[i] + two * (one + held[i]) * H[i, i] - by_plastic * (one + plastic) / (one + held[i])
        by_r = by_plastic * (one + plastic) / (one + r[i])
        if r[i] < -m[2]:
            by_m[2] = by_m[2] - by
        elif r[i] > m[3]:
            by_m[3] = by_m[3] + by
        else:
            by_r += by
        by_d[i] = by_r / (two + r[i] + r[i])
        j = (i + 1) % 3
        k = (i + 2) % 3
        part = clamp_quotient(r[j], r[k], -m[2], m[3]) / (two + r[j] + r[k])
        p[i] = part * (H[j, k] * (two + held[j] + held[k]) + K[j, k] * two * hard * m[0] * (one + held[j] + held[k]))
    return from_back(V, by_d, p), by_plastic * (one + volume_strain(r)) / (one + after), by_m


@wp.func
def from_back(V: Any, by_d: Any, p: Any):
    """V Y V^T."""
    return V * with_quotients(by_d, p) * wp.transpose(V)


@wp.func
def water_back(B: Any, q: Any, m: Any, by_B: Any, by_q: Any, by_tau: Any):
    zero = type(q)(0.0)
    one = type(q)(1.0)
    root = wp.sqrt(wp.max(one + determinant_strain(B), zero))
    J = q + (one + q) * (determinant_strain(B) / (one + root))
    by_m = zero * m
    by_J = by_q
    if m[3] == zero and J > type(q)(OPENED):
        by_J = zero
    free = J > type(q)(-0.9)
    J = wp.max(J, type(q)(-0.9))
    log_J = log_one_plus(J)
    p = m[1] / m[2] * exp_less_one(-m[2] * log_J)
    if m[3] != zero or p > zero:
        by_p = -(one + J) * wp.trace(by_tau)
        power = wp.exp(-m[2] * log_J)
        by_J -= p * wp.trace(by_tau) + by_p * m[1] * power / (one + J)
        by_m[1] = by_p * p / m[1]
        by_m[2] = -by_p * (p + m[1] * log_J * power) / m[2]
    if not free:
        by_J = zero
    return (by_J * (one + q) * type(q)(0.5) * root) * strain_inverse(B), by_J * root, by_m
