"""Rigid bodies that drive the joints of a skeleton, and what a result says of them."""

import numpy as np
from pxr import Usd, UsdGeom

import wsim
from tests.make.physics.animation.ragdoll import at, joints, ragdoll
from tests.physics.animation.make import theirs
from wsim.physics.animation.objects import Skinned
from wsim.physics.animation.write import bind
from wsim.scene import shapes
from wsim.usd.stage import StageUnits


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
