"""A bench's parts on made-up rows, and benches of scenes whose answer is known, on the CPU."""

import json
import os
import sys
import time
from dataclasses import replace
from math import inf

import numpy as np
import pytest

from tests.conftest import grid
from tests.make.bench.bench import report, row
from wsim import cli
from wsim.bench import Report, bench, cache, front, reference, sweep
from wsim.bench.budget import Budget
from wsim.bench.setting import Setting, first_substeps, scene_is_smooth
from wsim.bench.study import default_bench_frames
from wsim.bench.track import SampledFrames, largest_body_extent, rms_point_distance, run_with_setting
from wsim.cli import bench as command
from wsim.scene import Scene, SceneError, Surface
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation
from wsim.usd import save

G = 9.81


def spring_scene(**more) -> Scene:
    """A mass of 1/4 kg on a spring of 64 N/m and 1/2 m that hangs from a pinned point: 16 rad/s. All exact in binary."""
    scene = Scene(fps=32.0, frames=8, substeps=8, **more)
    net = scene.net("/net", [[0.0, 0.0, 0.0], [0.0, -0.5, 0.0]], [[0, 1]], [64.0], [0.25])
    scene.pin("/pin", net, [0])
    return scene


def hung(t: np.ndarray) -> np.ndarray:
    """Height of that mass: it swings about its equilibrium, m g / k below."""
    return -0.5 - G / 256.0 * (1.0 - np.cos(16.0 * t))


# choosing

def test_the_front_is_what_nothing_beats_in_both():
    rows = [row(1, 0.1), row(2, 0.05), row(3, 0.07), row(4, 0.01), row(4, 0.02), row(9, 0.01)]
    assert front.pareto_front(rows) == [rows[0], rows[1], rows[3]]


def test_a_row_that_gave_way_or_failed_is_on_no_front():
    assert front.pareto_front([row(1, 0.1, held=False), row(2, inf), row(3, 0.2)])[0].ms == 3


def test_errors_below_the_reference_s_own_are_equal():
    rows = [row(1, 0.1), row(2, 2e-3), row(3, 1e-3)]
    assert front.pareto_front(rows, doubt=5e-3) == rows[:2]


def test_the_fastest_within_an_error_bears_the_reference_s_doubt():
    rows = [row(1, 0.0095), row(2, 0.008), row(3, 0.001)]
    assert front.within_error(rows, 0.01) is rows[0]
    assert front.within_error(rows, 0.01, doubt=1e-3) is rows[1]
    assert front.within_error(rows, 1e-4) is None


def test_real_time_keeps_a_margin():
    rows = [row(5, 0.1), row(8, 0.01), row(9, 0.001)]
    assert front.within_time(rows, dt=0.010, margin=0.2) is rows[1]
    assert front.within_time(rows, dt=0.010, margin=0.0) is rows[2]
    assert front.within_time(rows, dt=0.001) is None


def test_float64_is_recommended_where_no_float32_will_do():
    single, double = row(10, 0.01), row(9, 0.001, "float64")
    assert front.within_error([single, double], 0.02) is single
    assert front.within_error([single, double], 0.002) is double


def test_nothing_is_recommended_where_errors_are_refused():
    assert report([row(1, 1e-6)], refused="it amplifies").recommend(0.01) is None


def test_a_frame_that_takes_no_tick_of_the_clock_ends_a_series_in_words():
    """It divided by 0."""
    there = reference.ReferenceSolution(None, 0.0, np.nan, np.ones(1), 0.0)
    made = sweep.BenchSweep(Scene(), None, there, None, print, rows=[row(0.0, 0.01)])
    assert not made.goes_on(row(1.0, 0.02)) and "10000 times faster" in made.left_out[0]["why"]


# the reference

@pytest.mark.parametrize("order", [1, 2, 4])
def test_richardson_finds_the_error_of_a_pure_power(order):
    """x_k = 2^(-order k): the differences of levels 0 to 3 and the error of level 3."""
    x = [2.0**(-order * k) for k in range(4)]
    assert reference.richardson([x[0] - x[1], x[1] - x[2], x[2] - x[3]], order) == pytest.approx(x[3], rel=1e-14)


def test_richardson_believes_the_slower_fall():
    """Order 4 was hoped for, 2 is seen: differences 4, 1 leave 1/4 + 1/16 ... = 1/3."""
    assert reference.richardson([4.0, 1.0], 4) == pytest.approx(1.0 / 3.0)


@pytest.mark.parametrize("differences", [[1.0, 1.0], [1.0, 0.9], [1.0, 2.0]])
def test_differences_that_do_not_shrink_leave_the_error_unknown(differences):
    assert reference.richardson(differences, 2) == inf
    assert "does not converge" in reference.reason_errors_are_refused(np.ones(2), inf)


def test_growth_beyond_the_limit_refuses_and_says_how_many_frames_are_calm():
    why = reference.reason_errors_are_refused(np.array([1.0, 5e3]), 1e-5)
    made = replace(report([row(1, None)]), refused=why, growth=[1.0, 5e3])
    assert "grows 5e+03 times" in why and "--frames 1 compares" in made.text()


def test_errors_below_the_reference_s_own_are_printed_as_such():
    assert "< 0.1 %" in report([row(1, 1e-5)], error=1e-3).text()


# what is varied

def test_the_first_substeps_last_about_a_hundredth():
    assert [first_substeps(Scene(fps=fps)) for fps in (24.0, 60.0, 120.0, 1000.0)] == [4, 2, 1, 1]


def test_colliders_tethers_and_limits_are_not_smooth(scene):
    assert scene_is_smooth(scene)
    assert not scene_is_smooth(scene.with_objects("Cloth", [replace(scene.cloths[0], tethers=True)]))
    assert not scene_is_smooth(scene.with_objects("Cloth", [replace(scene.cloths[0], material=Fabric(strain_limit=0.1))]))
    scene.collider("/ball", Surface(*grid()))
    assert not scene_is_smooth(scene)


def test_at_most_half_a_second_is_looked_at():
    assert [default_bench_frames(Scene(fps=24.0, frames=n)) for n in (0, 3, 96)] == [1, 3, 12]


def test_samples_are_even_and_end_with_the_last_frame():
    assert SampledFrames("cpu", 3).sampled == [1, 2, 3] and SampledFrames("cpu", 24).sampled == list(range(2, 25, 2))


def test_a_budget_counts_from_its_start():
    now = [5.0]
    budget = Budget(10.0, lambda: now[0])
    now[0] = 9.0
    assert (budget.spent, budget.left(), budget.left(0.5), budget.left(0.1)) == (4.0, 6.0, 1.0, 0.0)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The cache in a folder of this test."""
    monkeypatch.setattr(cache, "report_cache_folder", lambda: tmp_path / "kept")
    return tmp_path / "kept"


# benches

@pytest.fixture
def few(monkeypatch):
    """Two series and nothing in float64: seconds instead of minutes."""
    monkeypatch.setattr(sweep, "first_setting_of_series", lambda scene, quick: iter([Setting("xpbd", "backward_euler", 8, 4)]))
    monkeypatch.setattr(sweep, "DOUBLES", 0)
    monkeypatch.setattr(sweep, "ENOUGH", 4e-3)


def test_backward_euler_falls_as_much_too_far_as_it_must(few):
    """Points that fall from rest by backward Euler of n steps h are g t h / 2 too low; the pair's spring is slack."""
    scene = Scene(fps=32.0, frames=8, substeps=8)
    scene.net("/net", [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0, 1]], [64.0], [0.25])
    found = bench(scene, device="cpu", budget=600.0)
    rows = [r for r in found.rows if r.setting.solver == "xpbd"]
    assert found.size == 1.0 and not found.refused and rows
    for r in rows:
        assert r.end == pytest.approx(G * 0.25 / 32.0 / r.setting.substeps / 2.0, rel=1e-3)


def test_the_reference_is_as_near_to_a_swinging_mass_as_it_says(few):
    look, scene = SampledFrames("cpu", 8), spring_scene()
    made = reference.make_reference_solution(scene, look, Budget(600.0), lambda text: None)
    exact = hung(np.arange(1, 9) / 32.0)
    error = np.abs(made.track.places[:, 1, 1] - exact).max() / 2.0**0.5 / largest_body_extent(scene)  # RMS: one of two points
    assert error <= 1.5 * made.error <= 1.5e-4 and made.growth.max() < 2.0


def test_the_error_of_a_row_is_that_against_the_closed_form(few):
    scene = spring_scene()
    found = bench(scene, device="cpu", budget=600.0)
    r = next(r for r in found.rows if r.setting.solver == "xpbd")
    track = run_with_setting(scene, r.setting, SampledFrames("cpu", 8))
    exact = np.zeros((8, 2, 3))
    exact[:, 1, 1] = hung(np.arange(1, 9) / 32.0)
    wanted = rms_point_distance(track.places, exact) / largest_body_extent(scene)
    assert r.largest == pytest.approx(wanted.max(), abs=2.0 * found.reference["error"] + 1e-6)
    assert r.end == pytest.approx(wanted[-1], abs=2.0 * found.reference["error"] + 1e-6)


def test_a_scene_that_amplifies_perturbations_is_refused(few):
    """A chain that stands on its end: a link of it alone tips over by exp(sqrt(g / l) t), 100 times in half a second."""
    scene = Scene(fps=32.0, frames=16, substeps=8)
    points = np.zeros((5, 3))
    points[:, 1] = 0.0625 * np.arange(5)
    net = scene.net("/net", points, [[k, k + 1] for k in range(4)], [512.0], [0.0625])
    scene.pin("/pin", net, [0])
    found = bench(scene, device="cpu", budget=600.0)
    assert "amplifies perturbations" in found.refused and "--frames" in found.text()
    assert all(r.end is None and r.largest is None and np.isfinite(r.drift) for r in found.rows)
    assert found.recommend(0.5) is None


def test_what_the_budget_does_not_pay_for_is_named(few):
    found = bench(spring_scene(), device="cpu", budget=1e-6)
    assert "no refinement" in found.refused and len(found.rows) == 1
    assert any("xpbd backward_euler 8 x 4" in d["setting"] and "budget" in d["why"] for d in found.left_out)


def test_a_frame_on_a_cpu_is_timed_by_what_it_takes_of_it(monkeypatch):
    """A frame that waits for 20 ms, as for others on the machine, takes none of them; `seconds`, for the budget, has them."""
    replay = Simulation._replay
    monkeypatch.setattr(Simulation, "_replay", lambda sim: (time.sleep(0.02), replay(sim))[1])
    found = run_with_setting(spring_scene(), Setting("xpbd", "backward_euler", 8, 4), SampledFrames("cpu", 4))
    assert found.ms < 1e3 * found.seconds / 4 - 15.0
    assert "times of frames are CPU seconds of all threads" in report([row(1, 0.1)]).text()


def test_a_scene_in_which_nothing_moves_is_an_error(few):
    with pytest.raises(SceneError, match="nothing moves"):
        bench(spring_scene(gravity=(0.0, 0.0, 0.0)), device="cpu")


@pytest.mark.parametrize(("more", "word"), [({"device": "cuda:99"}, "no device"), ({"budget": -1.0}, "budget"),
                                            ({"frames": 0}, "frames")])
def test_bad_arguments_are_named(more, word):
    with pytest.raises(SceneError, match=word):
        bench(spring_scene(), **{"device": "cpu", **more})


# the command line

@pytest.fixture
def stage(tmp_path):
    path = str(tmp_path / "scene.usda")
    save(spring_scene(), path)
    return path


def wsim(*arguments) -> int:
    try:
        return cli.main([str(a) for a in arguments])
    except SystemExit as exit:
        return exit.code


@pytest.mark.parametrize("arguments", [("--error", "0"), ("--error", "-1%"), ("--error", "101%"), ("--error", "1.5"),
                                       ("--error", "1%%"), ("--error", "much"), ("--error", "1%", "--substeps", "4"),
                                       ("--error", "1%", "--precision", "float32")])
def test_an_error_that_is_none_is_wrong_usage(stage, tmp_path, arguments, capsys):
    assert wsim("run", stage, "-o", tmp_path / "out.usdc", *arguments) == 2
    assert "error" in capsys.readouterr().err


@pytest.mark.parametrize(("text", "value"), [("1%", 0.01), ("0.1 %", 0.001), ("0.01", 0.01), ("100%", 1.0)])
def test_errors_are_read_as_percent_or_as_fractions(text, value):
    assert cli.parse_error_fraction(text) == pytest.approx(value)


@pytest.mark.parametrize("arguments", [("--plot", "a.txt"), ("--plot", "no/folder/a.png"), ("--json", "a.usda"),
                                       ("--budget", "0"), ("--frames", "0")])
def test_bad_options_of_a_bench_are_wrong_usage(stage, arguments):
    assert wsim("bench", stage, *arguments) == 2


def test_a_plot_without_matplotlib_is_refused_before_the_bench(stage, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert wsim("bench", stage, "--device", "cpu", "--plot", tmp_path / "a.png") == 1
    assert 'pip install -e ".[plot]"' in capsys.readouterr().err


def test_a_bench_prints_writes_and_is_kept_for_run(few, kept, stage, tmp_path, capsys):
    """What the bench recommends for 5 % is what run takes, without another bench."""
    assert wsim("bench", stage, "--device", "cpu", "--budget", "600", "--json", tmp_path / "a.json") == 0
    assert "real time" in capsys.readouterr().out
    data = json.loads((tmp_path / "a.json").read_text())
    wanted = Report.from_dict(data).recommend(0.05).setting
    assert wsim("run", stage, "-o", tmp_path / "out.usdc", "--device", "cpu", "--error", "5%", "--json") == 0
    told = capsys.readouterr()
    ran = json.loads(told.out)
    assert "runs first" not in told.err
    assert Setting(ran["solver"], ran["integrator"], ran["substeps"], ran["iterations"], ran["precision"]) == wanted


def test_run_benches_where_nothing_is_known_and_says_so(kept, stage, monkeypatch, capsys):
    monkeypatch.setattr(command, "bench", lambda scene, **more: report([row(1, 1e-4)]))
    scene, setting = command.recommended_scene(spring_scene(), 0.01, "cpu", lambda text: None)
    assert "it runs first" in capsys.readouterr().err
    assert (scene.integrator, scene.substeps, setting.precision) == ("bdf2", 1, "float32")


@pytest.mark.parametrize(("made", "words"), [(report([row(1, 0.1)]), "stays within 1 %"),
                                             (report([row(1, None)], refused="it amplifies"), "can be promised")])
def test_run_fails_with_the_mend_where_no_setting_is_known(kept, made, words, monkeypatch):
    monkeypatch.setattr(command, "bench", lambda scene, **more: made)
    with pytest.raises(SceneError, match=words):
        command.recommended_scene(spring_scene(), 0.01, "cpu", lambda text: None)


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_a_plot_is_written_whole(tmp_path, ending):
    pytest.importorskip("matplotlib")
    from wsim.bench.plot import plot_bench_report

    rows = [row(k, 0.1 / k**2, own=k == 1, held=k < 3) for k in range(1, 5)] + [row(3, 0.0), row(4, 1e-3, "float64")]
    plot_bench_report(report(rows, error=1e-2), str(tmp_path / f"a.{ending}"))
    assert os.listdir(tmp_path) == [f"a.{ending}"]
    assert (tmp_path / f"a.{ending}").read_bytes()[:5] in (b"\x89PNG\r", b"<?xml")
