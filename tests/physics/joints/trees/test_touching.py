"""Trees that touch something: landing, friction, stacks beside bodies without joints."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.joints.aims import WAY
from tests.physics.joints.trees.chains import trees_of
from wsim import Box, Plane, Scene, Sphere
from wsim.physics.rigid.joints.joint import Drive
from wsim.scene import Varying

SCENES = Path(__file__).resolve().parents[4] / "scenes"


def spring_energy(trees) -> float:
    """Energy [J] of the springs of all drives."""
    t, now = trees.linked.t, trees.linked.now.numpy()
    return float((0.5 * np.where(t.drive.numpy() > 0, t.stiffness.numpy(), 0.0) * (now - t.target.numpy())**2).sum())


def landing(substeps: int):
    """(places of the torso, energies) of ten frames of the humanoid, which lands in the eighth; its drives are stiff."""
    scene = replace(wsim.load(SCENES / "humanoid.usda"), coordinates="reduced", substeps=substeps)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.load()
    method, trees = trees_of(simulation)
    places, energies = [], []
    for _ in simulation.frames(10):
        places.append(simulation.poses()["/World/Humanoid/torso"][:3, 3])
        energies.append(method.indicators(None, None)["rigid_energy"] + spring_energy(trees))
    return np.array(places), np.array(energies)


def test_a_humanoid_lands_as_in_a_finer_run_and_gains_no_energy():
    coarse, energies = landing(20)
    fine, _ = landing(60)
    assert np.linalg.norm(coarse - fine, axis=1).max() < 2e-3
    assert np.diff(energies).max() < 1e-3 * energies[0]
    assert energies[-1] < 0.8 * energies[0]


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_an_arm_that_lies_on_the_floor_is_borne_by_it(precision):
    """Two links and a loose ball come to rest; the floor's impulses in a substep are their weight. Contacts are overdamped:
    what is left of their speed after 2 s is 2e-4 m/s."""
    scene = Scene(fps=60, substeps=4, coordinates="reduced")
    scene.collider("/floor", Plane())
    first = scene.body("/a", Box((0.2, 0.02, 0.05)), at=(0.0, 0.03, 0.0))
    second = scene.body("/b", Box((0.2, 0.02, 0.05)), at=(0.45, 0.03, 0.0))
    scene.joint("revolute", "/hinge", first, second, at=(0.225, 0.03, 0.0), axis=(0, 0, 1))
    scene.body("/ball", Sphere(0.05), at=(0.0, 0.06, 0.5))
    simulation = wsim.Simulation(scene, device="cpu", precision=precision)
    simulation.run(120)
    method, _ = trees_of(simulation)
    assert np.abs(method.velocities()).max() < 1e-3
    pushed = method.contacts.list.push.numpy().reshape(-1, 4)[:method.contacts.room]
    count = method.contacts.list.count.numpy()
    borne = pushed[np.arange(4)[None] < count[:, None]].sum()
    weight = 9.81 * sum(m.mass for m in method.masses) / 240.0
    assert borne == pytest.approx(weight, rel=2e-3)


@pytest.mark.parametrize("angle", [20.0, 30.0])
def test_a_hinged_pair_slides_on_a_slope_or_holds(angle):
    """With mu = 0.5 a slope of 20 degrees holds, and on one of 30 it slides with g (sin - mu cos)."""
    mu, tilt = 0.5, np.radians(angle)
    scene = Scene(fps=60, substeps=8, coordinates="reduced", gravity=(9.81 * np.sin(tilt), -9.81 * np.cos(tilt), 0.0))
    scene.collider("/floor", Plane(), static_friction=mu, dynamic_friction=mu)
    first = scene.body("/a", Box((0.2, 0.02, 0.05)), at=(0.0, 0.02, 0.0), static_friction=mu, dynamic_friction=mu)
    second = scene.body("/b", Box((0.2, 0.02, 0.05)), at=(0.45, 0.02, 0.0), static_friction=mu, dynamic_friction=mu)
    scene.joint("revolute", "/hinge", first, second, at=(0.225, 0.02, 0.0), axis=(0, 1, 0))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(60)
    speed = trees_of(simulation)[0].velocities()[:, 0]
    exact = max(0.0, 9.81 * (np.sin(tilt) - mu * np.cos(tilt)))
    assert np.abs(speed - exact).max() < 0.01 * max(exact, 0.1)


def test_drives_that_follow_curves_read_no_row_beyond_those_of_the_frame():
    """A slider with a stiff drive lies on a floor. Behind the table of its targets there are no numbers."""
    ends, whole = [], {}
    for beyond in (0.0, np.nan):
        scene = Scene(fps=20, substeps=4, coordinates="reduced")
        scene.collider("/floor", Plane())
        body = scene.body("/b", Box((0.1, 0.1, 0.1)), at=(0.0, 0.1, 0.0))
        scene.joint("prismatic", "/rail", None, body, at=(0.0, 0.1, 0.0), axis=(1, 0, 0), drives={"transX": Drive(4e5, 4e2)})
        scene.varying.append(Varying("/rail", "target", WAY))
        simulation = wsim.Simulation(scene, device="cpu", precision="float64")
        simulation.load()
        linked = trees_of(simulation)[1].linked
        t = linked.t
        for name in ("aim", "pace"):
            whole[name] = wp.full((6, 1, 6), beyond, dtype=wp.float64, device="cpu")
            setattr(t, name, whole[name][:5])
        t.aiming, linked.t = 1, t
        simulation.run(3)
        ends.append(simulation.poses()["/b"])
    assert np.isfinite(ends[1]).all() and np.array_equal(*ends)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0.6, 0.8)])
@pytest.mark.parametrize("shape", [Box((0.1, 0.1, 0.1)), Sphere(0.1)])
def test_a_slider_that_its_rail_holds_is_not_pushed_by_what_it_touches(axis, shape):
    """It touches a floor, across or along its rail; along the floor friction of what bears nothing is 0: v = a t."""
    scene = Scene(fps=60, substeps=4, coordinates="reduced", gravity=(1.0, -9.81, 0.0))
    scene.collider("/floor", Plane())
    body = scene.body("/b", shape, at=(0.0, 0.1, 0.0))
    scene.joint("prismatic", "/rail", None, body, at=(0.0, 0.1, 0.0), axis=axis)
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(30)
    place = simulation.poses()["/b"][:3, 3]
    expected = (0.125, 0.1, 0.0) if axis[0] else (0.0, 0.1, 0.0)
    assert place == pytest.approx(expected, abs=2e-3)
