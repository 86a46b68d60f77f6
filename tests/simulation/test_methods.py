"""A method of one folder and one row (tests/make/rows/wheels) goes through all that those of wsim go through."""

from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd

from tests.make.rows.wheels import ROW, VALUES
from tests.make.rows.wheels.objects import Wheel
from wsim.cli import main
from wsim.cli.run import prepare_recorded_run
from wsim.scene import Scene, SceneError, methods, shapes
from wsim.scene.check.scene import check_scene
from wsim.scene.values import table
from wsim.simulation.simulation import Simulation
from wsim.usd import load, save
from wsim.usd.result.restart import ResultReader

CPU = {"device": "cpu"}
FAST, SLOW = Wheel("/World/fast", 0.5, 300.0, 2.0), Wheel("/World/slow", 0.0, -3.0, 0.0)


@pytest.fixture(autouse=True)
def row(monkeypatch):
    monkeypatch.setattr(methods, "METHODS", [*methods.METHODS, ROW])
    monkeypatch.setattr(table, "VALUES", [*table.VALUES, *VALUES])
    for module in ("wsim.scene.scene", "wsim.simulation.plan", "wsim.simulation.methods"):
        monkeypatch.setattr(f"{module}.METHODS", methods.METHODS)


def wheels(cloth: bool = False, **more) -> Scene:
    scene = Scene(**{"fps": 24.0, "frames": 8, "substeps": 4, "solver": "xpbd" if cloth else "auto"} | more)
    for wheel in (FAST, SLOW):
        scene.add(replace(wheel))
    if cloth:
        scene.pin("/World/pin", scene.cloth("/World/cloth", *shapes.sheet(0.5, 0.5, 4, 4)), [0, 4])
    return scene


def angle(wheel: Wheel, t: float) -> float:
    return wheel.angle + wheel.rate * (t if wheel.drag == 0.0 else (1.0 - np.exp(-wheel.drag * t)) / wheel.drag)


def turned(sim: Simulation, wheel: Wheel, world: int = 0) -> float:
    part = sim.state.parts["wheels"]
    return float(part.arrays["angle"].numpy()[part.rows[wheel.path, world]][0])


@pytest.mark.parametrize("cloth", [False, True])
def test_it_turns_as_its_closed_form_says_alone_and_beside_cloth(cloth):
    """A frame in which it turns more often than there is room for is repeated, and steps once."""
    sim = Simulation(wheels(cloth), precision="float64", **CPU)
    sim.run(8)
    for wheel in (FAST, SLOW):
        assert abs(turned(sim, wheel) - angle(wheel, 8 / 24.0)) < 1e-11
    (said,) = [w for w in sim.repeats if "turned" in w]
    assert "the frame was repeated" in said
    if cloth:
        alone = wheels(True)
        alone.objects.pop("Wheel")
        other = Simulation(alone, precision="float64", **CPU)
        other.run(8)
        assert np.array_equal(other.positions(), sim.positions()) and "spin" in sim.indicators()


def test_it_may_take_several_steps_in_a_substep(monkeypatch):
    """Of a third of the substep's length each; the plan says so."""
    from tests.make.rows.wheels import method
    monkeypatch.setattr(method, "SUBDIVIDE", 3)
    sim = Simulation(wheels(True), precision="float64", **CPU)
    sim.run(8)
    assert abs(turned(sim, FAST) - angle(FAST, 8 / 24.0)) < 1e-11
    (row,) = [r for r in sim.plan.table() if r["name"] == "spin"]
    assert row["rate"] == "1/3" and row["launches"] == 3 and "1/3" in sim.plan.describe()


def test_a_scene_is_saved_and_loaded_and_what_is_wrong_is_said_by_its_path(tmp_path):
    scene = wheels(True)
    save(scene, tmp_path / "s.usda")
    again = load(tmp_path / "s.usda")
    assert again == scene and not again.notes and [type(w) for w in again.things("Wheel")] == [Wheel, Wheel]
    scene.things("Wheel")[0].drag = -1.0
    (problem,) = [p for p in check_scene(scene) if p.fatal]
    assert problem.path == FAST.path and "drag is -1" in problem.text
    with pytest.raises(SceneError, match="is a str, which no method simulates; there are: Cloth, .*, Wheel"):
        scene.add("wheel")


def test_the_plan_names_it_and_a_scene_without_says_why():
    plan = Simulation(wheels(), **CPU).plan
    assert [r["name"] for r in plan.table()] == ["spin", "guard of parts"] and "points" in {s["stage"] for s in plan.skipped}
    scene = wheels(True)
    scene.objects.pop("Wheel")
    assert {"stage": "wheels", "why": "there is no wheel"} in Simulation(scene, **CPU).plan.skipped


@pytest.mark.parametrize("cloth", [False, True])
def test_a_run_is_recorded_and_goes_on_to_the_bit(tmp_path, cloth):
    source = str(tmp_path / "s.usda")
    save(wheels(cloth), source)
    whole, half, rest = (str(tmp_path / f"{name}.usdc") for name in ("whole", "half", "rest"))

    def run(output: str, frames: int, restart: str | None = None):
        job = prepare_recorded_run(replace(load(source), frames=frames), output, lambda s: Simulation(s, **CPU),
                                   restart=restart)
        job.frames()
        return job.simulation
    one = run(whole, 8)
    run(half, 4)
    two = run(rest, 8, half)
    assert {w.path: turned(one, w) for w in (FAST, SLOW)} == {w.path: turned(two, w) for w in (FAST, SLOW)}
    assert not any("bit for bit" in w for w in two.warnings)
    if cloth:
        assert np.array_equal(one.positions(), two.positions())
    for path in (whole, rest):
        stage = ResultReader(path).stage
        for wheel in (FAST, SLOW):
            prim = stage.GetPrimAtPath(wheel.path)
            assert len(prim.GetAttribute("xformOp:transform").GetTimeSamples()) == 9
            M = np.array(prim.GetAttribute("xformOp:transform").Get(8.0)).T
            theta = angle(wheel, 8 / 24.0)
            assert np.abs(M[:2, 0] - (np.cos(theta), np.sin(theta))).max() < 1e-4
            assert abs(prim.GetAttribute("toy:turns").Get(8.0) - theta / (2.0 * np.pi)) < 32 * 6e-8 * 73.0 / (2.0 * np.pi)


def test_a_run_with_other_steps_goes_on_from_where_it_was(tmp_path):
    """Its closed form holds for steps of any length; where a result does not say where it was, that is an error."""
    source, half, rest = (str(tmp_path / name) for name in ("s.usda", "half.usda", "rest.usda"))
    save(wheels(True), source)
    prepare_recorded_run(replace(load(source), frames=4), half, lambda s: Simulation(s, **CPU)).frames()
    job = prepare_recorded_run(replace(load(source), substeps=6), rest, lambda s: Simulation(s, **CPU), restart=half)
    job.frames()
    assert any("not bit for bit" in w for w in job.simulation.warnings)
    assert abs(turned(job.simulation, FAST) - angle(FAST, 8 / 24.0)) < 40 * 6e-8 * 73.0
    stage = Usd.Stage.Open(half)
    stage.GetPrimAtPath(SLOW.path).GetAttribute("wsim:restart:timeCode").Set(1.0)
    stage.GetRootLayer().Save()
    with pytest.raises(SceneError, match=f"{SLOW.path}: has no restart fields at frame 4"):
        prepare_recorded_run(load(source), rest, lambda s: Simulation(s, **CPU), restart=half)


def test_three_worlds_have_wheels_of_their_own():
    sim = Simulation(wheels(), worlds=3, precision="float64", **CPU)
    sim.set(FAST.path, "drag", 0.0, world=1)
    sim.run(2)
    ends = [turned(sim, FAST, world) for world in range(3)]
    assert ends[0] == ends[2] and abs(ends[1] - 0.5 - 300.0 * 2 / 24.0) < 1e-10 and abs(ends[0] - angle(FAST, 2 / 24.0)) < 1e-11
    for value in (-1.0, np.nan):
        with pytest.raises(SceneError, match=FAST.path):
            sim.set(FAST.path, "drag", value)


def test_its_arrays_are_handed_out_without_a_copy():
    from wsim.simulation.measure.views import arrays
    sim = Simulation(wheels(), **CPU)
    view = arrays(sim)["wheels.rate"]
    values = np.from_dlpack(view)
    assert values[view.index[FAST.path]] == 300.0
    sim.state.parts["wheels"].arrays["rate"].fill_(1.0)
    assert np.all(values == 1.0)


def test_what_is_not_finite_is_said_by_its_path():
    scene = wheels(fps=1.0)
    scene.things("Wheel")[1].rate = 3e38
    with pytest.raises(SceneError, match=f"{SLOW.path}: "):
        Simulation(scene, **CPU).run(8)


def test_gradients_are_refused_by_its_path():
    with pytest.raises(SceneError, match=f"{FAST.path}: gradients do not go through wheels"):
        Simulation(wheels(True), gradients=True, **CPU)


def test_the_command_line_runs_and_draws_it(tmp_path, capsys):
    save(wheels(), tmp_path / "s.usda")
    assert main(["run", str(tmp_path / "s.usda"), "-o", str(tmp_path / "o.usdc"), "--device", "cpu", "--png",
                 str(tmp_path / "o.png")]) == 0
    assert (tmp_path / "o.png").stat().st_size > 1000 and "spin" in capsys.readouterr().out
