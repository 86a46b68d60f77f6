"""Benches of scenes with soft bodies: what is tried, the reference against an independent one, what is shown of strain."""

import numpy as np
import pytest

from wsim import Bulk, Plane, Scene
from wsim.bench import bench, reference, sweep
from wsim.bench.budget import Budget
from wsim.bench.setting import Setting, first_setting_of_series
from wsim.bench.track import SampledFrames, largest_body_extent, rms_point_distance
from wsim.scene import shapes

E, NU, RHO = 1e4, 0.3, 1e3


def bar(**more) -> Scene:
    """Three cells, clamped at one end: it swings by 2 cm in an eighth of a second."""
    scene = Scene(fps=32.0, frames=4, substeps=4, iterations=2, **more)
    points, tets = shapes.block((0.3, 0.1, 0.1), (3, 1, 1))
    body = scene.soft("/bar", points, tets, material=Bulk(E, NU, RHO))
    scene.pin("/wall", body, range(4))
    return scene


@pytest.mark.parametrize("quick", [False, True])
def test_xpbd_is_not_tried(quick):
    tried = [(s.solver, s.integrator) for s in first_setting_of_series(bar(), quick)]
    assert tried[:2] == [("explicit", "auto"), ("implicit", "backward_euler")]
    assert ("implicit", "implicit_midpoint") in tried and not any(solver == "xpbd" for solver, _ in tried)
    assert all(s.solver != "xpbd" for s, _ in reference.reference_methods(bar(), 10))


def test_the_midpoint_is_not_tried_where_something_is_hit():
    scene = bar()
    scene.collider("/ground", Plane("Z"))
    assert all(s.integrator != "implicit_midpoint" for s in first_setting_of_series(scene))
    assert [(s.solver, order) for s, order in reference.reference_methods(scene, 10)] == [("explicit", 1), ("implicit", 1)]


@pytest.mark.parametrize("unsure, integrator", [(2.0, "rk4"), (0.0, "bdf2")])
def test_the_reference_is_as_near_to_an_independent_one_as_it_says(unsure, integrator, monkeypatch):
    """By Runge-Kutta; and by Newton's method where explicit steps are thought to cost too much."""
    pytest.importorskip("scipy")
    from tools.bench.soft.reference import Solid, exact
    monkeypatch.setattr(reference, "UNSURE", unsure)
    scene = bar()
    soft = scene.softs[0]
    made = reference.make_reference_solution(scene, SampledFrames("cpu", 4), Budget(600.0), lambda text: None)
    solid = Solid(soft.points.astype(np.float64), soft.tets, scene.pins[0].points, E, NU, RHO)
    wanted, _ = exact(solid, (0.125,), 1e-8, frame=1.0 / 32.0)
    error = rms_point_distance(made.track.places[-1:], wanted)[0] / largest_body_extent(scene)
    assert made.track.setting.integrator == integrator and not made.refused
    assert error <= 1.5 * made.error + 1e-7 and made.error <= reference.TARGET


@pytest.fixture
def few(monkeypatch):
    """One series and nothing in float64: seconds instead of minutes."""
    monkeypatch.setattr(sweep, "first_setting_of_series", lambda scene, quick: iter([Setting("implicit", "bdf2", 1, 2)]))
    monkeypatch.setattr(sweep, "DOUBLES", 0)
    monkeypatch.setattr(sweep, "ENOUGH", 2e-3)


def test_a_bench_says_what_was_not_tried_and_errors_fall(few):
    found = bench(bar(), device="cpu", budget=600.0)
    rows = [r for r in found.rows if r.setting.solver == "implicit"]
    assert not found.refused and len(rows) > 1 and rows[-1].largest < 0.5 * rows[0].largest
    assert "left out  xpbd: it has no tetrahedra" in found.text()
    assert found.recommend(0.01) is not None


def test_the_strain_of_tets_is_shown_where_errors_of_positions_are_not(few):
    found = bench(bar(solver="implicit", integrator="bdf2"), device="cpu", budget=1e-6)
    assert "no refinement" in found.refused and 0.0 < found.rows[0].strain < 0.2
