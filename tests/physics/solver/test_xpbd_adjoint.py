"""Gradients of XPBD that ran in place and is undone: against differences, and against fresh buffers with Warp's own adjoint."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from tests.conftest import first_and_slow
from tests.make.gradient.gradients import Run, everything_of_a_sheet, net, sheet
from tests.make.physics.solver.xpbd_adjoint import SWEEPS, Fresh, everything_of_wind
from wsim.gradient.recording import Recording
from wsim.physics.solver import batch, xpbd_adjoint
from wsim.scene import Pin
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("integrator, iterations", [("backward_euler", 1), ("backward_euler", 4), ("bdf2", 16),
                                                    ("implicit_midpoint", 16)])
def test_a_chain(integrator, iterations):
    """By every parameter, lengths too: the undone sweeps, with over-relaxation where there are more than two."""
    run = Run(net(**SWEEPS | {"integrator": integrator, "iterations": iterations}))
    assert not run.sim.warnings
    run.material("stiffness", 40.0)
    run.material("damping", 1e-3)
    run.state("positions")
    run.state("velocities")
    run.world()
    lengths, way = np.linspace(0.09, 0.11, 11).astype(np.float32), np.random.default_rng(8).normal(size=11)
    run = Run(net(**SWEEPS | {"integrator": integrator, "iterations": iterations, "lengths": lengths}))
    run.check(run.gradient.lengths() @ way, lambda s: ("/chain", "lengths", lengths + s * way), 2e-4, 1e-10)


@pytest.mark.parametrize("model", ["membrane", "springs"])
def test_a_sheet_that_stretches_shears_and_bends(model):
    everything_of_a_sheet(Run(sheet(model, damping=2e-4, integrator="backward_euler", **SWEEPS)))


@pytest.mark.parametrize("more", first_and_slow([
    SWEEPS | {"integrator": "backward_euler"}, {"integrator": "rk4"}, {"integrator": "leapfrog"},
    {"solver": "implicit", "integrator": "bdf2", "substeps": 2}]))
def test_wind(more):
    everything_of_wind(Run, **more)


@pytest.mark.parametrize("more", first_and_slow([
    SWEEPS | {"integrator": "backward_euler"}, {"integrator": "leapfrog"},
    {"solver": "implicit", "integrator": "bdf2", "substeps": 2}]))
def test_the_normal_drag_of_a_fabric(more):
    """By wind, places, stretch, and by the coefficient itself (which is not live: scenes with others)."""
    def run_of(c=0.3) -> Run:
        scene = sheet("springs", damping=2e-4, **more)
        cloth = scene.cloths[0]
        cloth.material, scene.wind = replace(cloth.material, normal_drag=c), (1.0, 3.0, 4.0)
        return Run(scene)
    run, way = run_of(), np.array([0.3, -0.5, 0.8])
    run.check(run.gradient.wind() @ way, lambda s: ("/", "wind", (1.0, 3.0, 4.0) + s * way), 0.02)
    run.material("stretch", 40.0)
    run.state("positions", 1e-6)
    losses = [run_of(0.3 + s).loss() for s in (1e-4, -1e-4)]
    assert run.gradient.air_coefficient("normal_drag") == pytest.approx((losses[0] - losses[1]) / 2e-4, rel=1e-6)


@pytest.mark.parametrize("more", [SWEEPS | {"integrator": "backward_euler"}, {"integrator": "leapfrog"},
                                  *({"solver": "implicit", "integrator": name, "substeps": 2}
                                    for name in ("bdf2", "implicit_midpoint"))])
def test_soft_pins(more):
    """They pull at two corners; by their stiffness, their damping, and where they are."""
    def scene(stiffness=50.0, damping=0.01):
        made = sheet("springs", **more)
        made.pins = [Pin("/soft", "/cloth", np.array([20, 24]), stiffness=stiffness, damping=damping)]
        return made
    run, way = Run(scene()), np.array([0.3, -0.5, 0.8])
    run.state("positions", 1e-6)
    run.material("stretch", 40.0)

    def moved(s):
        matrix = np.eye(4)
        matrix[:3, 3] = s * way
        return "/soft", "motion", matrix
    run.check(run.gradient.targets("/soft").sum(axis=0) @ way, moved, 2e-5)
    for name, value in (("stiffness", 50.0), ("damping", 0.01)):
        losses = []
        for s in (1e-4, -1e-4):
            sim = Simulation(scene(**{name: value * (1.0 + s)}), device="cpu", precision="float64", gradients=True)
            recording = Recording(sim, 3)
            losses.append((recording.positions(3) * run.x).sum() + (recording.velocities(3) * run.v).sum())
        assert run.gradient.pin("/soft", name) == pytest.approx((losses[0] - losses[1]) / (2e-4 * value), rel=1e-5)


@pytest.mark.parametrize("model, limit, tethers", [("membrane", np.inf, False), ("springs", 0.003, False),
                                                   ("springs", np.inf, True)])
def test_undone_sweeps_are_as_good_as_fresh_buffers(model, limit, tethers, monkeypatch):
    """Strain limits and tethers are on and off from sweep to sweep: differences would meet the kinks."""
    scene = sheet(model, damping=2e-4, integrator="backward_euler", **SWEEPS)
    scene.cloths[0].tethers = tethers
    scene.cloths[0].material = replace(scene.cloths[0].material, strain_limit=limit)
    ours = Run(scene)
    monkeypatch.setattr(xpbd_adjoint, "SweepAdjoint", Fresh)
    other = Run(scene)
    assert np.array_equal(ours.recording.positions(3), other.recording.positions(3))
    for name in ("positions", "velocities", "masses"):
        a, b = (getattr(run.gradient, name)() for run in (ours, other))
        assert np.abs(a - b).max() < 1e-12 * np.abs(b).max()
    for name in ("stretch", "bend", "damping"):
        a, b = (run.gradient.material(name, elements=True) for run in (ours, other))
        assert np.abs(a - b).max() < 1e-11 * np.abs(b).max()
    assert ours.recording.bytes < 0.5 * other.recording.bytes


@pytest.mark.parametrize("model, damping", [("membrane", 2e-4), ("membrane", 0.0), ("springs", 0.0)])
def test_a_launch_for_each_colour_gives_the_same_as_one_for_all(model, damping, monkeypatch):
    """Without damping gradients by places are taken from what those by displacements gain in a sweep: rounding apart."""
    scene, found = sheet(model, damping=damping, integrator="backward_euler", **SWEEPS), []
    for fuse in (batch.FUSE, 0):
        monkeypatch.setattr(batch, "FUSE", fuse)
        run = Run(scene)
        found.append([run.recording.positions(3), run.gradient.positions(), run.gradient.material("stretch", elements=True)])
    for a, b in zip(*found, strict=True):
        assert np.array_equal(a, b) if damping else np.abs(a - b).max() < 1e-12 * np.abs(a).max()


def test_points_that_pass_each_other_are_undone_too():
    """An over-relaxed sweep turns a stretched spring about: the direction is then the other one."""
    scene = net(**SWEEPS | {"stiffness": 4e6, "lengths": np.full(11, 0.02), "damping": 0.0, "integrator": "backward_euler"})
    run = Run(scene, frames=1)
    run.state("positions")


@pytest.mark.parametrize("model", ["springs", "membrane"])
def test_a_stiff_sheet_of_240_substeps(model):
    """2e4 N/m, backward Euler, a sweep a substep; checkpoints give the same gradient, and float32 one within 1e-4 (2e-4 by the
    masses of a membrane), by every element too: kernels/math/compensated.py."""
    scene = sheet(model, integrator="backward_euler", solver="xpbd", substeps=80, iterations=1)
    scene.cloths[0].material = replace(scene.cloths[0].material, stretch=2e4)
    run = Run(scene)
    run.material("stretch", 2e4)
    run.state("positions", 2e-6)
    again = Run(scene, keep="checkpoints")
    assert again.recording.slots.bytes < 0.2 * run.recording.slots.bytes
    assert 3 * again.recording.bytes < run.recording.bytes             # of which recorded launches are 4 MB, kept by both
    assert np.abs(again.gradient.positions() - run.gradient.positions()).max() < 1e-12 * np.abs(run.gradient.positions()).max()
    recording = Recording(Simulation(scene, device="cpu", gradients=True), 3)
    single = recording.backward({3: run.x}, {3: run.v})
    for name in ("positions", "velocities", "masses", "gravity", "density"):
        found, exact = (getattr(g, name)() for g in (single, run.gradient))
        most = 2e-4 if (model, name) == ("membrane", "masses") else 1e-4                     # 1.3e-4: they nearly cancel
        assert np.linalg.norm(found - exact) < most * np.linalg.norm(exact), name
    for name, elements in (("stretch", True), ("stretch", False), ("bend", True), ("bend", False)):
        found, exact = (g.material(name, elements=elements) for g in (single, run.gradient))
        assert np.linalg.norm(found - exact) < 1e-4 * np.linalg.norm(exact), name


def test_a_recording_runs_as_a_simulation_and_tells_a_residual_that_is_too_large():
    scene = sheet("springs", integrator="bdf2", **SWEEPS | {"iterations": 2, "substeps": 1})
    scene.cloths[0].material = replace(scene.cloths[0].material, stretch=1e6)
    sim = Simulation(scene, device="cpu", gradients=True)
    Recording(sim, 2).run()
    assert any("bdf2 leaves too large a residual" in text for text in sim.warnings)


def test_nothing_of_it_is_there_without_gradients():
    sim = Simulation(net(**SWEEPS, integrator="backward_euler"), device="cpu")
    assert all(b.adjoint is None for b in sim.plan.method("xpbd").batches)
    assert not any("stored" in name or "undo" in name for name in wp.get_module(sim.model.module).kernels)
