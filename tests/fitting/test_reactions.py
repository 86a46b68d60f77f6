"""Forces of pins as observations: what they tell that positions do not, files, and what is refused."""

import json

import numpy as np
import pytest

import wsim
from tests.make.fitting.fit import CPU, bar, sheet
from wsim import SceneError, Simulation
from wsim.fitting import Pull, Track, read
from wsim.usd.prims.reactions import REACTION


@pytest.fixture(scope="module")
def swing():
    """Positions and forces at each frame of a bar that swings."""
    scene, x, f = bar(), [], []
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(scene.frames, lambda s: (x.append(s.positions()), f.append(s.reactions())))
    return scene, np.array(x), np.array(f)


def noisy(values, size, seed=0):
    return values + size * np.random.default_rng(seed).normal(size=np.shape(values))


# what is found

def test_a_force_tells_stiffness_from_density(swing):
    """Positions of what falls alone know their ratio only; with what the wall bears, to 0.5 N of some 200, both are known."""
    scene, x, f = swing
    frames = np.arange(1, 21)
    track = Track("/bar", frames, noisy(x, 1e-4), sigma=1e-4)
    start = {"young": 1.4e5, "density": 900.0}
    alone = wsim.fit(scene, [track], "young,density", start=start, settings=CPU)
    assert "only the ratio of young to density matters" in alone.text() and alone.errors["density"] == np.inf
    pull = Pull("/wall", frames, noisy(f.sum(axis=1), 0.5, 1), sigma=0.5)
    assert pull.total
    both = wsim.fit(scene, [track, pull], "young,density", start=start, settings=CPU)
    assert both.converged and not both.estimate.words and both.unit == "sigma"
    for name, true in (("young", 1e5), ("density", 1e3)):
        assert both.errors[name] < 0.005 * true and abs(both.values[name] - true) < 3.5 * both.errors[name]
    assert both.misfit == pytest.approx(1.0, abs=0.1)


def test_forces_alone_are_enough_and_their_noise_is_estimated(swing):
    scene, _, f = swing
    pull = Pull("/wall", np.arange(1, 21), noisy(f, 0.2))
    assert not pull.total
    found = wsim.fit(scene, [pull], "young,density", start={"young": 1.2e5}, settings=CPU)
    assert found.converged and found.sigma == pytest.approx(0.2, rel=0.1) and " N, residuals over it" in found.text()
    assert found.values == pytest.approx({"young": 1e5, "density": 1e3}, rel=0.01)


def test_points_weights_and_gaps_count_as_they_do_for_positions(swing):
    scene, _, f = swing
    forces = f[:, [4, 0]].copy()
    forces[3, 0] = np.nan
    forces[:, 1] += 9.0
    pull = Pull("/wall", np.arange(1, 21), forces, points=[4, 0], weights=[1.0, 0.0], sigma=0.1)
    found = wsim.fit(scene, [pull], "density", start={"density": 1300.0}, settings=CPU)
    assert found.values["density"] == pytest.approx(1e3, rel=1e-5)


# files

@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The sheet on two pins as a stage, and a run of it with its forces."""
    from wsim import cli

    folder = tmp_path_factory.mktemp("pulls")
    wsim.save(sheet(), folder / "sheet.usda")
    assert cli.main(["run", str(folder / "sheet.usda"), "-o", str(folder / "seen.usdc"), "--reactions", "--frames", "12",
                     "--device", "cpu", "--quiet"]) == 0
    return folder


def test_a_run_writes_what_pins_bear_and_a_fit_reads_it(files, capsys):
    from pxr import Usd

    from wsim import cli

    scene = wsim.load(str(files / "sheet.usda"))
    stage = Usd.Stage.Open(str(files / "seen.usdc"))
    attribute = stage.GetPrimAtPath("/pin").GetAttribute(REACTION)
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(12)
    assert len(attribute.GetTimeSamples()) == 13 and np.array(attribute.Get(12.0)) == pytest.approx(sim.reactions(), abs=1e-3)
    given = ["fit", str(files / "sheet.usda"), "--to", str(files / "seen.usdc"), "--parameters", "stretch,density", "--start",
             "stretch=300", "--device", "cpu", "--json", "--noise", "1e-5"]
    assert cli.main(given) == 1 and "/pin: has wsim:reaction" in capsys.readouterr().err
    assert cli.main([*given, "--force-noise", "1e-3"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {p["name"]: p["value"] for p in said["parameters"]} == pytest.approx({"stretch": 200.0, "density": 200.0}, rel=1e-3)
    assert said["sigma_unit"] == "sigma"


def test_noise_weights_units_and_a_sum_are_read_from_the_stage(files, tmp_path):
    from pxr import Sdf, Usd, Vt

    layer = Sdf.Layer.CreateNew(str(tmp_path / "seen.usda"))
    layer.subLayerPaths.append(str(files / "sheet.usda"))
    layer.timeCodesPerSecond = 24.0
    stage = Usd.Stage.Open(layer)
    stage.SetMetadata("metersPerUnit", 1.0)
    prim = stage.OverridePrim("/pin")
    attribute = prim.CreateAttribute(REACTION, Sdf.ValueTypeNames.Vector3fArray)
    for frame in (3, 4):
        attribute.Set(Vt.Vec3fArray([(0.0, 20.0 + frame, 1.0)]), float(frame))
    prim.CreateAttribute("wsim:reactionNoise", Sdf.ValueTypeNames.Float).Set(0.25)
    prim.CreateAttribute("wsim:reactionWeights", Sdf.ValueTypeNames.FloatArray).Set([0.5])
    layer.Save()
    scene = wsim.load(str(files / "sheet.usda"))
    (pull,) = read(tmp_path / "seen.usda", scene)
    assert pull.total and pull.sigma == 0.25 and pull.weights.tolist() == [0.5] and pull.frames.tolist() == [3, 4]
    assert pull.positions[:, 0] == pytest.approx(np.array([(0.0, 23.0, 1.0), (0.0, 24.0, 1.0)]))
    stage.SetMetadata("metersPerUnit", 0.01)
    layer.Save()
    assert read(tmp_path / "seen.usda", scene, force=0.5)[0].positions[0, 0] == pytest.approx((0.0, 0.23, 0.01))
    attribute.Set(Vt.Vec3fArray([(0.0, 1.0, 1.0)] * 3), 4.0)
    layer.Save()
    with pytest.raises(SceneError, match="/pin: has 3 forces in .*; allowed are 2"):
        read(tmp_path / "seen.usda", scene)


@pytest.mark.parametrize("observed, words", [
    ([Pull("/bar", [1], np.zeros((1, 9, 3)))], "/bar: is observed and is no pin of the scene; there are /wall"),
    ([Pull("/wall", [1], np.zeros((1, 8, 3)))], r"has forces of shape \(1, 8, 3\); allowed is \(1, 9, 3\)"),
    ([Pull("/wall", [99], np.zeros((1, 3)))], "allowed is 1 to 20"),
    ([Pull("/wall", [1], np.zeros((1, 3)), sigma=0.0)], r"allowed is a finite number > 0 \[N\]"),
    ([Pull("/wall", [1], np.zeros((1, 3))), Track("/bar", [1], np.zeros((1, 63, 3)))], "need a sigma each"),
    ([Pull("/wall", [1], np.zeros((1, 3)), sigma=1.0), Track("/bar", [1], np.zeros((1, 63, 3)))], "some have sigma")])
def test_forces_that_cannot_be_are_named_with_what_is_allowed(observed, words):
    with pytest.raises(SceneError, match=words):
        wsim.fit(bar(), observed, "young", settings=CPU)
