"""Skinned points on the device: those of the host's formulas, of UsdSkel and of closed forms."""

import ctypes

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.physics.animation.skinning import nearest_faces, track
from tests.physics.animation.make import CHARACTERS, bones, lump, scene_of, skin, theirs, worn
from wsim.geometry import rotation
from wsim.geometry.triangulate import triangulate_polygons
from wsim.kernels.animation import deformed
from wsim.kernels.contact.project import SUNK
from wsim.model.launches import LaunchList
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import DUAL, LINEAR, Skeleton, Skinned
from wsim.scene import Scene, Surface, shapes

FAST = "CesiumMan.usdz", "float32"


@pytest.mark.parametrize(("asset", "method", "precision"), [
    pytest.param(asset, method, precision, marks=() if (asset, precision) == FAST else pytest.mark.slow)
    for asset in CHARACTERS for method in (LINEAR, DUAL) for precision in ("float32", "float64")])
def test_a_character_is_where_usd_skins_it_at_frames_and_between(tmp_path, asset, method, precision):
    """Of the size of the character 1e-5; frames of the source are 1 and more apart, substeps are not."""
    file, path = worn(tmp_path, asset, method)
    scene = wsim.load(file)
    sim = wsim.Simulation(scene, device="cpu", precision=precision)
    for _ in range(3):
        sim.step()
        ours, times = track(sim)
        some = [0, 1, len(times) // 2, len(times) - 1]
        for mine, their in zip(ours[some], theirs(file, path, 1.0 + 24.0 * times[some]), strict=True):
            np.testing.assert_allclose(mine, 0.5 * their, rtol=0, atol=1e-5 * 0.5 * np.ptp(their, axis=0).max())
    assert np.abs(ours[-1] - scene.colliders[0].motion.points(scene.colliders[0].shape.points)).max() > 1e-3


@pytest.mark.parametrize("joint", [0, 2])
def test_the_motion_of_a_joint_carries_what_is_bound_to_it_alone(joint):
    """Points of weight 1 go with their joint: x(t) = M(t) M(0)^-1 x(0), at the keys to rounding, without scales."""
    tree = bones(np.random.default_rng(4))
    points, all_of = shapes.sphere(0.3, 8)[0], np.full((len(shapes.sphere(0.3, 8)[0]), 1), joint)
    skinned, motion = Skinned(tree, points, all_of, np.ones_like(all_of, float)), tree.joint_motion(tree.joints[joint])
    first = tree.motion.points(skinned.at(0.0), 0.0)
    for t in tree.times:
        M = motion.at(t) @ np.linalg.inv(motion.at(0.0))
        want = tree.motion.points(skinned.at(t), t)
        np.testing.assert_allclose(first @ M[:3, :3].T + M[:3, 3], want, rtol=0, atol=1e-6)
    with pytest.raises(ValueError, match="there is no joint 'tail'"):
        tree.joint_motion("tail")


@pytest.mark.parametrize("scaled", [False, True])
@pytest.mark.parametrize("method", [LINEAR, DUAL])
def test_device_and_host_agree_with_blend_shapes_and_scales(method, scaled):
    rng = np.random.default_rng(3)
    points, counts, indices = shapes.sphere(0.3, 12)
    skinned = skin(rng, bones(rng, scaled), points, method=method, blends=[lump(rng)])
    sim = wsim.Simulation(scene_of(skinned, counts, indices), device="cpu", precision="float64")
    sim.run(2)
    ours, times = track(sim)
    want = skinned.over(times)
    assert np.abs(ours - want).max() < 4e-7 * np.abs(want).max()                    # Warp's meshes are float32
    plain = Skinned(skinned.skeleton, points, skinned.joints, skinned.weights, method=method)
    assert np.abs(want - plain.over(times)).max() > 1e-2                            # the corrective shape acts


def test_a_list_of_launches_that_a_graph_replays_has_the_bits_of_its_launches(monkeypatch):
    """As a GPU replays it in every frame."""
    rng, found = np.random.default_rng(3), []
    points, counts, indices = shapes.sphere(0.3, 12)
    skinned = skin(rng, bones(rng, True), points, method=DUAL, blends=[lump(rng)])
    for way in (LaunchList.launch, LaunchList.replay_as_graph):
        monkeypatch.setattr(LaunchList, "launch", way)
        sim = wsim.Simulation(scene_of(skinned, counts, indices), device="cpu", precision="float64")
        sim.run(3)
        found.append(track(sim)[0])
    assert np.array_equal(*found)


def twisted(method: str, angle: float = np.pi) -> float:
    """Volume of a tube's ring half way between two joints, of which one is turned about the axis, over that at rest."""
    q = np.array([[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)]]])
    skeleton = Skeleton("/s/bones", ("a", "a/b"), np.tile(np.eye(4), (2, 1, 1)), translations=np.zeros((1, 2, 3)), rotations=q)
    steps = 2000
    z = (np.arange(steps) + 0.5) / steps                             # weights go from one joint to the other along the zone
    points = np.stack([np.ones(steps), np.zeros(steps), z], axis=1)
    skinned = Skinned(skeleton, points, np.tile([0, 1], (steps, 1)), np.stack([1.0 - z, z], axis=1), method=method)
    x = skinned.at(0.0)
    return float((x[:, 0] ** 2 + x[:, 1] ** 2).mean())


def test_half_a_turn_keeps_a_third_of_the_zone_by_linear_blend_and_all_by_dual_quaternions():
    """r(z) = |1 - 2 z| by linear blend: the integral of r^2 is 1/3 (midpoints: 1 / (3 steps^2) less). A turn of exactly pi has
    no short way: 1e-6 less."""
    assert abs(twisted(LINEAR) - 1.0 / 3.0) < 1e-6
    assert abs(twisted(DUAL, np.pi - 1e-6) - 1.0) < 1e-12


def test_levels_are_composed_from_the_roots_whatever_the_order_of_the_joints():
    """A chain of turns by 0.1 about z: the k-th is at the corner of a polygon."""
    n = 6
    order = np.random.default_rng(1).permutation(n)
    parents = np.empty(n, int)
    parents[order] = [-1, *order[:-1]]
    T = np.tile([1.0, 0.0, 0.0], (1, n, 1))
    T[:, order[0]] = 0.0
    Q = np.tile(rotation.quaternion_exponential(np.array([0.0, 0.0, 0.1])), (1, n, 1))
    s = Skeleton("/s/bones", tuple("abcdef"), np.tile(np.eye(4), (n, 1, 1)), parents=parents, translations=T, rotations=Q)
    W = skinning.skinning_transforms(s, np.zeros(1))[0]
    angles = 0.1 * (np.arange(n) + 1)
    corners = np.concatenate([[[0.0, 0.0]], np.cumsum(np.stack([np.cos(angles), np.sin(angles)], 1), axis=0)[:-1]])
    np.testing.assert_allclose(W[order, :2, 3], corners, atol=1e-14)
    np.testing.assert_allclose(np.arctan2(W[order, 1, 0], W[order, 0, 0]), angles, atol=1e-14)


def test_a_rotation_between_keys_turns_at_constant_speed():
    """Half way from 90 degrees about x to 90 about y: (0.81649658; 0.40824829, 0.40824829, 0)."""
    h = np.sqrt(0.5)
    s = Skeleton("/s/bones", ("a",), np.eye(4)[None], times=[0.0, 1.0], translations=np.zeros((2, 1, 3)),
                 rotations=np.array([[[h, 0.0, 0.0, h]], [[0.0, h, 0.0, h]]]))
    q = skinning.sample_joint_animation(s, np.array([0.5]))[1][0, 0]
    np.testing.assert_allclose(q, (0.40824829, 0.40824829, 0.0, 0.81649658), atol=1e-8)


def test_skeletons_of_a_scene_are_evaluated_together_and_each_moves_its_own_mesh():
    rng = np.random.default_rng(8)
    points, counts, indices = shapes.sphere(0.3, 8)
    first = skin(rng, bones(rng), points)
    scene = scene_of(first, counts, indices)
    second = skin(rng, bones(rng, path="/other/bones", keys=5), points, m=2, method=DUAL)
    scene.add(second.skeleton)
    scene.collider("/other/body", Surface(second.at(0.0), counts, indices, poses=second))
    sim = wsim.Simulation(scene, device="cpu", precision="float64")
    sim.step()
    contacts = sim.plan.ports.contacts
    times = np.arange(contacts.substeps + 1) * contacts.dt / contacts.substeps
    for mesh in contacts.meshes.values():
        np.testing.assert_allclose(mesh.device["track"].numpy(), mesh.surface.poses.over(times), atol=1e-6)


def test_bounding_balls_hold_the_points_of_every_substep_and_strides_their_ways():
    rng = np.random.default_rng(4)
    points, counts, indices = shapes.sphere(0.3, 12)
    skinned = skin(rng, bones(rng), points)
    sim = wsim.Simulation(scene_of(skinned, counts, indices), device="cpu")
    sim.step()
    contacts = sim.plan.ports.contacts
    ball, stride = contacts.table.ball.numpy()[:, 0], contacts.table.stride.numpy()[:, 0]
    x, _ = track(sim)
    x = x - contacts.rows.origin[0]
    far = np.maximum(*(np.linalg.norm(y - ball[:, None, :3], axis=-1).max(1) for y in (x[:-1], x[1:])))
    way = np.linalg.norm(np.diff(x, axis=0), axis=-1).max(1)
    assert (far <= ball[:, 3] * (1 + 1e-6)).all() and (ball[:, 3] < far + way + contacts.gap[0] + 1e-3).all()
    assert (way <= stride * (1 + 1e-5)).all() and (stride < way * (1 + 1e-4)).all()


def test_a_scene_without_a_skeleton_imports_nothing_of_it():
    import subprocess
    import sys
    code = ("import sys, wsim; from wsim.scene import Scene, shapes; s = Scene(frames=1);"
            "s.cloth('/c', *shapes.sheet(1, 1, 2, 2));"
            "s.pin('/p', s.cloths[0], [0]); sim = wsim.Simulation(s, device='cpu'); sim.step();"
            "print([m for m in sys.modules if 'animation' in m and 'wsim' in m])")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip().splitlines()[-1] == "[]"


def test_the_velocity_of_a_skinned_collider_carries_what_lies_on_it():
    """A plate on a joint that slides at 0.5 m/s and rubs without limit takes a sheet along: momentum by the bones' motion."""
    points, counts, indices = shapes.box((1.0, 0.1, 1.0), 4)
    skeleton = Skeleton("/s/bones", ("a",), np.eye(4)[None], times=[0.0, 1.0],
                        translations=np.array([[[0.0, 0.0, 0.0]], [[0.5, 0.0, 0.0]]]))
    skinned = Skinned(skeleton, points, np.zeros((len(points), 1)), np.ones((len(points), 1)))
    scene = Scene(frames=12, substeps=8)
    scene.add(skeleton)
    cloth = scene.cloth("/sheet", *shapes.sheet(0.5, 0.5, 4, 4, horizontal=True, at=(0.0, 0.1005, 0.0)))
    scene.collider("/s/body", Surface(skinned.at(0.0), counts, indices, poses=skinned), static_friction=5.0,
                   dynamic_friction=5.0)
    sim = wsim.Simulation(scene, device="cpu")
    sim.run(12)
    assert abs(sim.velocities("/sheet")[:, 0].mean() - 0.5) < 0.01
    assert abs(sim.positions("/sheet")[:, 0].mean() - cloth.points[:, 0].mean() - 0.25) < 0.02


@pytest.mark.parametrize("asked", ["nothing", "always", "deep", "marked"])
def test_a_tree_that_a_substep_refits_finds_what_warps_refit_finds(asked):
    """Faces, sides by normals and rays in any case; winding numbers where something asks for them."""
    rng = np.random.default_rng(5)
    points, counts, indices = shapes.sphere(0.3, 12)
    corners = triangulate_polygons(points, counts, indices, True)[0].astype(np.int32)
    q, way = (wp.array(rng.normal(size=(300, 3)) * 0.4, dtype=wp.vec3f, device="cpu") for _ in range(2))
    moved = (points * [1.0, 3.0, 0.4] + 0.05 * np.sin(9.0 * points[:, [1, 2, 0]])).astype(np.float32)
    found = []
    for own in (False, True):
        places = wp.array(points.astype(np.float32), dtype=wp.vec3f, device="cpu")
        mesh = wp.Mesh(places, wp.array(corners.ravel(), dtype=int, device="cpu"), support_winding_number=True)
        places.assign(moved)
        if own:
            function = ctypes.cast(mesh.runtime.core.wp_mesh_refit_host, ctypes.c_void_p).value
            deep, mark = (wp.array([value], dtype=int, device="cpu") for value in (
                int(asked == "deep"), int(SUNK) * (asked == "marked")))
            wp.launch(deformed.mesh_refit_kernel("test_refit_own"), 1, [function, mesh.id, int(asked == "always"), deep, mark],
                      [], device="cpu")
        else:
            mesh.refit()
        out = wp.zeros(300, dtype=wp.vec4f, device="cpu")
        wp.launch(nearest_faces, 300, [mesh.id, q, way], [out], device="cpu")
        found.append(out.numpy())
    same = found[0] == found[1]
    assert same[:, [0, 1, 3]].all() and (asked == "nothing" or same[:, 2].all())


@pytest.mark.parametrize("closed", [True, False])
def test_meshes_that_points_are_known_to_be_far_from_change_no_bit(monkeypatch, closed):
    """A sheet that falls onto a mesh which deforms fast, closed and open; a frame is repeated from where it began."""
    from wsim.physics.contact import method
    found = []
    for cleared in (False, True):
        monkeypatch.setattr(method, "CLEARED", 1 if cleared else 1000)
        rng = np.random.default_rng(4)
        points, counts, indices = shapes.sphere(0.3, 8) if closed else shapes.sheet(1.0, 1.0, 6, 6, horizontal=True)
        scene = scene_of(skin(rng, bones(rng), points), counts, indices)
        scene.solver, scene.integrator, scene.substeps, scene.iterations = "xpbd", "backward_euler", 24, 2
        scene.cloths[0].points = scene.cloths[0].points - [0.0, 2.2, 0.0]
        sim = wsim.Simulation(scene, device="cpu")
        kept, touched = [], 0
        for frame in range(4):
            before = sim.fields("/sheet")
            sim.step()
            touched += int(sim.plan.ports.contacts.slots.count.numpy().sum())
            if frame == 2:
                sim.restart(2, {"/sheet": before})
                sim.step()
            kept.append(sim.positions("/sheet"))
        found.append(kept)
        assert touched > 0 and sim.plan.ports.contacts.cleared == cleared
    assert np.array_equal(found[0], found[1])
