"""Skeletons through USD: what is written is read back, and what UsdSkel and we make of it is the same."""

import numpy as np
import pytest
from pxr import Usd, UsdSkel

import wsim
from tests.make.physics.animation.usd import ATTACHED
from tests.make.usd.prims.skeleton import BOUND, COLLIDES, character, mesh
from tests.make.usda import Reader, cloth, notes
from tests.physics.animation.make import CHARACTERS, JOINTS, bones, lump, scene_of, skin, theirs, worn
from wsim.physics.animation.objects import DUAL, LINEAR, BlendShape, Follow, Skeleton, Skinned
from wsim.scene import Scene, shapes
from wsim.scene.curve import Curve, Motion
from wsim.scene.methods import other_objects


@pytest.fixture
def read(tmp_path):
    return Reader(tmp_path)


def standing() -> Motion:
    M = np.tile(np.eye(4), (2, 1, 1))
    M[1, :3, 3] = (0.5, 0.0, 0.0)
    return Motion(np.array([0.0, 0.25]), M)


def full(method: str = LINEAR) -> tuple[Scene, Skinned]:
    """A scene with all that a skeleton has."""
    rng = np.random.default_rng(5)
    points, counts, indices = shapes.sphere(0.3, 8)
    skeleton = bones(rng)
    skeleton.motion, skeleton.stretch = standing(), np.diag([2.0, 1.0, 1.0])
    skeleton.shapes, skeleton.weights = ("grow",), Curve(np.array([0.0, 0.1]), np.array([[0.0], [1.0]]))
    grow = BlendShape("grow", np.arange(6), 0.05 * rng.normal(size=(2, 6, 3)), [0.5, 1.0])
    geom = np.eye(4)
    geom[:3, 3] = (0.1, 0.2, 0.3)
    skinned = skin(rng, skeleton, points, method=method, blends=[grow, lump(rng)])
    skinned.geom = geom
    scene = scene_of(skinned, counts, indices)
    scene.pin("/man/pins", scene.cloths[0], [0, 1, 2], target="/man/body",
              follows=Follow.at_points(skinned, [3, 4, 5]))
    return scene, skinned


@pytest.mark.parametrize("ending", ["usda", "usdc"])
def test_a_saved_scene_is_read_back_equal(tmp_path, ending):
    scene, _ = full()
    wsim.save(scene, tmp_path / f"a.{ending}")
    first = wsim.load(tmp_path / f"a.{ending}")
    wsim.save(first, tmp_path / f"b.{ending}")
    found = wsim.load(tmp_path / f"b.{ending}")
    assert found == first and not notes(first)
    a, b = scene.colliders[0].shape.poses, first.colliders[0].shape.poses
    assert [s.name for s in b.blends] == ["grow", "lump"] and b.blends[1].joint == 1 and b.skeleton.joints == JOINTS
    for t in (0.0, 0.03, 0.1, 0.2):
        np.testing.assert_allclose(b.at(t), a.at(t), atol=1e-6)
        held = [s.pins[0].follows.over(np.array([t])) for s in (first, scene)]
        np.testing.assert_allclose(*held, atol=1e-6)
    assert found.colliders[0].shape.poses.skeleton is found.things("Skeleton")[0] is found.pins[0].follows.skin.skeleton


@pytest.mark.parametrize("method", [LINEAR, DUAL])
def test_usd_skins_what_was_saved_as_we_do(tmp_path, method):
    """Without corrective shapes, which UsdSkel does not know."""
    scene, skinned = full(method)
    skinned.blends, skinned.skeleton.weights, skinned.skeleton.shapes = [], None, ()
    file = tmp_path / "a.usda"
    wsim.save(scene, file)
    codes = np.array([0.0, 1.0, 1.37, 4.0])
    for code, their in zip(codes, theirs(file, "/man/body", codes), strict=True):
        t = code / scene.fps
        ours = skinned.skeleton.motion.points(skinned.at(t), t)
        np.testing.assert_allclose(ours, their, rtol=0, atol=1e-5)


def test_blend_shapes_saved_are_those_of_usd(tmp_path):
    scene, skinned = full()
    file = tmp_path / "a.usda"
    wsim.save(scene, file)
    stage = Usd.Stage.Open(str(file))
    shapes_ = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(stage.GetPrimAtPath("/man/body")))
    from wsim.physics.animation.skinning import part_weights
    for weight in (-0.2, 0.0, 0.3, 0.5, 0.8, 1.0, 1.3):
        values, _, subs = shapes_.ComputeSubShapeWeights([weight, 0.0])
        found = {shapes_.GetInbetween(s).GetWeight() if shapes_.GetInbetween(s) else 1.0: v
                 for s, v in zip(subs, values, strict=True) if shapes_.GetBlendShapeIndex(s) == 0}
        want = dict(zip((0.5, 1.0), part_weights(skinned.blends[0], np.array([weight]))[0].tolist(), strict=True))
        assert all(abs(found.get(k, 0.0) - w) < 1e-6 for k, w in want.items()), weight


@pytest.mark.parametrize("asset", CHARACTERS)
def test_a_loaded_character_is_saved_and_read_back(tmp_path, asset):
    file, path = worn(tmp_path, asset, LINEAR)
    first = wsim.load(file)
    first.source = None
    wsim.save(first, tmp_path / "again.usdc")
    second = wsim.load(tmp_path / "again.usdc")
    a, b = (next(c for c in s.colliders if c.path == path) for s in (first, second))
    for t in (0.0, 0.1, 0.33):
        size = np.ptp(a.shape.points, axis=0).max()
        np.testing.assert_allclose(b.motion.points(b.shape.poses.at(t), t), a.motion.points(a.shape.poses.at(t), t),
                                   atol=1e-6 * size)


def test_a_skeleton_that_nothing_follows_is_not_in_the_scene(read):
    scene = read(cloth() + character(mesh('prepend apiSchemas = ["SkelBindingAPI"]')))
    assert not other_objects(scene) and not scene.colliders


def test_joints_are_found_by_name_whatever_the_order_of_animation_and_mesh(read):
    """The animation names (b, a), the mesh (b) alone: its index 0 is joint b."""
    text = character(mesh(COLLIDES, BOUND + '\n    uniform token[] skel:joints = ["hip/b"]')).replace(
        'joints = ["hip"]', 'joints = ["hip", "hip/b"]', 1).replace('joints = ["hip"]', 'joints = ["hip/b", "hip"]')
    one = "( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )"
    text = text.replace(f"[{one}]", f"[{one}, {one}]").replace("[(0, 0, 0)]", "[(0, 0, 0), (0, 0, 0)]").replace(
        "[(0, 0.5, 0)]", "[(0, 0.5, 0), (0.25, 0, 0)]").replace("[(1, 0, 0, 0)]", "[(1, 0, 0, 0), (1, 0, 0, 0)]").replace(
        "[(1, 1, 1)]", "[(1, 1, 1), (1, 1, 1)]")
    scene = read(cloth() + text)
    (collider,) = scene.colliders
    np.testing.assert_allclose(collider.shape.poses.at(0.5) - collider.shape.poses.at(0.0),
                               np.tile([0.25, 0.5, 0.0], (4, 1)), atol=1e-6)


def test_an_instanced_skeleton_moves_its_own_mesh(read):
    prototype = character(mesh(COLLIDES)).replace('def SkelRoot "char"', 'class SkelRoot "char"')
    text = prototype + "".join(f'def SkelRoot "one{k}" (instanceable = true\n references = </char>) '
                               f'{{ double3 xformOp:translate = ({k}, 0, 0)\n'
                               'uniform token[] xformOpOrder = ["xformOp:translate"]\n }\n'
                               for k in range(2))
    scene = read(cloth() + text)
    assert sorted(b.path for b in scene.things("Skeleton")) == ["/one0/bones", "/one1/bones"]
    for k, collider in enumerate(sorted(scene.colliders, key=lambda c: c.path)):
        np.testing.assert_allclose(collider.motion.points(collider.shape.poses.at(0.5), 0.5),
                                   scene.cloths[0].points + (k, 0.5, 0.0), atol=1e-6)


@pytest.mark.parametrize(("kind", "indices", "coords"), [
    ("point", "[0, 3]", ""), ("face", "[0, 1]", ""),
    ("face", "[0, 1]", "vector3f[] physics:coords1 = [(1, 0, 0.2), (0, 0, 0.2)]")])
def test_cloth_is_pinned_to_points_and_faces_of_a_skinned_mesh(read, kind, indices, coords):
    """The mesh rises by 0.5 m in half a second (24 frames a second); the sheet is the same one."""
    scene = read(cloth() + character(mesh("", BOUND).replace("()", '(prepend apiSchemas = ["SkelBindingAPI"])'))
                 + ATTACHED.format(kind, indices, coords))
    assert len(scene.pins) == 1 and len(scene.things("Skeleton")) == 1
    sim = wsim.Simulation(scene, device="cpu")
    for frame in (1, 5, 12):
        while sim.frame < frame:
            sim.step()
        want = scene.cloths[0].points[[0, 3]] + (0.0, frame / 24, 0.2 if coords else 0.0)
        np.testing.assert_allclose(sim.positions("/cloth")[[0, 3]], want, atol=2e-6)


def test_a_pin_over_a_turning_bone_keeps_its_height_over_the_skin():
    """h n turns with the face: 90 degrees about z take a place 0.1 m above a face of normal y to 0.1 m beside it."""
    s = Skeleton("/s/bones", ("a",), np.eye(4)[None], times=[0.0, 1.0], translations=np.zeros((2, 1, 3)),
                 rotations=np.array([[[0.0, 0.0, 0.0, 1.0]], [[0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]]]))
    x = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    skinned = Skinned(s, x, np.zeros((3, 1)), np.ones((3, 1)))
    follow = Follow.near(skinned, np.array([[0, 1, 2]]), np.array([[0.25, 0.1, 0.25]]))
    np.testing.assert_allclose(follow.over(np.array([0.0, 1.0]))[:, 0], [[0.25, 0.1, 0.25], [-0.1, 0.25, 0.25]], atol=1e-12)


def test_pre_roll_delays_the_skeleton_once_for_all_that_follows_it():
    from wsim.cli.run import delay_scene_curves
    scene, skinned = full()
    moved = delay_scene_curves(scene, 0.5)
    (skeleton,) = moved.things("Skeleton")
    assert moved.colliders[0].shape.poses.skeleton is skeleton is moved.pins[0].follows.skin.skeleton
    np.testing.assert_allclose(moved.colliders[0].shape.poses.at(0.55), skinned.at(0.05), atol=1e-12)
