"""Adjoint of the law of sand (`wsim.kernels.particles.mpm.laws.sand_respond`), as the others in laws.py.

    e_i = log(1 + d_i) / 2,   volume = sum e + q,   dev = e - mean e,   e' = centre + part dev
    e_i - e_j = log(1 + (d_i - d_j) / (1 + d_j)) / 2,   exp(2 e'_i) - exp(2 e'_j) = exp(2 e'_j) (exp(part 2 (e_i - e_j)) - 1)

so that quotients by d_i - d_j keep their digits where stretches are equal.
"""

# ruff: noqa: UP018

from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_three
from wsim.kernels.particles.mpm.adjoint.laws import clamp_quotient, from_back
from wsim.kernels.particles.mpm.laws import OPENED, PRESSED, exp_less_one, log_one_plus


@wp.func
def part_of_one(x: Any, y: Any):
    """y / x of a y that is x but for x^2: 1 where x is 0."""
    found = type(x)(1.0)
    if x != type(x)(0.0):
        found = y / x
    return found


@wp.func
def sand_cone(volume: Any, size: Any, m: Any):
    """(part of the deviator that is left, centre, apex, largest deviator, 0: pressed, 1: flows, 2: open) of sand at a volume
    strain and a deviator of that size, see `sand_respond`."""
    zero = type(volume)(0.0)
    third = type(volume)(1.0) / type(volume)(3.0)
    bulk = type(volume)(3.0) * m[1] + m[0] + m[0]
    most = (m[3] - m[2] * third * bulk * volume) / (m[0] + m[0])
    apex = zero
    if m[2] > zero:
        apex = type(volume)(3.0) * m[3] / (m[2] * bulk)
    part = type(volume)(1.0)
    centre = third * volume
    way = int(0)
    if volume >= apex:
        part = zero
        centre = third * apex
        way = 2
    elif size > most:
        part = wp.max(most, zero) / size
        way = 1
    return part, centre, apex, most, way


@wp.func
def sand_open_back(volume: Any, apex: Any, by_sum: Any, by_q: Any, m: Any):
    """Cotangents of the volume strain and of the numbers, of sand that opens; by_sum: that of the sum of strains."""
    zero = type(volume)(0.0)
    bulk = type(volume)(3.0) * m[1] + m[0] + m[0]
    by_apex = by_sum / type(volume)(3.0)
    by_volume = zero
    if volume - apex < type(volume)(OPENED):
        by_volume = by_q
        by_apex -= by_q
    by_m = zero * m
    if m[2] > zero:
        by_m[3] = by_apex * type(volume)(3.0) / (m[2] * bulk)
        by_m[2] = -by_apex * apex / m[2]
        by_m[0] = type(volume)(-2.0) * by_apex * apex / bulk
        by_m[1] = type(volume)(-3.0) * by_apex * apex / bulk
    return by_volume, by_m


@wp.func
def sand_flow_back(volume: Any, most: Any, by_most: Any, m: Any):
    """Cotangents of the volume strain and of the numbers, of the largest deviator."""
    third = type(volume)(1.0) / type(volume)(3.0)
    double = m[0] + m[0]
    by_m = type(volume)(0.0) * m
    if most > type(volume)(0.0):
        slope = by_most / double
        by_m[3] = slope
        by_m[2] = -slope * third * (type(volume)(3.0) * m[1] + double) * volume
        by_m[0] = type(volume)(-2.0) * slope * (most + m[2] * third * volume)
        by_m[1] = -slope * m[2] * volume
        return -slope * m[2] * third * (type(volume)(3.0) * m[1] + double), by_m
    return type(volume)(0.0), by_m


@wp.func
def sand_quotients(given: Any, d: Any, e: Any, part: Any, H: Any, K: Any, mu: Any):
    """Y beside the diagonal, (yz, zx, xy). given: before, d: held above PRESSED, e: after the flow."""
    one = type(part)(1.0)
    two = one + one
    p = d
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        z = (d[j] - d[k]) / (one + d[k])
        log_z = log_one_plus(z)
        w = part * log_z
        slope = part * part_of_one(z, log_z) / (one + d[k])
        slope *= clamp_quotient(given[j], given[k], type(part)(PRESSED), type(part)(1.0e30))
        p[i] = slope * (wp.exp(two * e[k]) * part_of_one(w, exp_less_one(w)) * H[j, k] + mu * K[j, k])
    return p


@wp.func
def sand_back(B: Any, q: Any, m: Any, by_B: Any, by_q: Any, by_tau: Any):
    two = type(q)(2.0)
    third = type(q)(1.0) / type(q)(3.0)
    given, V = eigen_three(B)
    d = given
    e = d
    for i in range(3):
        d[i] = wp.max(given[i], type(q)(PRESSED))
        e[i] = type(q)(0.5) * log_one_plus(d[i])
    volume = e[0] + e[1] + e[2] + q
    mean = third * (volume - q)
    dev = e
    for i in range(3):
        dev[i] = e[i] - mean
    size = wp.length(dev)
    part, centre, apex, most, way = sand_cone(volume, size, m)
    for i in range(3):
        e[i] = centre + part * dev[i]
    H = wp.transpose(V) * by_B * V
    K = wp.transpose(V) * by_tau * V
    by_t = wp.get_diag(K)
    trace = by_t[0] + by_t[1] + by_t[2]
    by_e = e
    for i in range(3):
        by_e[i] = two * wp.exp(two * e[i]) * H[i, i] + two * m[0] * by_t[i] + m[1] * trace
    by_sum = by_e[0] + by_e[1] + by_e[2]
    by_volume = third * by_sum
    by_m = type(q)(0.0) * m
    by_dev = part * by_e
    if way == 2:
        by_volume, by_m = sand_open_back(volume, apex, by_sum, by_q, m)
    elif way == 1:
        by_part = wp.dot(by_e, dev)
        by_dev -= (by_part * part / (size * size)) * dev
        more, by_m = sand_flow_back(volume, most, by_part / size, m)
        by_volume += more
    by_m[0] = by_m[0] + two * wp.dot(e, by_t)
    by_m[1] = by_m[1] + (e[0] + e[1] + e[2]) * trace
    by_mean = third * (by_dev[0] + by_dev[1] + by_dev[2])
    by_d = d
    for i in range(3):
        by_d[i] = (by_volume + by_dev[i] - by_mean) / (two * (type(q)(1.0) + d[i]))
        if given[i] < type(q)(PRESSED):
            by_d[i] = type(q)(0.0)
    return from_back(V, by_d, sand_quotients(given, d, e, part, H, K, m[0])), by_volume, by_m
