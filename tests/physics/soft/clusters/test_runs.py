"""Clusters among other things: contacts, plastic flow, shared clusters, the same bits, restarts, worlds."""

from math import inf
from pathlib import Path

import numpy as np
import pytest

from tests.physics.soft.clusters.lattice import best_rotation, cube_points
from wsim.physics.soft.clusters import method
from wsim.scene import Plane, Scene
from wsim.simulation.simulation import Simulation
from wsim.usd import load


def falling(stiffness: float, **more) -> Scene:
    """A cube, turned, half its size above a floor."""
    scene, p = Scene(fps=60, substeps=8, iterations=4), cube_points(4, 0.06)
    turn = best_rotation(p, np.random.default_rng(1).normal(size=p.shape))
    scene.collider("/floor", Plane())
    scene.clusters("/c", p @ turn.T + [0, 0.25, 0], mass=1.0, stiffness=stiffness, **more)
    return scene


@pytest.mark.parametrize("stiffness", [inf, 2e4])
def test_a_falling_cube_comes_to_rest_on_a_face(stiffness):
    sim = Simulation(falling(stiffness, radius=0.01, damping=0.004), device="cpu")
    sim.run(240)
    x, v = sim.positions("/c"), sim.velocities("/c")
    assert abs(x[:, 1].min() - 0.01) < 1e-5 and np.linalg.norm(v, axis=1).max() < 1e-3
    assert abs(np.ptp(x[:, 1]) - 0.18) < (2e-3 if stiffness < inf else 1e-4)


def test_two_runs_have_the_same_bits():
    def run() -> np.ndarray:
        sim = Simulation(falling(3e3, spacing=0.1), device="cpu")
        sim.run(40)
        return np.concatenate([sim.positions("/c"), sim.velocities("/c")])
    assert np.array_equal(run(), run())


def test_blocks_that_share_a_cluster_find_what_one_finds(monkeypatch):
    """Three launches a colour instead of one; sums in another order."""
    def run() -> np.ndarray:
        sim = Simulation(falling(3e3, spacing=0.1, yield_strain=0.02, creep=5.0), device="cpu", precision="float64")
        sim.run(30)
        return sim.positions("/c")
    one = run()
    made = method.ShapeMatching
    monkeypatch.setattr(method, "ShapeMatching", lambda b: made(b, shares=True))
    monkeypatch.setattr(method.kernels, "CHUNK", 7)
    assert 0.0 < np.abs(run() - one).max() < 1e-9


def test_plastic_strain_stays_and_is_bounded():
    """A cluster that is stretched by 40 % and let go keeps a part; no more than max_strain."""
    rest = cube_points(3, 0.1)

    def left(**more) -> float:
        scene = Scene(fps=60, substeps=8, iterations=2, gravity=(0, 0, 0), air_drag=20.0)
        scene.clusters("/c", rest * [1.4, 1, 1], rest_points=rest, mass=1.0, stiffness=1e3, **more)
        sim = Simulation(scene, device="cpu")
        sim.run(90)
        flow = sim.state.parts["clusters"].arrays.get("flow")
        if flow is not None:
            P = flow.numpy()[0].astype(float)
            assert abs(np.linalg.det(P) - 1.0) < 0.05 and np.linalg.norm(P - np.eye(3)) < more["max_strain"] * 1.001
        return float(np.ptp(sim.positions("/c")[:, 0]) / 0.2 - 1.0)
    assert abs(left()) < 1e-3
    free, bound = left(yield_strain=0.1, creep=50.0, max_strain=inf), left(yield_strain=0.1, creep=50.0, max_strain=0.1)
    assert 0.08 < bound < 0.11 and bound + 0.02 < free < 0.4


def test_creep_does_not_depend_on_substeps():
    rest = cube_points(3, 0.1)

    def left(substeps: int) -> float:
        scene = Scene(fps=60, substeps=substeps, iterations=2, gravity=(0, 0, 0), solver="xpbd")
        body = scene.clusters("/c", rest * [1.3, 1, 1], rest_points=rest, mass=1.0, stiffness=1e3, yield_strain=0.1, creep=2.0)
        scene.pin("/ends", body, np.flatnonzero(np.abs(rest[:, 0]) > 0.05))
        sim = Simulation(scene, device="cpu", precision="float64")
        sim.run(30)
        return float(sim.state.parts["clusters"].arrays["flow"].numpy()[0, 0, 0])
    found = [left(4), left(8), left(16)]
    assert found[2] > 1.05 and abs(found[2] - found[1]) < 0.6 * abs(found[1] - found[0]) < 2e-3


def test_worlds_are_alike_and_stiffness_is_set_live():
    sim = Simulation(falling(3e3), device="cpu", worlds=2)
    sim.set("/c", "stiffness", 500.0, world=1)
    sim.run(25)
    alone = Simulation(falling(3e3), device="cpu")
    alone.run(25)
    assert np.array_equal(sim.positions("/c", world=0), alone.positions("/c"))
    assert np.abs(sim.positions("/c", world=1) - sim.positions("/c", world=0)).max() > 1e-3


def test_jellies_and_a_die_land_on_a_cloth_that_bears_them():
    """The scene jelly_clusters_on_cloth: 1.3 kg on a cloth. Nothing passes through, all keep their shape."""
    scene = load(Path(__file__).resolve().parents[4] / "scenes" / "jelly_clusters_on_cloth.usda")
    assert not scene.notes and [len(b.points) for b in scene.things("Clusters")] == [125, 216, 125]
    sim = Simulation(scene, device="cpu")
    sim.run(24)
    cloth = sim.positions("/World/Cloth")
    for body in scene.things("Clusters"):
        x = sim.positions(body.path)
        near = cloth[np.argmin(np.linalg.norm(cloth[:, [0, 2]] - x.mean(axis=0)[[0, 2]], axis=1))]
        assert x[:, 1].min() > near[1] - 0.02 and 0.3 < x[:, 1].mean() < 0.8
    die, rest = sim.positions("/World/Die").astype(float), scene.things("Clusters")[2].points.astype(float)
    off = die - die.mean(axis=0) - (rest - rest.mean(axis=0)) @ best_rotation(rest, die).T
    assert np.abs(off).max() < 1e-3 * np.ptp(rest)
    assert cloth[:, 1].min() < 0.6                                                  # 0.75 without load


def test_a_rigid_cluster_hangs_from_pinned_points():
    """Nine of its points are pinned: the others stay where they belong."""
    p = cube_points(3, 0.1)
    scene = Scene(fps=60, substeps=8, iterations=4, solver="xpbd", air_drag=3.0)
    body = scene.clusters("/c", p, mass=2.0, stiffness=inf)
    scene.pin("/pin", body, np.flatnonzero(p[:, 1] > 0.05))
    sim = Simulation(scene, device="cpu")
    sim.run(120)
    assert np.abs(sim.positions("/c") - p).max() < 1e-4
