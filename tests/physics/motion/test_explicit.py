"""Explicit integrators: textbook figures, observed orders, conservation, and how they meet pins, wind and colliders."""

from dataclasses import replace
from functools import cache
from math import cos

import numpy as np
import pytest
import warp as wp

from tools.bench.nets import reference
from tools.bench.nets.reference import rms
from wsim.physics.motion.stability import spectral_radius, stable_step
from wsim.scene import Scene, SceneError, Sphere, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.scene.integrator import EXPLICIT, IMPLICIT, TABLE
from wsim.simulation.plan import build_plan
from wsim.simulation.predicted import errors
from wsim.simulation.simulation import Simulation

DOUBLE = {"device": "cpu", "precision": "float64"}


def mass_on_spring(omega: float, h: float, integrator: str, length: float = 0.0) -> Scene:
    """Two points, one pinned at the origin, a spring between them; 1 kg at 1 m; a frame is a step."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=1.0 / h, substeps=1, integrator=integrator)
    net = scene.net("/net", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [omega**2], [1.0], lengths=[length])
    scene.pin("/pin", net, [0])
    return scene


class Driver:
    """The plan of a scene, run without the check that refuses what is known to blow up."""

    def __init__(self, scene: Scene):
        self.plan = build_plan(replace(scene, substeps=10**6), device=wp.get_device("cpu"), real=wp.float64)
        self.plan.clock.substeps = scene.substeps

    def run(self, frames: int) -> tuple[np.ndarray, np.ndarray]:
        for _ in range(frames):
            self.plan.before_frame(0.0)
            self.plan.frame()
            self.plan.clock.starting = False
        s = self.plan.state
        return s.x.numpy() + s.e.numpy(), s.v.numpy()


@pytest.mark.parametrize("integrator, ratio, digits", [("explicit_euler", 20959.16, 0.01), ("symplectic_euler", 1.043, 5e-4)])
def test_energy_of_the_stiff_oscillator(integrator, ratio, digits):
    """omega 100, h 0.001, 1 s: 1.01^1000 for explicit Euler."""
    x, v = Driver(mass_on_spring(100.0, 1e-3, integrator)).run(1000)
    energy = 0.5 * (v[1] @ v[1] + 1e4 * x[1] @ x[1])
    assert abs(energy / 5000.0 - ratio) < digits


def decaying(integrator: str) -> Scene:
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=100.0, substeps=1, integrator=integrator, air_drag=1000.0)
    scene.net("/net", [[0, 0, 0], [1, 0, 0]], [[0, 1]], [1e-12], [1.0], velocities=[[1, 0, 0], [1, 0, 0]])
    return scene


@pytest.mark.parametrize("integrator, value", [("explicit_euler", 3486784401.0), ("backward_euler", 11.0**-10)])
def test_stiff_decay(integrator, value):
    """y' = -1000 y, h 0.01, ten steps: 9^10 and 11^-10."""
    _, v = Driver(decaying(integrator)).run(10)
    np.testing.assert_allclose(v[0, 0], value, rtol=1e-9)


@wp.func
def pendulum(x: wp.vec3d, v: wp.vec3d):
    """theta'' = -g / L sin theta, theta in x[0]; L 1 m."""
    return wp.vec3d(-wp.float64(9.81) * wp.sin(x[0]), wp.float64(0.0), wp.float64(0.0))


@pytest.mark.parametrize("integrator, percent, digits",
                         [("explicit_euler", 113.363, 5e-4), ("symplectic_euler", -1.249, 5e-4), ("rk4", -1.01e-6, 5e-9)])
def test_energy_of_the_pendulum(integrator, percent, digits):
    """1 rad, h 0.01, 10 s: relative change of the energy above the lowest point."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=100.0, substeps=1, integrator=integrator)
    scene.net("/net", [[1, 0, 0], [-1, 0, 0]], [[0, 1]], [1e-30], [1.0])
    driver = Driver(scene)
    method = driver.plan.method("explicit")
    method.field = pendulum
    method.make(1)
    method.stages = method.stages[-1:]
    x, v = driver.run(1000)
    before, after = 9.81 * (1.0 - cos(1.0)), 9.81 * (1.0 - cos(x[0, 0])) + 0.5 * v[0, 0]**2
    assert abs(100.0 * (after / before - 1.0) - percent) < digits


@pytest.mark.parametrize("name", EXPLICIT)
def test_the_limit_is_where_growth_begins(name):
    method = TABLE[name]
    for omega, c in ((1e3, 0.0), (1e3, 50.0), (0.0, 1e3)):
        h = stable_step(method, omega, c)
        assert spectral_radius(method, omega, c, 0.99 * h) <= np.exp(h) + 1e-13 and spectral_radius(method, omega, c,
                                                                                                    1.1 * h) > np.exp(1.1 * h)
    if method.limit_undamped:
        assert abs(stable_step(method, 1e4) * 1e4 - method.limit_undamped) < 0.002 * method.limit_undamped
    assert stable_step(method, 0.0) == np.inf


def test_no_implicit_integrator_has_a_limit():
    assert {stable_step(TABLE[name], 1e6, 1e6) for name in IMPLICIT} == {np.inf}


@cache
def swung(integrator: str, tau: float, substeps: int) -> np.ndarray:
    """Where a damped chain is that swings for four frames."""
    scene = Scene(fps=20.0, frames=4, substeps=substeps, integrator=integrator)
    points = np.stack([np.arange(5), np.zeros(5), np.zeros(5)], axis=1) * 0.25
    net = scene.net("/net", points, [[i, i + 1] for i in range(4)], [200.0], [0.1], damping=tau)
    scene.pin("/pin", net, [0])
    return Driver(scene).run(4)[0]


@pytest.mark.parametrize("tau", [0.0, 2e-3])
@pytest.mark.parametrize("name", EXPLICIT)
def test_the_observed_order_is_the_declared_one(name, tau):
    """Against the method of order 4 by 512 substeps a frame."""
    exact = swung("rk4", tau, 512)
    counts = {"explicit_euler": (512, 1024), "rk4": (32, 64)}.get(name, (64, 128))
    errors = [rms(swung(name, tau, n) - exact) for n in counts]
    assert abs(np.log2(errors[0] / errors[1]) - TABLE[name].order) < 0.12


@pytest.fixture(scope="module")
def cloth():
    scene = reference.spring_cloth(12)
    where, error = reference.exact(reference.net(scene), (0.25,), 1e-9)
    return scene, where[0], error


@pytest.mark.parametrize("name, bound", [("leapfrog", 3e-6), ("rk4", 1e-8), ("symplectic_euler", 1e-3)])
def test_a_cloth_follows_the_exact_trajectory(cloth, name, bound):
    """Runge-Kutta in NumPy is independent of ours. Errors at 64 substeps: h^2 and h of what the 32 x 32 cloth shows."""
    scene, where, error = cloth
    sim = Simulation(replace(scene, integrator=name, substeps=64), **DOUBLE)
    sim.run(15)
    assert error < rms(sim.positions() - where) < bound or name == "rk4"
    assert rms(sim.positions() - where) < bound


def test_small_steps_lose_nothing_in_float32(cloth):
    """256 substeps: sums with their remainder keep float32 within a few roundings of 1 m."""
    scene, where, _ = cloth
    errors = []
    for precision in ("float32", "float64"):
        sim = Simulation(replace(scene, integrator="leapfrog", substeps=256), device="cpu", precision=precision)
        sim.run(15)
        errors.append(rms(sim.positions() - where))
    assert errors[0] < errors[1] + 1.5e-7


def free_cloth(**settings) -> Scene:
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=40, **settings)
    points, counts, indices = shapes.sheet(0.5, 0.5, 4, 4)
    rng = np.random.default_rng(3)
    scene.cloth("/cloth", points, counts, indices, velocities=rng.normal(size=points.shape) * 0.3,
                material=Fabric(stretch=50.0, shear=20.0, bend=1e-4, damping=1e-3))
    return scene


@pytest.mark.parametrize("name", ["leapfrog", "rk4", "midpoint"])
def test_a_free_cloth_keeps_its_momenta(name):
    """Linear to rounding; angular by the order of the method (central forces of every element)."""
    sim = Simulation(free_cloth(integrator=name), **DOUBLE)
    m = sim.model.stack("masses")[:, None]

    def momenta():
        x, v = sim.state.x.numpy() + sim.state.e.numpy(), sim.state.v.numpy()
        return (m * v).sum(0), np.cross(x, m * v).sum(0)
    before = momenta()
    sim.run(10)
    after = momenta()
    scale = np.abs(m * sim.state.v.numpy()).sum()
    assert np.abs(after[0] - before[0]).max() < 1e-13 * scale
    assert np.abs(after[1] - before[1]).max() < (1e-13 if name == "leapfrog" else 1e-5) * scale


def test_membranes_and_hinges_agree_with_a_converged_implicit_solution():
    """BDF2 with small steps and many sweeps is another road to the same motion; both are of order 2."""
    scene = free_cloth()
    scene.cloths[0].material = Fabric(stretch=50.0, shear=20.0, bend=1e-4)
    ends = []
    for settings in ({"integrator": "rk4", "substeps": 40}, {"integrator": "bdf2", "substeps": 160, "iterations": 40}):
        sim = Simulation(replace(scene, **settings), **DOUBLE)
        sim.run(6)
        ends.append(sim.positions())
    assert rms(ends[0] - ends[1]) < 2e-5


def test_leapfrog_keeps_the_energy_of_a_cloth():
    """It stays within O(h^2) of where it was for as long as one looks."""
    scene = replace(free_cloth(integrator="leapfrog"), substeps=80)
    scene.cloths[0].material = Fabric(stretch=50.0, shear=20.0, bend=1e-4)
    sim = Simulation(scene, **DOUBLE)
    start, most = sim.indicators()["energy"], 0.0
    for _ in range(60):
        sim.step()
        most = max(most, abs(sim.indicators()["energy"] / start - 1.0))
    assert most < 2e-3


@pytest.mark.parametrize("name", ["leapfrog", "symplectic_euler", "rk4"])
def test_where_others_act_within_a_substep_nothing_else_changes(name):
    """A collider out of reach makes every substep commit its positions: the motion is the same to rounding."""
    scene = reference.spring_cloth(8)
    scene.integrator, scene.substeps = name, 32
    apart = replace(scene, colliders=[])
    apart.collider("/far", Sphere(0.1), at=(0.0, 100.0, 0.0))
    ends = []
    for s in (scene, apart):
        sim = Simulation(s, **DOUBLE)
        sim.run(20)
        ends.append((sim.positions(), sim.velocities()))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-10)
    np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-8)


@pytest.mark.parametrize("name", ["leapfrog", "rk4"])
def test_a_moving_pin_takes_its_point_along(name):
    scene = Scene(fps=20.0, substeps=50, integrator=name)
    net = scene.net("/net", [[0, 0, 0], [0, -1, 0]], [[0, 1]], [100.0], [1.0])
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 0, 3] = 1.0
    scene.pin("/pin", net, [0], motion=Motion([0.0, 1.0], matrices))
    sim = Simulation(scene, **DOUBLE)
    sim.run(10)
    np.testing.assert_allclose(sim.positions()[0], [0.5, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(sim.velocities()[0], [1.0, 0.0, 0.0], atol=1e-9)
    assert 0.0 < sim.positions()[1, 0] < 0.5


def test_a_cloth_comes_to_rest_on_a_ball():
    scene = Scene(fps=60.0, substeps=64, integrator="leapfrog", air_drag=3.0)
    scene.cloth("/cloth", *shapes.sheet(0.3, 0.3, 6, 6), material=Fabric(stretch=100.0, shear=50.0, bend=1e-4, damping=1e-3))
    scene.collider("/ball", Sphere(0.5), at=(0.0, -0.55, 0.0), static_friction=1.0, dynamic_friction=1.0)
    sim = Simulation(scene, **DOUBLE)
    sim.run(300)
    found = sim.indicators()
    assert np.linalg.norm(sim.positions() - [0.0, -0.55, 0.0], axis=1).min() > 0.5
    assert found["kinetic_energy"] < 1e-8 and found["max_strain"] < 0.03


def test_worlds_and_repeats_give_the_same_bits():
    scene = replace(free_cloth(integrator="leapfrog"))
    ends = []
    for worlds in (1, 1, 3):
        sim = Simulation(scene, device="cpu", worlds=worlds)
        sim.run(5)
        ends += [sim.positions(world=w) for w in range(worlds)]
    assert all(np.array_equal(ends[0], other) for other in ends[1:])


def test_beyond_the_limit_is_refused_with_the_step_that_it_needs():
    """One spring k between a pin and 1 kg: leapfrog's limit is 2 / sqrt(k) = 0.02 s."""
    words = r"leapfrog is stable for h omega < 2, h c < 1: steps up to 0.02 s .*found 0.04 s; give --substeps 3 "
    with pytest.raises(SceneError, match=words):
        Simulation(mass_on_spring(100.0, 0.04, "leapfrog", 1.0), device="cpu")
    Simulation(mass_on_spring(100.0, 0.0199, "leapfrog", 1.0), device="cpu")


def test_auto_takes_with_gradients_what_it_takes_without():
    """Of a scene that it steps by XPBD, too: the derivative is that of what runs."""
    scene = mass_on_spring(1e9, 0.01, "auto", 0.9)
    plain, recorded = (Simulation(scene, gradients=g, **DOUBLE).plan.choice for g in (False, True))
    assert plain == recorded and plain.solver == "xpbd"
    scene = mass_on_spring(1e3, 0.01, "auto", 0.9)
    scene.solver = "explicit"
    assert "the scene names explicit" in Simulation(scene, gradients=True, **DOUBLE).plan.choice.why


def test_a_stiffer_parameter_gets_more_substeps():
    scene = mass_on_spring(100.0, 0.01, "leapfrog", 0.9)
    sim = Simulation(scene, **DOUBLE)
    sim.step()
    sim.set("/net", "stiffness", 1e6)
    sim.run(20)
    assert sim.plan.clock.substeps > 5 and any("substeps instead of 1" in w for w in sim.warnings)
    energy = 0.5 * np.sum(sim.velocities()[1]**2) + 0.5e6 * (np.linalg.norm(sim.positions()[1]) - 0.9)**2
    assert energy < 0.5e6 * 0.1**2 * 1.1


def test_a_stiffer_parameter_of_another_world_counts_too():
    sim = Simulation(mass_on_spring(100.0, 0.01, "leapfrog", 0.9), worlds=2, **DOUBLE)
    sim.set("/net", "stiffness", 1e6, world=1)
    assert sim.plan.clock.substeps > 5


def test_a_pin_that_begins_to_move_is_followed_through_every_substep():
    """Pinned points go from where they were to the end of the frame in equal parts, whatever was captured before."""
    scene = Scene(fps=20.0, substeps=50, integrator="leapfrog", gravity=(0.0, 0.0, 0.0))
    net = scene.net("/net", [[0, 0, 0], [0, -1, 0]], [[0, 1]], [100.0], [1.0])
    scene.pin("/pin", net, [0])
    sim = Simulation(scene, **DOUBLE)
    sim.run(4)
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 0, 3] = 1.0
    sim.set("/pin", "motion", Motion([0.2, 1.2], matrices))
    sim.run(2)
    np.testing.assert_allclose(sim.positions()[0], [0.1, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(sim.velocities()[0], [1.0, 0.0, 0.0], atol=1e-9)


def test_auto_takes_what_costs_least_and_says_why():
    soft, stiff = (Simulation(reference.spring_cloth(8, stretch=k, diagonal=k), device="cpu") for k in (10.0, 1e9))
    assert (soft.plan.choice.solver, soft.plan.integrator) == ("explicit", "leapfrog")
    assert (stiff.plan.choice.solver, stiff.plan.integrator) == ("xpbd", "backward_euler")
    assert "substeps keep" in soft.plan.describe() and "leapfrog would need" in stiff.plan.describe()


@pytest.mark.parametrize("springs, sweeps", [(20, 4), (20, 8), (30, 4)])
def test_a_hanging_chain_is_longer_by_what_sweeps_leave(springs, sweeps):
    """A row of N stiff springs under M sweeps: N^2 g h^2 / M but for a factor; `errors.slack_of_sweeps` is above and within
    2."""
    scene = Scene(fps=60.0, substeps=10, iterations=sweeps, solver="xpbd", integrator="backward_euler", air_drag=6.0)
    chain = scene.net("/chain", [[0.0, -0.05 * i, 0.0] for i in range(springs + 1)], [[i, i + 1] for i in range(springs)],
                      [1e7] * springs, [0.01] * (springs + 1))
    scene.pin("/pin", chain, [0])
    sim = Simulation(scene, **DOUBLE)
    sim.run(150)
    longer = -sim.positions()[-1, 1] - 0.05 * springs
    assert 0.5 < longer / errors.slack_of_sweeps(errors.falling_bodies(sim.model), 1.0 / 600.0, sweeps) < 1.0


def test_auto_takes_the_substeps_with_which_xpbd_errs_by_no_more_than_asked():
    sim = Simulation(replace(reference.spring_cloth(40, stretch=1e9, diagonal=1e9), error=1e-3, substeps=1), device="cpu")
    chosen, bodies, h = sim.plan.choice, errors.falling_bodies(sim.model), 1.0 / 60.0 / sim.plan.clock.substeps

    def error(h: float) -> float:
        return errors.drift_error(bodies, h) + errors.swept_error(bodies, h, chosen.iterations)
    assert chosen.solver == "xpbd" and error(h) <= 1e-3 < error(1.03 * h)


def test_auto_goes_on_with_xpbd_when_an_edge_is_torn_apart():
    scene = reference.spring_cloth(8, stretch=10.0, diagonal=10.0)
    sim = Simulation(scene, device="cpu")
    other = sim.plan.choice.other
    assert other is not None
    sim.step()
    thrown = np.zeros((64, 3))
    thrown[40] = (0.0, 500.0, 0.0)
    sim.set("/cloth", "velocities", thrown)
    sim.step()
    assert sim.plan.choice.solver == "xpbd" and any("from here on XPBD" in w for w in sim.warnings)
    assert sim.plan.clock.substeps == other.substeps > scene.substeps        # those of the wanted error
    sim.run(5)
    assert np.isfinite(sim.positions()).all() and sim.frame == 7


def test_the_kernels_of_implicit_steps_are_not_made():
    sim = Simulation(mass_on_spring(1.0, 0.1, "leapfrog", 1.0), device="cpu")
    names = {k.key for k in wp.get_module(sim.model.module).kernels.values()}
    assert not any("predict" in n or "finish" in n or "project" in n for n in names)


def test_limits_leave_the_energy_of_what_is_soft_in_the_report():
    """That of a cloth with a limit that it never meets is that of one without."""
    found = []
    for most in (10.0, None):
        scene = Scene(fps=60.0, solver="explicit")
        points, counts, indices = shapes.sheet(0.5, 0.5, 5, 5)
        more = {"strain_limit": most} if most else {}
        cloth = scene.cloth("/cloth", points, counts, indices, material=Fabric(stretch=100.0, shear=30.0, **more))
        scene.pin("/pin", cloth, [0, 5])
        sim = Simulation(scene, **DOUBLE)
        sim.run(6)
        found.append(sim.report(profile=False)["error"]["elastic_energy"])
    assert found[0] > 1e-3 and found[0] == pytest.approx(found[1], rel=1e-6), found
