"""Counts of contacts, joints, sources and particles, from which a frame's time is said: of scenes in which they are known."""

from collections import Counter

import numpy as np

from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Plane, Scene, Sphere
from wsim.simulation.predicted.scene_counts import count_liquids, count_rigid, count_smoke, longest_chain
from wsim.simulation.simulation import Simulation


def stack(n: int) -> Scene:
    scene = Scene()
    scene.collider("/floor", Plane())
    for k in range(n):
        scene.body(f"/box{k}", Box((0.1, 0.1, 0.1)), at=(0.0, 0.1 + 0.2 * k, 0.0))
    return scene


def test_a_stack_of_boxes_touches_at_four_corners_a_box():
    assert count_rigid(stack(3), 1, False)["contact"] == 12 and count_rigid(stack(9), 1, False)["contact"] == 36
    apart = Scene()
    apart.body("/ball", Sphere(0.1), at=(0, 5, 0))
    assert count_rigid(apart, 1, False) == {"rigid": 1, "contact": 2, "joint": 0} and count_rigid(Scene(), 1, False) == {}


def test_bodies_without_shapes_touch_nothing():
    scene = Scene()
    scene.add(Body("/point", [], mass=1.0, center=np.zeros(3), inertia=np.ones(3)))
    assert count_rigid(scene, 1, False) == {"rigid": 1, "contact": 2, "joint": 0}
    Simulation(scene, device="cpu").step()


def test_a_chain_counts_as_long_as_it_is():
    scene = stack(6)
    for k, (a, b) in enumerate(((0, 1), (1, 2), (3, 4))):
        scene.joint("revolute", f"/joint{k}", f"/box{a}", f"/box{b}", at=(0, 0.2 * (a + 1), 0))
    scene.joint("fixed", "/wall", None, "/box5", at=(0, 1.1, 0))
    joints = scene.things("Joint")
    assert longest_chain(joints) == 2
    assert count_rigid(scene, 1, True)["joint"] == 2 and count_rigid(scene, 1, False)["joint"] == 4


def test_fluids_count_their_sources_and_particles():
    """A tank of 10 cells a side, half full: 500 cells with eight particles each, as a lattice estimates."""
    scene = Scene()
    air = scene.smoke("/air", (2, 0, 0), (3, 1, 1), 0.1)
    tank = scene.liquid("/tank", (0, 0, 0), (1, 1, 1), 0.1)
    scene.liquid_source("/water", tank, Box((0.5, 0.25, 0.5)), at=(0.5, 0.25, 0.5))
    for k in range(3):
        scene.smoke_source(f"/s{k}", air, Sphere(0.1), at=(2.5, 0.5, 0.5), smoke=1.0)
    found = Counter(count_smoke(scene, 1, False)) + Counter(count_liquids(scene, 1, False))
    assert found["grid"] == 2 and found["cell"] == 2000 and found["emitted"] == 3000 and found["tank"] == 1
    assert np.isclose(found["drop"], 4000, rtol=0.02)


def test_what_is_said_grows_with_contacts_and_sources():
    scenes = [stack(2), stack(12)]
    for sources in (1, 30):
        scene = Scene()
        air = scene.smoke("/air", (0, 0, 0), (1, 1, 1), 0.05)
        for k in range(sources):
            scene.smoke_source(f"/s{k}", air, Sphere(0.1), at=(0.5, 0.5, 0.5), smoke=1.0)
        scenes.append(scene)
    said = [Simulation(scene, device="cpu").plan.seconds for scene in scenes]
    assert said[1] > 2.0 * said[0] and said[3] > 1.1 * said[2]
