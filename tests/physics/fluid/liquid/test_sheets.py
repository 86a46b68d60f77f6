"""Meshes whose points move, in a liquid: cloth, and colliders that deform."""

import numpy as np
import pytest

from tests.physics.fluid.liquid.tanks import method, particles, tank
from wsim.scene import Collider, Motion, Surface, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve
from wsim.scene.solids import Box
from wsim.simulation.simulation import Simulation

CELL = 1.0 / 32.0


def sheet(y: float, n: int = 12, size: float = 0.5):
    """A horizontal sheet over a tank of 0.25 m, beyond its walls: (points, counts, indices)."""
    return shapes.sheet(size, size, n, n, horizontal=True, at=(0.125, y, 0.125))


def grown(y: float, speed: float, seconds: float, closed=None) -> Surface:
    """A mesh whose points go up at that speed [m/s]."""
    points, counts, indices = closed or sheet(y)
    points = np.asarray(points, np.float64)
    poses = Curve(np.array([0.0, seconds]), np.stack([points, points + [0.0, speed * seconds, 0.0]]))
    return Surface(points, counts, indices, poses)


def cube(low, high):
    x = np.array([[a, b, c] for a in (low[0], high[0]) for b in (low[1], high[1]) for c in (low[2], high[2])])
    faces = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]
    return x, np.full(6, 4), np.array(faces)


def run(scene, frames: int) -> Simulation:
    sim = Simulation(scene, device="cpu")
    for _ in range(frames):
        sim.step()
    return sim


def pool(**more):
    return tank((8, 24, 8), ((0, 0.4, 0), (0.25, 0.7, 0.25)), cell=CELL, fps=48.0, **more)


def height(x: np.ndarray, triangles: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Height (n,) of a surface over places p (n, 3), by barycentric coordinates across y."""
    found = np.full(len(p), np.nan)
    for a, b, c in x[triangles]:
        s = np.linalg.solve(np.stack([b - a, c - a], axis=1)[[0, 2]], (p - a)[:, [0, 2]].T)
        inside = (s >= -1e-6).all(axis=0) & (s.sum(axis=0) <= 1.0 + 1e-6)
        found[inside] = (a + (b - a) * s[0][:, None] + (c - a) * s[1][:, None])[inside, 1]
    return found


def test_liquid_poured_onto_a_pinned_sheet_stays_above_it():
    """The sheet sags by its own weight, and swings; nothing comes through it in half a second, in which a fall goes 1.2 m."""
    scene = pool()
    points, counts, indices = sheet(0.3)
    cloth = scene.cloth("/sheet", points, counts, indices)
    rim = np.flatnonzero(np.abs(points[:, [0, 2]] - 0.125).max(axis=1) > 0.249)
    scene.pin("/rim", cloth, rim)
    triangles, sim = np.asarray(indices).reshape(-1, 3), Simulation(scene, device="cpu")
    for _ in sim.frames(24):
        p = particles(sim)["x"]
        assert (p[:, 1] > height(sim.positions("/sheet"), triangles, p)).all()
    assert sim.positions("/sheet")[:, 1].min() < 0.29
    assert "moves it, and does not feel it" in "".join(str(p) for p in check_scene(scene))


def test_without_it_the_liquid_falls():
    assert particles(run(pool(), 24))["x"][:, 1].min() < 0.05


def test_a_mesh_whose_points_move_is_the_collider_that_moves_so():
    """A block that rises in a pool, once by its motion, once by its points: the same openings, velocities and flow."""
    found = []
    low, high = (0.07, 0.1, 0.06), (0.17, 0.2, 0.19)
    for deforms in (False, True):
        scene = tank((8, 16, 8), ((0, 0, 0), (0.25, 0.4, 0.25)), cell=CELL, fps=48.0, steps=2)
        surface = Surface(*cube(low, high))
        motion = Motion.still(np.eye(4))
        if deforms:
            surface = grown(0.0, 0.5, 1.0, cube(low, high))
        else:
            M = np.tile(np.eye(4), (2, 1, 1))
            M[1, 1, 3] = 0.5
            motion = Motion(np.array([0.0, 1.0]), M)
        scene.colliders.append(Collider("/block", surface, motion))
        sim = run(scene, 4)
        o = method(sim).domains[0].obstacles
        found.append([np.sort(particles(sim)["x"], axis=0), *(a.numpy() for a in (o.open.x, o.open.y, o.solid.y))])
    for a, b in zip(*found, strict=True):
        assert a == pytest.approx(b, abs=2e-4)
    assert found[0][3].max() == pytest.approx(0.5, abs=1e-4)


def test_a_sheet_that_rises_lifts_what_is_on_it():
    """Its points go up at 0.5 m/s, and so does the liquid, whose energy is that of the weight lifted."""
    scene = pool()
    scene.colliders.append(Collider("/lift", grown(0.38, 0.5, 2.0)))
    sim = Simulation(scene, device="cpu")
    before = particles(sim)["x"][:, 1].mean()
    sim.run(12)
    now = particles(sim)
    assert now["x"][:, 1].min() > 0.38 + 0.5 * 0.25
    assert now["x"][:, 1].mean() - before == pytest.approx(0.5 * 0.25, abs=2.0 * CELL)


def test_a_scene_without_meshes_that_move_compiles_none_of_it():
    from wsim.physics.contact.collider.table import kind_names
    scene = pool()
    scene.colliders.append(Collider("/box", Box((0.1, 0.1, 0.1))))
    scene.colliders.append(Collider("/still", Surface(*cube((0, 0, 0), (0.1, 0.1, 0.1)))))
    assert kind_names(scene.colliders) == ("box", "solid")
    scene.colliders.append(Collider("/grows", grown(0.1, 1.0, 1.0)))
    assert "forming" in kind_names(scene.colliders)
