"""Fits of rigid bodies that touch and are joined: friction and the stiffness of a drive, from markers on them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import wsim
from wsim.fitting import Markers
from wsim.physics.rigid.joints.joint import Drive, revolute_joint
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Plane, Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

NOISE = 1e-3


def sliding(rub: float) -> Scene:
    """A box that comes to rest in the last frames; friction is the mean of both."""
    scene = Scene(gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, frames=24, substeps=4, contact_tolerance=1e-10)
    scene.collider("/floor", Plane("Z"), static_friction=0.3, dynamic_friction=0.3)
    shape = Collider("/box/shape", Box((0.2, 0.2, 0.05)), static_friction=rub, dynamic_friction=rub)
    scene.add(Body("/box", [shape], Motion.at_place((0.0, 0.0, 0.05 - 1e-9)), velocity=(2.0, 0.0, 0.0)))
    return scene


def swinging(stiffness: float, damping: float = 0.3) -> Scene:
    scene = Scene(gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, frames=24, substeps=4)
    arm = Body("/arm", mass=1.0, center=np.zeros(3), inertia=(0.02, 0.1, 0.1), motion=Motion.at_place((0.5, 0.0, 0.0)))
    scene.add(arm)
    scene.add(revolute_joint("/hinge", None, arm, axis=(0.0, 1.0, 0.0), drives={"rotX": Drive(stiffness, damping)}))
    return scene


def seen(scene: Scene, path: str, noise: float = NOISE) -> Markers:
    sim, poses, frames = Simulation(scene, device="cpu", precision="float64"), [], np.arange(2, 25, 2)
    for frame in range(1, 25):
        sim.step()
        if frame in frames:
            poses.append(sim.plan.ports.bodies.placed(path)[0])
    found = Markers.of(path, frames, np.array(poses), size=0.3)
    found.positions += noise * np.random.default_rng(4).normal(size=found.positions.shape)
    return found


CASES: dict[str, tuple[Callable[[float], Scene], str, str, float, float]] = {
    "friction": (sliding, "/box", "/box:dynamic_friction", 0.6, 0.4),
    "stiffness": (swinging, "/arm", "/hinge:stiffness", 25.0, 12.0)}


@pytest.mark.parametrize("case", CASES)
def test_a_coefficient_is_found_from_markers_with_an_error_bar(case):
    """Noise of a millimetre, four markers, twelve frames: the truth lies within four error bars, which are below 5 %."""
    make, path, name, truth, start = CASES[case]
    result = wsim.fit(make(start), [seen(make(truth), path)], name)
    assert result.converged and abs(result.values[name] - truth) < 4.0 * result.errors[name]
    assert result.errors[name] < 0.05 * truth and result.sigma == pytest.approx(NOISE, rel=0.2)


def test_the_fitted_scene_holds_what_was_found():
    result = wsim.fit(swinging(12.0, 0.6), [seen(swinging(25.0), "/arm", 0.0)], "/hinge:stiffness,/hinge:damping")
    (joint,) = result.scene.things("Joint")
    assert joint.taken("stiffness") == result.values["/hinge:stiffness"] == pytest.approx(25.0, rel=1e-5)
    assert joint.taken("damping") == pytest.approx(0.3, rel=1e-5)
    assert replace(joint, drives={}).taken("stiffness") is None
