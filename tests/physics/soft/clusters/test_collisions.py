"""Two bodies of clusters that fly and meet: momentum, angular momentum and energy, whatever holds them together."""

import numpy as np
import pytest

from wsim import Plane, Scene, Simulation, shapes
from wsim.geometry.tetra.tets import tet_surface_triangles

REACH = 0.026          # balls of a lattice of 5 cm that close it


def spinning_pair(stiffness, balls=True, substeps=16, iterations=8, **more):
    """Two cubes of 125 points that spin, and meet off their centres; without gravity."""
    scene = Scene(fps=60, substeps=substeps, iterations=iterations, gravity=(0, 0, 0))
    points, tets = shapes.block((0.2, 0.2, 0.2), 4)
    points = points - points.mean(axis=0)
    how = {"radius": REACH} if balls else {"counts": tet_surface_triangles(tets)}
    for path, at, way, spin in (("/a", (-0.3, 0, 0), (1, 0, 0), (1, 2, 3)), ("/b", (0.3, 0.08, 0.03), (-1, 0, 0), (-2, 1, 1))):
        scene.clusters(path, points + at, mass=1.0, stiffness=stiffness, self_collision=True, static_friction=0.0,
                       dynamic_friction=0.0, velocities=way + np.cross(spin, points), **how, **more)
    return Simulation(scene, device="cpu")


def moments(simulation):
    """Momentum, angular momentum and kinetic energy of both, each point of 1/125 kg."""
    x, v = (np.concatenate([f("/a"), f("/b")]).astype(float) for f in (simulation.positions, simulation.velocities))
    return v.sum(axis=0) / 125, np.cross(x, v).sum(axis=0) / 125, 0.5 * (v**2).sum() / 125


def collide(frames=45, **more):
    """Changes of momentum and angular momentum, over what there is of it, and the energy before and after."""
    simulation = spinning_pair(**more)
    before = moments(simulation)
    speed = simulation.velocities("/a").mean(axis=0)
    simulation.run(frames)
    after = moments(simulation)
    assert np.linalg.norm(simulation.velocities("/a").mean(axis=0) - speed) > 0.5                   # they met
    return *(np.linalg.norm(after[k] - before[k]) / max(np.linalg.norm(before[k]), k == 0) for k in (0, 1)), before[2], after[2]


@pytest.mark.parametrize(("stiffness", "balls", "bound"), [(np.inf, True, 1e-5), (1e4, True, 1e-5), (1e4, False, 5e-5)])
def test_two_that_collide_keep_both_momenta_and_gain_no_energy(stiffness, balls, bound):
    """Balls to 1e-5. Between triangles and points the torque has a rest of first order, of the last iteration."""
    linear, angular, before, after = collide(stiffness=stiffness, balls=balls)
    assert linear < 1e-5 and angular < bound and after < before


@pytest.mark.parametrize("steps", [(64, 8), (16, 32)])
def test_what_a_blow_of_rigid_ones_leaves_does_not_depend_on_steps(steps):
    """A rigid cluster answers with its own mass: a point alone has a 125th of it, and needed as many iterations."""
    few, many = collide(stiffness=np.inf)[3], collide(stiffness=np.inf, substeps=steps[0], iterations=steps[1])[3]
    assert many == pytest.approx(few, rel=0.05)


def test_a_rigid_cloud_that_overlaps_another_is_not_thrown():
    """Overlaps are parted by 0.01 (R + R) a substep at most, which is 0.5 m/s; moving its points alone threw it at 1.6 m/s."""
    scene, points = Scene(fps=60, substeps=16, iterations=8, gravity=(0, 0, 0)), shapes.block((0.2, 0.2, 0.2), 4)[0]
    for path, at in (("/a", (0, 0, 0)), ("/b", (0.245, 0.01, 0.02))):
        scene.clusters(path, points + at, mass=1.0, stiffness=np.inf, self_collision=True, radius=REACH)
    simulation, fastest = Simulation(scene, device="cpu"), 0.0
    for _ in range(20):
        simulation.step()
        fastest = max(fastest, np.linalg.norm(simulation.velocities("/a"), axis=1).max())
    assert 0.0 < fastest < 0.5


def test_a_wheel_of_many_points_rolls_as_a_disc_and_one_of_few_as_a_polygon():
    """Half of the mass at the rim, half at the axis: I = M R^2 / 2, so 2/3 g sin. A polygon of n corners loses the part
    1 - (1/2 + cos(2 pi / n)) / (3/2) of its spin at each corner."""
    slope, R = 0.3, 0.1
    pull = 2.0 / 3.0 * 9.81 * np.sin(slope)
    for n, bound in ((64, 0.08), (256, 0.02)):
        scene = Scene(fps=60, substeps=32, iterations=4, gravity=(9.81 * np.sin(slope), -9.81 * np.cos(slope), 0))
        scene.collider("/floor", Plane(), static_friction=1.0, dynamic_friction=1.0)
        turn = 2.0 * np.pi * np.arange(n) / n
        rim = [np.stack([R * np.sin(turn), R - R * np.cos(turn), np.full(n, z)], axis=1) for z in (-0.03, 0.03)]
        points = np.concatenate([*rim, [[0, R, -0.03], [0, R, 0.03]]])
        masses = np.r_[np.full(2 * n, 0.25 / n), 0.25, 0.25]
        scene.clusters("/wheel", points, masses=masses, stiffness=np.inf, static_friction=1.0, dynamic_friction=1.0)
        simulation = Simulation(scene, device="cpu")
        simulation.run(45)
        speed = simulation.velocities("/wheel")[-2:, 0].mean()
        assert pull * 0.75 * (1 - bound) < speed < pull * 0.75 * 1.01


def test_a_rigid_cluster_slides_down_a_slope_as_friction_says():
    mu = 0.4
    for beyond in (-1.0, 1.0):
        a = np.arctan(mu) + np.radians(beyond)
        scene = Scene(fps=60, substeps=8, iterations=4, gravity=(9.81 * np.sin(a), -9.81 * np.cos(a), 0))
        scene.collider("/floor", Plane(), static_friction=mu, dynamic_friction=mu)
        points = shapes.block((0.2, 0.1, 0.2), 3)[0]
        points = points - [0, points[:, 1].min(), 0]
        scene.clusters("/a", points, mass=1.0, stiffness=np.inf, static_friction=mu, dynamic_friction=mu)
        simulation = Simulation(scene, device="cpu")
        simulation.run(60)
        gained = max(9.81 * (np.sin(a) - mu * np.cos(a)), 0.0)
        assert simulation.velocities("/a")[:, 0].mean() == pytest.approx(gained, abs=2e-3)
