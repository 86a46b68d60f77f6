"""Gradients with respect to joint angles and weights of blend shapes, through skinning to pins; and what is refused."""

import numpy as np
import pytest

from tests.physics.animation.make import bones, lump, skin
from wsim import Fabric, Simulation
from wsim.geometry.triangulate import triangulate_polygons
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
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


def slopes(scene: Scene, names: list[str]) -> None:
    """Of order 4, in float64."""
    f = Rollout(Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 2), names, [1, 2])
    s = np.random.default_rng(5).normal(size=f.run().shape)
    found = f.vjp(s)
    for name in names:
        base = f.values()[name]
        way = np.random.default_rng(8).normal(size=base.shape)
        step = 2e-6
        losses = {k: float((f.run({name: base + k * step * way}) * s).sum()) for k in (-2, -1, 1, 2)}
        f.run({name: base})
        expected = (8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / (12.0 * step)
        assert abs(expected) > 1e-3
        assert float((found[name] * way).sum()) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("solver", "method", "stiffness"), [
    pytest.param(solver, method, stiffness, marks=pytest.mark.slow if (solver, method) != ("xpbd", DUAL) else ())
    for solver in SOLVERS for method, stiffness in ((LINEAR, 30.0), (DUAL, np.inf))])
def test_angles_and_weights_have_the_slope_of_differences(solver, method, stiffness):
    slopes(held(solver, method, stiffness), ["/man/bones:turns", "/man/bones:weights"])


@pytest.mark.slow
def test_a_skeleton_that_stands_still_has_them_too():
    slopes(held("explicit", keys=1), ["/man/bones:turns", "/man/bones:weights"])


@pytest.mark.slow
def test_angles_away_from_the_animation_have_the_slope_there():
    scene = held("explicit")
    f = Rollout(Recording(Simulation(scene, device="cpu", precision="float64", gradients=True), 2), ["/man/bones:turns"], [2])
    base = 0.4 * np.random.default_rng(1).normal(size=f.values()["/man/bones:turns"].shape)
    s = np.random.default_rng(5).normal(size=f.run({"/man/bones:turns": base}).shape)
    np.testing.assert_allclose(f.values()["/man/bones:turns"], base, atol=1e-12)
    way, step = np.random.default_rng(8).normal(size=base.shape), 2e-6
    slope = float((f.vjp(s)["/man/bones:turns"] * way).sum())
    losses = {k: float((f.run({"/man/bones:turns": base + k * step * way}) * s).sum()) for k in (-2, -1, 1, 2)}
    assert slope == pytest.approx((8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / (12.0 * step), rel=1e-6)


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
