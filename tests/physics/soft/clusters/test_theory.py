"""Clusters against closed forms and conservation laws."""

from math import inf

import numpy as np
import pytest

from tests.physics.soft.clusters.lattice import angular_momentum, best_rotation, cube_points
from wsim.scene import Plane, Scene
from wsim.simulation.simulation import Simulation

K = 400.0              # stiffness [1/s^2]: 20 rad/s


def stretched(integrator: str, fps: float, **more) -> np.ndarray:
    """Strain of a free cluster that starts 10 % too long, (30,), a row a frame of two substeps."""
    scene = Scene(fps=fps, substeps=2, gravity=(0, 0, 0), solver="xpbd", integrator=integrator, **more)
    rest = cube_points(4, 0.1)
    scene.clusters("/c", rest * [1.1, 1, 1], rest_points=rest, mass=2.0, stiffness=K)
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    for _ in range(30):
        sim.step()
        found.append((sim.positions("/c")[:, 0] @ rest[:, 0]) / (rest[:, 0] @ rest[:, 0]) - 1.0)
    return np.array(found)


@pytest.mark.parametrize("iterations", [1, 3])
def test_a_cluster_vibrates_at_the_square_root_of_its_stiffness(iterations):
    """The implicit midpoint turns a mode by 2 atan(omega h / 2) a substep, and does not damp it."""
    h, n = 1.0 / 200.0, 2 * np.arange(1, 31)
    exact = 0.1 * np.cos(2.0 * np.arctan(0.5 * np.sqrt(K) * h) * n)
    assert np.abs(stretched("implicit_midpoint", 100.0, iterations=iterations) - exact).max() < 1e-13


def test_backward_euler_of_a_cluster_is_that_of_a_spring():
    h, n = 1.0 / 200.0, 2 * np.arange(1, 31)
    exact = 0.1 * ((1.0 / (1.0 - 1j * np.sqrt(K) * h))**n).real
    assert np.abs(stretched("backward_euler", 100.0) - exact).max() < 1e-13


def projected_hessian(rest: np.ndarray, groups: list[np.ndarray]) -> np.ndarray:
    """Hessian over k of the sum of all clusters, in sqrt(m) dx with equal masses: a projector off rigid motions for each."""
    found = np.zeros((3 * len(rest), 3 * len(rest)))
    for g in groups:
        r = rest[g] - rest[g].mean(axis=0)
        rigid = [np.tile(e, (len(g), 1)) for e in np.eye(3)] + [np.cross(e, r) for e in np.eye(3)]
        Q = np.linalg.qr(np.array([mode.ravel() for mode in rigid]).T)[0]
        ids = (3 * g[:, None] + np.arange(3)).ravel()
        found[np.ix_(ids, ids)] += np.eye(len(ids)) - Q @ Q.T
    return found


def test_overlapping_clusters_vibrate_as_their_hessian_says():
    rest = cube_points(3, 0.1)
    scene = Scene(fps=200, substeps=2, iterations=40, gravity=(0, 0, 0), solver="xpbd", integrator="implicit_midpoint")
    body = scene.clusters("/c", rest, mass=1.0, stiffness=K, sizes=[18, 18],
                          members=[*np.flatnonzero(rest[:, 0] < 0.05), *np.flatnonzero(rest[:, 0] > -0.05)])
    values, vectors = np.linalg.eigh(projected_hessian(rest, body.groups))
    assert (np.abs(values[:6]) < 1e-12).all() and values[6] > 1e-3
    mode = vectors[:, 6].reshape(-1, 3)
    body.points, body.rest_points = rest + 1e-5 * mode, rest
    sim, h = Simulation(scene, device="cpu", precision="float64"), 1.0 / 400.0
    turn = 2.0 * np.arctan(0.5 * np.sqrt(values[6] * K) * h)
    for frame in range(1, 41):
        sim.step()
        now = ((sim.positions("/c") - rest) * mode).sum() / 1e-5
        assert abs(now - np.cos(2 * frame * turn)) < 1e-4                       # the mode is linear to 1e-5 / 0.1


@pytest.mark.parametrize(("stiffness", "spacing"), [(inf, inf), (inf, 0.1), (1e3, inf), (1e3, 0.1)])
def test_free_clusters_keep_both_momenta(stiffness, spacing):
    """float32: 1e-5 of what they begin with, over a second of spin and vibration."""
    p = cube_points(4, 0.07)
    m, v = np.full(len(p), 2.0 / len(p)), np.cross([2.0, -1.0, 3.0], p) + [0.3, 0.1, -0.2] + 0.5 * p * [1, -1, 0]
    scene = Scene(fps=60, substeps=6, iterations=10, gravity=(0, 0, 0))
    scene.clusters("/c", p, mass=2.0, stiffness=stiffness, spacing=spacing, velocities=v)
    sim = Simulation(scene, device="cpu")
    sim.run(60)
    x, u = sim.positions("/c").astype(float), sim.velocities("/c").astype(float)
    assert np.abs(m @ (u - v)).max() < 1e-5 * np.linalg.norm(m @ v)
    L = angular_momentum(p, v, m)
    assert np.linalg.norm(angular_momentum(x, u, m) - L) < 1e-5 * np.linalg.norm(L)


def euler_top(inertia: np.ndarray, omega: np.ndarray, time: float, steps: int) -> np.ndarray:
    """Rotation of a free rigid body after a time [s]: R' = [w]x R, I R^T w = R^T L, by Runge-Kutta of order 4."""
    L = inertia @ omega

    def rate(R):
        w = R @ np.linalg.solve(inertia, R.T @ L)
        return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]) @ R
    R, h = np.eye(3), time / steps
    for _ in range(steps):
        a = rate(R)
        b = rate(R + 0.5 * h * a)
        c = rate(R + 0.5 * h * b)
        R = R + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(R + h * c))
    return R


def spun(substeps: int, integrator: str) -> float:
    """Angle [rad] by which a rigid cluster that tumbles for half a second errs."""
    p, omega = cube_points(4, 0.1) * [1.0, 0.6, 0.3], np.array([0.3, 5.0, 0.2])
    scene = Scene(fps=20, substeps=substeps, iterations=1, gravity=(0, 0, 0), solver="xpbd", integrator=integrator)
    scene.clusters("/c", p, mass=1.0, stiffness=inf, velocities=np.cross(omega, p))
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(10)
    inertia = ((p**2).sum() * np.eye(3) - p.T @ p) / len(p)
    R = best_rotation(p, sim.positions("/c")) @ euler_top(inertia, omega, 0.5, 2000).T
    return float(np.arccos(np.clip(0.5 * (np.trace(R) - 1.0), -1.0, 1.0)))


@pytest.mark.parametrize(("integrator", "order"), [("backward_euler", 1), ("implicit_midpoint", 2)])
def test_a_rigid_cluster_tumbles_as_a_rigid_body(integrator, order):
    """About its middle axis, which is unstable."""
    coarse, fine = spun(20, integrator), spun(40, integrator)
    assert fine < 0.02 and coarse / fine > 0.8 * 2**order


def test_a_rigid_cluster_that_spins_keeps_its_energy():
    """Without what spin.py gives back it would lose 1 - exp(-(h omega)^2 n) of it: 6 % here."""
    p = cube_points(3, 0.1)
    scene = Scene(fps=60, substeps=4, iterations=1, gravity=(0, 0, 0))
    scene.clusters("/c", p, mass=1.0, stiffness=inf, velocities=np.cross([0, 0, 4.0], p))
    sim = Simulation(scene, device="cpu")
    before = (sim.velocities("/c").astype(float)**2).sum()
    sim.run(60)
    assert abs((sim.velocities("/c").astype(float)**2).sum() / before - 1.0) < 1e-3


def sag(substeps: int, iterations: int) -> float:
    """Sag [m] of the free end of a bar of overlapping clusters, one end of which is pinned."""
    p = cube_points(3, 0.1)
    p = np.concatenate([p, p[p[:, 0] > 0.05] + [0.1, 0, 0], p[p[:, 0] > 0.05] + [0.2, 0, 0]])
    scene = Scene(fps=20, substeps=substeps, iterations=iterations, solver="xpbd", air_drag=4.0)
    body = scene.clusters("/c", p, mass=1.0, stiffness=3e3, spacing=0.15, overlap=0.4)
    scene.pin("/pin", body, np.flatnonzero(p[:, 0] < -0.05))
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(160)
    assert np.abs(sim.velocities("/c")).max() < 1e-6
    return float(p[:, 1].min() - sim.positions("/c")[:, 1].min())


def test_stiffness_depends_on_neither_substeps_nor_iterations():
    found = [sag(4, 30), sag(8, 16), sag(16, 8), sag(8, 40)]
    assert found[0] > 1e-3 and np.ptp(found) < 1e-4 * found[0]


@pytest.mark.parametrize("stiffness", [inf, 1e3])
def test_a_cluster_that_starts_inside_out_recovers(stiffness):
    rest = np.random.default_rng(3).uniform(-0.5, 0.5, (30, 3))
    scene = Scene(fps=60, substeps=8, iterations=2, gravity=(0, 0, 0), air_drag=5.0)
    scene.clusters("/c", rest * [-1.0, 1.0, 1.0], rest_points=rest, mass=1.0, stiffness=stiffness)
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(300)
    x = sim.positions("/c") - sim.positions("/c").mean(axis=0)
    off = np.abs(x - (rest - rest.mean(axis=0)) @ best_rotation(rest, x).T).max()
    assert off < 1e-6


def test_a_flat_cluster_keeps_its_shape():
    """Points in a plane have a best rotation; only those in a line have none."""
    rest = cube_points(4, 0.1)[:16] * [0.0, 1.0, 1.0]
    scene = Scene(fps=60, substeps=4, gravity=(0, 0, 0))
    scene.clusters("/c", rest, mass=1.0, stiffness=inf, velocities=np.cross([3.0, 2.0, 1.0], rest))
    sim = Simulation(scene, device="cpu")
    sim.run(60)
    x = sim.positions("/c").astype(float) - sim.positions("/c").mean(axis=0)
    assert np.abs(x - rest @ best_rotation(rest, x).T).max() < 1e-6
    assert np.abs(x - rest).max() > 0.05


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_a_motion_has_no_scale(size):
    """Sizes and gravity times a length: places times that length."""
    def run(length: float) -> np.ndarray:
        p = cube_points(3, 0.3)
        scene = Scene(fps=60, substeps=6, iterations=3, gravity=(0, -9.81 * length, 0))
        scene.collider("/floor", Plane(), at=(0, -0.6 * length, 0))
        scene.clusters("/c", p * length, mass=1.0, stiffness=2e3, spacing=0.4 * length,
                       velocities=np.cross([1, 2, 3], p) * length)
        sim = Simulation(scene, device="cpu", precision="float64")
        sim.run(20)
        return sim.positions("/c") / length
    assert np.abs(run(size) - run(1.0)).max() < (1e-9 if size > 1.0 else 1e-2)      # margins of contacts are lengths

