"""Hinges one behind the other between two bodies: the same as a chain with bodies of hardly any mass between the hinges."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.physics.joints.trees.chains import trees_of
from wsim.physics.rigid.joints.joint import TURNS, Drive, joint_between, locked_limits_except

PLACE = np.array([0.1, 0.2, -0.3])                                             # of the first body's joint
POINTS = {"rotX": (0.0, 0.0, 0.0), "rotY": (0.02, -0.03, 0.01), "rotZ": (0.0, 0.05, 0.04)}
AXES = {"rotX": (1, 0, 0), "rotY": (0, 1, 0), "rotZ": (0, 0, 1)}
LIGHT = 1e-9                                                                     # [kg], [kg m^2]
ARMATURE = {"rotX": 0.01, "rotY": 0.02, "rotZ": 0.03}
DRIVES = {"rotX": Drive(20.0, 2.0, 0.1), "rotY": Drive(10.0, 0.5, -0.2), "rotZ": Drive(5.0, 1.0)}


def two_bodies():
    """Boxes behind the joint, the second on a hinge."""
    scene = wsim.Scene(fps=60, substeps=4, coordinates="reduced", frames=3)
    first = scene.body("/a", wsim.Box((0.1, 0.05, 0.02)), at=PLACE + (0.1, 0.02, 0.0))
    second = scene.body("/b", wsim.Box((0.1, 0.02, 0.03)), at=PLACE + (0.3, 0.02, 0.0))
    for body in (first, second):
        body.colliders[0].meets = False
    return scene, first, second


def merged(names) -> wsim.Scene:
    scene, first, second = two_bodies()
    scene.add(joint_between("/j", None, first, at=PLACE, limits=locked_limits_except(*names) | {"rotY": (-1.0, 0.4)},
                            hinges={name: POINTS[name] for name in names}, drives={n: DRIVES[n] for n in names},
                            armature={n: ARMATURE[n] for n in names}))
    scene.joint("revolute", "/k", first, second, at=PLACE + (0.2, 0.02, 0.0), axis=(0, 1, 0))
    return scene


def chained(names) -> wsim.Scene:
    scene, first, second = two_bodies()
    last = None
    for name in ("rotZ", "rotY", "rotX"):
        if name not in names:
            continue
        light = {"mass": LIGHT, "inertia": (LIGHT,) * 3}
        body = first if name == "rotX" else scene.body(f"/{name}", wsim.Sphere(0.01), at=PLACE, **light)
        body.colliders[0].meets = False
        limits = {"low": -1.0, "high": 0.4} if name == "rotY" else {}
        scene.joint("revolute", f"/j_{name}", last, body, at=PLACE + POINTS[name], axis=AXES[name],
                    drives={"rotX": DRIVES[name]}, armature={"rotX": ARMATURE[name]}, **limits)
        last = body
    scene.joint("revolute", "/k", first, second, at=PLACE + (0.2, 0.02, 0.0), axis=(0, 1, 0))
    return scene


def loaded(scene):
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.load()
    return simulation, trees_of(simulation)[1]


@pytest.mark.parametrize("names", [("rotX", "rotY"), TURNS])
def test_accelerations_and_motion_are_those_of_a_chain(names):
    """Three angles and two; a limit, springs, rotors. What lies between weighs 1e-9 of the rest."""
    q = np.array([0.4, -0.5, 0.7, 0.3])[3 - len(names):]
    qd = np.array([1.0, -2.0, 1.5, -0.7])[3 - len(names):]
    simulations = []
    for make in (merged, chained):
        simulation, trees = loaded(make(names))
        trees.q.assign(q)
        trees.qd.assign(qd)
        trees.stale = set()
        simulations.append((simulation, trees))
    (one, mine), (other, theirs) = simulations
    assert np.abs(mine.accelerations() - theirs.accelerations()).max() < 1e-6 * np.abs(theirs.accelerations()).max()
    for simulation in (one, other):
        simulation.run(3)
    assert np.abs(mine.q.numpy() - theirs.q.numpy()).max() < 1e-6
    assert abs(mine.q.numpy() - q).max() > 0.01                                     # it has moved
    for path in ("/a", "/b"):
        assert np.abs(one.poses(path)[path] - other.poses(path)[path]).max() < 1e-6


@pytest.mark.parametrize("names", [("rotX", "rotY"), TURNS])
def test_coordinates_of_bodies_as_they_stand(names):
    """Bodies stand where coordinates have led; the coordinates of these places are the same."""
    q = np.array([0.4, -0.9, 0.7, 0.3])[3 - len(names):]
    scene = merged(names)
    poses = wsim.JointTree(scene).poses(q)
    for body in scene.things("Body"):
        body.motion = wsim.Motion.still(poses[body.path][0])
    assert np.abs(wsim.JointTree(scene).start - q).max() < 1e-12


def test_inverse_dynamics_gives_back_accelerations():
    scene = merged(TURNS)
    for joint in scene.things("Joint"):
        joint.drives = {}
    _, trees = loaded(scene)
    q, qd = np.array([0.4, -0.5, 0.7, 0.3]), np.array([1.0, -2.0, 1.5, -0.7])
    trees.q.assign(q)
    trees.qd.assign(qd)
    trees.stale = set()
    tau = wsim.JointTree(scene).inverse_dynamics(q, qd, trees.accelerations())
    assert np.abs(tau).max() < 1e-9


def test_hinges_go_through_usd(tmp_path):
    scene = merged(TURNS)
    scene.things("Joint")[0].armature = dict.fromkeys(TURNS, 0.01)
    wsim.save(scene, tmp_path / "hinges.usda")
    joint = wsim.load(tmp_path / "hinges.usda").things("Joint")[0]
    assert {name: np.round(point, 9).tolist() for name, point in joint.hinges.items()} == {
        name: list(point) for name, point in POINTS.items()}


def test_maximal_coordinates_say_that_hinges_are_bent():
    scene = replace(merged(TURNS), coordinates="maximal")
    for joint in scene.things("Joint"):
        joint.armature = {}
    simulation = wsim.Simulation(scene, device="cpu")
    simulation.run(1)
    assert any("hinges one behind the other, of /j" in note for note in simulation.report()["warnings"])
