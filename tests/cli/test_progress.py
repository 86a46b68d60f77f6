"""The progress line and the closing report, on streams and clocks of our own."""

import io
import json
from types import SimpleNamespace

import numpy as np
import pytest

from wsim.cli.progress import WIDTH, Progress, progress_line
from wsim.simulation import report
from wsim.simulation.duration import expected_time_and_error, format_duration, long_run
from wsim.usd.result.as_json import as_json


class Terminal(io.StringIO):
    def isatty(self):
        return True

    def last(self) -> str:
        return self.getvalue().rsplit("\x1b[2K", 1)[-1]


class Clock:
    """Says the next of the given times at every call."""

    def __init__(self, *times: float):
        self.times = list(times)

    def __call__(self) -> float:
        return self.times.pop(0)


def test_time_per_frame_leaves_out_the_first_frame_and_time_left_follows():
    terminal = Terminal()
    progress = Progress(10, terminal, colour=False, clock=Clock(9.0, 9.5, 10.0))
    for done in (1, 2, 3):
        progress.frame(done)
    assert terminal.last() == f"[{'#' * round(0.3 * WIDTH):.<{WIDTH}}] frame 3/10  500 ms/frame  3.5 s left"


def test_nothing_is_drawn_without_a_terminal():
    stream = io.StringIO()
    progress = Progress(2, stream)
    progress.say("loading")
    progress.frame(1)
    progress.clear()
    assert stream.getvalue() == ""


def test_without_a_terminal_a_line_comes_every_five_seconds():
    """Frames of 2 s: at 6 s and at 12 s, each with the time that is left."""
    stream = io.StringIO()
    progress = Progress(8, stream, clock=Clock(0.0, *(2.0 * k for k in range(1, 8))))
    progress.say("compiling")
    for done in range(1, 8):
        progress.frame(done)
    assert stream.getvalue().splitlines() == ["frame 3/8  2 s/frame  10.0 s left", "frame 6/8  2 s/frame  4.0 s left"]


def test_quiet_draws_nothing():
    terminal = Terminal()
    Progress(2, terminal, quiet=True).frame(1)
    stream = io.StringIO()
    Progress(2, stream, quiet=True, clock=Clock(0.0, 9.0)).frame(1)
    assert terminal.getvalue() == stream.getvalue() == ""


@pytest.mark.parametrize(("name", "value", "coloured"), [("NO_COLOR", "1", False), ("NO_COLOR", "", True),
                                                         ("TERM", "dumb", False)])
def test_colour_follows_the_environment(monkeypatch, name, value, coloured):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv(name, value)
    terminal = Terminal()
    Progress(2, terminal).frame(1)
    assert ("\x1b[32m" in terminal.getvalue()) == coloured


def test_a_line_is_redrawn_at_most_twenty_times_a_second_and_at_the_end():
    terminal = Terminal()
    progress = Progress(100, terminal, clock=Clock(*(0.001 * k for k in range(100))))
    for done in range(1, 101):
        progress.frame(done)
    assert 2 <= terminal.getvalue().count("\r") <= 4
    assert "frame 100/100" in terminal.last()


def test_the_line_is_cleared_when_something_fails():
    terminal = Terminal()
    with pytest.raises(ValueError), progress_line(3, terminal) as progress:
        progress.frame(1)
        raise ValueError
    assert terminal.last() == ""


@pytest.mark.parametrize(("seconds", "text"), [(4.25, "4.2 s"), (65.0, "1:05"), (59.99, "60.0 s"), (7384.0, "2:03:04")])
def test_durations(seconds, text):
    assert format_duration(seconds) == text


@pytest.mark.parametrize("seconds, samples, slow", [(9.0, 1, False), (11.0, 1, True), (4.0, 3, True)])
def test_a_run_that_takes_longer_than_ten_seconds_a_frame_is_said(seconds, samples, slow):
    plan = SimpleNamespace(seconds=seconds, choice=SimpleNamespace(error=0.012))
    warnings = long_run(plan, 10, samples)
    assert bool(warnings) == slow
    each = seconds * samples
    assert expected_time_and_error(plan, 10,
                                   samples).startswith(f"about {each:.1f} s a frame, {format_duration(10 * each)} for 10")
    assert expected_time_and_error(plan, 10,
                                   samples).endswith("; expected error 1.2 % of the size, more where small folds grow")
    if slow:
        assert f"a frame takes about {seconds * samples:.1f} s, and 10 of them" in warnings[0] and "--substeps" in warnings[0]


REPORT = {
    "device": "cpu", "precision": "float32", "frames": 96, "points": 6400, "constraints": 38000, "ms_per_frame": 12.345,
    "substeps": 10, "iterations": 4, "integrator": "bdf2", "points_per_second": 5.2e6, "constraints_per_second": 1.23e8,
    "seconds": {"total": 3.5, "load": 0.0123},
    "error": {"max_strain": 0.0123, "penetration": np.float64(1e-5), "residual": 0.2},
    "stages": [{"name": "predict", "phase": "predict", "ms": 0.25}, {"name": "distance", "phase": "solve", "ms": 1.0},
               {"name": "bend", "phase": "solve", "ms": 0.5}],
    "skipped": [{"stage": "contact", "why": "there is no collider"}], "warnings": ["warning: /cloth: odd"],
}


@pytest.mark.parametrize("words", [
    "96 frames of 6400 points and 38000 constraints on cpu, float32",
    "12.3 ms/frame; 5.2 M points and 123 M constraints a second",
    "load 12.3 ms, total 3.50 s", "solve    1.5 ms a substep, launched one by one (distance 1, bend 0.5)",
    "max strain 1.23 %", "penetration 1e-05 m", "residual 0.2",
    "left out  contact: there is no collider", "warning: /cloth: odd"])
def test_the_report_says(words):
    assert words in report.report_text(REPORT, verbose=True)


def test_a_report_tells_errors_apart_from_energies_and_what_the_scene_lacks_when_asked():
    energies = {"kinetic_energy": 1.5, "gravity_energy": -2.0, "energy": -0.5, "contacts": 3, "too_near": 0}
    told = report.report_text({**REPORT, "error": {**REPORT["error"], **energies}}).splitlines()
    (error,) = (line for line in told if line.startswith("error"))
    (energy,) = (line for line in told if line.startswith("energy"))
    assert error == "error     penetration 1e-05 m, residual 0.2" and "figures   max strain 1.23 %" in told
    assert energy == "energy    kinetic 1.5 J, gravity -2 J, total -0.5 J"
    assert "count     contacts 3" in told and not [line for line in told if "left out" in line or "a substep" in line]


@pytest.mark.parametrize("what, said, line", [
    ({"points": 0, "sizes": {"grid": 9}}, False, "fluid speed 2.5 m/s, fluid iterations 4, fluid smoke 0.5 m^3"),
    ({"points": 0, "sizes": {"bodies": 2}}, True, "10 substeps, 1 iteration"), ({}, True, "10 substeps, 1 iteration, bdf2")])
def test_a_report_speaks_of_steps_of_what_there_is(what, said, line):
    """Fluids have steps of their own, rigid bodies one integrator."""
    found = {"fluid_speed": 2.5, "fluid_iterations": 4.0, "fluid_smoke": 0.5} if not said else {}
    told = report.report_text({**REPORT, "iterations": 1, "error": found, **what})
    assert ("substeps" in told) == said and f"{line}\n" in told


def test_a_report_with_less_is_shorter_but_whole():
    few = {"device": "cpu", "precision": "float64", "frames": 1, "ms_per_frame": 2.0}
    assert report.report_text(few).splitlines()[1] == "time      2 ms/frame"


def test_json_holds_numbers_and_null_for_what_is_not_finite():
    values = {"a": np.float32(0.5), "b": float("inf"), "c": np.arange(2), "d": (np.int64(3), None)}
    data = json.loads(as_json(values))
    assert data == {"a": 0.5, "b": None, "c": [0, 1], "d": [3, None]}
