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
from wsim.kernels.rigid.soft_step import A2
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


@pytest.mark.parametrize("arm", [0.002, 0.005, 0.02])
def test_a_point_near_a_hinge_is_pushed_apart_with_the_energy_of_a_free_body(arm):
    """I w^2 = m u^2 with u^2 = 2 g R: the turn in a substep is h u sqrt(m / I) / (1 + 1 / a_2) for any arm; no speed stays."""
    radius, h = 0.1, 1.0 / 480.0
    scene = Scene(fps=480, substeps=1, coordinates="reduced")
    smooth = {"static_friction": 0.0, "dynamic_friction": 0.0}
    scene.collider("/wall", Box((1.0, 1.0, 0.1)), at=(0.0, 0.0, -0.15), **smooth)
    ball = scene.body("/ball", Sphere(radius), at=(arm, 0.0, 0.0), **smooth)
    scene.joint("revolute", "/hinge", None, ball, at=(0.0, 0.0, 0.0), axis=(0, 1, 0))
    simulation = wsim.Simulation(scene, device="cpu", precision="float64")
    simulation.run(1)
    turn = np.arcsin(np.abs(simulation.poses()["/ball"][0, 2]))
    exact = h * np.sqrt(2.0 * 9.81 * radius / (0.4 * radius**2 + arm**2)) / (1.0 + 1.0 / A2)
    assert turn == pytest.approx(exact, rel=1e-6)
    assert np.abs(trees_of(simulation)[0].spins()).max() < 1e-2 * exact / h


@pytest.mark.parametrize("size, precision", [(1e-3, "float32"), (1.0, "float64"), (1e3, "float32")])
def test_a_hinge_and_a_ball_that_start_inside_a_wall_keep_their_speeds(size, precision):
    """Boxes start 0.2 or 4 % of a size inside a wall or a floor. No body gets faster than a fall of five sizes."""
    for depth in (0.002, 0.04):
        for wall, at in ((Box((size, size, 0.1 * size)), (0.5, 0.0, depth - 0.13)), (Plane(), (0.0, depth - 0.02, 0.0))):
            scene = Scene(fps=60, substeps=8, coordinates="reduced", gravity=(0.0, -9.81 * size, 0.0))
            scene.collider("/wall", wall, at=size * np.array(at))
            links = [scene.body(f"/b{k}", Box((0.25 * size, 0.02 * size, 0.03 * size)), at=((0.25 + 0.5 * k) * size, 0, 0))
                     for k in range(2)]
            scene.joint("revolute", "/hinge", None, links[0], at=(0, 0, 0), axis=(0, 0.6, 0.8))
            scene.joint("spherical", "/socket", *links, at=(0.5 * size, 0, 0))
            simulation = wsim.Simulation(scene, device="cpu", precision=precision)
            for _ in simulation.frames(15):
                assert np.abs(trees_of(simulation)[0].velocities()).max() < np.sqrt(2.0 * 9.81 * 5.0) * size
