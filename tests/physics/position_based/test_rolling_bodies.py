"""Grains that turn and light or heavy rigid bodies: what a body's solve knows of them, momenta, and that none is thrown."""

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.piles import MASS, R, filled_box, set_spins
from wsim import Scene
from wsim.kernels.position_based.rolling import bodies
from wsim.kernels.position_based.rolling.law import rolling_law_func
from wsim.physics.position_based.objects import Grains

law = rolling_law_func(wp.float64)


@wp.kernel(module="unique", enable_backward=False)
def both_contacts(n: wp.vec3d, lam: wp.array(dtype=wp.float64), s0: wp.array(dtype=wp.vec3d), psi0: wp.array(dtype=wp.vec3d),
                  mu: wp.vec3d, values: wp.array(dtype=wp.types.matrix((4, 3), wp.float64)),
                  slopes: wp.array(dtype=bodies.SlopedVector, ndim=2)):
    k = wp.tid()
    T, q = bodies.sloped_rolling_contact(n, lam[k], s0[k], psi0[k], mu[0], mu[1], mu[2])
    plain = law(n, lam[k], s0[k], psi0[k], wp.vec3d(wp.float64(1.0) + mu[0], mu[0], mu[0]), wp.vec3d(mu[1], mu[1], mu[2]))
    values[k] = wp.matrix_from_rows(plain[0], plain[1], T.v, q.v)
    slopes[k, 0] = T
    slopes[k, 1] = q


@pytest.mark.parametrize(("mu", "rolling"), [(0.5, 0.1), (0.2, 1.0), (2.0, 0.01), (0.3, 0.0)])
def test_a_star_knows_the_law_of_rolling_and_its_derivatives(mu, rolling):
    """T and q are those of the law, and central differences agree with their derivatives in all parts of it."""
    rng, step = np.random.default_rng(4), 1e-7
    n = rng.normal(size=3)
    n /= np.linalg.norm(n)
    lam, s0, psi0 = rng.uniform(0.1, 2.0, 200), rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    s0 -= np.outer(s0 @ n, n)

    def contacts(lam, s0, psi0):
        values, slopes = np.zeros((len(lam), 4, 3)), wp.zeros((len(lam), 2), dtype=bodies.SlopedVector, device="cpu")
        out = wp.array(values, dtype=wp.types.matrix((4, 3), wp.float64), device="cpu")
        given = [wp.array(a, dtype=d, device="cpu") for a, d in ((lam, wp.float64), (s0, wp.vec3d), (psi0, wp.vec3d))]
        wp.launch(both_contacts, len(lam), [wp.vec3d(*n), *given, wp.vec3d(2.5, mu, rolling), out, slopes], device="cpu")
        return out.numpy(), slopes.numpy()
    values, slopes = contacts(lam, s0, psi0)
    assert np.allclose(values[:, :2], values[:, 2:], atol=1e-12)
    across = np.eye(3) - np.outer(n, n)
    for k in range(2):
        by_lam = (contacts(lam + step, s0, psi0)[0] - contacts(lam - step, s0, psi0)[0])[:, 2 + k] / (2 * step)
        found = [(by_lam, slopes["lam"][:, k])]
        for axis in range(3):
            u, w = step * across[axis], step * np.eye(3)[axis]
            by_s = (contacts(lam, s0 + u, psi0)[0] - contacts(lam, s0 - u, psi0)[0])[:, 2 + k] / (2 * step)
            by_psi = (contacts(lam, s0, psi0 + w)[0] - contacts(lam, s0, psi0 - w)[0])[:, 2 + k] / (2 * step)
            found += [(by_s, slopes["s"][:, k] @ across[axis]), (by_psi, slopes["psi"][:, k][:, :, axis])]
        for differences, slope in found:
            assert np.quantile(np.abs(differences - slope).max(axis=1), 0.98) < 1e-6           # but at the kinks


def momenta(simulation, mass):
    """Momentum, angular momentum about the centre of all, and that of the body alone."""
    part = next(m for m in simulation.plan.methods if m.name == "grains").rolling.part
    rigid = simulation.plan.method("rigid").part.arrays
    x, v = (a("/grains").astype(float) for a in (simulation.positions, simulation.velocities))
    omega = part.arrays["spin"].numpy()[part.rows["/grains", 0]].astype(float)
    X, p, L = simulation.poses()["/box"][:3, 3].astype(float), *(rigid[k].numpy()[0].astype(float) for k in "pL")
    total, center = MASS * v.sum(axis=0) + p, (MASS * x.sum(axis=0) + mass * X) / (MASS * len(x) + mass)
    turns = MASS * np.cross(x - center, v).sum(axis=0) + 0.4 * MASS * R * R * omega.sum(axis=0)
    return total, turns + np.cross(X - center, p) + L, L


@pytest.mark.parametrize("shape", [wsim.Box((0.02,) * 3), wsim.Sphere(0.02)])
@pytest.mark.parametrize(("ratio", "rolling"), [(1e-3, 0.3), (0.1, 1.0), (1.0, 0.05), (100.0, 0.2), (0.1, 0.0)])
def test_a_body_and_the_grains_that_hit_it_keep_both_momenta(ratio, rolling, shape):
    """Without gravity grains that spin hit it from all sides in one substep. (Later ones begin with overlaps, which move places
    alone.)"""
    rng, speed, ball = np.random.default_rng(1), 0.5, isinstance(shape, wsim.Sphere)
    scene = Scene(fps=480, substeps=1, iterations=4, gravity=(0, 0, 0))
    ways, chosen = rng.normal(size=(60, 3)), []
    ways /= (np.linalg.norm(ways, axis=1) if ball else np.abs(ways).max(axis=1))[:, None]
    for k in range(60):
        sides = np.sort(np.abs(ways[k]))[-2] if not ball else 0.0                          # none at an edge of the box
        if sides < 0.8 and all(np.linalg.norm(ways[k] - ways[j]) > 1.15 for j in chosen):
            chosen.append(k)
    normals = ways[chosen] if ball else np.where(np.abs(ways[chosen]) == 1.0, np.sign(ways[chosen]), 0.0)
    points = 0.02 * ways[chosen] + 1.5 * R * normals
    scene.body("/box", shape=shape, mass=ratio * MASS, static_friction=0.5, dynamic_friction=0.5)
    scene.particles("/grains", points=points, radius=R, velocities=-speed * normals,
                    material=Grains(static_friction=0.5, dynamic_friction=0.5, rolling_friction=rolling))
    simulation = wsim.Simulation(scene, device="cpu")
    set_spins(simulation, "/grains", rng.uniform(-50.0, 50.0, points.shape))
    p, L, body = momenta(simulation, ratio * MASS)
    simulation.run(5)
    p1, L1, moved = momenta(simulation, ratio * MASS)
    assert len(points) > 4 and np.linalg.norm(moved - body) > 1e-6 * MASS * R * R * 50.0
    assert np.abs(p1 - p).max() < 1e-6 * MASS * len(points) * speed
    assert np.abs(L1 - L).max() < 1e-6 * MASS * len(points) * (speed * 0.04 + 0.4 * R * R * 50.0)


@pytest.mark.parametrize(("ratio", "rolling", "steps"), [
    (1e-4, 0.3, (4, 2)), (1e-4, 1.0, (8, 4)), (1e-3, 0.2, (8, 4)), (1e-2, 0.3, (8, 4)), (1e-2, 1.0, (16, 4)),
    (0.1, 0.01, (4, 2)), (1.0, 1.0, (8, 4)), (1e3, 0.3, (8, 4))])
def test_no_box_is_thrown_by_grains_that_roll(ratio, rolling, steps):
    """Nothing is faster than what has fallen from the top of the pile, and no more than its energy is there."""
    scene, height = filled_box(ratio, True, *steps, rolling)
    simulation = wsim.Simulation(scene, device="cpu")
    before = np.array([0.0, height, 0.0])
    for _ in range(24):
        simulation.step()
        now = simulation.poses()["/box"][:3, 3].astype(float)
        assert np.linalg.norm(now - before) * 60.0 < 0.5
        before = now
    assert np.abs(simulation.velocities("/grains")).max() < 0.5
