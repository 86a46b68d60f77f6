"""So many frames a second: the most accurate of what is predicted to be fast enough, and what it errs by."""

from pathlib import Path

import numpy as np
import pytest

from tools.bench.choice.scenes import Case
from wsim.scene import Scene, SceneError
from wsim.simulation import cost
from wsim.simulation.duration import warn_of_missed_rate
from wsim.simulation.predicted import rate
from wsim.simulation.simulation import Simulation
from wsim.usd import save

CPU = {"device": "cpu"}


def seconds(sim) -> float:
    return cost.seconds_of_counts(sim.model, cost.count_frame_of_choice(sim.model, sim.plan.choice))


@pytest.mark.parametrize("kind, size, stiffness", [("net", 12, 1e3), ("membrane", 12, 5e3), ("hinges", 12, 5e4),
                                                   ("on a ball", 12, 50.0), ("soft", 2, 1e5), ("on a floor", 2, 1e7)])
def test_more_time_is_less_error_and_all_of_it_is_held(kind, size, stiffness):
    """Down to the solver's own least; and never more than there is, with what the table may be off by."""
    errors, scene = [], Case(kind, size, stiffness).scene
    for fps in (1000.0, 240.0, 60.0, 15.0):
        sim = Simulation(scene, fps=fps, **CPU)
        assert (seconds(sim) <= 1.0 / fps / rate.SPARE) == ("the most accurate" in sim.plan.choice.why)
        assert any("are not held" in w for w in sim.warnings) == (seconds(sim) > 1.0 / fps)
        errors.append(sim.plan.choice.error)
    assert all(np.diff(errors) <= 0.0) and errors[-1] < errors[0]


def test_where_nothing_is_fast_enough_the_fastest_runs_and_says_what_it_takes():
    sim = Simulation(Case("membrane", 40, 5e4).scene, fps=9000.0, **CPU)
    assert sim.plan.choice.why.startswith("nothing holds 9000 frames a second; this is the fastest")
    assert "are not held" in sim.warnings[-1] and "coarser mesh" in sim.warnings[-1]
    sim.step()


def test_newton_steps_are_taken_where_they_err_by_less_than_sweeps_in_the_same_time(monkeypatch):
    """Stiff sheets, launch by launch: leapfrog takes hundreds of substeps, and backward Euler errs with order 1."""
    monkeypatch.setitem(cost.COSTS["cpu"], "packed", cost.COSTS["cpu"]["element"])
    sim = Simulation(Case("hinges", 24, 5e3).scene, fps=15.0, **CPU)
    chosen = sim.plan.choice
    assert (chosen.solver, chosen.integrator.name, chosen.iterations) == ("implicit", "bdf2", 1) and chosen.error < 0.005
    assert "xpbd backward_euler" in chosen.why


def test_what_a_scene_names_stays():
    scene = Case("membrane", 12, 50.0).scene
    for solver, integrator in (("xpbd", "auto"), ("implicit", "bdf2"), ("auto", "symplectic_euler")):
        scene.solver, scene.integrator = solver, integrator
        chosen = Simulation(scene, fps=60.0, **CPU).plan.choice
        assert solver in ("auto", chosen.solver) and integrator in ("auto", chosen.integrator.name)


def test_a_scene_without_points_has_no_setting():
    pyramid = str(Path(__file__).resolve().parents[3] / "scenes" / "pyramid.usda")
    assert Simulation(pyramid, fps=60.0, **CPU).plan.choice.solver == "none"


@pytest.mark.parametrize("fps", [0.0, -1.0, np.inf, np.nan])
def test_what_is_no_rate_is_refused(fps):
    with pytest.raises(SceneError, match="fps: found .* above 0"):
        Simulation(Scene(), fps=fps, **CPU)


def test_the_command_line_says_it_and_refuses_what_contradicts(tmp_path, capsys):
    from wsim.cli import main
    path = str(tmp_path / "net.usda")
    scene = Case("net", 6, 1e3).scene
    scene.frames = 2
    save(scene, path)
    assert main(["plan", path, "--fps", "60", "--device", "cpu"]) == 0
    assert "the most accurate that holds 60 frames a second" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["run", path, "--fps", "60", "--substeps", "3"])
    assert "leave out --substeps, or --fps" in capsys.readouterr().err


def test_a_rate_that_was_predicted_and_is_not_held_is_told():
    """By half of the frames; one long frame is none."""
    said = warn_of_missed_rate(60.0, [12.0, 30.0, 29.0, 31.0])
    assert len(said) == 1 and "60 frames a second were asked for, and half of the frames took 29.5 ms" in said[0]
    assert warn_of_missed_rate(60.0, [12.0, 12.0, 90.0]) == warn_of_missed_rate(None, [90.0]) == warn_of_missed_rate(60.0,
                                                                                                                     []) == []
    sim = Simulation(Case("hinges", 24, 5e3).scene, fps=15.0, **CPU)
    sim.run(2)
    sim.milliseconds[:] = [100.0, 100.0, 100.0]
    assert any("half of the frames took 100 ms" in w for w in sim.report()["warnings"])
