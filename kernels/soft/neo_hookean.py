"""Stable Neo-Hookean energy density, stress and stiffness (Smith, de Goes, Kim 2018, eq. 14; zero at rest):

    Psi = mu'/2 (I - 3 - log((I + 1)/4)) + lam'/2 (J - 1 - mu/lam')^2 - mu^2/(2 lam')      I = |F|^2, J = det F

F = 1 + H. Its second order in H is 3/4 mu' |e|^2 + (lam'/2 - 5/16 mu') tr(e)^2, e = sym(H): for the E and nu of small strain
mu' = 4/3 mu, lam' = lam + 5/6 mu, and the rest length is free of stress as 3/4 mu' = mu. Near rest these terms cancel, so it is
evaluated about rest, with c2 = tr cof H, c3 = det H:

    Psi = mu (|H|^2/2 - c2 - c3) + 2/3 mu (x - log(1 + x)) + lam'/2 j^2        x = (I - 3)/4, j = J - 1 = tr H + c2 + c3
    P   = mu (H + H^T - tr H - cof H) + mu/3 x/(1 + x) F + lam' j cof F

The logarithm keeps F = 0 from being a minimum: an element pressed to nearly a point opens again. Where |j| > 1e6 the last term
of Psi goes on linearly (same P at the seam): with moduli up to 1e11 Pa nothing leaves float32. H, q, V, A, B: principal.py.
"""

from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_three
from wsim.kernels.math.rotation import identity_like
from wsim.kernels.soft.principal import LARGEST, clamp_entries, corotated_strain, off_diagonal, positive_part


@wp.func
def cofactor_matrix(A: Any):
    """cof A = det(A) A^-T = d det(A) / dA; of any A."""
    return wp.matrix_from_rows(wp.cross(A[1], A[2]), wp.cross(A[2], A[0]), wp.cross(A[0], A[1]))


@wp.func
def cofactor_change(A: Any, dA: Any):
    """Directional derivative of cof A."""
    return wp.matrix_from_rows(wp.cross(dA[1], A[2]) + wp.cross(A[1], dA[2]), wp.cross(dA[2], A[0]) + wp.cross(A[2], dA[0]),
                               wp.cross(dA[0], A[1]) + wp.cross(A[0], dA[1]))


@wp.func
def less_log(x: Any):
    """x - log(1 + x) for x > -1. Near 0 by r = x / (2 + x), log(1 + x) = 2 artanh r: x r - 2 r^3 (1/3 + r^2/5 + ..)."""
    one = type(x)(1.0)
    value = x - wp.log(one + x)
    if wp.abs(x) < type(x)(0.25):                      # r^2 < 0.0205: ten terms leave 1e-17
        r = x / (one + one + x)
        rr = r * r
        sum = type(x)(wp.static(1.0 / 21.0))
        for k in range(9):
            sum = one / type(x)(19 - 2 * k) + rr * sum
        value = x * r - type(x)(2.0) * r * rr * sum
    return value


@wp.func
def neo_hookean_invariants(H: Any):
    """x, j, and w = |H|^2/2 - c2 - c3."""
    C = cofactor_matrix(H)
    t = wp.trace(H)
    c = wp.trace(C) + wp.dot(H[0], C[0])
    hh = type(t)(0.5) * wp.ddot(H, H)
    return type(t)(0.5) * (t + hh), t + c, hh - c


@wp.func
def neo_hookean_volume(j: Any, mu: Any, lam: Any):
    """lam' and j clamped to +-LARGEST."""
    most = type(j)(LARGEST)
    return lam + type(mu)(wp.static(5.0 / 6.0)) * mu, wp.clamp(j, -most, most)


@wp.func
def neo_hookean_energy(H: Any, q: Any, mu: Any, lam: Any):
    """Psi [J/m^3], 0 at rest; q is not read."""
    x, j, w = neo_hookean_invariants(clamp_entries(H))
    volume, k = neo_hookean_volume(j, mu, lam)
    half = type(mu)(0.5)
    return mu * w + type(mu)(wp.static(2.0 / 3.0)) * mu * less_log(x) + volume * k * (j - half * k)


@wp.func
def neo_hookean_stress(H: Any, q: Any, mu: Any, lam: Any):
    """P [Pa], see the top; q is not read."""
    G = clamp_entries(H)
    x, j, w = neo_hookean_invariants(G)
    volume, k = neo_hookean_volume(j, mu, lam)
    C = cofactor_matrix(G)
    t = wp.trace(G)
    one = identity_like(G)
    cof = C + (one + t * one - wp.transpose(G))        # cof F = 1 + tr H - H^T + cof H
    shear = mu * (x / (type(mu)(3.0) * (type(mu)(1.0) + x)))
    return mu * (G + wp.transpose(G) - t * one - C) + shear * (one + G) + (volume * k) * cof


@wp.func
def neo_hookean_factors(H: Any, mu: Any, lam: Any):
    """m, c, b, L of P = m F + L cof F, m = 4/3 mu I/(I + 1), L = lam' j - mu, c = dm/dI times 2, b = dL/dJ [Pa]."""
    x, j, w = neo_hookean_invariants(H)
    volume, k = neo_hookean_volume(j, mu, lam)
    d = type(mu)(1.0) / (type(mu)(1.0) + x)            # 4 / (I + 1)
    third = type(mu)(wp.static(1.0 / 3.0)) * mu
    b = type(mu)(0.0) * volume
    if k == j:
        b = volume
    return mu + third * x * d, type(mu)(0.5) * third * d * d, b, volume * k - mu


@wp.func
def neo_hookean_derivative(H: Any, q: Any, dF: Any, mu: Any, lam: Any):
    """dP = m dF + c (F:dF) F + b (cof F:dF) cof F + L dcof F [Pa]; q is not read."""
    G = clamp_entries(H)
    m, c, b, L = neo_hookean_factors(G, mu, lam)
    F = identity_like(G) + G
    cof = cofactor_matrix(F)
    return m * dF + (c * wp.ddot(F, dF)) * F + (b * wp.ddot(cof, dF)) * cof + L * cofactor_change(F, dF)


@wp.func
def neo_hookean_spectrum(H: Any, q: Any, mu: Any, lam: Any):
    """V, A, B of the positive part: f, t = m -+ L s_k (Smith, de Goes, Kim 2019, section 4), A the rest in stretches."""
    G = clamp_entries(H)
    m, c, b, L = neo_hookean_factors(G, mu, lam)
    e, V = eigen_three(corotated_strain(G, q))
    one = type(mu)(1.0)
    s = e + wp.vector(one, one, one)
    p = wp.vector(s[1] * s[2], s[2] * s[0], s[0] * s[1])
    A = m * identity_like(G) + c * wp.outer(s, s) + b * wp.outer(p, p)
    cross = wp.matrix_from_rows(wp.vector(one - one, s[2], s[1]), wp.vector(s[2], one - one, s[0]),
                                wp.vector(s[1], s[0], one - one))
    ms = wp.vector(m, m, m)
    return V, positive_part(A + L * cross), off_diagonal(ms - L * s, ms + L * s)
