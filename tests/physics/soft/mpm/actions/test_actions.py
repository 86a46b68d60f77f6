"""Loads, air and pins of material points against closed forms."""

import numpy as np
import pytest

import wsim
from wsim.physics.mpm.objects import Granular, Jelly, Pour, Snow
from wsim.scene.check.scene import check_scene

from ..test_method import find_method, total_momentum

G = 9.81


def still_scene(**more):
    return wsim.Scene(**({"fps": 60, "gravity": (0, 0, 0)} | more))


def cube(scene, path="/cube", at=(0, 0, 0), **more):
    return scene.mpm(path, wsim.Box((0.1, 0.1, 0.1)), at=at, **({"cell": 0.05, "material": Jelly(1e4)} | more))


def mean_velocity(simulation, k=0):
    return simulation.samples()[k].velocities.mean(axis=0)


def test_force_accelerates_by_its_sum_over_the_mass():
    scene = still_scene()
    jelly = cube(scene)
    ramp = wsim.Curve([0.0, 1.0], [(0, 0, 0), (0, 0, 96.0)])
    scene.force("/steady", jelly, range(jelly.point_count), (16.0, 0, 0))
    scene.force("/ramp", jelly, np.arange(0, jelly.point_count, 2), ramp)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(10)
    mass, t = 1000.0 * 0.2**3, 10.0 / 60.0
    momentum, _ = total_momentum(simulation)
    assert np.allclose(momentum, (16.0 * t, 0.0, 48.0 * t * t), rtol=1e-12, atol=1e-12 * mass)
    simulation.set("/steady", "force", (0, 0, 0))
    simulation.set("/ramp", "force", (0, 6.0, 0))
    simulation.run(6)
    assert np.allclose(total_momentum(simulation)[0] - momentum, (0, 0.6, 0), atol=1e-12 * mass)


def test_each_weight_bears_its_part():
    scene = still_scene()
    speck = scene.mpm("/specks", points=[[0, 0, 0], [1, 0, 0]], volumes=1e-5, cell=0.05, material=Jelly(1e4))
    scene.force("/push", speck, [0, 1], (0, 0.6, 0), weights=[0.25, 0.75])
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(6)
    assert np.allclose(simulation.samples()[0].velocities[:, 1], 0.6 * np.array([0.25, 0.75]) / 0.01 * 0.1, rtol=1e-6)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_decay_by_air_is_exponential_and_turns_decay_too(integrator):
    scene = still_scene(air_drag=3.0)
    cube(scene, velocity=(2, 0, 0), spin=(0, 0, 1.0), material=Jelly(1e4), integrator=integrator)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    start = total_momentum(simulation)
    simulation.run(30)
    end = total_momentum(simulation)
    assert np.allclose(end[0], np.exp(-1.5) * start[0], rtol=1e-6, atol=1e-9)
    assert end[1][2] == pytest.approx(np.exp(-1.5) * start[1][2], rel=1e-4 if integrator == "explicit" else 0.02)


def test_ball_falls_with_the_terminal_speed_of_its_frontal_area_and_drifts_with_the_wind():
    """It begins at 0.8 of that speed and of the wind's: differences fall by exp(-2 t G / terminal), those across it by the root
    of that."""
    scene, density, area = still_scene(gravity=(0, -G, 0), wind=(3.0, 0, 0)), 2.5, np.pi * 0.2**2
    terminal = np.sqrt(2.0 * density * (4.0 / 3.0 * 0.2 * area) * G / (scene.air_density * 0.47 * area))
    scene.mpm("/ball", wsim.Sphere(0.2), cell=0.05, material=Jelly(2.5e3, density=density), drag=0.47,
              velocity=(2.4, -0.8 * terminal, 0))
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(45)
    fall, v = np.exp(-0.75 * G / terminal), mean_velocity(simulation)
    assert -v[1] == pytest.approx(terminal * (1.0 - 0.2 * fall**2), rel=0.06)       # area of a ball of 8 cells, within 12 %
    assert v[0] == pytest.approx(3.0 - 0.6 * fall, abs=0.06) and abs(v[2]) < 0.1
    simulation.set("/", "wind", (0, 0, 0))
    simulation.run(30)
    assert mean_velocity(simulation)[0] == pytest.approx(v[0] * np.exp(-0.5 * G / terminal), rel=0.1)


def test_grain_that_flies_alone_has_the_drag_of_a_ball():
    scene = still_scene(gravity=(0, -G, 0))
    scene.mpm("/grain", points=[[0, 0, 0]], volumes=0.025**3, cell=0.05, material=Granular(density=20.0), drag=0.47)
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(240)
    area = np.pi / 4.0 * (6.0 / np.pi * 0.025**3) ** (2.0 / 3.0)
    terminal = np.sqrt(2.0 * 20.0 * 0.025**3 * G / (scene.air_density * 0.47 * area))
    assert -mean_velocity(simulation)[1] == pytest.approx(terminal, rel=1e-3)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_bar_that_hangs_on_a_pin_stretches_by_its_weight(integrator):
    """u = rho g (L y - y^2 / 2) / E, twice: the surface of what is pinned at a plane of nodes, and half a cell off; the pin
    holds within 0.3 cells of it, and by its force the bar's weight."""
    ratios, young = [], 1e6
    for low in (0.35, 0.325):
        scene = still_scene(gravity=(0, -G, 0))
        bar = scene.mpm("/bar", wsim.Box((0.05, 0.45, 0.05)), cell=0.05, integrator=integrator,
                        material=Jelly(young, poisson=0.0, viscosity=3000.0))
        top = bar.points_within(wsim.Box((0.2, 0.2, 0.2)), at=(0, low + 0.2, 0))
        scene.pin("/pin", bar, top)
        simulation = wsim.Simulation(scene, device="cpu", precision="float64")
        start = simulation.samples()[0].positions
        simulation.run(45)
        moved = simulation.samples()[0].positions - start
        assert np.abs(moved[top]).max() < 1e-12
        y = low - start[:, 1]
        tip = y > y.max() - 1e-6
        length = low + 0.45
        ratios.append(moved[tip, 1].mean() / (-1000.0 * G * (length * y[tip] - 0.5 * y[tip]**2) / young).mean())
        if integrator == "explicit":
            force = simulation.reactions("/pin").sum(axis=0)
            assert force == pytest.approx((0, 1000.0 * 0.01 * 0.9 * G, 0), abs=0.01 * 88.0)
        else:
            with pytest.raises(wsim.SceneError, match="not measured"):
                simulation.reactions("/pin")
    length = 0.8
    assert all(abs(ratio - 1.0) < 2.0 * 0.3 * 0.05 / length * 1.2 + 0.01 for ratio in ratios), ratios
    assert min(ratios) < 1.0 < max(ratios)                     # on the mean it is held at its surface


def test_soft_pin_lets_a_body_sag_by_its_weight_over_its_stiffness():
    scene = still_scene(gravity=(0, -G, 0))
    jelly = cube(scene, material=Jelly(1e5))
    stiffness = 10.0                                           # of each particle [N/m]
    scene.pin("/springs", jelly, range(jelly.point_count), stiffness=stiffness, damping=0.4)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    start = simulation.samples()[0].positions
    simulation.run(90)
    moved = simulation.samples()[0].positions - start
    mass = 1000.0 * 0.025**3
    assert moved[:, 1].mean() == pytest.approx(-mass * G / stiffness, rel=1e-3)
    assert simulation.reactions("/springs").sum(axis=0) == pytest.approx((0, 8.0 * G, 0), rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("material", [Jelly(2e4, viscosity=20.0), Snow(), Granular(cohesion=2000.0)])
def test_pin_drags_and_turns_a_region_that_takes_the_rest_along(material):
    scene = still_scene()
    block = cube(scene, material=material)
    half = block.points_within(wsim.Box((0.2, 0.06, 0.2)), at=(0, 0.06, 0))
    turn = np.array([0.0, 0.0, np.sin(0.5), np.cos(0.5)])
    motion = wsim.Motion.through([0.0, 1.0], [(0, 0, 0), (0.5, 0.2, 0)], [(0, 0, 0, 1), turn])
    scene.pin("/hand", block, half, motion=motion)
    simulation = wsim.Simulation(scene, device="cpu")
    start = simulation.samples()[0].positions
    simulation.run(60)
    x = simulation.samples()[0].positions
    target = motion.points(start, 1.0)
    assert np.abs(x[half] - target[half]).max() < 1e-5
    rest = np.setdiff1d(np.arange(len(x)), half)
    if isinstance(material, Jelly):
        assert np.linalg.norm(x[rest] - target[rest], axis=1).max() < 0.03
    assert np.linalg.norm(x[rest].mean(axis=0) - target[rest].mean(axis=0)) < 0.05


def test_motion_of_a_pin_can_be_set_while_it_runs_and_bits_repeat():
    found = []
    for _ in range(2):
        scene = still_scene(gravity=(0, -G, 0))
        jelly = cube(scene)
        top = jelly.points_within(wsim.Box((0.2, 0.03, 0.2)), at=(0, 0.08, 0))
        scene.pin("/hand", jelly, top)
        simulation = wsim.Simulation(scene, device="cpu")
        for frame in range(4):
            simulation.set("/hand", "motion", wsim.Motion.through(
                [frame / 60, (frame + 1) / 60], [(0.01 * frame, 0, 0), (0.01 * frame + 0.01, 0, 0)], kind="linear"))
            simulation.step()
        found.append(simulation.samples()[0].positions)
        assert find_method(simulation).part.count == 512
    assert np.array_equal(found[0], found[1])
    assert np.allclose(found[0][top, 0] - jelly.placed_points()[top, 0], 0.04, atol=1e-6)


def test_body_rests_on_a_pinned_table_of_jelly():
    """What is pinned does not give way, and the pin bears the weight of the body besides its own."""
    scene = still_scene(gravity=(0, -G, 0))
    table = scene.mpm("/table", wsim.Box((0.2, 0.05, 0.2)), cell=0.05, material=Jelly(5e4))
    scene.pin("/pin", table, range(table.point_count))
    scene.body("/ball", wsim.Sphere(0.08), at=(0, 0.145, 0), density=500.0)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(60)
    forces = []
    for _ in range(30):
        simulation.step()
        forces.append(simulation.reactions("/pin").sum(axis=0)[1])
    weight = G * (1000.0 * 0.4 * 0.1 * 0.4 + 500.0 * 4.0 / 3.0 * np.pi * 0.08**3)
    assert np.mean(forces) == pytest.approx(weight, rel=0.01)
    assert abs(simulation.samples()[0].matrix[1, 3] - 0.145) < 0.03


def test_what_makes_no_sense_is_refused_in_one_line():
    def lines(**more):
        scene = still_scene()
        jelly = cube(scene, **more)
        return scene, jelly

    def refused(scene, *words):
        with pytest.raises(wsim.SceneError) as error:
            wsim.Simulation(scene, device="cpu")
        found = [str(problem) for problem in error.value.problems if problem.fatal]
        assert len(found) == 1 and all(word in found[0] for word in words) and "\n" not in found[0], found

    scene, jelly = lines()
    scene.pin("/pin", jelly, [0, 512])
    refused(scene, "/pin", "0 to 511", "fix:")
    scene, jelly = lines()
    scene.pin("/pin", jelly, [])
    refused(scene, "/pin", "holds no points", "points_within")
    scene, jelly = lines()
    scene.pin("/a", jelly, [3])
    scene.pin("/b", jelly, [3, 4])
    refused(scene, "particle 3 is held by two pins")
    scene, jelly = lines()
    scene.force("/push", jelly, [600], (1, 0, 0))
    refused(scene, "/push", "0 to 511")
    scene, jelly = lines()
    scene.traction("/push", jelly, [[0, 1, 2]], (1, 0, 0))
    refused(scene, "/push", "no triangles")
    scene, jelly = lines()
    scene.tie("/tie", jelly, [0], scene.soft("/soft", *wsim.shapes.block((0.2, 0.2, 0.2), (1, 1, 1))), [0])
    refused(scene, "/tie", "share no points")
    scene, jelly = lines(pour=Pour(), velocity=(0, -1, 0))
    scene.pin("/pin", jelly, [0])
    refused(scene, "/pin", "pours")
    scene, jelly = lines(material=Granular(), integrator="implicit")
    scene.pin("/pin", jelly, [0])
    refused(scene, "/pin", "implicit")
    scene, jelly = lines(drag=-1.0)
    refused(scene, "/cube", "drag is -1")
    scene, jelly = lines()
    scene.force("/push", jelly, [0], (1, 0, 0))
    with pytest.raises(wsim.SceneError, match="no derivative"):
        wsim.Simulation(scene, device="cpu", gradients=True)


def test_wind_without_drag_is_named():
    scene = still_scene(wind=(3, 0, 0))
    cube(scene)
    assert any("do not feel the wind" in str(problem) for problem in check_scene(scene))
