"""The suite and the comparison of two revisions: judging on made-up rows, and a few rows on the CPU."""

import json
import subprocess
import sys
from math import nan

import numpy as np
import pytest

from tools.bench import compare, suite
from tools.bench.nets import plot
from tools.bench.problems import PROBLEMS, discrete
from wsim.scene.integrator import TABLE

FALL, OSCILLATOR = (next(p for p in PROBLEMS if p.name == name) for name in ("fall", "oscillator"))


def row(name="p s i 1 x 1", ms=1.0, error=0.1, **more):
    return {"name": name, "ms": ms, "error": error, "finite": error is not None, "unit": "m", "known": 1e-7} | more


def only(a, b):
    """The one entry of the table of runs with one row each."""
    (found,) = compare.beside([[r] for r in a], [[r] for r in b])
    return found


# closed forms

@pytest.mark.parametrize("integrator, order", [(n, TABLE[n].order) for n in (
    "backward_euler", "bdf2", "implicit_midpoint", "sdirk3", "symplectic_euler", "leapfrog", "rk4")])
def test_the_discrete_closed_forms_have_the_orders_of_their_integrators(integrator, order):
    """x = cos(10 t), at 0.5 s."""
    errors = [discrete(integrator, 1.0, 0.0, 0.5 / n, n, w=10.0) - np.cos(5.0) for n in (200, 400)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


def test_an_integrator_without_a_closed_form_says_so():
    with pytest.raises(ValueError, match="no closed form of heun"):
        discrete("heun", 1.0, 0.0, 0.1, 1)


# rows

def test_names_of_rows_are_unique_and_the_quick_ones_are_among_all():
    names, quick = ([suite.name_of(p.name, s) for p, s in suite.rows(q)] for q in (False, True))
    assert len(set(names)) == len(names) and 0 < len(quick) < len(names) and set(quick) < set(names)


def test_only_takes_rows_by_parts_of_their_names():
    found = {(p.name, s["integrator"]) for p, s in suite.rows(only=("fall explicit rk4", "damped xpbd"))}
    assert found == {("fall", "rk4"), ("damped", "backward_euler"), ("damped", "bdf2")}


def test_what_is_no_number_is_written_as_none_and_said():
    found = suite.judged({"name": "x", "ms": 1.0}, {"error": nan, "drift": 0.5})
    assert found["error"] is None and found["drift"] == 0.5 and found["finite"] is False
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("problem, solver, integrator", [
    (FALL, "explicit", "symplectic_euler"), (OSCILLATOR, "xpbd", "bdf2"), (OSCILLATOR, "implicit", "backward_euler")])
def test_a_row_errs_by_what_its_integrator_does(problem, solver, integrator):
    """In float64 the distance from the integrator's own closed form is rounding: 240 substeps or fewer, 1e-12 each."""
    setting = {"solver": solver, "integrator": integrator, "substeps": 8, "iterations": 2}
    setting |= {"substeps": problem.stable} if solver == "explicit" else {}
    found = suite.run(problem, setting, "cpu", "float64")
    assert found["finite"] and found["discrete"] < 1e-9 < found["error"] and found["ms"] > 0.0 and not found["warnings"]


def test_a_method_that_is_not_known_is_a_row_that_failed():
    found = suite.run(FALL, {"solver": "magic", "integrator": "auto", "substeps": 1, "iterations": 1}, "cpu")
    assert not found["finite"] and "magic" in found["failed"] and "cannot run" in suite.line(found)


# soft bodies

def soft(name: str, solver: str, integrator: str, substeps: int) -> dict:
    problem = next(p for p in suite.PROBLEMS if p.name == name)
    return suite.run(problem, {"solver": solver, "integrator": integrator, "substeps": substeps, "iterations": 1}, "cpu")


def test_no_row_of_a_soft_body_is_one_of_xpbd():
    found = {(p.name, s["solver"]) for p, s in suite.rows(only=("soft_",))}
    assert found == {(f"soft_{what}", solver) for what in ("rest", "frequency", "modulus", "spin")
                     for solver in ("explicit", "implicit")}


@pytest.mark.parametrize("name, solver, integrator, substeps, bound", [
    ("soft_rest", "implicit", "backward_euler", 1, 1e-5), ("soft_frequency", "explicit", "leapfrog", 12, 5e-5),
    ("soft_modulus", "implicit", "backward_euler", 1, 1e-4), ("soft_spin", "explicit", "leapfrog", 6, 1e-3)])
def test_soft_bodies_are_as_near_to_what_is_known_as_they_should_be(name, solver, integrator, substeps, bound):
    pytest.importorskip("scipy")
    found = soft(name, solver, integrator, substeps)
    assert found["finite"] and found["error"] < bound and not found["warnings"]


def test_without_scipy_a_row_that_needs_it_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "tools.bench.soft.reference", None)
    monkeypatch.delattr("tools.bench.soft.reference", raising=False)
    found = soft("soft_rest", "explicit", "leapfrog", 12)
    assert "SciPy" in found["failed"] and "Traceback" not in found["failed"]


# side by side

def test_slower_by_more_than_the_spread_is_marked():
    """Medians 1 and 1.3, both sides spread by 0.1."""
    a, b = [row(ms=t) for t in (0.95, 1.0, 1.05)], [row(ms=1.3 * t) for t in (0.95, 1.0, 1.05)]
    assert only(a, b)["marks"] == ["SLOWER"] and only(b, a)["marks"] == ["faster"]
    assert only(a, b)["ratio"] == pytest.approx(1.3) and only(a, b)["spread"] == pytest.approx(0.1)


def test_slower_by_less_than_the_spread_is_not_marked():
    a, b = [row(ms=t) for t in (0.9, 1.0, 1.1)], [row(ms=1.15 * t) for t in (0.9, 1.0, 1.1)]
    assert only(a, b)["marks"] == []


def test_one_fast_pair_is_enough_for_a_doubt():
    """Medians 1 and 2; the second pair went the other way, whatever the spread."""
    assert only([row(ms=t) for t in (1.0, 1.0, 1.0)], [row(ms=t) for t in (2.0, 0.99, 2.0)])["marks"] == []


def test_one_repeat_has_no_spread_and_marks_no_time():
    assert only([row(ms=1.0)], [row(ms=9.0)])["spread"] is None and only([row(ms=1.0)], [row(ms=9.0)])["marks"] == []


@pytest.mark.parametrize("a, b, marks", [
    (0.1, 0.1005, []), (0.1, 0.102, ["LESS ACCURATE"]), (0.1, 0.05, []), (1e-9, 9e-8, []), (1e-9, 2e-7, ["LESS ACCURATE"]),
    (0.1, None, ["NOT FINITE"]), (None, 0.1, []), (None, None, [])])
def test_errors_are_judged_past_what_the_answer_is_known_to(a, b, marks):
    assert only([row(error=a)], [row(error=b)])["marks"] == marks


def test_how_fast_nonsense_is_says_nothing():
    assert only([row(ms=t, error=None) for t in (1.0, 1.0)], [row(ms=t) for t in (2.0, 2.0)])["marks"] == []


def test_what_a_side_cannot_run_is_named_with_the_reason():
    a = [[row("both"), row("old"), {"name": "new", "finite": False, "failed": "TypeError: solver\nmore"}]]
    b = [[row("both"), row("new"), row("newest")]]
    table = compare.beside(a, b)
    assert [r["name"] for r in table] == ["both", "new", "newest", "old"]
    assert [r["cannot"] for r in table] == [{}, {"A": "TypeError: solver"}, {"A": "no such row"}, {"B": "no such row"}]
    text = "\n".join([*map(compare.line, table), *compare.summed(table)])
    assert "A cannot run: 2\n    new\n    newest" in text and "B cannot run: 1\n    old" in text


def test_a_table_is_printed_with_times_errors_and_marks():
    text = compare.line(only([row(ms=1.0)] * 2, [row(ms=2.0, error=0.2)] * 2))
    assert text.split() == ["p", "s", "i", "1", "x", "1", "1.000", "2.000", "2.000", "(2.000", "to", "2.000)", "1.00e-01",
                            "2.00e-01", "SLOWER,", "LESS", "ACCURATE"]


def test_an_unknown_revision_is_refused_by_name():
    done = subprocess.run([sys.executable, compare.__file__, "no_such_revision", "WORK"], capture_output=True, text=True,
                          cwd=compare.ROOT)
    assert done.returncode == 1 and "compare: git" in done.stderr and "Traceback" not in done.stderr


# the picture

def result(tmp_path, name="r.json", **problem):
    rows = [{"side": side, "solver": solver, "ms": ms, "finite": error is not None, "error_025": error}
            for side, solver, ms, error in (("wsim", "explicit", 0.3, 1e-6), ("wsim", "xpbd", 1.0, 1e-3),
                                            ("newton", "vbd", 9.0, 0.01), ("newton", "vbd_tile", 8.0, 0.02),
                                            ("newton", "xpbd", 1.0, 3.0), ("newton", "xpbd", 2.0, None))]
    problem = {"n": 32, "stiffness": 1e3, "worst": 0.3, "newton": "1", "rows": rows} | problem
    (tmp_path / name).write_text(json.dumps({"hardware": "GPU", "wsim": "abc", "warp": "1", "problems": [problem]}))
    return str(tmp_path / name)


def test_rows_of_a_metre_and_of_no_number_are_left_out_and_counted(tmp_path):
    (problem,) = plot.sheets([result(tmp_path)])
    assert plot.left_out(problem) == {"Newton XPBD": 2} and "2 of Newton XPBD" in plot.below([problem])
    assert {kind[2]: len(rows) for kind, rows in plot.series(problem)}["Newton VBD"] == 2


def test_of_the_same_sheet_twice_the_later_file_counts(tmp_path):
    files = [result(tmp_path, "a.json", worst=1.0), result(tmp_path, "b.json", worst=2.0), result(tmp_path, "c.json", n=16)]
    assert [(p["n"], p["worst"]) for p in plot.sheets(files)] == [(16, 0.3), (32, 2.0)]


@pytest.mark.parametrize("text", ["", "[]", "{}"])
def test_another_file_is_refused_by_name(tmp_path, text):
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(SystemExit, match=r"x\.json is no result"):
        plot.sheets([str(tmp_path / "x.json")])


def test_a_picture_is_1200_pixels_wide(tmp_path):
    pytest.importorskip("matplotlib")
    plot.draw(plot.sheets([result(tmp_path)]), str(tmp_path / "p.png"))
    png = (tmp_path / "p.png").read_bytes()
    assert int.from_bytes(png[16:20]) == 1200 and sorted(f.suffix for f in tmp_path.iterdir()) == [".json", ".png"]


def test_without_matplotlib_the_mend_is_said(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(SystemExit, match=r"pip install -e"):
        plot.draw(plot.sheets([result(tmp_path)]), str(tmp_path / "p.png"))


@pytest.mark.parametrize("value, text", [(1.0, "1 m"), (0.01, "10 mm"), (1e-6, "1 \u00b5m"), (1e-8, "10 nm")])
def test_lengths_are_labelled_by_their_unit(value, text):
    assert plot.length(value) == text
