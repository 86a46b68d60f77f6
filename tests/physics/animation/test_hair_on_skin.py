"""Hair that grows from a mesh which a skeleton moves: roots stay where UsdSkel has the skin, edges turn with its faces; what is
given in Python comes back from USD; what cannot be is refused in one line."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.physics.animation.lying import lying_cube
from tests.physics.animation.make import bones, skin
from wsim.physics.animation.objects import Follow, Skeleton, Skinned
from wsim.physics.rods.objects import Rods
from wsim.scene import Scene, SceneError, Sphere, Surface, shapes
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation


def hairy(skeleton: Skeleton, skinned: Skinned, counts, indices, number: int = 12, **more) -> tuple[Scene, Rods]:
    scene = Scene(fps=24.0, frames=3, substeps=2, gravity=(0.0, 0.0, 0.0))
    scene.add(skeleton)
    body = scene.collider("/man/body", Surface(skinned.at(0.0), counts, indices, poses=skinned), motion=skeleton.motion)
    return scene, scene.hair("/hair", body, number, 0.05, diameters=0.001, young=1e8, **more)


def test_hair_on_a_rigid_part_goes_with_its_joint():
    """Without gravity and without mass to speak of, each strand moves as the joint does: x(t) = M(t) M(0)^-1 x(0)."""
    skeleton, skinned, counts, indices = lying_cube()
    scene, hair = hairy(skeleton, skinned, counts, indices, density=1.0)
    simulation = Simulation(scene, device="cpu")
    joint, start = skeleton.joint_motion("hip"), hair.points.copy()
    for _ in range(3):
        simulation.step()
        M = joint.at(simulation.frame / scene.fps) @ np.linalg.inv(joint.at(0.0))
        x = simulation.samples()[0].positions.reshape(12, 9, 3)
        expected = (start @ M[:3, :3].T + M[:3, 3]).reshape(12, 9, 3)
        assert np.abs(x - expected)[:, :2].max() < 1e-12                        # the clamped edge, to rounding
        assert np.abs(x - expected).max() < 2e-3                                # the rest bends a little, as it is flung


def test_roots_stay_on_skin_that_deforms():
    rng = np.random.default_rng(3)
    points, counts, indices = shapes.sphere(0.3, 12)
    skeleton = bones(rng)
    skinned = skin(rng, skeleton, points, m=2)
    scene, hair = hairy(skeleton, skinned, counts, indices)
    follow = hair.pins[0].follows
    simulation = Simulation(scene, device="cpu")
    simulation.run(2)
    x = simulation.samples()[0].positions.reshape(12, 9, 3)
    roots = follow.over(np.array([simulation.frame / scene.fps]))[0][::2]
    assert np.abs(x[:, 0] - roots).max() < 1e-12
    assert np.abs(np.linalg.norm(x[:, 1] - x[:, 0], axis=1) - 0.05 / 8).max() < 1e-12    # turned, not stretched


def test_it_comes_back_from_usd_and_runs_alike(tmp_path):
    scene, hair = hairy(*lying_cube())
    wsim.save(scene, tmp_path / "s.usda")
    again = wsim.load(tmp_path / "s.usda")
    pin, back = hair.pins[0], again.things("Rods")[0].pins[0]
    assert back.target == "/man/body" and np.array_equal(pin.points, back.points)
    assert np.array_equal(pin.follows.faces, back.follows.faces)
    assert np.abs(pin.follows.places - back.follows.places).max() < 1e-6
    one, two = (Simulation(each, device="cpu") for each in (scene, again))
    one.run(2), two.run(2)
    assert np.abs(one.samples()[0].positions - two.samples()[0].positions).max() < 1e-5


def test_two_runs_and_a_delayed_scene():
    from wsim.cli.run import delay_scene_curves
    scene, _ = hairy(*lying_cube())
    found = []
    for each in (scene, scene, delay_scene_curves(scene, 1.0 / 24.0)):
        simulation = Simulation(each, device="cpu")
        simulation.run(2)
        found.append(simulation.samples()[0].positions.reshape(12, 9, 3))
    assert np.array_equal(found[0], found[1])
    simulation = Simulation(scene, device="cpu")
    simulation.run(1)
    assert np.abs(found[2][:, 0] - simulation.samples()[0].positions.reshape(12, 9, 3)[:, 0]).max() < 1e-12


@pytest.mark.parametrize("number", [1, 7, 400])
def test_strands_are_spread_evenly_and_stand_on_a_ball(number):
    points, counts = shapes.grow_strands(*shapes.sphere(0.5, 48), number, 0.1, 4)
    strands = points.reshape(number, 5, 3)
    assert (counts == 5).all() and np.allclose(np.linalg.norm(strands[:, 4] - strands[:, 0], axis=1), 0.1)
    assert (np.linalg.norm(strands[:, 4], axis=1) > 0.59).all()
    if number == 400:
        assert np.abs(strands[:, 0].mean(axis=0)).max() < 0.02
        assert abs(np.count_nonzero(strands[:, 0, 2] > 0.25) - 100) < 8          # Archimedes: a quarter of the area


def test_hair_grows_on_a_shape_too_and_turns_with_it():
    scene = Scene(fps=24.0, substeps=2)
    times = np.array([0.0, 0.2])
    turn = Motion.through(times, np.zeros((2, 3)), [(0, 0, 0, 1), (0, 0, np.sin(0.5), np.cos(0.5))])
    hair = scene.hair("/hair", scene.collider("/ball", Sphere(0.1), motion=turn), 9, 0.05, diameters=0.001)
    assert hair.pins[0].motion is turn and hair.pins[0].target == "/ball"
    first = hair.points.reshape(9, 9, 3)[:, 0]
    simulation = Simulation(scene, device="cpu")
    simulation.run(2)
    M = turn.at(2 / 24)
    assert np.abs(simulation.samples()[0].positions.reshape(9, 9, 3)[:, 0] - first @ M[:3, :3].T).max() < 1e-12


def test_what_cannot_be_is_said_in_one_line():
    skeleton, skinned, counts, indices = lying_cube()
    scene, hair = hairy(skeleton, skinned, counts, indices)
    pin = hair.pins[0]
    hair.pins[0] = replace(pin, follows=Follow.at_points(skinned, pin.follows.corners[:, 0]))
    with pytest.raises(SceneError, match="holds strands at points of skin.*allowed: faces; fix: author physics:type1"):
        Simulation(scene, device="cpu")
    poses = Curve([0.0, 1.0], np.stack(2 * [skinned.points]))
    waves = scene.collider("/waves", Surface(skinned.points, counts, indices, poses=poses))
    with pytest.raises(SceneError, match="/waves, whose points are animated; allowed are .*; fix: skin it"):
        scene.hair("/more", waves, 3, 0.1)
    with pytest.raises(SceneError, match=r"/more: cannot grow on /man/body: where is true of 0 of \d+ triangles"):
        scene.hair("/more", scene.colliders[0], 3, 0.1, where=lambda x: x[:, 1] > 9.0)
    with pytest.raises(SceneError, match="cannot grow on /man/body: length is -1; it must be finite and > 0"):
        scene.hair("/more", scene.colliders[0], 3, -1.0)
