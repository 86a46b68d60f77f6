"""Sweeps in this process: the table, what is refused before anything runs, what is gone on with."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.sweep.sweep import CPU, hung, lasting, table
from wsim import cli
from wsim.scene import SceneError
from wsim.simulation.simulation import Simulation
from wsim.sweep.job import Settings


def test_a_row_is_what_a_simulation_of_its_own_gives(file, tmp_path):
    """Values, strain, energy; each run to the bit."""
    vary = ["/World/Cloth:stretch=log(100,1000,3)", "gravity_y=list(-9.81,-3)"]
    rows = list(wsim.sweep(file, vary, tmp_path / "out", settings=CPU))
    assert [r["run"] for r in rows] == list(range(6)) and {r["status"] for r in rows} == {"done"}
    for row in rows:
        scene = wsim.load(file)
        scene.cloths[0].material = replace(scene.cloths[0].material, stretch=row["/World/Cloth:stretch"])
        scene.gravity = (0.0, row["gravity_y"], 0.0)
        sim = Simulation(scene, device="cpu")
        sim.plan.clock.touching = True
        sim.run()
        found = sim.indicators()
        for name in ("max_strain", "rms_strain", "kinetic_energy", "gravity_energy"):
            assert row[name] == pytest.approx(found[name], rel=1e-12), name
    assert len({r["state"] for r in rows}) == 6
    assert lasting(table(tmp_path / "out")) == lasting(rows)


def test_worlds_of_one_state_give_the_table_of_runs_alone(file, tmp_path):
    vary = ["stretch=log(100,1000,3)", "/World/Ball:dynamic_friction=list(0.1,0.9)", "wind=list(0 0 0, 1 0 2)"]
    tables = [list(wsim.sweep(file, vary, tmp_path / str(n), settings=Settings(device="cpu", worlds=n))) for n in (1, 5, 12)]
    assert {r["worlds"] for r in tables[2]} == {12}
    assert lasting(tables[0]) == lasting(tables[1]) == lasting(tables[2])


@pytest.mark.parametrize(("vary", "words"), [
    ("/World/Cloth:strech=lin(1,2,2)", "has no value 'strech'; there are stretch, "),
    ("/World/Nothing:stretch=lin(1,2,2)", "nothing of that path is simulated"),
    ("strech=lin(1,2,2)", "is no value of anything here"),
    ("density=list(0.1,-1)", r"density is -1; allowed is a finite number > 0 \(run 1: density -1\)"),
    ("gravity=list(1,2)", "gravity is 1.0; allowed is three numbers"),
    ("stretch=list(red)", "stretch is 'red'; allowed is a number"),
    ("file=list(nothere.usda)", "there is no such file"),
])
def test_draws_that_cannot_run_are_listed_and_nothing_runs(file, tmp_path, vary, words):
    with pytest.raises(SceneError, match=words):
        wsim.sweep(file, vary, tmp_path / "out", settings=CPU)
    assert not (tmp_path / "out").exists()


def test_every_refused_draw_is_listed(file, tmp_path):
    with pytest.raises(SceneError) as caught:
        wsim.sweep(file, "density=list(-1,0.2,-2)", tmp_path / "out", settings=CPU)
    assert [p.text.split(" (run ")[1][0] for p in caught.value.problems] == ["0", "2"]


def test_a_folder_of_another_sweep_is_refused(file, tmp_path):
    list(wsim.sweep(file, "stretch=list(200)", tmp_path / "out", settings=CPU))
    with pytest.raises(SceneError, match="holds another sweep .other draws"):
        wsim.sweep(file, "stretch=list(300)", tmp_path / "out", resume=True, settings=CPU)
    with pytest.raises(SceneError, match="holds this sweep already; go on with it by --resume"):
        wsim.sweep(file, "stretch=list(200)", tmp_path / "out", settings=CPU)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("all of it")
    with pytest.raises(SceneError, match="holds other files and no sweep"):
        wsim.sweep(file, "stretch=list(200)", tmp_path / "mine", settings=CPU)


def test_a_sweep_that_was_stopped_goes_on_where_it_was(file, tmp_path):
    """Stopped after two rows, with half a line in the journal: the same table to the bit, and no run twice."""
    vary = "stretch=log(100,1000,4)"
    whole = list(wsim.sweep(file, vary, tmp_path / "whole", settings=Settings(device="cpu", worlds=1)))
    settings = Settings(device="cpu", worlds=1)
    rows = wsim.sweep(file, vary, tmp_path / "out", settings=settings)
    first = [next(rows), next(rows)]
    rows.close()
    assert lasting(table(tmp_path / "out")) == lasting(first)                  # a valid table
    with open(tmp_path / "out" / "rows.jsonl", "a") as journal:
        journal.write(json.dumps(whole[2])[:50])
    again = list(wsim.sweep(file, vary, tmp_path / "out", resume=True, settings=settings))
    assert lasting(again) == lasting(whole) == lasting(table(tmp_path / "out"))
    assert [r["seconds"] for r in again[:2]] == [r["seconds"] for r in first]


def test_results_lie_over_the_scene_and_say_their_draw(file, tmp_path):
    from pxr import Usd
    rows = list(wsim.sweep(file, "stretch=list(200,400)", tmp_path / "out", settings=Settings(device="cpu", keep="last")))
    for row in rows:
        stage = Usd.Stage.Open(str(tmp_path / "out" / row["result"]))
        points = stage.GetPrimAtPath("/World/Cloth").GetAttribute("points")
        assert points.GetTimeSamples() == [3.0]
        said = json.loads(stage.GetRootLayer().customLayerData["wsim:sweep"])
        assert said["stretch"] == row["stretch"] and said["max_strain"] == row["max_strain"]
    every = list(wsim.sweep(file, "stretch=list(200,400)", tmp_path / "all", settings=Settings(device="cpu", keep="all")))
    stage = Usd.Stage.Open(str(tmp_path / "all" / every[1]["result"]))
    assert stage.GetPrimAtPath("/World/Cloth").GetAttribute("points").GetTimeSamples() == [0.0, 1.0, 2.0, 3.0]


def test_start_states_and_files_are_varied(file, tmp_path):
    """From where another run ended the cloth is elsewhere; a file is another scene."""
    list(wsim.sweep(file, "stretch=list(200)", tmp_path / "one", settings=Settings(device="cpu", keep="last")))
    start = tmp_path / "one" / "results" / "000000.usdc"
    other = hung(tmp_path / "other.usda", frames=2)
    rows = list(wsim.sweep(file, [f"file=list({file},{other})"], tmp_path / "files", settings=CPU))
    assert [r["frames"] for r in rows] == [3, 2] and rows[0]["scene_hash"] != rows[1]["scene_hash"]
    begun = list(wsim.sweep(file, [f"start=list({start})", "stretch=list(200,300)"], tmp_path / "starts", settings=CPU))
    low = begun[0]["gravity_energy"]
    assert low < list(wsim.sweep(file, "stretch=list(200)", tmp_path / "two", settings=CPU))[0]["gravity_energy"]
    assert begun[0]["state"] != begun[1]["state"]


def test_variants_are_varied(tmp_path):
    from pxr import Sdf, Usd
    path = hung(tmp_path / "scene.usda")
    stage = Usd.Stage.Open(path)
    sets = stage.GetPrimAtPath("/World").GetVariantSets().AddVariantSet("size")
    for name, height in (("low", 0.3), ("high", 0.7)):
        sets.AddVariant(name)
        sets.SetVariantSelection(name)
        with sets.GetVariantEditContext():
            ball = stage.OverridePrim("/World/Ball")
            ball.CreateAttribute("wsim:thickness", Sdf.ValueTypeNames.Double).Set(height)
    stage.Save()
    rows = list(wsim.sweep(path, "/World:size=list(low,high)", tmp_path / "out", settings=CPU))
    assert {r["status"] for r in rows} == {"done"} and rows[0]["scene_hash"] != rows[1]["scene_hash"]
    with pytest.raises(SceneError, match="wide"):
        wsim.sweep(path, "/World:size=list(wide)", tmp_path / "other", settings=CPU)


def test_a_run_that_fails_is_listed_with_its_reason_and_leaves_the_others(tmp_path):
    """A named explicit integrator is stable for one of three stiffnesses."""
    path = hung(tmp_path / "scene.usda", solver="explicit", integrator="leapfrog", substeps=40)
    rows = list(wsim.sweep(path, "stretch=list(100,1e9,120)", tmp_path / "out", settings=Settings(device="cpu", worlds=3)))
    assert [r["status"] for r in rows] == ["done", "failed", "done"]
    assert "leapfrog is stable for" in rows[1]["why"] and np.isfinite(rows[2]["max_strain"])


def test_a_folder_in_which_nothing_ran_is_taken_and_a_file_is_none(file, tmp_path):
    """A sweep whose cluster did not answer left no row."""
    rows = wsim.sweep(file, "stretch=list(200)", tmp_path / "out", settings=CPU)
    rows.close()
    assert [r["status"] for r in wsim.sweep(file, "stretch=list(200)", tmp_path / "out", settings=CPU)] == ["done"]
    with pytest.raises(SceneError, match="is a file, or lies in one; give a folder"):
        wsim.sweep(file, "stretch=list(200)", tmp_path / "out" / "runs.csv", settings=CPU)


def test_failed_runs_are_told_with_their_reasons(tmp_path, capsys):
    path = hung(tmp_path / "scene.usda", solver="explicit", integrator="leapfrog", substeps=40)
    assert cli.main(["sweep", path, "--vary", "stretch=list(100,1e9)", "-o", str(tmp_path / "out"), "--device", "cpu"]) == 1
    said = capsys.readouterr()
    assert "run 1 failed: /: integrator leapfrog is stable for" in said.err and "2 runs, 1 failed" in said.out


@pytest.mark.slow
def test_rigid_scenes_run_one_after_another_and_are_gone_on_with(tmp_path, capsys):
    """Boxes that slide: said, each as alone to the bit, whole after it was stopped."""
    from wsim.scene.methods import objects_with_values
    scene = wsim.load("scenes/dominoes.usda")
    scene.frames = 4
    vary, names = "gravity_y=list(-9.81,-5,-3)", {type(t).__name__ for t in objects_with_values(scene)}
    whole = list(wsim.sweep(scene, vary, tmp_path / "whole", settings=CPU))
    assert {r["status"] for r in whole} == {"done"} and "Body" in names
    alone = Simulation(replace(scene, gravity=(0.0, -5.0, 0.0)), device="cpu")
    alone.run()
    assert whole[1]["rigid_energy"] == alone.indicators()["rigid_energy"]
    begun = wsim.sweep(scene, vary, tmp_path / "out", settings=CPU)
    next(begun)
    begun.close()
    assert lasting(wsim.sweep(scene, vary, tmp_path / "out", resume=True, settings=CPU)) == lasting(whole)
    assert cli.main(["sweep", "scenes/snowball.usda", "--vary", vary, "-o", str(tmp_path / "said"), "--device", "cpu",
                     "--frames", "1"]) == 0
    assert "runs go one after another on each worker: material points of all worlds share" in capsys.readouterr().err


def test_the_command_line_writes_the_table_and_tells_failures(file, tmp_path, capsys):
    asked = ["sweep", file, "--vary", "stretch=lin(100,200,2)", "-o", str(tmp_path / "out"), "--device", "cpu", "--frames", "1"]
    assert cli.main(asked) == 0
    assert "runs.csv: 2 runs, 0 failed" in capsys.readouterr().out
    assert [r["stretch"] for r in table(tmp_path / "out")] == ["100.0", "200.0"]
    assert cli.main(asked) == 1
    assert "--resume" in capsys.readouterr().err
    assert cli.main([*asked, "--resume"]) == 0


def test_two_sweeps_in_one_folder_wait_for_each_other(file, tmp_path):
    """The second says who writes there, and takes no row of the first."""
    vary = "stretch=list(200,300)"
    first = wsim.sweep(file, vary, tmp_path / "out", settings=CPU)
    row = next(first)
    with pytest.raises(BlockingIOError, match=f"is being written by another run: process {os.getpid()}"):
        wsim.sweep(file, vary, tmp_path / "out", resume=True, settings=CPU)
    assert [row, *first] == list(wsim.sweep(file, vary, tmp_path / "out", resume=True, settings=CPU))
    assert not (tmp_path / "out/sweep.lock").exists()


def test_only_rows_of_runs_that_are_there_are_gone_on_with(file, tmp_path):
    """No row of another number, of other values, of none, nor of a result that somebody removed."""
    settings = Settings(device="cpu", keep="last")
    vary, out = "stretch=list(200,300,400)", tmp_path / "out"
    whole = list(wsim.sweep(file, vary, out, settings=settings))
    (out / whole[1]["result"]).unlink()
    rows = [whole[0], whole[1], {**whole[2], "run": 3}, {**whole[2], "run": -1}, {**whole[2], "run": True},
            {**whole[2], "stretch": 500.0}, {"run": 2}, [1]]
    (out / "rows.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    again = list(wsim.sweep(file, vary, out, resume=True, settings=settings))
    assert lasting(again) == lasting(whole) == lasting(table(out))
    assert [a["seconds"] == b["seconds"] for a, b in zip(again, whole, strict=True)] == [True, False, False]
    assert all((out / row["result"]).is_file() for row in again)
