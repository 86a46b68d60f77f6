"""Cloth on skeletons that rigid bodies drive: what follows them goes with the bodies, in every solver."""

import numpy as np
import pytest

import wsim
from tests.conftest import first_and_slow
from tests.make.physics.animation.dressed import clothed, seen
from tests.make.physics.animation.ragdoll import at
from wsim.geometry import rotation
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import DUAL, LINEAR, Skeleton, Skinned
from wsim.physics.rigid.objects import Body
from wsim.scene import Box, Capsule, Collider, Scene, SceneError, Surface, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Motion

SOLVERS = {"xpbd": {"solver": "xpbd", "integrator": "bdf2"},
           "explicit": {"solver": "explicit", "integrator": "leapfrog", "substeps": 64},
           "implicit": {"solver": "implicit", "integrator": "backward_euler"},
           "midpoint": {"solver": "implicit", "integrator": "implicit_midpoint"}}


@pytest.mark.parametrize(("solver", "method", "blends"), first_and_slow([
    ("xpbd", LINEAR, True), ("explicit", LINEAR, False), ("implicit", DUAL, False), ("midpoint", LINEAR, True)]))
def test_pins_and_meshes_are_where_the_bodies_have_taken_the_joints(solver, method, blends):
    """Where frames end; meshes in float32."""
    scene = clothed(method, blends, **SOLVERS[solver])
    sim, skin = wsim.Simulation(scene, device="cpu", precision="float64"), scene.pins[0].follows.skin
    start = seen(sim, skin)
    for _ in range(4):
        sim.step()
        x = seen(sim, skin)
        (mesh,) = sim.plan.ports.contacts.meshes.values()
        track = skin.skeleton.motion.points(mesh.device["track"].numpy()[-1].astype(np.float64))
        np.testing.assert_allclose(track, x, atol=3e-7)
        follow = scene.pins[0].follows
        np.testing.assert_allclose(sim.positions("/sheet")[:2],
                                   skinning.points_over_triangles(x[follow.corners], follow.places), atol=1e-9)
    assert np.abs(x - start).max() > 0.2


def one(spin=(0.0, 0.0, 3.0)) -> tuple[Scene, Skinned]:
    """A box with a sheet on it, thrown up and turning, in the skin of a joint that it drives."""
    scene = Scene(frames=8, fps=24.0, substeps=6)
    bones = scene.add(Skeleton("/man/bones", ("a",), np.eye(4)[None], bodies={"a": "/low"}))
    scene.add(Body("/low", [Collider("/low/shape", Capsule(0.05, 0.1), meets=False)], Motion.still(at(0.0, 0.0, 0.0)),
                   velocity=(0.2, 2.0, 0.0), spin=spin))
    points, counts, indices = shapes.box((0.5, 0.1, 0.5), 2)
    skin = Skinned(bones, points, np.zeros((len(points), 1)), np.ones((len(points), 1)))
    scene.collider("/man/skin", Surface(skin.at(0.0), counts, indices, poses=skin))
    scene.cloth("/sheet", *shapes.sheet(0.3, 0.3, 4, 4, horizontal=True, at=(0.0, 0.105, 0.0)))
    return scene, skin


def test_the_joints_that_a_run_wrote_move_cloth_alike_when_they_are_played_back():
    scene, skin = one()
    sim = wsim.Simulation(scene, device="cpu", precision="float64")
    found, x = [joints_of(sim)], []
    for _ in range(6):
        sim.step()
        found.append(joints_of(sim))
        x.append(sim.positions("/sheet"))
    assert x[-1][:, 1].mean() > 0.2                                  # alone it would have fallen below -0.2
    again, played = one()[0], np.array(found)
    bones = Skeleton("/man/bones", ("a",), np.eye(4)[None], times=np.arange(7) / 24.0, translations=played[:, None, :3],
                     rotations=played[:, None, 3:])
    for name in ("Body", "Joint", "Skeleton"):
        again.objects.pop(name, None)
    again.add(bones)
    again.colliders[0].shape.poses = Skinned(bones, skin.points, skin.joints, skin.weights)
    second = wsim.Simulation(again, device="cpu", precision="float64")
    for want in x:
        second.step()
        np.testing.assert_allclose(second.positions("/sheet"), want, atol=1e-6)


def joints_of(sim) -> np.ndarray:
    """Place and quaternion of the only joint, (7,)."""
    (found,) = [s for s in sim.samples() if type(s).__name__ == "Joints"]
    return np.concatenate([found.translations[0], rotation.unit_quat(found.rotations[0])])


def test_a_restart_goes_on_to_the_bit_and_a_graph_has_the_bits_of_its_launches():
    whole = wsim.Simulation(clothed(soft=True), device="cpu")
    whole.run(5)
    plain = wsim.Simulation(clothed(soft=True), device="cpu")
    plain._replay = plain.plan.frame
    plain.run(3)
    fields = {path: plain.fields(path) for path in plain.state.paths()}
    second = wsim.Simulation(clothed(soft=True), device="cpu")
    second.restart(3, fields)
    second.run(2)
    np.testing.assert_array_equal(second.positions("/sheet"), whole.positions("/sheet"))


def said(scene: Scene) -> str:
    return "\n".join(map(str, check_scene(scene)))


def test_bodies_that_drive_joints_are_not_met_beside_their_skin_and_it_is_said():
    scene = clothed()
    for body in scene.things("Body"):
        body.colliders[0].meets = True
    assert ("warning: /high: drives a joint of /man/bones, and cloth and soft bodies do not meet it, but what follows "
            "/man/bones (/man/skin, /pin)") in said(scene)
    scene.add(Body("/ball", [Collider("/ball/shape", Box((0.1, 0.1, 0.1)))], Motion.still(at(5.0, 0.0, 0.0))))
    assert "error: /ball: can meet /sheet, where /man/skin follows /man/bones" in said(scene)


def test_a_corrective_shape_of_a_driven_joint_is_refused():
    scene = clothed(blends=True)
    scene.pins[0].follows.skin.blends[0].joint = 0
    assert "error: /man/skin: blend shape grow is driven by joint hip, which /low drives" in said(scene)


def test_several_worlds_are_refused():
    with pytest.raises(SceneError, match="/man/bones: rigid bodies drive what others follow, and there are 2 worlds"):
        wsim.Simulation(clothed(), device="cpu", worlds=2)
