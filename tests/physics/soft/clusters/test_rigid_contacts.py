"""Contacts of rigid clusters act on the whole of them: they do what `scene.body` does, of the same masses."""

from math import inf

import numpy as np
import pytest

from tests.physics.soft.clusters.lattice import best_rotation, cube_points
from wsim import Box, Motion, Plane, Scene, Simulation, Sphere

HALF, MASS = 0.1, 8.0


def corner_down(tilt: float) -> np.ndarray:
    """Rotation that turns the corner (1, 1, 1) down, and then by `tilt` [rad] about z."""
    a, b = np.ones(3) / np.sqrt(3.0), np.array([0.0, -1.0, 0.0])
    n = np.cross(a, b)
    K = np.cross(np.eye(3), n)
    c, s = np.cos(tilt), np.sin(tilt)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ (np.eye(3) - K + K @ K / (1.0 + a @ b))


def cube_of_body() -> np.ndarray:
    """Corners of a cube, which touch and have next to no mass, and of one within it, 1 / sqrt(3) as large: eight masses there
    have the inertia of the solid one."""
    return np.concatenate([cube_points(2, 2 * HALF), cube_points(2, 2 * HALF / np.sqrt(3.0))])


def drop(kind: str, tilt: float, friction: float, substeps: int = 8, iterations: int = 4) -> tuple[np.ndarray, Simulation]:
    """Heights of the centre, and how much of its own axis nearest to the vertical points up, of 120 frames, (120, 2)."""
    scene = Scene(fps=60, substeps=substeps, iterations=iterations)
    scene.collider("/floor", Plane(), static_friction=friction, dynamic_friction=friction)
    M, points = np.eye(4), cube_of_body()
    M[:3, :3], M[:3, 3] = corner_down(tilt), [0, 0.3, 0]
    more = {"motion": Motion.still(M), "static_friction": friction, "dynamic_friction": friction}
    if kind == "body":
        scene.body("/c", Box((HALF,) * 3), mass=MASS, **more)
    else:
        masses = np.full(16, MASS / 8.0)
        masses[:8] *= 1e-3
        scene.clusters("/c", points, masses=masses, stiffness=inf, **more)
    simulation, found = Simulation(scene, device="cpu"), []
    for _ in range(120):
        simulation.step()
        if kind == "body":
            pose = simulation.poses()["/c"]
            R, y = pose[:3, :3], pose[1, 3]
        else:
            x = simulation.positions("/c").astype(float)
            R, y = best_rotation(points[8:], x[8:] - x[8:].mean(axis=0)), x[8:, 1].mean()
        found.append((y, np.abs(R[1]).max()))
    return np.array(found), simulation


@pytest.mark.parametrize(("tilt", "friction"), [(0.3, 0.5), (0.6, 0.5), (0.3, 0.0)])
def test_a_cube_that_falls_on_its_corner_moves_as_a_body_does(tilt, friction):
    """The same fall onto a face within 2 frames, at 8 substeps of 4 iterations; the energy rises in none. The body's own path
    moves by up to 6 mm from 8 to 100 substeps, that of the cluster by 1.6 mm."""
    body, _ = drop("body", tilt, friction)
    cluster, simulation = drop("clusters", tilt, friction)
    assert np.abs(cluster - body)[:, 0].max() < 0.07 * HALF and not simulation.warnings
    rest = [int(np.flatnonzero(rows[:, 1] < 0.9999).max()) for rows in (body, cluster)]
    assert abs(rest[0] - rest[1]) <= 2
    assert abs(cluster[-1, 0] - HALF) < 1e-5 and cluster[-1, 1] > 1.0 - 1e-6


def test_what_a_contact_does_does_not_depend_on_iterations():
    """One iteration of 8 substeps and eight of them leave the same path, within a hundredth of the cube."""
    few, many = drop("clusters", 0.3, 0.5, iterations=1)[0], drop("clusters", 0.3, 0.5, iterations=8)[0]
    assert np.abs(few - many)[:, 0].max() < 0.02 * HALF


def test_a_blow_beside_the_centre_follows_the_closed_form():
    """A bar that falls flat on a ball under one end: without friction and gravity the impulse at r along n is
    v / (1/M + (r x n)^2 / J), and then it turns by r m v / J."""
    scene = Scene(fps=240, substeps=8, iterations=2, gravity=(0, 0, 0))
    scene.collider("/ball", Sphere(0.05), at=(0.2, -0.0501, 0), static_friction=0.0, dynamic_friction=0.0)
    grid = np.meshgrid([-0.2, -0.1, 0.0, 0.1, 0.2], [0.0, 0.02], [-0.02, 0.0, 0.02], indexing="ij")
    points = np.stack(grid, -1).reshape(-1, 3)
    scene.clusters("/bar", points, mass=0.3, stiffness=inf, velocities=np.tile([0, -1.0, 0], (30, 1)), static_friction=0.0,
                   dynamic_friction=0.0)
    simulation = Simulation(scene, device="cpu", precision="float64")
    simulation.run(2)
    v, x = simulation.velocities("/bar"), simulation.positions("/bar")
    m, r = 0.01, points - points.mean(axis=0)
    J, arm = m * (r[:, 0]**2 + r[:, 1]**2).sum(), 0.2
    impulse = 1.0 / (1.0 / 0.3 + arm**2 / J)
    c = x - x.mean(axis=0)
    omega = m * (c[:, 0] * v[:, 1] - c[:, 1] * v[:, 0]).sum() / (m * (c[:, 0]**2 + c[:, 1]**2).sum())
    assert abs(v[:, 1].mean() - (impulse / 0.3 - 1.0)) < 2e-3
    assert abs(omega / (arm * impulse / J) - 1.0) < 5e-3
