"""Stiffnesses that go to and fro are bounded where that may matter, and nowhere else."""

import numpy as np

from tests.conftest import grid
from wsim.physics.motion import explicit
from wsim.scene import Motion, Scene, Sphere
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation


def hung(**more) -> Scene:
    scene = Scene(fps=60.0, solver="explicit", substeps=1)
    fabric = Fabric(stretch=200.0, shear=60.0, bend=1e-4, density=200.0, thickness=1e-3, **more)
    cloth = scene.cloth("/cloth", *grid(), material=fabric)
    scene.pin("/pin", cloth, [0, 1])
    scene.collider("/ball", Sphere(0.1), at=(0.0, -5.0, 0.0))
    return scene


def test_explicit_steps_are_enough_for_any_stiffness_and_seldom_counted(monkeypatch):
    asked = []
    inner = explicit.Explicit.least
    monkeypatch.setattr(explicit.Explicit, "least", lambda self: asked.append(1) or inner(self))
    sim, rng = Simulation(hung(damping=1e-4), device="cpu"), np.random.default_rng(3)
    method = sim.plan.method("explicit")
    for _ in range(60):
        name, usual = [("stretch", 200.0), ("shear", 60.0), ("bend", 1e-4)][rng.integers(3)]
        sim.set("/cloth", name, usual * rng.uniform(0.3, 1.5))
        assert sim.plan.clock.substeps >= inner(method)
    assert len(asked) < 30


def test_what_is_no_stiffness_is_counted_each_time(monkeypatch):
    asked = []
    inner = explicit.Explicit.least
    monkeypatch.setattr(explicit.Explicit, "least", lambda self: asked.append(1) or inner(self))
    sim = Simulation(hung(), device="cpu")
    for k, (name, value) in enumerate([("density", 200.0), ("stretch", 190.0), ("density", 190.0), ("stretch", 180.0)]):
        sim.set("/cloth", name, value)
        assert len(asked) == k + 1


def test_a_pin_that_moves_from_frame_to_frame_keeps_its_graph_and_its_path():
    """As one whose path was known from the start."""
    def matrix(t):
        M = np.eye(4)
        M[:3, 3] = 0.05 * np.sin(3.0 * t), 0.0, 0.0
        return M
    ends = []
    times = np.arange(9) / 60.0
    for live in (False, True):
        scene = hung()
        if not live:
            scene.pins[0].motion = Motion(times, np.stack([matrix(t) for t in times]))
        sim, graphs = Simulation(scene, device="cpu"), []
        for k in range(8):
            if live:
                sim.set("/pin", "motion", Motion(times[k:k + 2], np.stack([matrix(t) for t in times[k:k + 2]])))
            sim.step()
            graphs.append(sim.graph)
        assert len({id(g) for g in graphs[1:]}) == 1
        ends.append(sim.positions())
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-7)


def test_frames_that_were_prepared_are_those_of_frames_that_were_not():
    """To the bit, through a contact."""
    ends = []
    for prepared in (False, True):
        scene = hung()
        scene.colliders[0].motion = Motion.at_place(scene.cloths[0].points.mean(axis=0) + (0.0, -0.3, 0.0))
        sim = Simulation(scene, device="cpu")
        if prepared:
            sim.prepare()
        sim.run(40)
        ends.append(sim.positions())
        assert sim.forms["met"] and sim.forms["free"]
    np.testing.assert_array_equal(*ends)
