"""Mass, centre and inertia of shapes, meshes and bodies."""

import numpy as np
import pytest

from wsim.geometry import rotation
from wsim.physics.rigid.mass import body_inertia, shape_volume, sum_volumes
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Surface, shapes
from wsim.scene.curve import Motion
from wsim.scene.solids import Box, Capsule, Cone, Cylinder, Plane, Sphere

SHAPES = [(Box((0.5, 1.0, 1.5)), shapes.box((0.5, 1.0, 1.5))), (Sphere(0.7), shapes.sphere(0.7, 96)),
          (Cylinder(0.5, 1.0), shapes.cylinder(0.5, 1.0, 192)), (Cone(0.5, 1.0), shapes.cone(0.5, 1.0, 192)),
          (Capsule(0.5, 1.0), shapes.capsule(0.5, 1.0, 96))]


@pytest.mark.parametrize("shape, mesh", SHAPES)
def test_closed_forms_agree_with_the_mesh_of_the_same_shape(shape, mesh):
    """A mesh with chords of n segments on a circle lacks about (2 pi / n)^2 / 6 of its area."""
    found, of_mesh = shape_volume(shape), shape_volume(Surface(*mesh))
    assert abs(of_mesh.volume / found.volume - 1.0) < 3e-3
    assert np.abs(of_mesh.center - found.center).max() < 2e-3
    assert np.abs(of_mesh.inertia - found.inertia).max() < 6e-3 * found.inertia.max()


def test_the_mesh_of_a_box_is_exact_and_may_be_wound_inward_and_lie_anywhere():
    points, counts, indices = shapes.box((0.5, 1.0, 1.5))
    inward = indices.reshape(-1, counts[0])[:, ::-1].ravel()
    for at, faces in (((0.0, 0.0, 0.0), indices), ((3.0, -2.0, 1.0), inward)):
        found = shape_volume(Surface(points + np.array(at), counts, faces))
        assert abs(found.volume - 6.0) < 1e-6 and np.abs(found.center - at).max() < 1e-6
        assert np.abs(found.inertia - shape_volume(Box((0.5, 1.0, 1.5))).inertia).max() < 1e-5


def test_what_encloses_nothing_has_no_volume():
    assert shape_volume(Plane()).volume == 0.0
    assert shape_volume(Surface(*shapes.sheet(1.0, 1.0, 2, 2))).volume == 0.0


def test_two_boxes_are_one_box():
    """Parallel axes, and a turn: halves of a box, one turned half around."""
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = rotation.axis_rotation_matrix(np.array([0.0, 0.0, 1.0]), np.pi), (0.5, 0.0, 0.0)
    half = shape_volume(Box((0.5, 0.3, 0.2)))
    whole = sum_volumes([half.moved(M), half.moved(Motion.at_place((-0.5, 0.0, 0.0)).at(0.0))])
    assert np.abs(whole.inertia
                  - shape_volume(Box((1.0, 0.3, 0.2))).inertia).max() < 1e-15 and np.abs(whole.center).max() < 1e-15


def test_a_body_takes_its_mass_from_density_or_is_given_it():
    box = Collider("/b/box", Box((0.5, 1.0, 1.5)), Motion.at_place((1.0, 0.0, 0.0)))
    found = body_inertia(Body("/b", [box]))
    assert found.mass == 6000.0 and np.array_equal(found.center, (1.0, 0.0, 0.0))
    assert np.allclose(found.moments, 2000.0 * np.array([1.25, 2.5, 3.25]), rtol=1e-15)
    light = body_inertia(Body("/b", [box], mass=6.0))
    assert np.allclose(light.moments, found.moments / 1000.0, rtol=1e-14)
    moved = body_inertia(Body("/b", [box], mass=6.0, center=(0.0, 0.0, 0.0)))
    assert np.allclose(light.moments, (2.5, 5.0, 6.5), rtol=1e-14) and np.allclose(moved.moments, (6.5, 8.5, 11.0), rtol=1e-14)


def test_moments_ascend_along_axes_that_turn_with_them():
    given = Body("/b", mass=1.0, center=np.zeros(3), inertia=(3.0, 1.0, 2.0))
    found = body_inertia(given)
    R = rotation.quaternion_to_matrix(found.axes)
    assert np.array_equal(found.moments, (1.0, 2.0, 3.0))
    assert np.allclose(R @ np.diag(found.moments) @ R.T, np.diag([3.0, 1.0, 2.0]), atol=1e-15) and np.linalg.det(R) > 0.0
