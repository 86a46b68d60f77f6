"""The head of a plan in words: substeps where something takes them."""

import numpy as np
import pytest

import wsim


def rope(scene):
    scene.rods("/rope", np.stack([np.linspace(0.0, 0.4, 5), np.ones(5), np.zeros(5)], axis=1), counts=[5], diameters=0.01)


SCENES = {
    "smoke": (lambda s: s.smoke("/air", (0, 0, 0), (1, 1, 1), 0.25), False),
    "sand": (lambda s: s.mpm("/heap", wsim.Box((0.1, 0.1, 0.1)), material="sand"), False),
    "rods": (rope, True),
    "bodies": (lambda s: s.body("/ball", wsim.Sphere(0.1)), True),
    "cloth": (lambda s: s.cloth("/cloth", *wsim.shapes.sheet(1.0, 1.0, 2, 2)), True),
}


@pytest.mark.parametrize("what", SCENES)
def test_substeps_are_named_where_something_takes_them(what):
    fill, substeps = SCENES[what]
    scene = wsim.Scene(frames=1)
    fill(scene)
    head = wsim.Simulation(scene, device="cpu").plan.describe().splitlines()[1]
    assert ("substeps of" in head) == substeps and ("steps of their own" in head) != substeps


def test_rigid_bodies_are_counted_and_no_solver_of_points_is_named():
    scene = wsim.Scene(frames=1)
    scene.joint("revolute", "/hinge", None, scene.body("/arm", wsim.Box((0.1, 0.1, 0.1))))
    first, second = wsim.Simulation(scene, device="cpu").plan.describe().splitlines()[:2]
    assert first.startswith("1 body, 1 joint, 1 world, ") and "solver" not in second
