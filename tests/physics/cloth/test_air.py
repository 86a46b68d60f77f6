"""Wind on cloth against closed forms: drag, lift, terminal velocity, strong wind on light cloth, momentum."""

import numpy as np
import pytest

from tests.make.physics.cloth.air import RHO, SIDE, sheet
from wsim.scene import Motion, Scene, Sphere, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

DOUBLE = {"device": "cpu", "precision": "float64"}


def total_force(scene: Scene) -> np.ndarray:
    """Sum over the corners of what the kernel `press` writes [N]."""
    sim = Simulation(scene, **DOUBLE)
    aero = sim.plan.method("aero")
    sim.plan.method("points").predict(sim.plan.clock)
    aero.launch(sim.plan.clock)
    return 3.0 * aero.force.numpy().sum(axis=0)               # a third of a triangle's force for each corner


@pytest.mark.parametrize("speed", [0.5, 10.0, -7.0])
def test_drag_at_normal_incidence_is_the_textbook_s(speed):
    """F = 1/2 rho cd A v |v|, along the wind. Points are float32: their sides are right to 1e-7."""
    force = total_force(sheet((0.0, speed, 0.0), drag=1.3))
    wanted = 0.5 * RHO * 1.3 * SIDE**2 * speed * abs(speed)
    np.testing.assert_allclose(force, (0.0, wanted, 0.0), rtol=1e-6, atol=1e-6 * abs(wanted))


@pytest.mark.parametrize("tilt", [0.2, 0.9])
def test_drag_takes_the_projected_area_and_acts_along_the_wind(tilt):
    """The wind along +x meets the area A sin(tilt)."""
    force = total_force(sheet((6.0, 0.0, 0.0), drag=0.7, tilt=tilt))
    np.testing.assert_allclose(force, (0.5 * RHO * 0.7 * SIDE**2 * np.sin(tilt) * 36.0, 0.0, 0.0), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("tilt", [0.1, np.pi / 4, 1.3])
def test_lift_is_across_the_wind_and_towards_the_raised_front(tilt):
    """Normal (sin, cos): the edge towards the wind (-x) is raised, so the lift is up: 1/2 rho cl A v^2 sin cos."""
    force = total_force(sheet((8.0, 0.0, 0.0), lift=0.9, tilt=tilt))
    wanted = 0.5 * RHO * 0.9 * SIDE**2 * 64.0 * np.sin(tilt) * np.cos(tilt)
    np.testing.assert_allclose(force, (0.0, wanted, 0.0), rtol=1e-6, atol=1e-6 * wanted)
    turned = total_force(sheet((8.0, 0.0, 0.0), lift=0.9, tilt=-tilt))
    np.testing.assert_allclose(turned, -force, rtol=1e-6, atol=1e-6 * wanted)


def test_lift_does_not_know_front_from_back():
    """Turning the polygons round turns n, and the force stays."""
    scene = sheet((8.0, 1.0, 2.0), lift=0.9, drag=0.4, tilt=0.3)
    cloth = scene.cloths[0]
    force = total_force(scene)
    cloth.indices = np.ascontiguousarray(cloth.indices.reshape(-1, 3)[:, ::-1]).ravel()
    np.testing.assert_allclose(total_force(scene), force, rtol=1e-12)


def test_lift_vanishes_along_and_across_the_sheet():
    for wind in ((5.0, 0.0, 0.0), (0.0, 5.0, 0.0)):
        assert np.abs(total_force(sheet(wind, lift=1.0))).max() < 1e-6 * 0.5 * RHO * SIDE**2 * 25.0


def test_only_the_relative_velocity_counts():
    """The same sheet at rest in wind u - v and moving with v in wind u."""
    wind, v = np.array([3.0, -2.0, 1.0]), np.array([1.0, 4.0, -0.5])          # exact in float32
    still, moving = (sheet(tuple(wind - v), drag=1.0, lift=0.5), sheet(tuple(wind), velocity=v, drag=1.0, lift=0.5))
    np.testing.assert_allclose(total_force(moving), total_force(still), rtol=1e-12)
    assert not total_force(sheet(tuple(v), velocity=v, drag=1.0, lift=0.5)).any()


def test_air_takes_from_the_cloth_the_momentum_of_its_force():
    """One substep: sum m dv = h F / (1 + 2 h w k): a heavy sheet, h w k up to 6e-5."""
    scene = sheet((4.0, 5.0, 0.0), area_density=50.0, drag=1.0, lift=0.6, tilt=0.4, substeps=20)
    h, force = 1.0 / 60.0 / 20, total_force(scene)
    sim = Simulation(scene, **DOUBLE)
    sim.plan.before_frame(0.0)
    sim.plan.substep()
    momentum = sim.model.stack("masses") @ sim.state.v.numpy()
    np.testing.assert_allclose(momentum, h * force, atol=2e-4 * h * np.linalg.norm(force))


@pytest.mark.parametrize("substeps", [20, 80])
def test_a_falling_sheet_ends_at_its_terminal_velocity(substeps):
    """v = sqrt(2 m g / (rho cd A)), to second order in e = h g / v: one Newton step of the quadratic drag."""
    weight, cd = 0.05 * 9.81, 1.1
    scene = sheet(area_density=0.05, drag=cd, gravity=(0.0, -9.81, 0.0), substeps=substeps)
    wanted, h = np.sqrt(2.0 * weight / (RHO * cd)), 1.0 / 60.0 / substeps
    sim = Simulation(scene, **DOUBLE)
    sim.run(90)                                                          # 1.5 s, 17 times v / g
    v = sim.velocities()
    np.testing.assert_allclose(v[:, 1], -wanted, rtol=2.0 * (h * 9.81 / wanted)**2)
    assert np.abs(v[:, [0, 2]]).max() < 1e-6


def test_a_falling_sheet_follows_the_hyperbolic_tangent():
    """v(t) = v_t tanh(g t / v_t), order 1 in h: halved steps halve the error."""
    weight, cd, errors = 0.2 * 9.81, 1.1, []
    vt = np.sqrt(2.0 * weight / (RHO * cd))
    for substeps in (8, 16, 32):
        sim = Simulation(sheet(area_density=0.2, drag=cd, gravity=(0.0, -9.81, 0.0), substeps=substeps), **DOUBLE)
        sim.run(12)
        errors.append(abs(sim.velocities()[:, 1].mean() + vt * np.tanh(9.81 * 0.2 / vt)))
    assert np.all(np.abs(np.log2(np.array(errors[:-1]) / errors[1:]) - 1.0) < 0.15)


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_strong_wind_on_light_cloth_does_not_overshoot(substeps, precision):
    """10 g/m^2 in 60 m/s at 24 frames a second: an explicit force would give it 150 times the wind (one substep)."""
    scene = sheet((0.0, 60.0, 0.0), area_density=0.01, drag=1.0, fps=24.0, substeps=substeps)
    sim = Simulation(scene, device="cpu", precision=precision)
    before = 0.0
    for _ in range(12):
        sim.step()
        v = sim.velocities()
        assert v[:, 1].min() >= before * (1.0 - 1e-5) and v[:, 1].max() <= 60.0 * (1.0 + 1e-5)
        before = v[:, 1].min()
    assert before > 0.97 * 60.0


def still(sim: Simulation, path: str) -> bool:
    """Up to what rest shapes are rounded by."""
    return bool(np.abs(sim.velocities(path)).max() < 1e-12)


def test_wind_is_live_for_one_cloth_and_for_all():
    scene = sheet(drag=1.0)
    points, counts, indices = shapes.sheet(SIDE, SIDE, 2, 2, horizontal=True, at=(3.0, 0.0, 0.0))
    scene.cloth("/other", points, counts, indices, drag=1.0)
    sim = Simulation(scene, **DOUBLE)
    sim.run(2)
    assert still(sim, "/cloth") and still(sim, "/other")
    sim.set("/other", "wind", (0.0, 3.0, 0.0))
    sim.run(2)
    assert still(sim, "/cloth") and sim.velocities("/other")[:, 1].min() > 0.0
    sim.set("/", "wind", (0.0, 3.0, 0.0))
    sim.run(2)
    assert sim.velocities("/cloth")[:, 1].min() > 0.0


def test_a_cloth_without_coefficients_does_not_feel_the_wind_of_another():
    scene = sheet((0.0, 5.0, 0.0), drag=1.0)
    points, counts, indices = shapes.sheet(SIDE, SIDE, 2, 2, horizontal=True, at=(3.0, 0.0, 0.0))
    scene.cloth("/calm", points, counts, indices)
    sim = Simulation(scene, **DOUBLE)
    sim.run(3)
    assert sim.velocities("/cloth")[:, 1].min() > 0.0 and still(sim, "/calm")


def test_a_triangle_without_area_feels_nothing():
    scene = Scene(solver="xpbd", gravity=(0.0, 0.0, 0.0), wind=(0.0, 5.0, 0.0), substeps=2)
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1]], float)
    cloth = scene.cloth("/cloth", points, [3], [0, 1, 2], drag=1.0, lift=1.0)
    sim = Simulation(scene, **DOUBLE)
    sim.set("/cloth", "positions", np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], float))
    aero = sim.plan.method("aero")
    sim.plan.method("points").predict(sim.plan.clock)
    aero.launch(sim.plan.clock)
    assert cloth.drag == 1.0 and not aero.force.numpy().any() and not aero.k.numpy().any()


def test_leapfrog_keeps_order_2_in_wind_drag_and_damping():
    """A damped sheet swings by an edge in a wind: halved steps leave a quarter of the differences, to 10 % at h c = 5 %."""
    scene = sheet((3.0, 1.0, 2.0), drag=1.0, lift=0.3, gravity=(0.0, -9.81, 0.0), air_drag=2.0, solver="explicit",
                  integrator="leapfrog", fps=24.0)
    cloth, ends = scene.cloths[0], []
    cloth.material = Fabric(stretch=200.0, shear=60.0, thickness=5e-4, density=300.0, damping=2e-3)
    scene.pin("/pin", cloth, np.flatnonzero(cloth.points[:, 0] < -0.39))
    for scene.substeps in (60, 120, 240):
        sim = Simulation(scene, **DOUBLE)
        sim.run(4)
        ends.append(sim.positions())
    a, b = (np.linalg.norm(ends[k] - ends[k + 1]) for k in (0, 1))
    assert abs(np.log2(a / b) - 2.0) < 0.15


@pytest.mark.slow
def test_wind_on_a_cloth_that_touches_is_the_same_from_a_graph_as_launch_by_launch():
    """Newton's method with contacts: the kernels of the wind and of the contacts stand in one module."""
    def run(eager: bool) -> np.ndarray:
        scene = sheet((3.0, -2.0, 0.0), drag=1.3, solver="implicit", integrator="backward_euler", substeps=2, iterations=2)
        scene.collider("/floor", Sphere(0.3), dynamic_friction=0.3, motion=Motion.at_place((0.0, -0.299, 0.0)))
        sim = Simulation(scene, **DOUBLE)
        if eager:
            sim._replay = sim.plan.frame
        sim.run(3)
        assert sim.indicators()["contacts"] > 0
        return sim.positions()
    np.testing.assert_array_equal(run(False), run(True))
