"""Rigid bodies that drive the joints of a skeleton, and what a result says of them."""

import numpy as np
from pxr import Usd, UsdGeom

import wsim
from tests.physics.animation.make import theirs
from wsim.physics.animation.objects import Skeleton, Skinned
from wsim.physics.animation.write import bind
from wsim.physics.rigid.objects import Body
from wsim.scene import Capsule, Collider, Scene, shapes
from wsim.scene.curve import Motion
from wsim.usd.stage import StageUnits

JOINTS = ("hip", "hip/knee", "hip/knee/foot")


def at(x: float, y: float, z: float) -> np.ndarray:
    M = np.eye(4)
    M[:3, 3] = (x, y, z)
    return M


def ragdoll(turn: float = 0.0) -> Scene:
    """Two bodies that fall apart, of three joints; the third keeps to its parent. The skeleton stands 1 m to the side."""
    scene = Scene(frames=8, fps=24.0, substeps=4)
    bind_ = np.stack([at(0.0, 1.0, 0.0), at(0.0, 1.5, 0.0), at(0.0, 2.0, 0.0)])
    place = np.eye(4)
    place[:3, :3] = [[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]]
    place[:3, 3] = (1.0, 0.0, 0.0)
    scene.add(Skeleton("/man/bones", JOINTS, bind_, motion=Motion.still(place),
                       bodies={"hip": "/low", "hip/knee": "/high"}))
    for path, y, spin in (("/low", 1.2, (0.0, 0.0, 3.0)), ("/high", 1.8, (2.0, 1.0, 0.0))):
        collider = Collider(f"{path}/shape", Capsule(0.05, 0.1))
        scene.add(Body(path, [collider], Motion.still(at(1.0, y, 0.0)), velocity=(0.3, 2.0, 0.0), spin=spin))
    return scene


def joints(sim) -> np.ndarray:
    """World transforms of the joints that a sample says, (3, 4, 4)."""
    (found,) = [s for s in sim.samples() if type(s).__name__ == "Joints"]
    from wsim.geometry import rotation
    from wsim.physics.animation.driven import skeleton_to_world
    from wsim.physics.animation.skinning import skeleton_space_transforms
    L = np.tile(np.eye(4), (3, 1, 1))
    L[:, :3, :3] = rotation.quaternion_to_matrix(found.rotations) * found.scales[:, None, :]
    L[:, :3, 3] = found.translations
    bones = sim.scene.things("Skeleton")[0]
    return skeleton_to_world(bones, sim.time) @ skeleton_space_transforms(bones.parents, L[None])[0]


def test_joints_keep_to_their_bodies_and_the_others_to_their_parents():
    sim = wsim.Simulation(ragdoll(0.7), device="cpu", precision="float64")
    start, low, high = joints(sim), at(1.0, 1.2, 0.0), at(1.0, 1.8, 0.0)
    np.testing.assert_allclose(start[:, :3, 3], [(1.0, 1.0, 0.0), (1.0, 1.5, 0.0), (1.0, 2.0, 0.0)], atol=1e-12)
    sim.run(6)
    X, now = sim.plan.method("rigid").poses(), joints(sim)
    np.testing.assert_allclose(np.linalg.inv(X[0]) @ now[0], np.linalg.inv(low) @ start[0], atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(X[1]) @ now[1], np.linalg.inv(high) @ start[1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(now[1]) @ now[2], np.linalg.inv(start[1]) @ start[2], atol=1e-12)
    assert np.abs(now - start).max() > 0.3


def worn(folder) -> tuple:
    """The ragdoll as a file, with a mesh that its skeleton moves and that nobody simulates."""
    file, scene = folder / "doll.usda", ragdoll()
    wsim.save(scene, file)
    stage = Usd.Stage.Open(str(file))
    points, counts, indices = shapes.box((0.1, 0.5, 0.1), 2)
    points = points + (0.0, 1.5, 0.0)
    mesh = UsdGeom.Mesh.Define(stage, "/man/skin")
    mesh.CreateFaceVertexCountsAttr(counts), mesh.CreateFaceVertexIndicesAttr(indices)
    part = np.clip((points[:, 1] - 1.0) * 2.0, 0.0, 1.0)
    skinned = Skinned(scene.things("Skeleton")[0], points, np.tile([0, 1], (len(points), 1)), np.stack([1 - part, part], 1))
    bind(stage, "/man/skin", skinned, StageUnits(1.0, 1.0, "Y", 24.0, 0.0))
    stage.Save()
    return file, skinned


def test_a_result_says_the_joints_and_usd_skins_by_them(tmp_path):
    """float32 and halves of scales that are 1."""
    file, skinned = worn(tmp_path)
    sim = wsim.Simulation(wsim.load(file), device="cpu")
    assert sim.scene.things("Skeleton")[0].bodies == {"hip": "/low", "hip/knee": "/high"}
    seen = [joints(sim)]
    with sim.record(tmp_path / "out.usdc"):
        for _ in range(4):
            sim.step()
            seen.append(joints(sim))
    unbind = np.linalg.inv(skinned.skeleton.bind)
    from wsim.physics.animation.skinning import linear_blend_skinning
    for code, found in zip(range(5), theirs(tmp_path / "out.usdc", "/man/skin", range(5)), strict=True):
        want = linear_blend_skinning(skinned.points, skinned.joints, skinned.weights, seen[code] @ unbind)
        np.testing.assert_allclose(found, want, atol=2e-6)
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    assert stage.GetPrimAtPath("/man/bones/simulated").GetTypeName() == "SkelAnimation"


def test_a_run_goes_on_to_the_bit(tmp_path):
    file, _ = worn(tmp_path)
    whole = wsim.Simulation(wsim.load(file), device="cpu")
    whole.run(6)
    first = wsim.Simulation(wsim.load(file), device="cpu")
    first.run(3)
    fields = {path: first.fields(path) for path in first.state.paths()}
    second = wsim.Simulation(wsim.load(file), device="cpu")
    second.restart(3, fields)
    np.testing.assert_array_equal(joints(second), joints(first))
    second.run(3)
    np.testing.assert_array_equal(joints(second), joints(whole))
