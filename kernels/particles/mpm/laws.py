"""Material laws of the material point method: energy, Kirchhoff stress and return mapping, by the strain B = F F^T - 1.

    x_respond(B, q, m)   -> (B, q, tau, a): the strain and the inner variable after plastic flow, the Kirchhoff stress [Pa], and
                            the stiffness of the fastest wave, density at rest times c^2 [Pa]
    x_energy(B, q, m)    energy per volume at rest [J/m^3]

B is symmetric, q is one number that a law remembers, m has eight numbers: mu, lambda [Pa], five of the law, the viscosity
[Pa s]. s_i are the principal stretches, so that the eigenvalues of B are s_i^2 - 1; e_i = log s_i, J = s_1 s_2 s_3, and
tau_i = s_i dPsi/ds_i. Each formula is written so that small strains keep their digits.

    neo_hookean   Psi = mu/2 (tr B - 2 log J) + lambda/2 (log J)^2; Bonet, Wood 2008, eq. 6.27
    corotational  Psi = mu sum (s_i - 1)^2 + lambda/2 (J - 1)^2; Stomakhin et al. 2012, fixed corotated
    snow          that one, with s_i held in [1 - m2, 1 + m3], and mu, lambda times exp(m4 (1 - Jp)), Jp = 1 + q the plastic
                  change of volume; Stomakhin et al. 2013
    sand          Psi = mu sum e_i^2 + lambda/2 (sum e_i)^2; |dev tau| <= m2 p + m3, p = -tr tau / 3; Klar et al. 2016. q is
                  the opening that loose grains must lose before they are pressed again, after Tampubolon et al. 2017
    water         p = lambda / m2 (J^-m2 - 1), and at least 0 where m3 is 0; q = J - 1; Tait's form, Monaghan 1994
"""

# ruff: noqa: UP018

from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_three, identity_like
from wsim.kernels.particles.mpm.material.series import exp_less_one, exp_matrix, log_matrix, log_one_plus, small_strain

HARDENING = wp.constant(4.0)       # snow: largest exponent; 55 times as stiff
OPENED = wp.constant(1.0)          # sand, water: largest opening, beyond it what has flown apart does not count
PRESSED = wp.constant(-0.99)       # least s_i^2 - 1 of elastic laws, a tenth of the length; below it strain is not remembered:
#                                    rounding would make B singular, and what is squeezed flat could not open again


@wp.func
def volume_strain(d: Any):
    """(1 + d_1) (1 + d_2) (1 + d_3) - 1."""
    return d[0] + d[1] + d[2] + d[0] * d[1] + d[1] * d[2] + d[2] * d[0] + d[0] * d[1] * d[2]


@wp.func
def determinant_strain(B: Any):
    """det(1 + B) - 1 of a symmetric B."""
    minors = (B[0, 0] * B[1, 1] - B[0, 1] * B[0, 1] + B[1, 1] * B[2, 2] - B[1, 2] * B[1, 2]
              + B[2, 2] * B[0, 0] - B[2, 0] * B[2, 0])
    return wp.trace(B) + minors + wp.determinant(B)


@wp.func
def stretch_strain(d: Any):
    """s_i - 1 of the eigenvalues d_i = s_i^2 - 1 of B."""
    one = type(d[0])(1.0)
    r = d
    for i in range(3):
        r[i] = d[i] / (one + wp.sqrt(wp.max(one + d[i], one - one)))
    return r


@wp.func
def from_principal(V: Any, d: Any):
    """V diag(d) V^T."""
    return V * wp.diag(d) * wp.transpose(V)


@wp.func
def hold_pressed(B: Any):
    """B with principal values above PRESSED, where it is pressed to a tenth of its volume: all of them are raised by the least
    s_i^2 there may be, without a search for axes that all jelly would pay for."""
    least = type(B[0, 0])(PRESSED)
    held = B
    if not determinant_strain(B) > least:
        held = B + (type(least)(1.0) + least) * identity_like(B)
    return held


@wp.func
def neo_hookean_respond(B_in: Any, q: Any, m: Any):
    two = type(q)(2.0)
    B = hold_pressed(B_in)
    log_J = log_one_plus(determinant_strain(B)) / two
    tau = m[0] * B + (m[1] * log_J) * identity_like(B)
    a = m[0] * (two + wp.sqrt(wp.ddot(B, B))) + m[1] * (type(q)(1.0) + wp.abs(log_J))
    return B, q, tau, a


@wp.func
def neo_hookean_energy(B: Any, q: Any, m: Any):
    half = type(q)(0.5)
    log_J = half * log_one_plus(determinant_strain(B))
    return half * m[0] * (wp.trace(B) - log_J / half) + half * m[1] * log_J * log_J


@wp.func
def corotational_tau(r: Any, mu: Any, lam: Any):
    """Principal Kirchhoff stresses [Pa] of s_i - 1."""
    one = type(mu)(1.0)
    change = volume_strain(r)
    tau = r
    for i in range(3):
        tau[i] = (mu + mu) * r[i] * (one + r[i]) + lam * change * (one + change)
    return tau


@wp.func
def corotational_wave(r: Any, mu: Any, lam: Any):
    one = type(mu)(1.0)
    s = one + wp.max(wp.max(r[0], r[1]), wp.max(r[2], one - one))
    J = one + wp.max(volume_strain(r), one - one)
    return (mu + mu) * s * s + lam * J * J


@wp.func
def corotational_respond(B_in: Any, q: Any, m: Any):
    B = hold_pressed(B_in)
    d, V = eigen_three(B)
    r = stretch_strain(d)
    return B, q, from_principal(V, corotational_tau(r, m[0], m[1])), corotational_wave(r, m[0], m[1])


@wp.func
def corotational_energy(B: Any, q: Any, m: Any):
    d, V = eigen_three(B)
    r = stretch_strain(d)
    change = volume_strain(r)
    return m[0] * wp.dot(r, r) + type(q)(0.5) * m[1] * change * change


@wp.func
def snow_hardening(q: Any, m: Any):
    most = type(q)(HARDENING)
    return wp.exp(wp.clamp(-m[4] * q, -most, most))


@wp.func
def snow_respond(B: Any, q: Any, m: Any):
    one = type(q)(1.0)
    d, V = eigen_three(B)
    r = stretch_strain(d)
    before = volume_strain(r)
    held = r
    for i in range(3):
        held[i] = wp.clamp(r[i], -m[2], m[3])
        d[i] = held[i] * (one + one + held[i])
    after = volume_strain(held)
    plastic = q + (one + q) * (before - after) / (one + after)
    hard = snow_hardening(plastic, m)
    tau = corotational_tau(held, hard * m[0], hard * m[1])
    B_out = B
    if before != after:
        B_out = from_principal(V, d)
    return B_out, plastic, from_principal(V, tau), corotational_wave(held, hard * m[0], hard * m[1])


@wp.func
def snow_energy(B: Any, q: Any, m: Any):
    return snow_hardening(q, m) * corotational_energy(B, q, m)


@wp.func
def sand_flow(sum: Any, size: Any, q: Any, m: Any):
    """(centre, part, opening, whether it flows): of a sum and a size of the deviator of e, e = centre + part dev is left."""
    zero, third = type(q)(0.0), type(q)(1.0) / type(q)(3.0)
    bulk = type(q)(3.0) * m[1] + m[0] + m[0]                   # tr tau / tr e
    apex = zero                                                # tr e at which cohesion ends
    if m[2] > zero:
        apex = type(q)(3.0) * m[3] / (m[2] * bulk)
    volume = sum + q
    opened = zero
    part = type(q)(1.0)
    flows = q != zero
    if volume >= apex:
        opened = wp.min(volume - apex, type(q)(OPENED))
        volume = apex
        part = zero
        flows = True
    else:
        most = (m[3] - m[2] * third * bulk * volume) / (m[0] + m[0])
        if size > most:
            part = wp.max(most, zero) / size
            flows = True
    return third * volume, part, opened, flows


@wp.func
def sand_respond(B: Any, q: Any, m: Any):
    third, one = type(q)(1.0) / type(q)(3.0), identity_like(B)
    B_out = B
    tau = B
    opened = q
    if wp.sqrt(wp.ddot(B, B)) < small_strain(q):               # nearly always
        E = type(q)(0.5) * log_matrix(B)
        sum = wp.trace(E)
        dev = E - (third * sum) * one
        centre, part, opened, flows = sand_flow(sum, wp.sqrt(wp.ddot(dev, dev)), q, m)
        E = part * dev + centre * one
        tau = (m[0] + m[0]) * E + (type(q)(3.0) * m[1] * centre) * one
        if flows:
            B_out = exp_matrix(E + E)
    else:
        d, V = eigen_three(B)
        e = d
        pressed = bool(False)
        for i in range(3):
            pressed = pressed or not d[i] > type(q)(PRESSED)
            e[i] = type(q)(0.5) * log_one_plus(wp.max(d[i], type(q)(PRESSED)))
        sum = e[0] + e[1] + e[2]
        for i in range(3):
            e[i] -= third * sum
        centre, part, opened, flows = sand_flow(sum, wp.length(e), q, m)
        for i in range(3):
            e[i] = centre + part * e[i]
            d[i] = exp_less_one(e[i] + e[i])
            e[i] = (m[0] + m[0]) * e[i] + type(q)(3.0) * m[1] * centre
        tau = from_principal(V, e)
        if flows or pressed:
            B_out = from_principal(V, d)
    return B_out, opened, tau, m[0] + m[0] + m[1] + wp.sqrt(wp.ddot(tau, tau))


@wp.func
def sand_energy(B: Any, q: Any, m: Any):
    d, V = eigen_three(B)
    e = d
    for i in range(3):
        e[i] = type(q)(0.5) * log_one_plus(d[i])
    volume = e[0] + e[1] + e[2]
    return m[0] * wp.dot(e, e) + type(q)(0.5) * m[1] * volume * volume


@wp.func
def water_respond(B: Any, q: Any, m: Any):
    """B is the change since the last response; the shape is forgotten."""
    zero = type(q)(0.0)
    one = type(q)(1.0)
    root = wp.sqrt(wp.max(one + determinant_strain(B), zero))
    change = (determinant_strain(B)) / (one + root)
    J = wp.max(q + (one + q) * change, type(q)(-0.9))
    p = m[1] / m[2] * exp_less_one(-m[2] * log_one_plus(J))
    if m[3] == zero:
        p = wp.max(p, zero)
        J = wp.min(J, type(q)(OPENED))
    return zero * B, J, (-(one + J) * p) * identity_like(B), m[1] * wp.exp((one - m[2]) * log_one_plus(J))


@wp.func
def water_energy(B: Any, q: Any, m: Any):
    """Integral of -p dJ from 1."""
    one = type(q)(1.0)
    rise = m[2] - one
    held = q
    if m[3] == one - one:
        held = wp.min(q, one - one)
    return m[1] / m[2] * (exp_less_one(-rise * log_one_plus(held)) / rise + held)
