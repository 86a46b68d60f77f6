"""Gradients of rigid bodies that joints move, float64: against differences of order 8 of runs, and a pendulum's closed form."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.gradient.rigid.joints import LAST, SCENES, Y, hung, pair, second, seeds
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.physics.rigid.joints.joint import (
    Drive,
    revolute_joint,
    spherical_joint,
)
from wsim.physics.rigid.objects import Body
from wsim.scene import Scene, SceneError
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])      # Fornberg 1988, table 1


NAMES = ("/a:velocity", "/b:spin", "/b:mass", "/b:inertia", "/a:force", "/b:torque", "/b:drag", "/b:spin_drag", "gravity")


@cache
def recorded(kind: str) -> Recording:
    return Recording(Simulation(SCENES[kind](), device="cpu", precision="float64", gradients=True), LAST)


def loss(r: Recording) -> float:
    r.run()
    poses, twists = seeds()
    return float(sum((r.poses(f, p) * M).sum() for f, by in poses.items() for p, M in by.items())
                 + sum((r.twists(f, p) * M).sum() for f, by in twists.items() for p, M in by.items()))


@cache
def gradient(kind: str):
    poses, twists = seeds()
    return recorded(kind).backward(poses=poses, twists=twists)


def slopes(kind: str, name: str, step: float) -> tuple[float, float]:
    """Along one direction: what the gradient says, and differences."""
    r = recorded(kind)
    value = inputs_by_name(r, [name])[name]
    base = value.read_value()
    found = value.gradient(gradient(kind), 0, base.shape)
    way = np.random.default_rng(3).normal(size=base.shape) if base.ndim else np.ones(())
    losses = []
    for k in (1, 2, 3, 4):
        for sign in (1.0, -1.0):
            value.write_value(base + sign * k * step * way)
            losses.append(loss(r))
    value.write_value(base)
    r.run()
    return float((found * way).sum()), float(np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / step)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SCENES)
def test_every_kind_of_joint_has_the_slope_of_differences(kind):
    """By differences of steps within which the same rows act; they tell up to 1e-8 of a slope."""
    for name in NAMES if kind in ("spherical", "driven") else NAMES[:4:3] + NAMES[-1:] + NAMES[1:2]:
        found, expected = slopes(kind, name, 1e-5 if kind in ("limits", "cone", "distance") else 2e-3)
        assert found == pytest.approx(expected, rel=1e-7, abs=2e-9), name


DRIVES = [pytest.param(kind, f"/{path}:{name}", id=f"{kind} {path} {name}") for kind in ("driven", "driven D6")
          for path in ("second", "first") for name in ("target", "stiffness", "damping")]
DRIVES += [pytest.param("driven alone", f"/first:{name}", id=f"alone {name}") for name in ("target", "stiffness", "damping")]


@pytest.mark.parametrize("kind, name", first_and_slow(DRIVES))
def test_drives_have_the_slope_of_differences(kind, name):
    if kind == "driven D6" and "first" in name:
        with pytest.raises(SceneError):
            inputs_by_name(recorded(kind), [name])[name].read_value()
        return
    found, expected = slopes(kind, name, 1e-3)
    assert abs(expected) > 1e-6 and found == pytest.approx(expected, rel=1e-7)
    if kind == "driven D6":
        assert inputs_by_name(recorded(kind), [name])[name].read_value().shape == (4,)


@pytest.mark.slow
def test_a_recording_goes_where_a_simulation_does_to_the_bit():
    """In maximal coordinates, which recordings of joints have."""
    for kind in ("spherical", "driven", "limits"):
        sim = Simulation(replace(SCENES[kind](), coordinates="maximal"), device="cpu", precision="float64")
        sim.run(LAST)
        r = Recording(Simulation(SCENES[kind](), device="cpu", precision="float64", gradients=True), LAST)
        r.run()
        method, other = sim.plan.method("rigid"), r.sim.plan.method("rigid")
        for name in ("x", "e", "q", "o", "p", "L"):
            assert np.array_equal(method.part.arrays[name].numpy(), other.part.arrays[name].numpy())


@pytest.mark.slow
def test_a_pendulum_swings_by_its_period():
    """A point mass on a massless arm, 1e-3 rad wide: phi = a cos(w t), w^2 = g / l. d phi / d a = cos(w t), and by g
    -a t sin(w t) / 2 sqrt(g l): of second order in the step, 1e-6 of a for the width."""
    a, g, arm, frames = 1e-3, 9.81, 0.7, 30
    scene = Scene(gravity=(0.0, 0.0, -g), up="Z", fps=60.0, substeps=16)
    bob = Body("/bob", mass=2.0, center=np.zeros(3), inertia=(1e-9,) * 3,
               motion=Motion.at_place((arm * np.sin(a), 0.0, -arm * np.cos(a))))
    scene.add(bob)
    scene.add(spherical_joint("/hinge", None, bob))
    r = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), frames)
    r.run()
    w, t = np.sqrt(g / arm), frames / 60.0
    by = np.zeros((4, 4))
    by[0, 3] = 1.0 / arm
    found = r.backward(poses={frames: {"/bob": by}})
    assert r.poses(frames, "/bob")[0, 3] / arm == pytest.approx(a * np.cos(w * t), abs=2e-5 * a)
    assert -found.gravity()[2] == pytest.approx(-0.5 * a * t * np.sin(w * t) / np.sqrt(g * arm), rel=1e-4)
    assert found.value("/bob", "velocity")[0] == pytest.approx(np.sin(w * t) / w / arm, rel=1e-4)


def test_a_drive_that_pushes_against_a_limit_is_refused():
    scene = pair(hung(revolute_joint, axis=Y, low=-0.001, high=0.001, drives={"rotX": Drive(900.0, 2.0, 0.9)}),
                 second(spherical_joint))
    r = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 6)
    with pytest.raises(SceneError, match="/first: its drive pushes it against a limit"):
        r.backward(twists={6: {"/a": np.ones((2, 3))}})


def test_live_masses_reach_joints():
    """The same motion as of bodies that had them from the start."""
    scene, other = (pair(hung(), second(spherical_joint)) for _ in range(2))
    other.things("Body")[1].mass = 3.5
    one, two = (Simulation(s, device="cpu", precision="float64") for s in (scene, other))
    one.set("/b", "mass", 3.5)
    for sim in (one, two):
        sim.run(6)
    assert np.abs(one.plan.method("rigid").poses() - two.plan.method("rigid").poses()).max() < 1e-13


@pytest.mark.slow
def test_islands_of_worlds_are_apart():
    r = Recording(Simulation(SCENES["driven"](), device="cpu", precision="float64", worlds=2, gradients=True), LAST)
    r.run()
    poses, _ = seeds()
    found = r.backward(poses={LAST: {("/b", 1): poses[LAST]["/b"]}})
    one = recorded("driven").backward(poses={LAST: {"/b": poses[LAST]["/b"]}})
    for name in ("stiffness", "target"):
        assert found.value("/first", name, 1) == pytest.approx(one.value("/first", name), rel=1e-12)
        assert found.value("/first", name, 0) == 0.0


@pytest.mark.slow
def test_a_humanoid_that_falls_has_the_slope_of_differences():
    """Sixteen bodies, fifteen joints with limits and drives, five frames of a jump; nothing is touched."""
    from wsim.usd.load import load
    scene = load(Path(__file__).resolve().parents[3] / "scenes/humanoid.usda")
    scene.iterations = 8
    for body in scene.things("Body"):
        for collider in body.colliders:
            collider.meets = False
    torso, hip = scene.things("Body")[0].path, next(j.path for j in scene.things("Joint") if len(j.driven()) == 3)
    r = Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 5)
    by = {5: {body.path: np.random.default_rng(2).normal(size=(4, 4)) for body in scene.things("Body")}}

    def seen() -> float:
        r.run()
        return float(sum((r.poses(5, path) * M).sum() for path, M in by[5].items()))
    seen()
    found = r.backward(poses=by)
    assert r.bodies.left < 1e-10
    for name in (f"{torso}:velocity", f"{hip}:target", "gravity"):
        value = inputs_by_name(r, [name])[name]
        base, losses = value.read_value(), []
        way, step = np.array([0.3, -0.5, 0.8]), 1e-3
        for k in (1, 2, 3, 4):
            for sign in (1.0, -1.0):
                value.write_value(base + sign * k * step * way)
                losses.append(seen())
        value.write_value(base)
        expected = np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / step
        assert float(value.gradient(found, 0, base.shape) @ way) == pytest.approx(expected, rel=1e-8), name
