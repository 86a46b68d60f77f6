"""Gradients with respect to joint angles and weights of blend shapes, through skinned colliders.

Warp's meshes keep their points in float32, in either precision. Blend shapes whose offsets and weights are binary fractions put
points where float32 has them exactly, so that differences by weights are those of float64; by angles they carry the rounding of
the points, 3e-8 of 0.2 m, over the step.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.contact.collider_adjoint import below, wavy
from tests.make.physics.contact.project_adjoint import SOLVERS, dropped
from tests.physics.animation.make import bones, skin
from wsim.geometry import rotation
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.physics.animation.objects import DUAL, LINEAR, BlendShape, Skeleton, Skinned
from wsim.physics.animation.skinning_adjoint import skinned_point_gradients
from wsim.scene import Scene, Surface, shapes
from wsim.scene.curve import Curve
from wsim.simulation.simulation import Simulation

FRAMES = 4
SUBSTEPS = {"xpbd": 6, "leapfrog": 50, "implicit": 6}
HOW = {"xpbd": SOLVERS["xpbd"], "leapfrog": SOLVERS["leapfrog"],
       "implicit": {"solver": "implicit", "integrator": "backward_euler", "substeps": 6, "iterations": 40}}


def hills() -> Surface:
    """An open mesh with low hills: heights that float32 has to 2^-33."""
    found = wavy()
    found.points[:, 2] *= 0.2
    return found


def worn(solver: str, method: str = LINEAR, turned: float = 0.0, axes=(0, 0, 1), still: bool = False) -> Scene:
    """A sheet thrown at a mesh that two joints and a blend shape move. turned [rad]: about how far joints turn; axes of the
    shape's offsets; still: one key alone."""
    scene = below(dropped("plane", (0.5, 0.4), 0.0, **HOW[solver]))
    floor, surface = scene.colliders[0], hills()
    points = np.round(surface.points.astype(np.float64) * 2.0**16) / 2.0**16
    rng, n, keys = np.random.default_rng(2), len(points), 1 if still else 2
    h = 1.0 / (scene.fps * SUBSTEPS[solver])
    times = np.array([0.0, 2.0 ** np.ceil(np.log2(FRAMES * SUBSTEPS[solver])) * h])[:keys]      # a binary fraction a substep
    Q = np.tile([0.0, 0.0, 0.0, 1.0], (keys, 2, 1))
    Q[..., :3] = 0.5 * turned * rng.normal(size=(keys, 2, 3))
    skeleton = Skeleton("/man/bones", ("a", "a/b"), np.tile(np.eye(4), (2, 1, 1)), times=times,
                     translations=np.zeros((keys, 2, 3)), rotations=Q / np.linalg.norm(Q, axis=-1, keepdims=True),
                     shapes=("grow",), weights=Curve(times, np.array([[0.0], [0.5]])[:keys]))
    offsets = rng.integers(-3, 4, (1, n, 3)) / 2.0**9 * np.array(axes)
    part = rng.integers(0, 5, n) / 4.0
    skin = Skinned(skeleton, points, np.tile([0, 1], (n, 1)), np.stack([part, 1.0 - part], axis=1), method=method,
                   blends=[BlendShape("grow", np.arange(n), offsets)])
    floor.shape, floor.thickness = Surface(skin.at(0.0), surface.counts, surface.indices, poses=skin), 1e-3
    floor.motion.values[:, 2, 3] -= 1e-3
    skeleton.motion = floor.motion
    scene.add(skeleton)
    scene.cloths[0].velocities = np.tile([0.6, 0.3, -0.2], (25, 1))
    return scene


def slope(scene: Scene, what: str, step: float, keep: str = "auto") -> tuple[float, float]:
    """Along a direction: of the gradient, and of differences of order 4."""
    sim = Simulation(scene, device="cpu", precision="float64", gradients=True)
    f = Rollout(Recording(sim, FRAMES, keep), [f"/man/bones:{what}"], [FRAMES // 2, FRAMES])
    s = np.random.default_rng(5).normal(size=f.run().shape)
    assert sim.indicators()["contacts"] >= 4
    found = f.vjp(s)[f"/man/bones:{what}"]
    base = f.values()[f"/man/bones:{what}"]
    way = np.round(np.random.default_rng(8).normal(size=base.shape) * 4.0) / 4.0
    losses = {k: float((f.run({f"/man/bones:{what}": base + k * step * way}) * s).sum()) for k in (-2, -1, 1, 2)}
    expected = (8.0 * (losses[1] - losses[-1]) - (losses[2] - losses[-2])) / (12.0 * step)
    return float((found * way).sum()), expected


WEIGHTS = [("xpbd", 2.0**-13, (0, 0, 1)), ("leapfrog", 2.0**-13, (0, 0, 1)), ("implicit", 2.0**-10, (1, 1, 1))]


@pytest.mark.parametrize(("solver", "step", "axes"), first_and_slow(WEIGHTS))
def test_weights_of_blend_shapes_have_the_slope_of_differences(solver, step, axes):
    """Gradients of the sheet that lands on the mesh and rubs on it; the shape moves it upward, by implicit steps anyhow."""
    found, expected = slope(worn(solver, axes=axes), "weights", step)
    assert abs(expected) > 0.1 and found == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize(("solver", "method", "step"), first_and_slow([
    ("xpbd", LINEAR, 1e-4), ("xpbd", DUAL, 1e-4), ("leapfrog", LINEAR, 2e-5), ("implicit", LINEAR, 1e-4)]))
def test_joint_angles_have_the_slope_of_differences(solver, method, step):
    """Differences by steps of 1e-4 rad, which move 0.2 m by 2e-5 m, of which float32 rounds 1.5e-8 m; by leapfrog, where
    contacts come and go within 5e-5 rad, by shorter ones."""
    found, expected = slope(worn(solver, method, turned=0.003), "turns", step)
    assert abs(expected) > 1.0 and found == pytest.approx(expected, rel=7e-4)


@pytest.mark.slow
@pytest.mark.parametrize("more", [{"keep": "checkpoints"}, {"still": True}])
def test_frames_that_run_again_and_joints_that_stand_still_have_them_too(more):
    scene = worn("xpbd", still=more.pop("still", False))
    found, expected = slope(scene, "weights", 2.0**-13, **more)
    assert abs(expected) > 0.1 and found == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("method", [LINEAR, DUAL])
def test_gradients_by_points_go_through_skinning(method):
    """Exact: sums of g x over some times, by angles and weights, against differences of order 4 in float64."""
    rng = np.random.default_rng(3)
    points, _, _ = shapes.sphere(0.3, 6)
    skeleton = bones(rng)
    skeleton.stretch, skeleton.shapes = np.diag([2.0, 1.0, 0.5]), ("grow",)
    skeleton.weights = Curve(np.array([0.0, 0.1]), np.array([[0.1], [0.9]]))
    grow = BlendShape("grow", np.arange(len(points)), 0.1 * rng.normal(size=(2, len(points), 3)), [0.05, 1.0])
    skinned, times = skin(rng, skeleton, points, method=method, blends=[grow]), np.array([0.0, 0.013, 0.05, 0.12])
    g = rng.normal(size=(len(times), len(points), 3))
    turns, weights = skinned_point_gradients(skinned, times, g)
    away, heavier, step = rng.normal(size=turns.shape), rng.normal(size=weights.shape), 1e-3

    def loss(s: float) -> float:
        moved = replace(skeleton,
                        rotations=rotation.quat_product(skeleton.orientations, rotation.quaternion_exponential(s * away)),
                        weights=Curve(skeleton.weights.times, skeleton.weights.values + s * heavier))
        return float((replace(skinned, skeleton=moved).over(times) * g).sum())
    expected = (8.0 * (loss(step) - loss(-step)) - (loss(2.0 * step) - loss(-2.0 * step))) / (12.0 * step)
    assert (turns * away).sum() + (weights * heavier).sum() == pytest.approx(expected, rel=1e-9)
