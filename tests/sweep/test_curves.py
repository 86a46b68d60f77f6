"""Values over time that differ from world to world: set in a running simulation, and drawn by a sweep from files."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.sweep.sweep import CPU, lasting
from tests.make.sweep.worlds import HOW, cloth
from wsim.scene import Motion, SceneError, Varying
from wsim.scene.curve import Curve
from wsim.simulation.simulation import Simulation
from wsim.sweep.job import Settings

GUSTS = [Curve([0.0, 0.1, 0.2], [[0, 0, 0], [8, 0, 3], [0, 0, 0]]), Curve([0.0], [[1.0, 0, 0]]),
         Curve([0.05, 0.15], [[0, 0, 5], [0, 0, -5]], "catmull_rom")]
STIFFER = Curve([0.0, 0.2], [100.0, 300.0])


@pytest.mark.parametrize("solver", list(HOW))
def test_a_world_follows_its_curve_as_one_alone_follows_that_of_its_scene(solver):
    """Wind and stiffness, to the bit."""
    sim = Simulation(cloth(solver), worlds=3, device="cpu")
    sim.plan.clock.touching = True
    sim.set("/", "wind", GUSTS, range(3))
    sim.set("/cloth", "stretch", STIFFER, world=2)
    sim.run(6)
    for world, gust in enumerate(GUSTS):
        varying = [Varying("/", "wind", gust)] + [Varying("/cloth", "stretch", STIFFER)] * (world == 2)
        alone = Simulation(replace(cloth(solver), varying=varying), device="cpu")
        alone.plan.clock.touching = True
        alone.run(6)
        assert alone.plan.clock.substeps == sim.plan.clock.substeps
        assert np.array_equal(alone.positions(), sim.positions("/cloth", world)), world
    assert np.abs(sim.positions("/cloth", 0) - sim.positions("/cloth", 1)).max() > 1e-3


def test_a_value_that_is_set_ends_a_curve_and_a_plan_that_is_built_anew_goes_on_with_it():
    sim, still = (Simulation(cloth("xpbd"), worlds=2, device="cpu") for _ in range(2))
    for each in (sim, still):
        each.plan.clock.touching = True
    sim.set("/", "wind", GUSTS[0])
    sim.set("/", "wind", (1.0, 0.0, 0.0))
    for each in (sim, still):
        each.run(3)
    assert np.array_equal(sim.positions("/cloth", 1), still.positions("/cloth", 1))
    sim.set("/", "wind", GUSTS[0], world=1)
    assert [c[3] for c in sim.changes if isinstance(c[2], Curve)] == [1]


def test_what_no_value_could_be_is_refused_of_a_curve_too():
    sim = Simulation(cloth("xpbd"), worlds=2, device="cpu")
    with pytest.raises(SceneError, match="stretch is -5"):
        sim.set("/cloth", "stretch", Curve([0.0, 1.0], [-5.0, 100.0]), world=1)
    assert sim.changes == []
    with pytest.raises(SceneError, match="wind varies in time, and a recording has one value"):
        Simulation(cloth("xpbd"), device="cpu", gradients=True).set("/", "wind", GUSTS[0])


def written(path, header: str, rows) -> str:
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return str(path)


@pytest.fixture
def files(tmp_path) -> dict[str, str]:
    return {"gust": written(tmp_path / "gust.csv", "time,x,y,z", [(0, 0, 0, 0), (0.06, 8, 0, 3), (0.125, 0, 0, 0)]),
            "calm": written(tmp_path / "calm.csv", "time,x,y,z", [(0, 0.5, 0, 0)]),
            "swing": written(tmp_path / "swing.csv", "time,x,y,z", [(0, 0, 0, 0), (0.125, 0.2, 0.1, 0)]),
            "still": written(tmp_path / "still.csv", "time,x,y,z", [(0, 0, 0, 0)]),
            "soft": written(tmp_path / "soft.csv", "time,stretch", [(0, 300), (0.125, 100)])}


def test_curves_of_files_are_drawn_and_worlds_of_them_give_the_table_of_runs_alone(file, files, tmp_path):
    vary = [f"wind=list({files['gust']},{files['calm']},2 0 0)", f"/World/Pin:motion=list({files['swing']},{files['still']})",
            f"/World/Cloth:stretch=list({files['soft']},250)"]
    tables = [list(wsim.sweep(file, vary, tmp_path / str(n), settings=Settings(device="cpu", worlds=n))) for n in (1, 12)]
    assert {r["status"] for r in tables[0]} == {"done"} and {r["worlds"] for r in tables[1]} == {12}
    assert lasting(tables[0]) == lasting(tables[1])
    assert len({r["state"] for r in tables[0]}) == 12 and len({r["scene_hash"] for r in tables[0]}) == 12
    scene = wsim.load(file)
    scene.varying = [Varying("/", "wind", Curve([0, 0.06, 0.125], [[0, 0, 0], [8, 0, 3], [0, 0, 0]])),
                     Varying("/World/Cloth", "stretch", Curve([0, 0.125], [300.0, 100.0]))]
    moved = scene.pins[0].motion.at(0.0).copy()
    moved[:3, 3] += (0.2, 0.1, 0.0)
    scene.pins[0].motion = Motion([0.0, 0.125], [scene.pins[0].motion.at(0.0), moved])
    sim = Simulation(scene, device="cpu")
    sim.plan.clock.touching = True
    sim.run()
    assert tables[0][0]["max_strain"] == pytest.approx(sim.indicators()["max_strain"], rel=1e-6)


def test_a_draw_stands_for_what_the_scene_says_over_time(file, files, tmp_path):
    """A plain number of a value that varies in the file is that number."""
    scene = wsim.load(file)
    plain = list(wsim.sweep(replace(scene, source=None), "wind=list(3 0 0)", tmp_path / "plain", settings=CPU))
    scene.varying = [Varying("/", "wind", GUSTS[0])]
    again = list(wsim.sweep(replace(scene, source=None), "wind=list(3 0 0)", tmp_path / "again", settings=CPU))
    assert plain[0]["state"] == again[0]["state"]


@pytest.mark.parametrize(("vary", "words"), [
    ("wind=list(nothere.csv)", "nothere.csv: cannot be read"),
    ("wind=list({soft})", "soft.csv: a curve of wind has 4 columns of finite numbers"),
    ("wind_x=list({soft})", "wind_x takes no curve; vary wind, of three numbers"),
    ("/World/Pin:motion=list(1,2)", "motion is 1.0; allowed are files of curves"),
])
def test_files_that_are_no_curves_are_refused_before_anything_runs(file, files, tmp_path, vary, words):
    with pytest.raises(SceneError, match=words):
        wsim.sweep(file, vary.format(**files), tmp_path / "out", settings=CPU)
    assert not (tmp_path / "out").exists()
