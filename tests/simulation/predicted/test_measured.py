"""The error that a run reports of its first frames, beside converged runs and closed forms."""

from dataclasses import replace
from math import exp, log, sqrt

import numpy as np
import pytest

from wsim import Box, Fabric, Plane, Scene, Simulation
from wsim.simulation.predicted.growth import GROWS, HIT, SEED, SHARE
from wsim.simulation.predicted.measured import leave_out
from wsim.simulation.report import report_text

STIFF = Fabric(stretch=2600.0, shear=1100.0, bend=8e-4, thickness=6.6e-4, density=185.0, poisson=0.2)


def slivers() -> Scene:
    """A sheet of 5 x 5 cells on a small box, with more columns of points, a thirtieth of a cell beside the inner ones."""
    width, line = 0.13, np.linspace(0.0, 1.0, 6)
    across = np.sort(np.concatenate([line, line[1:-1] + 0.006])) * width
    points = np.array([(x - width / 2, 0.0, z - width / 2) for z in line * width for x in across])
    n = len(across)
    corners = [(j * n + i, (j + 1) * n + i, (j + 1) * n + i + 1, j * n + i + 1) for j in range(5) for i in range(n - 1)]
    triangles = [t for a, b, c, d in corners for t in ((a, b, c), (a, c, d))]
    scene = Scene(fps=30.0)
    scene.cloth("/c", points, np.full(len(triangles), 3), np.ravel(triangles), material=STIFF)
    scene.collider("/b", Box((0.0266, 0.0133, 0.0266)), at=(0.0, -0.02, 0.0))
    return scene


def row(stretched: float) -> Scene:
    """Three points in a row at rest without gravity, the outer two pinned; the springs are so much longer than at rest."""
    scene = Scene(fps=30.0, gravity=(0.0, 0.0, 0.0))
    points = np.array([(-0.1, 0.0, 0.0), (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)])
    net = scene.net("/n", points, [(0, 1), (1, 2)], [50.0], [0.01], lengths=np.full(2, 0.1 / (1.0 + stretched)))
    scene.pin("/p", net, [0, 2])
    return scene


def test_sweeps_report_at_least_the_error_that_they_have_and_the_main_run_keeps_its_bits():
    """Leapfrog of twice as many substeps agrees with the reference."""
    scene = slivers()
    auto, alone = Simulation(scene, device="cpu"), Simulation(scene, device="cpu")
    alone.measured = False
    assert auto.plan.choice.solver == "xpbd"
    auto.run(3)
    alone.run(3)
    assert np.array_equal(auto.positions("/c"), alone.positions("/c"))
    exact = replace(scene, solver="explicit", integrator="leapfrog", substeps=2500)
    fine = Simulation(exact, device="cpu", precision="float64")
    fine.run(3)
    apart = auto.positions("/c") - fine.positions("/c")
    true, said = sqrt((apart**2).sum(axis=1).mean()) / 0.13, auto.report(False)["predicted"]
    assert true <= said["error"] and said["error_before"] < true
    assert "positions err by about" in report_text(auto.report(False))


def test_a_row_that_is_pressed_grows_as_its_middle_point_does():
    """sigma^2 = -2 k strain / m of one free point between two springs; the sum of tensions of the pinned ones is half of it."""
    pressed, pulled = (Simulation(row(s), device="cpu") for s in (-0.02, 0.02))
    for sim in (pressed, pulled):
        assert sim.plan.choice.solver == "explicit"
        sim.run(3)
    square = 50.0 * 0.02 / 0.01 * np.array([1.0, 2.0, 1.0])
    assert log(pressed.measured.growth.factor) == pytest.approx(GROWS * sqrt(square.mean()) * 3 / 30.0, rel=1e-4)
    assert pulled.measured.growth.factor == 1.0


def test_a_pressed_row_is_called_sensitive_once_rounding_has_grown_to_an_edge():
    """An edge is half of the row: SEED exp(n q) + SHARE p exp((n - 1) q) = 1/2 after n frames of q = GROWS sigma dt, p the
    error of the first one's steps."""
    pressed, pulled = row(-0.005), row(0.02)
    pressed.fps = pulled.fps = 3.0
    sim, other = Simulation(pressed, device="cpu"), Simulation(pulled, device="cpu")
    sim.run(1)
    q = GROWS * sqrt(50.0 * 0.005 / 0.01 * 4.0 / 3.0) / 3.0
    n = 1.0 + log(0.5 / (SEED * exp(q) + SHARE * sim.measured.growth.steps)) / q
    assert 3.0 < n < 10.0
    sim.run(int(n) - 1)
    assert not sim.report(False)["predicted"]["sensitive"] and "sensitive" not in report_text(sim.report(False))
    sim.run(1)
    assert sim.report(False)["predicted"]["sensitive"] and "sensitive" in report_text(sim.report(False))
    other.run(int(n) + 1)
    assert not other.report(False)["predicted"]["sensitive"]


def test_leapfrog_reports_the_error_of_hits_once_something_is_hit():
    """A net falls from rest on a floor 5 cm below, at v = sqrt(2 g 0.05 m), after 6.06 frames. It is met somewhere in a step h
    and errs by at most v h; said is HIT v h of the speed at the end of a frame, from the frame on that could meet it."""
    scene = Scene(fps=60.0)
    points = np.array([(x, 0.05, z) for x in (0.0, 0.1) for z in (0.0, 0.1)])
    scene.net("/n", points, [(0, 1), (1, 3), (3, 2), (2, 0)], [50.0], [0.01])
    scene.collider("/floor", Plane())
    sim = Simulation(scene, device="cpu")
    assert sim.plan.choice.solver == "explicit"
    sim.run(4)
    before = 0.1 * sim.report(False)["predicted"]["error"]
    sim.run(4)
    after = 0.1 * sim.report(False)["predicted"]["error"]
    hit = HIT / 60.0 / sim.plan.clock.steps * sqrt(2.0 * 9.81 * 0.05)
    assert before < 0.1 * hit and 0.95 * hit < after < 1.1 * hit


@pytest.mark.parametrize(("half", "beside"), [(0.06, 20), (0.045, 12), (0.3, 0)])
def test_points_beside_the_edges_of_a_box_make_a_run_sensitive_and_a_wide_floor_does_not(half, beside):
    """6 x 6 points 2 cm apart fall on a box. On a top of 12 cm the rim of the net lies within 2 cm of the edges, 20 points; on
    one of 9 cm 4 x 4 points lie, 12 of them so. They are said to err by an edge, a fifth of the size."""
    points = np.array([(0.02 * i - 0.05, 0.052, 0.02 * j - 0.05) for j in range(6) for i in range(6)])
    edges = [(k, k + 1) for k in range(36) if k % 6 < 5] + [(k, k + 6) for k in range(30)]
    scene = Scene(fps=60.0)
    scene.net("/n", points, edges, [50.0], [0.01])
    scene.collider("/box", Box((half, 0.05, half)))
    sim = Simulation(scene, device="cpu")
    sim.run(3)
    growth, said = sim.measured.growth, sim.report(False)["predicted"]
    assert growth.touched and growth.edged == pytest.approx(beside / 36.0)
    assert said["sensitive"] == (beside > 0)
    assert 0.0 < said["error"] - 0.2 * sqrt(beside / 36.0) < 0.02


def test_steps_that_a_scene_names_are_not_measured():
    sim = Simulation(replace(slivers(), solver="xpbd", iterations=1), device="cpu")
    sim.run(1)
    assert not sim.measured and "sensitive" not in sim.report(False)["predicted"]


def test_positions_that_are_set_are_not_the_start_of_a_companion():
    sim = Simulation(slivers(), device="cpu")
    sim.set("/c", "positions", sim.positions("/c") + 1.0)
    sim.run(1)
    assert sim.measured is False


def test_the_companion_steps_when_the_report_asks_and_says_the_same_whenever_it_does():
    """Once behind four frames, or behind each of them; a run that is interrupted has what was compared before."""
    late, often = Simulation(slivers(), device="cpu"), Simulation(slivers(), device="cpu")
    for _ in range(4):
        late.step()
        often.step()
        said = often.report(False)["predicted"]
    assert late.measured.companion is None and late.report(False)["predicted"] == said and said["error_frames"] == 4
    late.step()
    leave_out(late)
    assert late.report(False)["predicted"] == said
