"""Grains that turn on cloth, clusters and ropes: closed forms of rolling, momenta, and the law of friction."""

from math import inf

import numpy as np
import pytest

import wsim
from tests.make.physics.piles import set_spins, spins
from wsim import Fabric, Scene, shapes
from wsim.physics.position_based.objects import Grains

G, R, SLOPE = 9.81, 0.01, 0.2


def slope_scene(slope=SLOPE, **more):
    """A scene that falls by `slope` [rad] along x."""
    steps = {"fps": 60, "substeps": 8, "iterations": 4, "solver": "xpbd"}
    return Scene(**steps | more, gravity=(G * np.sin(slope), -G * np.cos(slope), 0))


def add_marble(scene, at, mu=0.5, rolling=0.0, **more):
    scene.particles("/marble", points=[at], radius=R, material=Grains(static_friction=mu, dynamic_friction=mu,
                                                                      rolling_friction=rolling, **more))


def add_held_cloth(scene, mu=0.5, border=False, **fabric):
    """A sheet of which all points are held but one in a corner, or those of its border."""
    fabric = Fabric(**{"stretch": 5000.0, "thickness": 0.001, "density": 500.0} | fabric, static_friction=mu,
                    dynamic_friction=mu)
    cloth = scene.cloth("/cloth", *shapes.sheet(0.4, 0.1, 24, 6, horizontal=True), material=fabric)
    x = np.asarray(cloth.points)
    held = (np.abs(x[:, 0]) > 0.199) | (np.abs(x[:, 2]) > 0.049) if border else np.arange(len(x)) > 0
    scene.pin("/pin", cloth, np.flatnonzero(held))


@pytest.mark.parametrize(("substeps", "iterations", "error"), [(4, 1, 0.03), (16, 2, 2e-3), (32, 4, 5e-4)])
def test_a_marble_rolls_down_a_held_cloth_by_five_sevenths(substeps, iterations, error):
    """From triangle to triangle: planes of those ahead, as they were where a substep began, brake it by an error of order 2."""
    scene = slope_scene(substeps=substeps, iterations=iterations)
    add_held_cloth(scene)
    add_marble(scene, [-0.15, R + 0.0005, 0.003])
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(12)
    v = simulation.velocities("/marble")[0]
    assert np.isclose(v[0], 5 / 7 * G * np.sin(SLOPE) * 0.2, rtol=error)
    assert np.isclose(spins(simulation, "/marble")[0, 2], -v[0] / R, rtol=1e-4)


def test_a_marble_slides_on_cloth_above_the_slope_that_friction_can_turn_it_on():
    slope = np.arctan(3.5 * 0.1) + 0.1
    scene = slope_scene(slope, substeps=32)
    add_held_cloth(scene, 0.1)
    add_marble(scene, [-0.15, R + 0.0005, 0.003], 0.1)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(12)
    assert np.isclose(simulation.velocities("/marble")[0, 0], G * (np.sin(slope) - 0.1 * np.cos(slope)) * 0.2, rtol=4e-3)
    assert np.isclose(spins(simulation, "/marble")[0, 2], -2.5 * 0.1 * G * np.cos(slope) * 0.2 / R, rtol=2e-3)


@pytest.mark.parametrize(("beyond", "rolls"), [(-0.01, False), (0.02, True)])
def test_a_marble_stays_on_cloth_up_to_its_rolling_friction(beyond, rolls):
    slope = np.arctan(0.1) + beyond
    scene = slope_scene(slope)
    add_held_cloth(scene)
    add_marble(scene, [-0.1, R + 0.0005, 0.003], rolling=0.1)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(30)
    speed = simulation.velocities("/marble")[0, 0]
    assert np.isclose(speed, 5 / 7 * G * (np.sin(slope) - 0.1 * np.cos(slope)) * 0.5, rtol=0.02) if rolls else abs(speed) < 1e-4


def test_a_marble_rolls_on_a_taut_cloth_that_it_dents():
    """A cloth that hangs between held edges: the marble is as fast as it would be on a plate, to its dents, and rolls."""
    scene = slope_scene(substeps=16, iterations=8)
    add_held_cloth(scene, border=True, stretch=20000.0, density=2000.0)
    add_marble(scene, [-0.15, R + 0.0005, 0.0], density=300.0)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(24)
    v = simulation.velocities("/marble")[0]
    assert np.isclose(v[0], 5 / 7 * G * np.sin(SLOPE) * 0.4, rtol=0.04)
    assert np.isclose(spins(simulation, "/marble")[0, 2], -v[0] / R, rtol=0.03)


def test_a_marble_rolls_on_a_cluster():
    """A heavy block stands on the slope, which holds it by friction."""
    scene = slope_scene(substeps=8, iterations=4)
    scene.collider("/floor", wsim.Plane(), at=(0, -0.025, 0), static_friction=2.0, dynamic_friction=2.0)
    points, tets = shapes.block((0.4, 0.05, 0.1), (8, 1, 2))
    points = points - points.mean(axis=0)
    from wsim.geometry.tetra.tets import tet_surface_triangles
    surface = tet_surface_triangles(tets)
    scene.clusters("/block", points, counts=np.full(len(surface), 3), indices=surface.ravel(), mass=20.0, stiffness=inf,
                   static_friction=2.0, dynamic_friction=2.0)
    add_marble(scene, [-0.15, 0.025 + 0.00285 + R, 0.003])          # its skin has a thickness
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(6)
    before = simulation.velocities("/marble")[0, 0]
    simulation.run(18)
    v = simulation.velocities("/marble")[0]
    assert np.isclose(v[0] - before, 5 / 7 * G * np.sin(SLOPE) * 0.3, rtol=0.02)
    assert np.isclose(spins(simulation, "/marble")[0, 2], -v[0] / R, rtol=0.02)


def test_a_marble_rolls_on_two_ropes_by_the_radius_at_which_it_touches_them():
    """Rails of half distance a and radius p: it touches them k = R sqrt(1 - a^2 / (R + p)^2) from its axis, and the
    acceleration is g sin / (1 + 2/5 R^2 / k^2)."""
    a, p = 0.009, 0.005
    scene = slope_scene()
    t = np.linspace(-0.25, 0.25, 21)
    points = np.concatenate([np.stack([t, 0 * t, 0 * t + z], axis=1) for z in (-a, a)])
    rods = scene.rods("/ropes", points, [21, 21], diameters=[2 * p], young=1e7, density=1100.0, self_collision=True,
                      static_friction=0.5, dynamic_friction=0.5)
    scene.pin("/pin", rods, np.arange(42))
    add_marble(scene, [-0.15, np.sqrt((R + p) ** 2 - a * a), 0.0])
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(24)
    k = R * np.sqrt(1.0 - (a / (R + p)) ** 2)
    v = simulation.velocities("/marble")[0]
    assert np.isclose(v[0], G * np.sin(SLOPE) / (1.0 + 0.4 * (R / k) ** 2) * 0.4, rtol=0.01)
    assert np.isclose(spins(simulation, "/marble")[0, 2], -v[0] / k, rtol=0.01)


@pytest.mark.parametrize("partner", ["cloth", "clusters"])
def test_a_marble_that_spins_against_something_free_keeps_both_momenta(partner):
    scene = Scene(fps=60, substeps=16, iterations=4, gravity=(0, 0, 0))
    if partner == "cloth":
        scene.cloth("/other", *shapes.sheet(0.2, 0.2, 6, 6, horizontal=True),
                    material=Fabric(500.0, thickness=0.002, density=2000.0, static_friction=0.5, dynamic_friction=0.5))
    else:
        points, tets = shapes.block((0.15, 0.1, 0.15), (3, 2, 3))
        from wsim.geometry.tetra.tets import tet_surface_triangles
        surface = tet_surface_triangles(tets)
        scene.clusters("/other", points - points.mean(axis=0) - [0, 0.05, 0], counts=np.full(len(surface), 3),
                       indices=surface.ravel(), mass=0.7, stiffness=inf, static_friction=0.5, dynamic_friction=0.5)
    scene.particles("/marble", points=[[0.003, 0.0125, 0.002]], radius=R, velocities=[[0.0, -0.3, 0.0]],
                    material=Grains(static_friction=0.5, dynamic_friction=0.5, rolling_friction=0.1))
    simulation = wsim.Simulation(scene, device="cpu")
    set_spins(simulation, "/marble", [[0.0, 20.0, 60.0]])
    mass = 2600 * 4 / 3 * np.pi * R**3

    def momenta():
        P, L = np.zeros(3), 0.4 * mass * R * R * spins(simulation, "/marble")[0]
        for body in simulation.model.bodies:
            x, v = (a(body.path).astype(float) for a in (simulation.positions, simulation.velocities))
            P, L = P + body.point_masses @ v, L + np.cross(x, body.point_masses[:, None] * v).sum(axis=0)
        return P, L
    before = momenta()
    simulation.run(8)
    after = momenta()
    spin = spins(simulation, "/marble")[0]
    assert abs(spin[2] - 60.0) > 5.0 and abs(spin[1] - 20.0) > 0.1
    assert np.abs(after[0] - before[0]).max() < 2e-6 * 0.3 * mass
    assert np.abs(after[1] - before[1]).max() < 0.02 * 0.4 * mass * R * R * 60.0
