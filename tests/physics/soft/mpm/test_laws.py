"""Material laws of the material point method against their definitions, in float64, on random strains."""

import numpy as np
import pytest
import warp as wp

from wsim.kernels.particles.mpm.material.law_table import LAWS, choose_law
from wsim.kernels.particles.mpm.tables import point_tables
from wsim.physics.mpm.objects import Granular, Jelly, Snow, Water

MATERIALS = {"neo_hookean": Jelly(), "corotational": Jelly(model="corotational"),
             "snow": Snow(compression_limit=0.5, tension_limit=0.5),
             "sand": Granular(friction_angle=1.5), "water": Water(tension=True)}
vec8 = point_tables(wp.float64).vec8


def law_kernels():
    respond, energy = choose_law(tuple(LAWS), wp.float64)

    @wp.kernel(module="unique", enable_backward=False)
    def law_response(law: int, B: wp.array(dtype=wp.mat33d), q: wp.array(dtype=wp.float64), m: vec8,
                     B_out: wp.array(dtype=wp.mat33d), q_out: wp.array(dtype=wp.float64), tau: wp.array(dtype=wp.mat33d),
                     psi: wp.array(dtype=wp.float64)):
        i = wp.tid()
        C, r, T, a = respond(law, B[i], q[i], m)
        B_out[i] = C
        q_out[i] = r
        tau[i] = T
        psi[i] = energy(law, C, r, m)

    return law_response


KERNEL = law_kernels()


def respond(name, material, B, q=None):
    """(B, q, tau, energy) after the response to strains B (n, 3, 3)."""
    n = len(B)
    q = np.zeros(n) if q is None else q
    inputs = [wp.array(B, dtype=wp.mat33d, device="cpu"), wp.array(q, dtype=wp.float64, device="cpu")]
    outputs = [wp.zeros(n, dtype=t, device="cpu") for t in (wp.mat33d, wp.float64, wp.mat33d, wp.float64)]
    wp.launch(KERNEL, n, [list(LAWS).index(name), *inputs, vec8(*material.numbers()), *outputs], device="cpu")
    return [each.numpy() for each in outputs]


def strains(size, n=20):
    """F F^T - 1 of random F near 1, and F."""
    F = np.eye(3) + size * np.random.default_rng(1).uniform(-1, 1, (n, 3, 3))
    return F @ F.swapaxes(1, 2) - np.eye(3), F


@pytest.mark.parametrize("name", LAWS)
def test_stress_is_the_derivative_of_the_energy(name):
    """tau = dPsi/dF F^T, by central differences; sand is pressed, so that it does not slide."""
    _, F = strains(0.05)
    F = 0.85 * F if name == "sand" else F
    step, tau = 1e-6, np.zeros_like(F)
    for i in range(3):
        for j in range(3):
            dL = np.zeros((3, 3))
            dL[i, j] = step
            psi = [respond(name, MATERIALS[name], G @ G.swapaxes(1, 2) - np.eye(3))[3]
                   for G in ((np.eye(3) + s * dL) @ F for s in (-1, 1))]
            tau[:, i, j] = (psi[1] - psi[0]) / (2 * step)
    found = respond(name, MATERIALS[name], F @ F.swapaxes(1, 2) - np.eye(3))[2]
    assert np.abs(found - tau).max() < 1e-7 * np.abs(tau).max()


@pytest.mark.parametrize("name", ["neo_hookean", "corotational", "snow", "sand"])
def test_small_strains_give_hookes_law(name):
    """tau = 2 mu eps + lambda tr eps, off by the strain, 1e-7; sand is pressed."""
    mu, lam = MATERIALS[name].numbers()[:2]
    eps = 1e-8 * np.random.default_rng(2).uniform(-1, 1, (10, 3, 3))
    eps = 0.5 * (eps + eps.swapaxes(1, 2)) - (1e-7 * np.eye(3) if name == "sand" else 0.0)
    hooke = 2 * mu * eps + lam * np.trace(eps, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    assert np.abs(respond(name, MATERIALS[name], 2 * eps)[2] - hooke).max() < 1e-5 * np.abs(hooke).max()


def test_sand_ends_on_the_cone_and_keeps_its_volume():
    """|dev tau| = sqrt(2) (tan(angle) p + cohesion) where it slides; tr e stays."""
    sand = Granular(friction_angle=0.5, cohesion=2e3)
    F = 0.97 * strains(0.1)[1]
    B = F @ F.swapaxes(1, 2) - np.eye(3)
    B_out, q, tau, _ = respond("sand", sand, B)
    p = -np.trace(tau, axis1=1, axis2=2) / 3
    size = np.linalg.norm(tau + p[:, None, None] * np.eye(3), axis=(1, 2))
    slid = np.abs(B_out - B).max(axis=(1, 2)) > 0
    closed = (q == 0)
    assert (slid & closed).sum() > 5
    most = np.sqrt(2) * (np.tan(0.5) * p + 2e3)
    assert np.allclose(size[slid & closed], most[slid & closed], rtol=1e-9)
    assert (size <= most * (1 + 1e-9) + 1e-9).all()
    assert np.allclose(np.linalg.det(np.eye(3) + B_out[closed]), np.linalg.det(np.eye(3) + B[closed]), rtol=1e-12)


def test_sand_that_opens_bears_nothing_until_it_is_closed():
    """Opened by 0.06 and closed by as much in parts, it is unloaded until the sum is below 0."""
    sand, q, B = Granular(), np.zeros(1), np.zeros((1, 3, 3))
    for step, volume in ((0.06, 0.06), (-0.05, 0.01), (-0.02, -0.01)):
        B = (1 + B) * np.exp(2 * step / 3) - 1 if np.any(B) else np.exp(2 * step / 3) * np.eye(3)[None] - np.eye(3)
        B, q, tau, _ = respond("sand", sand, B, q)
        B = B * np.eye(3)
        bulk = np.trace(tau[0]) / 3
        if volume >= 0:
            assert bulk == 0.0 and abs(q[0] - volume) < 1e-12
        else:
            lam, mu = sand.numbers()[1], sand.numbers()[0]
            assert abs(bulk / ((lam + 2 * mu / 3) * volume) - 1) < 1e-9 and q[0] == 0.0


def test_snow_holds_its_stretches_and_hardens():
    """Pressed by 0.1 along an axis: the stretch is 1 - 0.025, Jp = 0.9 / 0.975, and stiffness exp(10 (1 - Jp))."""
    B, q, tau, _ = respond("snow", Snow(), np.diag([0.9**2 - 1, 0, 0])[None])
    Jp = 0.9 / 0.975
    mu, lam = (np.exp(10 * (1 - Jp)) * v for v in Snow().numbers()[:2])
    assert np.allclose(B[0], np.diag([0.975**2 - 1, 0, 0]), atol=1e-14) and abs(q[0] + 1 - Jp) < 1e-14
    assert abs(tau[0, 0, 0] / (-2 * mu * 0.025 * 0.975 - lam * 0.025 * 0.975) - 1) < 1e-12


def test_water_follows_taits_equation_and_comes_apart():
    J = np.array([0.97, 1.02])
    B = (J[:, None, None] ** (2 / 3) - 1) * np.eye(3)
    p = 1e5 / 7 * (J**-7 - 1)
    _, q, tau, _ = respond("water", Water(tension=True), B)
    assert np.allclose(q, J - 1, rtol=1e-12) and np.allclose(np.trace(tau, axis1=1, axis2=2) / 3, -J * p, rtol=1e-10)
    assert np.trace(respond("water", Water(), B)[2][1]) == 0.0
