"""What tests/usd/prims/test_soft.py shares with other tests: soft_scene."""

from math import inf

import numpy as np

from tests.make.usd.usd import _cloth, _motion
from wsim.scene import Pin, Plane, Scene, Skin, Soft, shapes
from wsim.scene.solid import MODELS, Bulk

TURNED = [0, 1, 3, 2]


def _bulk(rng) -> Bulk:
    return Bulk(young=rng.uniform(1e3, 1e9), poisson=rng.uniform(-0.9, 0.49), density=rng.uniform(10, 9000),
                model=str(rng.choice(MODELS)), damping=rng.uniform(0.0, 0.1), yield_strain=rng.choice([inf, 0.1]),
                static_friction=rng.uniform(), dynamic_friction=rng.uniform())


def _skin(rng, path: str) -> Skin:
    return Skin(path, rng.uniform(-0.4, 0.4, (4, 3)), [3, 4], [0, 1, 2, 0, 1, 2, 3])


def _soft(rng, path: str, skins: tuple = ()) -> Soft:
    """A block at random; where a transform mirrors it, its tets are turned: their volumes are positive in the world."""
    def maybe(value):
        return value if rng.uniform() < 0.5 else None

    points, tets = shapes.block((1, 1, 1), 2)
    n, t, motion = len(points), len(tets), _motion(rng, rigid=False)
    tets = tets[:, TURNED] if np.linalg.det(motion.at(0.0)[:3, :3]) < 0 else tets
    others = [_bulk(rng) for _ in range(rng.integers(3))]
    which = rng.permutation(np.arange(t) % (len(others) + 1)) if others else None
    return Soft(path, points, tets, _bulk(rng), others, which, motion, velocities=maybe(rng.normal(size=(n, 3))),
                rest_points=maybe(points + rng.uniform(-0.05, 0.05, (n, 3))), masses=maybe(rng.uniform(0.1, 1.0, n)),
                mass=maybe(rng.uniform()), filled=maybe(rng.uniform(0.0, 1.0, t)), pressure=rng.normal(),
                quadratic=bool(rng.integers(2)), skins=[_skin(rng, skin) for skin in skins])


def soft_scene(seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    scene = Scene(frames=5, start=float(rng.choice([0.0, 3.0])), up=str(rng.choice(["Y", "Z"])))
    scene.softs = [_soft(rng, "/World/ball/sim", ("/World/ball/skin", "/World/ball/more/fur")), _soft(rng, "/soft"),
                   _soft(rng, "/World/b/in", ("/World/b/x/one", "/World/b/y", "/World/b/x/two"))]
    scene.cloths = [_cloth(rng, "/World/ball/scarf"), _cloth(rng, "/World/cloth")]
    scene.softs[1].others.append(scene.softs[0].material)          # one Material serves both
    scene.softs[1].which = np.arange(len(scene.softs[1].tets), dtype=np.int32) % len(scene.softs[1].materials)
    scene.collider("/floor", Plane(), at=(0, -5, 0))
    scene.pins = [Pin("/soft/pin", "/soft", [0, 3, 8], motion=_motion(rng)),
                  Pin("/World/pin", "/World/ball/sim", [2], "/World/hook", motion=_motion(rng), places=[(0, 1, 0)])]
    return scene
