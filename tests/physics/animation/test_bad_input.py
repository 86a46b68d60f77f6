"""What is wrong with a skeleton is one line by prim path, with the mend."""

import numpy as np
import pytest

import wsim
from tests.make.usd.prims.skeleton import BOUND, COLLIDES, RISES, character, mesh
from tests.make.usda import Reader, cloth, errors
from tests.physics.animation.make import bones, scene_of, skin
from wsim.physics.animation.objects import Follow, Skeleton
from wsim.scene import Scene, SceneError, shapes
from wsim.scene.check.scene import check_scene

IDENTITY = "( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )"
FLAT = "( (1, 0, 0, 0), (0, 0, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )"
TURN = "quatf[] rotations = [(1, 0, 0, 0)]"


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


def made() -> Scene:
    rng = np.random.default_rng(2)
    points, counts, indices = shapes.sphere(0.3, 8)
    return scene_of(skin(rng, bones(rng), points), counts, indices)


def said(scene: Scene) -> str:
    return "\n".join(map(str, check_scene(scene)))


def test_the_scene_that_the_others_break_is_sound():
    assert not [p for p in check_scene(made()) if "/man" in p.path]


def test_a_ring_of_joints_is_named():
    scene = made()
    scene.things("Skeleton")[0].parents = np.array([2, 0, 1, 0])
    assert ("error: /man/bones: joints hang on each other in a ring: hip < hip/knee/foot < hip/knee < hip; allowed: a tree; "
            "fix: give one of them the parent -1") in said(scene)
    with pytest.raises(SceneError, match="in a ring"):
        wsim.Simulation(scene, device="cpu")


@pytest.mark.parametrize(("name", "value", "words"), [
    ("parents", np.array([-1, 9, 0, 0]), "the parent of hip/knee is joint 9"),
    ("rotations", np.zeros((3, 4, 4)), "a rotation of length 0"),
    ("translations", np.full((3, 4, 3), np.nan), "translations hold NaN or infinity"),
    ("times", np.array([0.0, 0.2, 0.2]), "its key times do not increase"),
    ("bind", np.zeros((4, 4, 4)) + np.diag([1.0, 0.0, 1.0, 1.0]), "the bind transform of hip flattens space"),
    ("joints", ("a", "b", "a", "c"), "two joints are named a"),
    ("scales", np.ones((2, 4, 3)), "scales of shape (2, 4, 3)"),
    ("bodies", {"hip": "/nobody"}, "joint hip is driven by /nobody, which is no rigid body here")])
def test_what_is_wrong_with_a_skeleton(name, value, words):
    scene = made()
    setattr(scene.things("Skeleton")[0], name, value)
    assert f"error: /man/bones: {words}" in said(scene) and "fix: " in said(scene)


def test_quaternions_that_are_not_unit_are_divided_by_their_length_with_a_warning():
    scene = made()
    skinned = scene.colliders[0].shape.poses
    before = skinned.over(np.array([0.0, 0.03]))
    skinned.skeleton.rotations = 1.5 * skinned.skeleton.rotations
    assert "warning: /man/bones: quaternions of length 1.5 to 1.5, which are divided by it" in said(scene)
    np.testing.assert_allclose(skinned.over(np.array([0.0, 0.03])), before, atol=1e-12)


def test_weights_that_do_not_sum_to_one_are_normalised_with_a_warning():
    scene = made()
    skinned = scene.colliders[0].shape.poses
    before = skinned.at(0.03)
    skinned.weights = 0.5 * skinned.weights
    assert "do not sum to 1 (of point 0 to 0.5): they are divided by their sum" in said(scene)
    np.testing.assert_allclose(skinned.at(0.03), before, atol=1e-12)
    skinned.weights[7] = 0.0
    assert "error: /man/body: the weights of 1 points sum to 0 or less, first of point 7" in said(scene)


@pytest.mark.parametrize(("name", "value", "words"), [
    ("geom", np.diag([1.0, 0.0, 1.0, 1.0]), "its geomBindTransform flattens it"),
    ("method", "cubic", "skinningMethod is 'cubic'; allowed: classicLinear or dualQuaternion")])
def test_what_is_wrong_with_a_skin(name, value, words):
    scene = made()
    setattr(scene.colliders[0].shape.poses, name, value)
    assert f"error: /man/body: {words}" in said(scene)


def test_a_joint_that_there_is_not():
    scene = made()
    scene.colliders[0].shape.poses.joints[3, 1] = 4
    assert "error: /man/body: a point follows joint 4; allowed: 0 to 3, joints of /man/bones" in said(scene)


def test_a_skeleton_that_was_not_added_and_a_motion_that_is_another():
    scene = made()
    scene.colliders[0].motion = wsim.scene.Motion.at_place((1.0, 0.0, 0.0))
    assert "/man/body: its points follow /man/bones, and its motion is another" in said(scene)
    scene.objects.pop("Skeleton")
    assert ("/man/body: it follows /man/bones, which is not in the scene; allowed: a skeleton of the scene; fix: add it"
            in said(scene))


def test_a_pin_with_too_few_places():
    scene = made()
    scene.pin("/man/pin", scene.cloths[0], [0, 1, 2], target="/man/body",
              follows=Follow.at_points(scene.colliders[0].shape.poses, [1, 2]))
    assert "error: /man/pin: 3 points and 2 places on the mesh that it follows" in said(scene)


def test_a_skeleton_and_its_mesh_without_a_common_prim_cannot_be_saved(tmp_path):
    scene = made()
    scene.colliders[0].path = "/body"
    with pytest.raises(SceneError, match="/man/bones and /body have no prim above them that can be a SkelRoot|SkelRoot"):
        wsim.save(scene, tmp_path / "a.usda")


# on a stage

def test_an_animation_that_is_named_and_not_there(read):
    text = cloth() + character(mesh(COLLIDES)).replace("animationSource = </char/walk>", "animationSource = </char/gone>")
    assert "/char/bones: names /char/gone as its animation, which is no SkelAnimation that can be read" in errors(read, text)


def test_a_skeleton_that_is_named_and_not_there(read):
    text = cloth() + character(mesh(COLLIDES)).replace("rel skel:skeleton = </char/bones>", "rel skel:skeleton = </char/gone>")
    assert "/char/skin: is bound to the skeleton /char/gone, which is none that can be read" in errors(read, text)


def test_a_joint_before_the_one_above_it(read):
    text = cloth() + character(mesh(COLLIDES)).replace('def Skeleton "bones"', 'def Skeleton "BONES"', 1).replace(
        'joints = ["hip"]', 'joints = ["hip/knee", "hip"]', 1).replace(f"[{IDENTITY}]", f"[{IDENTITY}, {IDENTITY}]").replace(
        '"BONES"', '"bones"')
    found = errors(read, text)
    assert "/char/bones: is no skeleton that USD can read" in found and "behind those above it" in found


def test_an_animation_of_joints_that_the_skeleton_lacks_is_warned_of(read):
    text = character(mesh(COLLIDES)).replace('"walk" {\n        uniform token[] joints = ["hip"]',
                                             '"walk" {\n        uniform token[] joints = ["hop"]')
    scene = read(cloth() + text)
    assert any("/char/walk: moves hop, which /char/bones does not have: 1 of its 1 joints move nothing" in str(note)
               for note in scene.notes)


def test_a_bind_pose_that_flattens(read):
    text = cloth() + character(mesh(COLLIDES)).replace(f"bindTransforms = [{IDENTITY}", f"bindTransforms = [{FLAT}")
    assert "/char/bones: the bind transform of hip flattens space; author one with an inverse" in errors(read, text)


def test_quaternions_of_another_length_are_warned_of(read):
    scene = read(cloth() + character(mesh(COLLIDES)).replace(TURN, TURN.replace("(1, 0, 0, 0)", "(2, 0, 0, 0)")))
    assert "/char/bones: quaternions of length 2 to 2, which are divided by it" in said(scene)
    np.testing.assert_allclose(scene.colliders[0].shape.poses.at(0.25), scene.cloths[0].points + (0.0, 0.25, 0.0), atol=1e-6)


def test_a_quaternion_of_length_zero(read):
    text = cloth() + character(mesh(COLLIDES)).replace(TURN, TURN.replace("(1, 0, 0, 0)", "(0, 0, 0, 0)"))
    assert "/char/walk: holds a rotation that is no quaternion (0, NaN or infinity)" in errors(read, text)


def test_a_joint_of_a_mesh_that_the_skeleton_lacks(read):
    text = cloth() + character(mesh(COLLIDES, BOUND + '\n    uniform token[] skel:joints = ["wing"]'))
    assert "/char/skin: is bound to joint wing, which /char/bones does not have" in errors(read, text)


def test_weights_of_a_stage_that_do_not_sum_to_one(read):
    scene = read(cloth() + character(mesh(COLLIDES, BOUND.replace("jointWeights = [1]", "jointWeights = [0.5]"))))
    assert "/char/skin: the weights of 4 points do not sum to 1 (of point 0 to 0.5)" in said(scene)
    np.testing.assert_allclose(scene.colliders[0].shape.poses.at(0.25), scene.cloths[0].points + (0.0, 0.25, 0.0), atol=1e-6)


def test_numbers_of_an_animation_that_do_not_fit(read):
    text = cloth() + character(mesh(COLLIDES)).replace("scales = [(1, 1, 1)]", "scales = [(1, 1, 1), (1, 1, 1)]")
    assert "/char/walk: has 1 joints and other numbers of translations, rotations or scales" in errors(read, text)


def test_an_attachment_to_a_face_that_the_mesh_does_not_have(read):
    from tests.make.physics.animation.usd import ATTACHED
    text = cloth() + character(mesh(COLLIDES), RISES) + ATTACHED.format("face", "[0, 7]", "")
    assert "/held: physics:indices1 holds 7; allowed is 0 to 1, faces of /char/skin" in errors(read, text)


def test_an_empty_skeleton():
    scene = Scene()
    scene.add(Skeleton("/s", (), np.zeros((0, 4, 4))))
    assert "error: /s: 0 joints; allowed: 1 to 65536" in said(scene)
