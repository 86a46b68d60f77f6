"""Strands on meshes that deform, by keys of their points and by skeletons: as on rigid ones that move alike."""

import numpy as np
import pytest

from wsim.physics.animation.objects import DUAL, LINEAR, Skeleton, Skinned
from wsim.physics.rods.objects import Rods
from wsim.scene import Scene, Surface, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

FRAMES, THICK = 24, 0.01
TIMES = np.array([0.0, 0.2, 0.5])


def slab(closed: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A box 1 m wide below y = 0, or a sheet there."""
    if closed:
        points, counts, indices = shapes.box((0.5, 0.1, 0.5), 3)
        return points - (0.0, 0.1, 0.0), counts, indices
    return shapes.sheet(1.0, 1.0, 5, 5, horizontal=True)


def laid(self_collision: bool = False, **more) -> tuple[Scene, Rods]:
    """Two ropes across each other's way, that lie on y = 0."""
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, substeps=4)
    line = np.linspace(-0.2, 0.2, 17)
    points = np.concatenate([np.stack([line + 0.01, 0.0 * line + 0.0052, 0.0 * line + z], 1) for z in (0.05, -0.15)])
    rods = scene.add(Rods("/ropes", points, [17, 17], THICK, young=1e6, density=500.0, static_friction=0.4,
                          dynamic_friction=0.3, self_collision=self_collision, **more))
    return scene, rods


def ends(scene: Scene) -> tuple[np.ndarray, dict]:
    sim = Simulation(scene, device="cpu")
    sim.run(FRAMES)
    return np.array(sim.plan.method("rods").points(0)[0]), sim.indicators()


def placed(y: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Frames that shift by y along x and turn about the y axis [rad]."""
    M = np.tile(np.eye(4), (len(y), 1, 1))
    M[:, 0, 3] = y
    M[:, 0, 0] = M[:, 2, 2] = np.cos(turn)
    M[:, 0, 2], M[:, 2, 0] = np.sin(turn), -np.sin(turn)
    return M


@pytest.mark.parametrize(("closed", "self_collision"), [
    (True, False), (False, False), pytest.param(True, True, marks=pytest.mark.slow)])
def test_points_with_keys_carry_strands_as_a_prim_that_moves(closed, self_collision):
    """Shifted to and fro, faster than friction follows: where it slips and where it sticks alike."""
    points, counts, indices = slab(closed)
    shift = np.array([0.0, 0.1, -0.05])
    found = []
    for moved in (True, False):
        scene, _ = laid(self_collision)
        if moved:
            scene.collider("/slab", Surface(points, counts, indices), motion=Motion(TIMES, placed(shift, 0.0 * shift)),
                           static_friction=0.4, dynamic_friction=0.3)
        else:
            poses = Curve(TIMES, (points[None] + shift[:, None, None] * (1.0, 0.0, 0.0)).astype(np.float32))
            scene.collider("/slab", Surface(points, counts, indices, poses=poses), static_friction=0.4, dynamic_friction=0.3)
        assert not [p for p in check_scene(scene) if "deform" in str(p) or "start" in str(p)]
        found.append(ends(scene))
    (a, told), (b, also) = found
    assert np.abs(a - laid()[1].points).max() > 0.05 and a[:, 1].min() > 0.9 * THICK / 2.0
    np.testing.assert_allclose(b, a, atol=2e-6)
    assert also["rod_penetration"] == pytest.approx(told["rod_penetration"], abs=1e-6)


@pytest.mark.parametrize("method", [LINEAR, pytest.param(DUAL, marks=pytest.mark.slow)])
def test_a_skeleton_carries_strands_as_a_prim_that_turns(method):
    points, counts, indices = slab(True)
    turn = np.array([0.0, 0.2, 0.3])
    M, found = placed(0.0 * turn, turn), []
    for moved in (True, False):
        scene, _ = laid()
        shape = Surface(points, counts, indices)
        if moved:
            scene.collider("/slab", shape, motion=Motion(TIMES, M), static_friction=0.9, dynamic_friction=0.9)
        else:
            half = np.stack([0.0 * turn, np.sin(0.5 * turn), 0.0 * turn, np.cos(0.5 * turn)], -1)[:, None]
            bones = scene.add(Skeleton("/bones", ("a",), np.eye(4)[None], times=TIMES, translations=np.zeros((3, 1, 3)),
                                       rotations=half))
            skin = Skinned(bones, points, np.zeros((len(points), 1)), np.ones((len(points), 1)), method=method)
            scene.collider("/slab", Surface(skin.at(0.0), counts, indices, poses=skin), motion=bones.motion,
                           static_friction=0.9, dynamic_friction=0.9)
        found.append(ends(scene)[0])
    assert np.abs(found[0] - laid()[1].points).max() > 0.02
    np.testing.assert_allclose(found[1], found[0], atol=2e-6)


@pytest.mark.parametrize("self_collision", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_mesh_that_bulges_lifts_what_lies_on_it(self_collision):
    """A roof of two slopes rises out of a flat sheet: ropes bend over the ridge, and their ends lie on both."""
    points, counts, indices = shapes.sheet(1.0, 1.0, 8, 8, horizontal=True)
    roof = np.array(points)
    roof[:, 1] += 0.1 - 0.2 * np.abs(roof[:, 0])
    scene, _ = laid(self_collision)
    shape = Surface(points, counts, indices, poses=Curve(np.array([0.0, 0.3]), np.array([points, roof], np.float32)))
    scene.collider("/sheet", shape, static_friction=0.5, dynamic_friction=0.5)
    x, told = ends(scene)
    away = (x[:, 1] - (0.1 - 0.2 * np.abs(x[:, 0]))) * np.cos(np.arctan(0.2))          # from the roof
    assert x[8, 1] > 0.09 and away.min() > 0.4 * THICK and told["rod_penetration"] < 0.1 * THICK
    np.testing.assert_allclose(away[np.abs(x[:, 0]) > 0.15], THICK / 2.0, atol=0.05 * THICK)
