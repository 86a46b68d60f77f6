"""Elastic materials: energy density Psi [J/m^3], stress P = dPsi/dF [Pa], stiffness. The table at the end names them.

F = 1 + H is the deformation gradient, H the gradient of displacement: with H given, a strain of 1e-6 keeps its digits in
float32, where F - 1 keeps one. P is the first Piola-Kirchhoff stress: P n is the force per rest area on a face with rest normal
n. q is the quaternion (x, y, z, w) of the rotation R of F (kernels/math/rotation.py); E = sym(R^T F) - 1 = sym(R^T (H - D))
with D = R - 1 straight from q. mu, lam [Pa] are the Lame parameters of small strain, for every material (`lame_parameters`).

    linear                 Psi = mu |e|^2 + lam/2 tr(e)^2,  e = sym(H)       for small turns only: a turned body swells
    corotational           the same of E: mu |F - R|^2 + lam/2 tr(R^T F - 1)^2                  (Sifakis, Barbic 2012, 3.4)
    st_venant_kirchhoff    the same of (F^T F - 1)/2; softens below a stretch of 0.58, and does not resist inversion
    neo_hookean            kernels/soft/neo_hookean.py: keeps its volume better; for large strain

The stiffness comes exactly, dP(F; dF), and as its positive part: `spectrum` once per element and step, `response`
(principal.py) for each dF. Of corotational there is a shorter form of both,

    dP = R (2 mu sym X + lam tr X + [T axl X]x),   X = R^T dF,   T = sum_k t_k V_k V_k^T,
    t_k = 2 mu + (lam (tr S - 3) - 2 mu) 2 / (s_i + s_j)        S = R^T F = V diag(s) V^T

`twist_stiffness` and `corotational_response`. All but the t_k is positive; they have no bound as s_i + s_j goes to 0, and stop
at `SUM`.

H counts as if clamped to +-1e6: with moduli up to 1e11 Pa nothing leaves float32.

ns each in float32 on one core of a CPU, 200 000 elements strained by about 0.1 (float64 takes much the same):

                          P    dP exact    spectrum or twist    its response
    linear               11           4                    3              56
    corotational         31         301             283, 289          56, 31
    neo_hookean          22          41                  334              56
    st_venant_kirchhoff  28          39                  308              56
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_three
from wsim.kernels.math.rotation import identity_like, machine_epsilon, twice_axis
from wsim.kernels.soft.neo_hookean import (
    cofactor_matrix,
    neo_hookean_derivative,
    neo_hookean_energy,
    neo_hookean_spectrum,
    neo_hookean_stress,
)
from wsim.kernels.soft.principal import (
    clamp_entries,
    corotated_strain,
    off_diagonal,
    positive_part,
    rotate_matrix,
    symmetrised_matrix,
    unrotate_matrix,
)

SUM = wp.constant(1.0e-3)         # of two stretches: smaller is stiffer against the turns of flat elements


def lame_parameters(E: float, nu: float) -> tuple[float, float]:
    """mu, lam [Pa] of Young's modulus E [Pa] and Poisson's ratio nu. Raises ValueError unless E > 0 and -1 < nu < 0.5."""
    if not 0.0 < E < float("inf"):
        raise ValueError(f"E is {E} Pa; Young's modulus is positive and finite")
    if not -1.0 < nu < 0.5:
        raise ValueError(f"nu is {nu}; Poisson's ratio lies between -1 and 0.5, rubber has about 0.49")
    return E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))


@wp.func
def green_strain(H: Any):
    """(F^T F - 1) / 2 = sym(H) + H^T H / 2, Green's strain."""
    return symmetrised_matrix(H) + type(H[0, 0])(0.5) * (wp.transpose(H) * H)


@wp.func
def hooke_energy(E: Any, mu: Any, lam: Any):
    """mu |E|^2 + lam/2 tr(E)^2 [J/m^3] of a symmetric strain."""
    t = wp.trace(E)
    return mu * wp.ddot(E, E) + type(mu)(0.5) * lam * t * t


@wp.func
def hooke_stress(E: Any, mu: Any, lam: Any):
    """2 mu E + lam tr(E) [Pa]."""
    return (mu + mu) * E + (lam * wp.trace(E)) * identity_like(E)


@wp.func
def linear_energy(H: Any, q: Any, mu: Any, lam: Any):
    """Psi [J/m^3] of small strain; q is not read."""
    return hooke_energy(symmetrised_matrix(clamp_entries(H)), mu, lam)


@wp.func
def linear_stress(H: Any, q: Any, mu: Any, lam: Any):
    """P = 2 mu e + lam tr(e) [Pa]; q is not read."""
    return hooke_stress(symmetrised_matrix(clamp_entries(H)), mu, lam)


@wp.func
def linear_derivative(H: Any, q: Any, dF: Any, mu: Any, lam: Any):
    """dP [Pa]; H and q are not read."""
    return hooke_stress(symmetrised_matrix(dF), mu, lam)


@wp.func
def linear_spectrum(H: Any, q: Any, mu: Any, lam: Any):
    """V, A, B of the constant stiffness, which is positive; respond with q = (0, 0, 0, 1)."""
    B = wp.matrix_from_rows(type(H[0])(mu - mu, mu + mu, mu + mu), type(H[0])(mu - mu, mu - mu, mu + mu), type(H[0])())
    return identity_like(H), hooke_stretch(H, mu, lam), B


@wp.func
def hooke_stretch(H: Any, mu: Any, lam: Any):
    """A = 2 mu + lam 1 1^T; positive for every E > 0, -1 < nu < 1/2."""
    one = type(H[0])(lam, lam, lam)
    return (mu + mu) * identity_like(H) + wp.matrix_from_rows(one, one, one)


@wp.func
def stretch_sum(H: Any):
    """(y, a): y = tr S - 3, and a = |F|^2 - 3, without a rotation.

    tr S = s1 + s2 + s3 is the largest eigenvalue of Horn's matrix (rotation.py), whose characteristic polynomial is
    x^4 - 2 |F|^2 x^2 - 8 det F x + |F|^4 - 4 |cof F|^2. About x = 3, with j = det F - 1 and b = |cof F|^2 - 3 - 2 a, small
    strains keep their digits: p(y) = y^4 + 12 y^3 + (48 - 2a) y^2 + (64 - 12a - 8j) y - 20a - 24j + a^2 - 4b. All its roots are
    real: Newton from above, x = sqrt(3) |F|, falls to the largest. Half the digits where that is double (s2 + s3 = 0).
    """
    zero = type(H[0, 0])(0.0)
    two = type(zero)(2.0)
    C = cofactor_matrix(H)
    t = wp.trace(H)
    c = wp.trace(C)
    hh = wp.ddot(H, H)
    K = t * identity_like(H) - wp.transpose(H) + C                   # cof F = 1 + K
    a = two * t + hh
    j = t + c + wp.dot(H[0], C[0])
    p0 = a * a - type(zero)(4.0) * (two * c + wp.ddot(K, K) - two * hh) - type(zero)(20.0) * a - type(zero)(24.0) * j
    p1 = type(zero)(64.0) - type(zero)(12.0) * a - type(zero)(8.0) * j
    p2 = type(zero)(48.0) - two * a
    three = type(zero)(3.0)
    y = three * a / (wp.sqrt(wp.max(type(zero)(9.0) + three * a, zero)) + three)
    n = int(60)                                                      # a variable: not unrolled
    for _k in range(n):
        p = (((y + type(zero)(12.0)) * y + p2) * y + p1) * y + p0
        slope = ((type(zero)(4.0) * y + type(zero)(36.0)) * y + two * p2) * y + p1
        if not slope > zero:
            break
        step = p / slope
        y -= wp.max(step, zero)
        if not step > machine_epsilon(zero) * wp.abs(y):
            break
    return y, a


@wp.func
def corotational_energy(H: Any, q: Any, mu: Any, lam: Any):
    """Psi = mu |E|^2 + lam/2 tr(E)^2 [J/m^3], E = S - 1; |E|^2 = |F|^2 - 3 - 2 tr E; q is not read."""
    y, a = stretch_sum(clamp_entries(H))
    return mu * wp.max(a - (y + y), type(mu)(0.0)) + type(mu)(0.5) * lam * y * y


@wp.func
def corotational_stress(H: Any, q: Any, mu: Any, lam: Any):
    """P = R (2 mu E + lam tr E) = 2 mu (F - R) + lam tr(R^T F - 1) R [Pa]; in this form q need not be exact
    (`corotated_strain`)."""
    return rotate_matrix(q, hooke_stress(corotated_strain(H, q), mu, lam))


@wp.func
def twist_eigenvalues(e: Any, mu: Any, lam: Any):
    """t_k [Pa] from e = s - 1, as (2 mu (e_i + e_j) + 2 lam tr E) / (s_i + s_j), which does not cancel at rest."""
    two = type(e[0])(2.0)
    least = type(e[0])(SUM) - two
    r0 = wp.max(e[1] + e[2], least)                                  # s_i + s_j - 2
    r1 = wp.max(e[2] + e[0], least)
    r2 = wp.max(e[0] + e[1], least)
    m = mu + mu
    c = two * lam * (e[0] + e[1] + e[2])
    return wp.vector((m * r0 + c) / (two + r0), (m * r1 + c) / (two + r1), (m * r2 + c) / (two + r2))


@wp.func
def twist_stiffness(H: Any, q: Any, mu: Any, lam: Any, least: Any):
    """T = V diag(max(t, least)) V^T [Pa]: all that corotational stiffness needs beside q; least = 0: the positive part."""
    e, V = eigen_three(corotated_strain(H, q))
    t = twist_eigenvalues(e, mu, lam)
    T = wp.diag(wp.vector(wp.max(t[0], least), wp.max(t[1], least), wp.max(t[2], least)))
    return V * T * wp.transpose(V)


@wp.func
def corotational_response(q: Any, T: Any, dF: Any, mu: Any, lam: Any):
    """dP = R (2 mu sym X + lam tr X + [T axl X]x) [Pa], X = R^T dF."""
    X = unrotate_matrix(q, dF)
    half = type(mu)(0.5)
    return rotate_matrix(q, hooke_stress(symmetrised_matrix(X), mu, lam) + wp.skew(half * (T * twice_axis(X))))


@wp.func
def corotational_derivative(H: Any, q: Any, dF: Any, mu: Any, lam: Any):
    """dP [Pa], with dR = R [(tr S - S)^-1 axl(X - X^T)]x; q must be the rotation of F."""
    return corotational_response(q, twist_stiffness(H, q, mu, lam, type(mu)(-3.0e38)), dF, mu, lam)


@wp.func
def corotational_product(H: Any, q: Any, dF: Any, mu: Any, lam: Any):
    """dP of `corotational_derivative` without eigenvectors: R (2 mu X + lam tr X + (lam tr E - 2 mu) [w]x), X = R^T dF,
    (tr S - S) w = axl(X - X^T). It does not stop at the limits of nearly flat elements. A gradient of 320 tets on a CPU takes
    1.9 of a run with it and 3.1 with the other (tools/bench/gradients.py)."""
    E = corotated_strain(H, q)
    X = unrotate_matrix(q, dF)
    one = type(mu)(1.0)
    t = wp.trace(E)
    w = wp.inverse((t + one + one) * identity_like(E) - E) * twice_axis(X)
    return rotate_matrix(q, (mu + mu) * X + (lam * wp.trace(X)) * identity_like(E) + (lam * t - mu - mu) * wp.skew(w))


@wp.func
def corotational_spectrum(H: Any, q: Any, mu: Any, lam: Any):
    """V, A, B of the positive part: f = 2 mu, A = 2 mu + lam 1 1^T."""
    e, V = eigen_three(corotated_strain(H, q))
    t = twist_eigenvalues(e, mu, lam)
    m = mu + mu
    return V, hooke_stretch(H, mu, lam), off_diagonal(wp.vector(m, m, m), t)


@wp.func
def st_venant_kirchhoff_energy(H: Any, q: Any, mu: Any, lam: Any):
    """Psi [J/m^3] of Green's strain; q is not read."""
    return hooke_energy(green_strain(clamp_entries(H)), mu, lam)


@wp.func
def st_venant_kirchhoff_stress(H: Any, q: Any, mu: Any, lam: Any):
    """P = F Sigma [Pa], Sigma = 2 mu E + lam tr E of Green's strain; q is not read."""
    G = clamp_entries(H)
    Sigma = hooke_stress(green_strain(G), mu, lam)
    return Sigma + G * Sigma


@wp.func
def st_venant_kirchhoff_derivative(H: Any, q: Any, dF: Any, mu: Any, lam: Any):
    """dP = dF Sigma + F (2 mu dE + lam tr dE), dE = sym(F^T dF) [Pa]; q is not read."""
    G = clamp_entries(H)
    dSigma = hooke_stress(symmetrised_matrix(dF + wp.transpose(G) * dF), mu, lam)
    return dF * hooke_stress(green_strain(G), mu, lam) + dSigma + G * dSigma


@wp.func
def st_venant_kirchhoff_spectrum(H: Any, q: Any, mu: Any, lam: Any):
    """V, A, B of the positive part: with L = lam tr E - mu, f, t = mu (s_i^2 +- s_i s_j + s_j^2) + L."""
    e, V = eigen_three(corotated_strain(H, q))
    one = type(mu)(1.0)
    s = e + wp.vector(one, one, one)
    L = lam * (e[0] + e[1] + e[2] + type(mu)(0.5) * wp.dot(e, e)) - mu
    u = wp.cw_mul(s, s)
    p = wp.vector(s[1] * s[2], s[2] * s[0], s[0] * s[1])
    r = mu * wp.vector(u[1] + u[2], u[2] + u[0], u[0] + u[1]) + wp.vector(L, L, L)
    three = (mu + mu + mu) * u + wp.vector(L, L, L)
    return V, positive_part(wp.diag(three) + lam * wp.outer(s, s)), off_diagonal(r + mu * p, r - mu * p)


@dataclass(frozen=True)
class Material:
    """A row of the table: functions of H and dF (3 x 3), the quaternion q (x, y, z, w), mu and lam [Pa]."""

    energy: wp.Function            # (H, q, mu, lam) -> Psi [J/m^3]
    stress: wp.Function            # (H, q, mu, lam) -> P [Pa]
    derivative: wp.Function        # (H, q, dF, mu, lam) -> dP [Pa], exact
    spectrum: wp.Function          # (H, q, mu, lam) -> V, A, B for `response`: its positive part
    turns: bool = True             # else q is never the rotation of F, but (0, 0, 0, 1)
    needs_rotation: bool = False   # stress and derivative read q; `spectrum` always does, energy never


TABLE = {
    "linear": Material(linear_energy, linear_stress, linear_derivative, linear_spectrum, turns=False),
    "corotational": Material(corotational_energy, corotational_stress, corotational_derivative, corotational_spectrum,
                             needs_rotation=True),
    "neo_hookean": Material(neo_hookean_energy, neo_hookean_stress, neo_hookean_derivative, neo_hookean_spectrum),
    "st_venant_kirchhoff": Material(st_venant_kirchhoff_energy, st_venant_kirchhoff_stress, st_venant_kirchhoff_derivative,
                                    st_venant_kirchhoff_spectrum),
}
