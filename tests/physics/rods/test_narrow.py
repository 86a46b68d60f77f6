"""Colliders narrower than points of strands are apart: strands meet them by their points, which is told."""

import re

import numpy as np
import pytest

from tests.physics.rods.rig import scene, simulated
from wsim.geometry import primitives
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Collider, Motion, Plane, Sphere, Surface
from wsim.scene.check.narrow import half_width
from wsim.scene.check.scene import check
from wsim.scene.solids import Capsule, Cylinder


def laid(points: int, shape=None):
    """A metre of rope over a ball of 6 cm, that stands between the sixth and the seventh of eleven points."""
    x = np.zeros((points, 3))
    x[:, 0], x[:, 1] = np.linspace(-0.55, 0.45, points), 0.08
    made, rods = scene(x, gravity=(0.0, -9.81, 0.0), young=1e6)
    made.substeps = 4
    if shape is not None:
        made.collider("/ball", shape)
    return made


def told(made) -> list[str]:
    return [p.text for p in check(made) if "by their points" in p.text]


def test_a_ball_passes_between_points_and_is_told_and_not_between_as_many_as_that_asks_for():
    made = laid(11, Sphere(0.03))
    simulation, method = simulated(made)
    simulation.run(20)
    assert method.points(0)[0][:, 1].max() < -0.2                                        # it has fallen past
    said, = [w for w in simulation.warnings if "by their points" in w]
    assert "/rod" in said and "/ball" in said and "points 5 and 6 are 0.1 m apart" in said
    apart = float(re.search(r"points less than ([\d.e-]+) m apart", said)[1])
    assert apart == pytest.approx(2.0 * (0.03 + 0.01))                                   # the ball and the rope
    finer = laid(int(np.ceil(1.0 / apart)) + 1, Sphere(0.03))
    assert not told(finer)
    simulation, method = simulated(finer)
    simulation.run(20)
    assert method.points(0)[0][:, 1].max() > 0.03                                        # it hangs over the ball


def test_a_thickness_is_part_of_what_points_meet():
    made = laid(11)
    made.collider("/ball", Sphere(0.03), thickness=0.015)
    assert not told(made)
    made.colliders[0].thickness = 0.005
    assert told(made)


def test_rigid_bodies_are_met_by_edges_and_not_told():
    made = laid(11)
    made.add(Body("/body", [Collider("/body/ball", Sphere(0.03), motion=Motion.still(np.eye(4)))],
                  Motion.at_place((0.0, 0.5, 0.0))))
    assert not told(made)


def mesh(outline) -> Surface:
    points, triangles = outline
    return Surface(np.asarray(points, np.float32), np.full(len(triangles), 3), np.asarray(triangles).ravel())


@pytest.mark.parametrize("shape, expected, error", [
    (Sphere(0.03), 0.03, 1e-9), (Box((0.2, 0.1, 0.004)), 0.004, 1e-9), (Capsule(0.02, 0.3), 0.02, 1e-9),
    (Cylinder(0.1, 0.01), 0.01, 1e-9), (Plane(), np.inf, 0.0),
    (mesh(primitives.sphere(1.0, 64)), 1.0, 0.05), (mesh(primitives.cylinder(0.1, 0.1, 0.01, 32)), 0.01, 1e-5),
    (mesh(primitives.capsule(0.02, 0.02, 0.3, 64)), 0.02, 0.05), (mesh(primitives.box((0.2, 0.1, 0.004))), 0.004, 1e-5)],
    ids=["sphere", "box", "capsule", "cylinder", "plane", "ball", "disc", "rod", "plate"])
def test_half_of_the_least_width(shape, expected, error):
    """Of meshes by their corners: balls of 64 sides have theirs on the ball, and their faces within 0.5 % of its normals."""
    made = Collider("/shape", shape, motion=Motion.at_place((5.0, 1.0, 0.0)))
    assert half_width(made) == pytest.approx(expected, rel=error)
    assert half_width(made, 2.5 * expected) == half_width(made)                          # what is below half of a reach


def test_a_mesh_that_is_wound_inward_is_as_wide():
    points, triangles = primitives.box((0.2, 0.1, 0.004))
    there = [half_width(Collider("/shape", mesh((points, f)), motion=Motion.still(np.eye(4))))
             for f in (np.asarray(triangles), np.asarray(triangles)[:, ::-1])]
    assert there[0] == there[1]
