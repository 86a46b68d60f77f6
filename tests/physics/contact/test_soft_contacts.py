"""Gradients through contacts of tets under Newton's method, solved to a residual, in float64 against differences of order 8:
backward Euler and BDF2, two substeps a frame. A free bar is thrown askew at a convex shape or a mesh that rises and turns,
lands on it and slides. Differences take steps in which no point begins or ends to touch and nothing that slides sticks.

Every scene has the same kinds of colliders, so that one module serves an integrator: what it does not need lies far below."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.gradient.gradients import WEIGHTS, bar
from tests.make.physics.contact.collider_adjoint import HIGH, TRIED, below, led
from tests.make.physics.contact.project_adjoint import SHAPES, Slid
from tests.make.physics.solver.newton_adjoint_contacts import NEWTON
from wsim.geometry.rotation import axis_rotation_matrix
from wsim.gradient.recording import Recording
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

FRAMES, FRICTION = 4, 0.4
MATERIALS = {"backward_euler": ("corotational", 0.0), "bdf2": ("neo_hookean", 1e-3)}
SHAPES = SHAPES | TRIED
CASES = [pytest.param(shape, integrator, id=f"{shape}-{integrator}") for shape, integrator in (
    ("sphere", "backward_euler"), ("box", "bdf2"), ("sheet", "bdf2"), ("deforming", "backward_euler"))]


def thrown(shape: str, integrator: str, friction: float = FRICTION):
    model, damping = MATERIALS[integrator]
    scene = bar(model, damping=damping, **NEWTON | {"integrator": integrator})
    scene.pins, soft = [], scene.softs[0]
    askew = axis_rotation_matrix(np.array([0.3, 1.0, 0.2]) / np.linalg.norm([0.3, 1.0, 0.2]), 0.25)
    points = soft.points @ askew.T
    points[:, 2] -= points[:, 2].min()
    soft.points, soft.velocities = points.astype(np.float32), np.tile(np.float32([0.8, 0.4, -0.5]), (len(points), 1))
    soft.material = replace(soft.material, static_friction=friction, dynamic_friction=friction)
    times = np.arange(FRAMES + 1) / 60
    places = np.stack([np.eye(4)] * (FRAMES + 1))
    places[:, 2, 3] = -HIGH[shape] - 0.0053 + 0.1 * times
    places[:, 0, 0] = places[:, 1, 1] = np.cos(3.0 * times)
    places[:, 1, 0], places[:, 0, 1] = np.sin(3.0 * times), -np.sin(3.0 * times)
    lowest = points[points[:, 2].argmin()]
    places[:, :2, 3] = lowest[:2] - (0.004, 0.007)
    scene.collider("/floor", SHAPES[shape], motion=Motion(times, places), static_friction=friction,
                   dynamic_friction=friction, thickness=1e-3)
    return below(scene)


@cache
def recorded(shape: str, integrator: str) -> Slid:
    return Slid(thrown(shape, integrator), frames=FRAMES)


@pytest.mark.parametrize("shape, integrator", first_and_slow(CASES))
def test_a_bar_that_lands_and_slides(shape, integrator):
    """By its start, gravity, what it is made of, and friction and thickness of both."""
    run = recorded(shape, integrator)
    assert run.recording.residuals["forward"] < 1e-12 and run.recording.residuals["adjoint"] < 1e-11
    run.recording.run()
    assert run.sim.indicators()["contacts"] >= 1
    within = 1e-8
    run.by("positions", 1e-6, within)
    run.by("velocities", 1e-5, within)
    g, way = np.asarray(run.scene.gravity), np.array([0.3, -0.5, 0.8])
    run.check(run.gradient.gravity() @ way, lambda s: ("/", "gravity", g + s * way), 1e-4, within)
    for name, value in (("young", 2e4), ("poisson", 0.35), *[("damping", 1e-3)] * (integrator == "bdf2")):
        run.check(value * run.gradient.material(name), lambda s, n=name, v=value: (run.path, n, v * (1.0 + s)), 1e-4, within)
    for path in ("/bar", "/floor"):
        run.check(run.gradient.friction(path)[1], lambda s, p=path: (p, "dynamic_friction", FRICTION + s), 1e-5, within)
    run.check(run.gradient.thickness("/floor"), lambda s: ("/floor", "thickness", 1e-3 + s), 1e-6, within)


@pytest.mark.parametrize("shape, integrator", [("plane", "backward_euler"), ("sheet", "bdf2")])
def test_a_bar_that_sticks_is_carried(shape, integrator):
    """Thrown hardly at all, with friction that holds."""
    scene = thrown(shape, integrator, 1.5)
    scene.softs[0].velocities *= np.float32((0.1, 0.1, 1.0))
    run = Slid(scene, frames=FRAMES)
    run.recording.run()
    assert 2 in run.sim.plan.method("implicit").adjoint.contacts.frame.bears.numpy()
    run.by("positions", 1e-6, 1e-8)
    run.by("velocities", 1e-5, 1e-8)
    run.check(2e4 * run.gradient.material("young"), lambda s: (run.path, "young", 2e4 * (1.0 + s)), 1e-4, 1e-8)


@pytest.mark.parametrize("shape, integrator", [("sphere", "backward_euler"), ("sheet", "bdf2")])
def test_by_the_motion_of_a_collider(shape, integrator):
    """Worlds share their colliders, so that every difference is a run of its own, to the residual of a recording."""
    run = recorded(shape, integrator)
    by, step = run.gradient.motion("/floor"), 1e-7
    ways, losses = np.random.default_rng(1).normal(size=by.shape), []
    sim = Simulation(run.scene, device="cpu", precision="float64", gradients=True)
    for s in [sign * k * step for k in range(1, 5) for sign in (1, -1)]:
        sim.reset()
        sim.set("/floor", "motion", led(run.scene.colliders[0].motion, run.scene.substeps, *np.moveaxis(s * ways, 1, 0)))
        recording = Recording(sim, FRAMES)
        losses.append((recording.positions(FRAMES) * run.x).sum() + (recording.velocities(FRAMES) * run.v).sum())
    assert (by * ways).sum() == pytest.approx(np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / step, rel=1e-7)


def test_a_bar_of_quadratic_tets_under_pressure():
    """Middles touch too; by bdf2 on a mesh."""
    scene = thrown("sheet", "bdf2")
    scene.softs[0].quadratic, scene.softs[0].pressure = True, 400.0
    run = Slid(scene, frames=2)
    run.recording.run()
    assert run.sim.indicators()["contacts"] >= 1
    run.by("positions", 1e-6, 1e-8)
    run.by("velocities", 1e-5, 1e-8)
    run.check(400.0 * run.gradient.material("pressure"), lambda s: (run.path, "pressure", 400.0 * (1.0 + s)), 1e-3, 1e-8)
    run.check(run.gradient.friction("/bar")[1], lambda s: ("/bar", "dynamic_friction", FRICTION + s), 1e-5, 1e-8)
