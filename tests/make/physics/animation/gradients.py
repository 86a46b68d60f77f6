"""What tests/physics/animation/test_gradients.py shares with other tests: UNFOLLOWED, changed, held."""

import numpy as np

from tests.physics.animation.make import bones, lump, skin
from wsim import Fabric
from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.animation.objects import DUAL, LINEAR, BlendShape, Follow
from wsim.scene import Scene, shapes
from wsim.scene.curve import Curve

SOLVERS = {"explicit": {"solver": "explicit", "integrator": "leapfrog", "substeps": 60},
           "xpbd": {"solver": "xpbd", "integrator": "bdf2", "substeps": 6, "iterations": 4},
           "implicit": {"solver": "implicit", "integrator": "backward_euler", "substeps": 8, "iterations": 20}}


def held(solver: str, method: str = LINEAR, stiffness: float = np.inf, keys: int = 3) -> Scene:
    """A sheet that hangs on a skinned mesh by places over its triangles, one of them soft if stiffness is finite."""
    rng = np.random.default_rng(6)
    scene = Scene(fps=60.0, frames=2, gravity=(0.0, -9.81, 0.0), **SOLVERS[solver])
    skeleton = bones(rng, keys=keys)
    skeleton.times = skeleton.times * 0.4                                # two frames are 1/30 s
    skeleton.translations, skeleton.rotations = 0.05 * skeleton.translations, _slow(skeleton.rotations)
    skeleton.shapes, skeleton.weights = ("grow",), Curve(skeleton.times[:2], np.array([[0.2], [0.9]])[:min(keys, 2)])
    scene.add(skeleton)
    cloth = scene.cloth("/sheet", *shapes.sheet(0.3, 0.3, 3, 3, at=(0.0, 0.6, 0.0)),
                        material=Fabric(stretch=40.0, bend=1e-4, density=300.0))
    points, counts, indices = shapes.sphere(0.3, 8)
    grow = BlendShape("grow", np.arange(len(points)), 0.02 * rng.normal(size=(2, len(points), 3)), [0.05, 1.0])
    skinned = skin(rng, skeleton, points + (0.0, 0.6, 0.0), method=method, blends=[grow])
    triangles, _ = triangulate_polygons(points, counts, indices)
    for path, mine in (("/left", [0, 1]), ("/right", [2, 3])):
        follow = Follow.near(skinned, triangles, cloth.points[mine])
        scene.pin(path, cloth, mine, follows=follow, stiffness=stiffness if path == "/right" else np.inf)
    return scene


def _slow(Q: np.ndarray) -> np.ndarray:
    """Near no rotation."""
    Q = np.concatenate([0.05 * Q[..., :3], np.ones((*Q.shape[:2], 1))], axis=-1)
    return Q / np.linalg.norm(Q, axis=-1, keepdims=True)


def scaled(scene: Scene) -> None:
    scene.things("Skeleton")[0].scales = 1.1 * scene.things("Skeleton")[0].scales
    for pin in scene.pins:
        pin.follows.skin.method = DUAL


def still(scene: Scene) -> None:
    bones_ = scene.things("Skeleton")[0]
    bones_.translations = bones_.rotations = bones_.scales = None
    bones_.times, bones_.animated = np.zeros(1), np.zeros(4, bool)


# key of `REFUSED`: path that is named, what is done to a scene, what is asked for
UNFOLLOWED = {
    "followed": ("/man/bones", lambda scene: scene.pins.clear(), "turns"),
    "corrective": ("/left", lambda scene: scene.pins[0].follows.skin.blends.append(lump(np.random.default_rng(0))), "turns"),
    "scaled": ("/left", scaled, "turns"),
    "unanimated": ("/man/bones", still, "turns"),
    "shapes": ("/man/bones", lambda scene: setattr(scene.things("Skeleton")[0], "weights", None), "weights"),
}


def changed(change) -> Scene:
    scene = held("explicit")
    change(scene)
    return scene
