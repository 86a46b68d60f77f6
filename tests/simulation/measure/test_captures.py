"""Graphs of a run: how many are captured and why, and substeps that are a loop of the device."""

from pathlib import Path

import numpy as np
import pytest

from tests.make.gpu.free_frames import net
from tests.physics.contact.selfcontact.rig import SOLVERS, crumple
from wsim.model import launches
from wsim.physics.contact.selfcontact import near
from wsim.scene import Plane
from wsim.simulation import report
from wsim.simulation.measure.captures import capture_forms
from wsim.simulation.simulation import Simulation
from wsim.usd import load

SCENES = Path(__file__).parents[3] / "scenes"


def rollers():
    """Mesh colliders that turn, whose edges surfaces meet."""
    return load(SCENES / "rollers.usda"), 3


def cape():
    """A mesh that joints deform, pins that move with it, wind."""
    return load(SCENES / "bone_cape.usda"), 3


def chart(soft: bool = False, integrator: str = "backward_euler"):
    """Pins that move along curves."""
    scene = load(SCENES / "easing_chart.usda")
    scene.solver, scene.integrator, scene.substeps, scene.iterations = "xpbd", integrator, 24, 2
    for pin in scene.pins if soft else ():
        pin.stiffness, pin.damping = 500.0, 0.5
    return scene, 3


def crumpled(solver: str):
    """A sheet that meets itself, with lists that grow."""
    return crumple(2, 12, 8.0, **SOLVERS[solver]), 4


LOOPED = {"mesh colliders": rollers, "deforming mesh": cape, "pins": chart, "soft pins": lambda: chart(True),
          "bdf2": lambda: chart(False, "bdf2"), "midpoint": lambda: chart(False, "implicit_midpoint"),
          "self-contact bdf2": lambda: crumpled("xpbd bdf2"), "self-contact": lambda: crumpled("xpbd")}


@pytest.mark.parametrize("made", LOOPED.values(), ids=LOOPED)
def test_substeps_in_a_loop_have_the_bits_of_substeps_one_by_one(made, monkeypatch):
    """And a graph holds the launches of three of them."""
    found, counts = [], []
    launch = launches.KernelLaunches.launch
    for many in (1 << 60, 0):
        monkeypatch.setattr(launches, "LOOP_LAUNCHES", many)
        (scene, frames), count = made(), [0]

        def counted(model, *given, count=count):
            count[0] += 1
            launch(model, *given)
        monkeypatch.setattr(launches.KernelLaunches, "launch", counted)
        sim = Simulation(scene, device="cpu")
        sim.run(frames)
        assert bool(sim.plan.loop) == (many == 0)
        found.append(np.concatenate([sim.positions(b.path) for b in scene.bodies()]))
        counts.append(count[0])
    assert np.array_equal(*found) and counts[1] < 0.8 * counts[0]             # first frames of bdf2 have no graph


def test_a_run_tells_when_and_why_it_captured():
    scene = crumple(0, 8, 1.0, **SOLVERS["xpbd"])
    sim = Simulation(scene, device="cpu")
    sim.run(2)
    sim.graphs.forget("a value was set")
    sim.run(1)
    told = sim.report()["captures"]
    assert [(c["frame"], c["why"]) for c in told] == [
        (1, "the first frame with contacts"), (2, "the first frame without contacts"), (3, "a value was set")]
    assert all(c["seconds"] > 0.0 for c in told)
    late = [dict(told[0], frame=11, why="another solver"), *told[:2]]
    assert "captured 3 times" in report.report_text(sim.report() | {"captures": late})
    assert "1 of them after frame 10" in report.report_text(sim.report() | {"captures": late})
    assert "frame 11, with contacts: another solver" in report.report_text(sim.report() | {"captures": late})


def test_forms_that_are_captured_early_have_the_bits_of_forms_captured_when_they_come():
    """Of a net that falls on the ground: without contacts, with them behind such a frame, with them. A GPU
    captures all three behind the first frame."""
    places, captured = [], []
    for early in (False, True):
        sim = Simulation(net(8, Plane(), at=(0.0, 0.0, 0.0), height=0.6, velocity=(0.0, 0.0, -8.0), pinned=False), device="cpu")
        sim.step()
        if early:
            capture_forms(sim)
        before = len(sim.graphs.log)
        sim.run(6)
        captured.append(len(sim.graphs.log) - before)
        places.append(sim.positions())
    assert captured == [2, 0] and sim.forms["free"] > 1 and np.array_equal(*places)


def test_nothing_is_captured_or_repeated_once_a_run_is_prepared(monkeypatch):
    """Of a sheet that crumples: its first list has room for four pairs a point, and its second frame wants eleven."""
    monkeypatch.setattr(near, "EACH", 4)
    ready, other = (Simulation(crumple(3, 24, 8.0, **SOLVERS["xpbd"]), device="cpu") for _ in range(2))
    ready.prepare()
    captured = len(ready.graphs.log)
    ready.run(4)
    other.run(4)
    assert captured == 2 and len(ready.graphs.log) == captured and not ready.repeats
    assert any("there was room for" in said for said in other.repeats)
