"""Steps that would never end are refused before anything is made for them, and many are said with the time that they take."""

from dataclasses import replace

import pytest

from wsim.bench import cache
from wsim.cli.run import prepare_recorded_run
from wsim.physics.fluid.liquid.objects import Liquid
from wsim.physics.fluid.objects import Fluid
from wsim.scene import Scene, SceneError
from wsim.scene.check import counts
from wsim.scene.check.scene import check_scene
from wsim.simulation.simulation import Simulation
from wsim.usd import save

CPU = {"device": "cpu"}


@pytest.mark.parametrize("name", ["frames", "substeps", "iterations"])
def test_counts_without_end_are_refused(scene, name):
    fatal = [str(p) for p in check_scene(replace(scene, **{name: counts.MOST + 1})) if p.fatal]
    assert len(fatal) == 1 and f"{name} is 1e+06; allowed: a whole number up to 1000000" in fatal[0] and f"--{name}" in fatal[0]
    assert not [p for p in check_scene(replace(scene, **{name: counts.MOST})) if p.fatal]


def test_steps_that_a_stiff_net_needs_are_refused_too():
    scene = Scene(solver="explicit")
    net = scene.net("/net", [[0, 0, 0], [0.1, 0, 0]], [[0, 1]], [1e20], [0.1])
    scene.pin("/pin", net, [0])
    with pytest.raises(SceneError, match="substeps a frame, for steps that are short enough, is .*allowed is up to 1000000"):
        Simulation(scene, **CPU)


def test_many_steps_are_said_with_their_time(scene, tmp_path):
    scene.solver, scene.substeps, scene.frames = "xpbd", 20_000, 1000
    save(scene, tmp_path / "scene.usda")
    scene.source = str(tmp_path / "scene.usda")
    (said,) = [w for w in Simulation(scene, **CPU).warnings if "substeps" in w]
    assert said.startswith("warning: /: 20000 substeps a frame: a frame takes about ")
    job = prepare_recorded_run(scene, str(tmp_path / "out.usdc"), lambda s: Simulation(s, **CPU), samples=20, preroll=10)
    job.recorder.close()
    assert any("20200 frames take about" in w for w in job.simulation.warnings)
    for more, words in (({"samples": 2000}, "--samples times frames is 2000000"),
                        ({"samples": 500, "preroll": 5000}, "--preroll times samples is 2500000")):
        with pytest.raises(SceneError, match=words):
            prepare_recorded_run(scene, str(tmp_path / "out.usdc"), lambda s: Simulation(s, **CPU), **more)


def test_without_a_home_a_bench_keeps_nothing_and_says_so(monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")
    monkeypatch.setattr("pathlib.Path.home", homeless)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache.read_cached_report("x") == (None, "")
    with pytest.raises(OSError, match="no home folder"):
        cache.report_cache_folder()


@pytest.mark.parametrize("name", ["steps", "most_steps"])
@pytest.mark.parametrize("kind", [Fluid, Liquid])
def test_steps_of_fluids_without_end_are_refused_and_many_are_said(kind, name):
    for count, fatal, said in ((counts.MOST, False, "expected: up to 10000"), (counts.MOST + 1, True, "to 1000000")):
        scene = Scene()
        scene.add(kind("/air", (0, 0, 0), (1, 1, 1), 0.125, **{name: count}))
        assert [p.fatal for p in check_scene(scene) if f"{name} is 1e+06" in p.text and said in p.text] == [fatal]
