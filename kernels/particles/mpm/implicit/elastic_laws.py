"""Energies of elastic laws in principal stretches s, and their derivatives for Newton's method (Stomakhin et al. 2012,
section 4; the eigenvalues: Smith, de Goes, Kim 2019, section 4).

    x_principal(s, mu, lam) -> (P, D, O, flip, twist)

P_i = dPsi/ds_i; D, O: diagonal and off-diagonal (yz, zx, xy) of d2Psi/ds_i ds_j; flip = (P_i - P_j) / (s_i - s_j), twist =
(P_i + P_j) / (s_i + s_j) of the pairs yz, zx, xy. `principal_function` takes the positive parts, so that the matrix of Newton's
method is positive definite.
"""

# ruff: noqa: E741

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_three
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm import laws
from wsim.kernels.particles.mpm.tables import point_tables


@wp.func
def neo_hookean_principal(s: Any, mu: Any, lam: Any):
    """Psi = mu/2 (sum s_i^2 - 3 - 2 log J) + lam/2 (log J)^2."""
    one = type(mu)(1.0)
    log_J = wp.log(s[0] * s[1] * s[2])
    P = s - s
    D = s - s
    off = s - s
    flip = s - s
    twist = s - s
    for i in range(3):
        a = one / s[i]
        pair = one / (s[(i + 1) % 3] * s[(i + 2) % 3])
        P[i] = mu * (s[i] - a) + lam * log_J * a
        D[i] = mu + (mu + lam * (one - log_J)) * a * a
        off[i] = lam * pair
        flip[i] = mu + (mu - lam * log_J) * pair
        twist[i] = mu - (mu - lam * log_J) * pair
    return P, D, off, flip, twist


@wp.func
def corotational_principal(s: Any, mu: Any, lam: Any):
    """Psi = mu sum (s_i - 1)^2 + lam/2 (J - 1)^2."""
    one = type(mu)(1.0)
    two = one + one
    J = s[0] * s[1] * s[2]
    P = s - s
    D = s - s
    off = s - s
    flip = s - s
    twist = s - s
    for i in range(3):
        a = s[(i + 1) % 3]
        b = s[(i + 2) % 3]
        P[i] = two * mu * (s[i] - one) + lam * (J - one) * a * b
        D[i] = two * mu + lam * a * a * b * b
        off[i] = lam * (two * J - one) * s[i]
        flip[i] = two * mu - lam * (J - one) * s[i]
        twist[i] = two * mu * (one - two / (a + b)) + lam * (J - one) * s[i]
    return P, D, off, flip, twist


@cache
def principal_function(names: tuple[str, ...], real):
    """Function (number of a law in `names`, s, q, m) -> (P, D, O, flip, twist) with the positive parts of all but P."""
    t, vec8 = types(real), point_tables(real).vec8
    neo = names.index("neo_hookean") if "neo_hookean" in names else -1
    snow = names.index("snow") if "snow" in names else -1

    @wp.func
    def find_principal(law: int, s: t.vec3, q: real, m: vec8):
        hard = real(1.0)
        if law == wp.static(snow):
            hard = laws.snow_hardening(q, m)
        P, D, off, flip, twist = corotational_principal(s, hard * m[0], hard * m[1])
        if law == wp.static(neo):
            P, D, off, flip, twist = neo_hookean_principal(s, m[0], m[1])
        d, V = eigen_three(t.mat33(D[0], off[2], off[1], off[2], D[1], off[0], off[1], off[0], D[2]))
        for i in range(3):
            d[i] = wp.max(d[i], real(0.0))
            flip[i] = wp.max(flip[i], real(0.0))
            twist[i] = wp.max(twist[i], real(0.0))
        A = laws.from_principal(V, d)
        return P, t.vec3(A[0, 0], A[1, 1], A[2, 2]), t.vec3(A[1, 2], A[2, 0], A[0, 1]), flip, twist

    return find_principal
