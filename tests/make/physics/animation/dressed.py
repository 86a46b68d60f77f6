"""What tests/physics/animation/test_dressed.py shares with other tests: clothed, seen."""

import numpy as np

from tests.make.physics.animation.ragdoll import joints, ragdoll
from wsim.physics.animation import skinning
from wsim.physics.animation.objects import LINEAR, BlendShape, Follow, Skinned
from wsim.scene import Collider, Scene, Surface, shapes
from wsim.scene.curve import Curve


def clothed(method: str = LINEAR, blends: bool = False, soft: bool = False, **more) -> Scene:
    """The ragdoll with a mesh that collides and a sheet that hangs on it by two places, on one of them softly; its bodies meet
    nothing."""
    scene = ragdoll(0.7)
    for name, value in more.items():
        setattr(scene, name, value)
    bones = scene.things("Skeleton")[0]
    for body in scene.things("Body"):
        body.colliders = [Collider(c.path, c.shape, meets=False) for c in body.colliders]
    points, counts, indices = shapes.box((0.1, 0.6, 0.1), 2)
    points = points + (0.0, 1.5, 0.0)
    part = np.clip((points[:, 1] - 1.0) * 2.0, 0.0, 1.0)
    grow = []
    if blends:
        bones.shapes, bones.weights = ("grow",), Curve(np.array([0.0, 0.2]), np.array([[0.0], [1.0]]))
        grow = [BlendShape("grow", np.arange(len(points)), 0.05 * np.ones((1, len(points), 3)))]
    skin = Skinned(bones, points, np.tile([0, 1], (len(points), 1)), np.stack([1.0 - part, part], 1), method=method,
                   blends=grow)
    scene.collider("/man/skin", Surface(skin.at(0.0), counts, indices, poses=skin), motion=bones.motion)
    sheet = scene.cloth("/sheet", *shapes.sheet(0.3, 0.3, 3, 3, at=(1.4, 1.5, 0.0)))
    x = sheet.points[:2]
    scene.pin("/pin", sheet, [0, 1], follows=Follow.near(skin, indices.reshape(-1, 4)[:, :3], x))
    if soft:
        scene.pin("/soft", sheet, [2], follows=Follow.near(skin, indices.reshape(-1, 4)[:, :3], sheet.points[2:3]),
                  stiffness=30.0)
    return scene


def seen(sim, skin: Skinned) -> np.ndarray:
    """World points of a mesh by the joints that a sample says."""
    bones = skin.skeleton
    A = np.linalg.inv(bones.motion.at(0.0)) @ joints(sim) @ np.linalg.inv(bones.bind)
    return bones.motion.points(skinning.skin_points(skin, A[None], np.array([sim.time]))[0])
