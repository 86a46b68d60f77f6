"""Meshes of a soft body that are only seen: found, brought into its frame and its rest shape, saved beside it."""

import numpy as np
import pytest

from tests.make.usd.usda_soft import SOLID, body, place, skin
from tests.make.usda import Reader, cloth, notes
from wsim.scene import Scene, SceneError, Skin, Surface, shapes
from wsim.usd import save


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


def test_meshes_of_the_body_are_skins_in_the_frame_of_the_tets(read):
    """The skin hangs one unit above and is twice as large; both stand under the body's transform."""
    scene = read(body(skin() + skin("up", 'double3 xformOp:translate = (0, 0, 0.1)\ndouble3 xformOp:scale = (2, 2, 2)\nuniform '
                                          'token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]'),
                      place("double xformOp:rotateX", "90")), header="metersPerUnit = 0.01")
    look, up = scene.softs[0].skins
    assert (look.path, up.path) == ("/body/look", "/body/up") and look.counts.tolist() == [3]
    assert np.array_equal(look.points[1], np.float32([0.3, 0.1, 0.1]) * np.float32(0.01))
    assert np.allclose(up.points, (2 * look.points.astype(float) + (0, 0, 0.001)), rtol=0, atol=1e-9)
    assert [n.text for n in scene.notes if "follow" in n.text] == []


def test_a_skin_whose_transform_mirrors_is_turned_over(read):
    mirrored = skin("look", place("float3 xformOp:scale", "(-1, 1, 1)"))
    scene = read(body(mirrored + skin("left", 'token orientation = "leftHanded"')).replace("(0.1, 0.3", "(-0.1, 0.3"))
    assert [s.indices.tolist() for s in scene.softs[0].skins] == [[2, 1, 0], [2, 1, 0]]


def test_skins_are_read_where_they_are_bound_and_go_to_the_rest_shape(read):
    """Rest is twice the bind pose, so the skin's points there are twice as well. Samples in time say nothing of the pose."""
    rest = "point3f[] physics:restShapePoints = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (2, 2, 2)]"
    look = skin(extra="point3f[] points.timeSamples = {0: [(9, 9, 9), (9, 9, 9), (9, 9, 9)]}")
    points = read(body(look).replace(SOLID, f"{SOLID}\n{rest}")).softs[0].skins[0].points
    assert np.allclose(points, 2 * np.array([(0.1, 0.1, 0.1), (0.3, 0.1, 0.1), (0.1, 0.3, 0.1)]), rtol=0, atol=1e-7)


def test_a_pose_says_where_a_skin_is_bound(read):
    pose = ('uniform token[] physics:deformablePose:tied:purposes = ["bindPose"]\n'
            "point3f[] physics:deformablePose:tied:points = [(0, 0, 0), (0.5, 0, 0), (0, 0.5, 0)]")
    scene = read(body(skin(extra=pose, apis='prepend apiSchemas = ["PhysicsDeformablePoseAPI:tied"]')))
    assert scene.softs[0].skins[0].points[1].tolist() == [0.5, 0.0, 0.0]


def test_what_lies_in_the_body_and_is_no_skin_is_noted(read):
    """A nested body is its own; a collision mesh is stood for by the tets; an instance cannot be written over."""
    scene = read(body(skin("hull", apis='prepend apiSchemas = ["PhysicsCollisionAPI"]') + cloth() + 'def Points "dust" {}\n'
                      + 'def Xform "copy" (instanceable = true\nprepend references = </asset>) {}\n' + skin("bare").replace(
                          "int[] faceVertexCounts = [3]", "")) + f'class Xform "asset" {{\n{skin()}}}\n')
    assert scene.softs[0].skins == [] and [c.path for c in scene.cloths] == ["/body/cloth"] and scene.colliders == []
    found = notes(scene)
    for said in ("/body/hull: lies in the deformable body /body and does not follow it: it has PhysicsCollisionAPI",
                 "/body/dust: lies in", "/body/copy/look: lies in", "/body/bare: lies in the deformable body /body and has no"):
        assert said in found
    assert "/body/cloth" not in found.replace("/body/cloth: no physics material", "")


@pytest.mark.parametrize("skins, said", [
    ([Skin("/look", np.zeros((3, 3)), [3], [0, 1, 2])], "/look: must lie beside /sim"),
    ([Skin("/sim/look", np.zeros((3, 3)), [3], [0, 1, 2])], "/sim/look: lies below /sim, which is geometry"),
    ([Skin("/sim/look", np.zeros((3, 3)))], "/sim/look: has no faces; give counts and indices")])
def test_skins_that_no_stage_can_hold_are_not_saved(tmp_path, skins, said):
    scene = Scene()
    scene.soft("/sim", *shapes.block((1, 1, 1), 4), skins=skins)
    with pytest.raises(SceneError) as error:
        save(scene, tmp_path / "s.usda")
    assert said in str(error.value) and list(tmp_path.iterdir()) == []


def test_bodies_and_mesh_colliders_that_a_body_would_take_in_are_not_saved(tmp_path):
    scene, faces = Scene(), (np.eye(3), [3], [0, 1, 2])
    for name in "ab":
        look = Skin(f"/World/skin_{name}", np.eye(3) / 9, *faces[1:])
        scene.soft(f"/World/{name}", *shapes.block((1, 1, 1), 4), skins=[look])
    scene.collider("/World/wall", Surface(*faces))
    with pytest.raises(SceneError) as error:
        save(scene, tmp_path / "s.usda")
    assert "/World/b: and /World/a both have skins below /World" in str(error.value)
    assert "/World/wall: is a mesh collider below /World" in str(error.value)


