"""Fits of Poisson's ratio of a membrane and of its strain limit, and the layer that they write."""

import json
from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.fitting.fit import bar, motion
from tests.make.usda import BIND, Reader, cloth, fabric
from wsim import cli
from wsim.fitting import Settings, Track
from wsim.fitting.parameter import parameters_of_names
from wsim.scene import Scene, SceneError, shapes
from wsim.scene.fabric import Fabric
from wsim.usd.result.fitted import save_fitted


def stretched(poisson: float = 0.3, limit: float = 0.04, model: str = "membrane") -> Scene:
    """6 x 6 points, 1 m wide, hang by their upper edge, are thrown down, contract, and meet their limits."""
    scene = Scene(fps=30, frames=8, solver="xpbd", integrator="backward_euler", substeps=6, iterations=4)
    sheet = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 5, 5), model=model, material=Fabric(
        stretch=60.0, shear=25.0, bend=1e-4, density=200.0, poisson=poisson, strain_limit=limit))
    y = sheet.points[:, 1]
    sheet.velocities = np.outer((y.max() - y) / np.ptp(y), [0.0, -1.0, 0.0])
    scene.pin("/pin", sheet, np.flatnonzero(y > y.max() - 1e-6))
    return scene


@pytest.mark.parametrize("poisson, start", [(0.3, 0.1), (-0.35, 0.2)])
def test_both_are_found_from_noisy_motion(poisson, start):
    """8 frames, 20 micrometres of noise; limits move points by up to 2 cm. From a ratio above 0 to one below it, too."""
    scene = stretched(poisson)
    x, free = motion(scene), motion(stretched(poisson, 10.0))
    assert np.abs(x - free).max() > 0.02
    noisy = x + 2e-5 * np.random.default_rng(0).normal(size=x.shape)
    found = wsim.fit(scene, [Track("/sheet", np.arange(1, 9), noisy)], "poisson,strain_limit",
                     start={"poisson": start, "strain_limit": 0.05}, settings=Settings(device="cpu"))
    for name, true, most in (("poisson", poisson, 1e-3), ("strain_limit", 0.04, 2e-5)):
        assert abs(found.values[name] - true) < min(3.5 * found.errors[name], most)
    material = found.scene.cloths[0].material
    assert (material.poisson, material.strain_limit) == (found.values["poisson"], found.values["strain_limit"])


@pytest.mark.filterwarnings("error")
def test_a_limit_that_is_never_met_is_said_to_change_nothing():
    scene = stretched(limit=0.5)
    found = wsim.fit(scene, [Track("/sheet", np.arange(1, 9), motion(scene))], "poisson,strain_limit",
                     start={"poisson": 0.2}, settings=Settings(device="cpu"))
    assert found.values["poisson"] == pytest.approx(0.3, abs=1e-6) and found.errors["strain_limit"] == np.inf
    assert "strain_limit changes nothing that was observed" in found.text()
    assert np.array_equal(np.isfinite(found.estimate.correlation), np.ones((2, 2)))


def test_the_command_finds_both_and_writes_them_by_their_names_in_usd(tmp_path, capsys):
    scene, out, seen = (str(tmp_path / name) for name in ("sheet.usda", "fitted.usda", "seen.usdc"))
    wsim.save(stretched(), scene)
    with wsim.Recorder(wsim.load(scene), seen) as recorder:
        for frame, positions in enumerate(motion(wsim.load(scene)), 1):
            recorder.append(float(frame), {"/sheet": positions}, {"/sheet": np.zeros_like(positions)}, {})
    given = ["fit", scene, "--to", seen, "--parameters", "poisson,strain_limit", "--start", "poisson=0.1", "--start",
             "strain_limit=0.05", "--device", "cpu", "-o", out, "--json"]
    assert cli.main(given) == 0
    found = {p["name"]: p["value"] for p in json.loads(capsys.readouterr().out)["parameters"]}
    assert found == pytest.approx({"poisson": 0.3, "strain_limit": 0.04}, rel=1e-3)
    loaded, before = (wsim.load(path).cloths[0].material for path in (out, scene))
    assert loaded == replace(before, **found)
    text = (tmp_path / "fitted.usda").read_text()
    assert "physics:poissonsRatio = " in text and "wsim:strainLimit = " in text


def test_a_layer_keeps_what_a_file_derives_from_its_old_ratio(tmp_path):
    """Shear and bending follow E, nu and h where they are not authored, and K of stretch holds nu: they stay what they were."""
    scene = Reader(tmp_path)(cloth(f'{BIND}\nuniform token wsim:model = "membrane"') + fabric(
        "float physics:youngsModulus = 2e5\nfloat physics:poissonsRatio = 0.25\nfloat physics:density = 300"))
    assert scene.cloths[0].model == "membrane"
    found, _ = parameters_of_names("poisson", [scene])
    out = tmp_path / "fitted.usda"
    save_fitted(scene, found[0].written(scene, -0.2), out)
    after, before = wsim.load(str(out)).cloths[0].material, scene.cloths[0].material
    assert after == replace(before, poisson=-0.2) and before.poisson == 0.25


def test_who_has_them():
    """Membranes, and cloths whose limit is finite; a soft body beside them keeps its own range."""
    both = stretched()
    both.softs = bar().softs
    (p,), _ = parameters_of_names("poisson", [both])
    assert [thing.path for _, thing in p.rows(both)] == ["/sheet", "/bar"] and p.map.low == -1.0
    springs = stretched(model="springs")
    springs.softs = both.softs
    (p,), _ = parameters_of_names("poisson", [springs])
    assert [thing.path for _, thing in p.rows(springs)] == ["/bar"] and p.map.low == 0.0
    (p,), scenes = parameters_of_names("poisson", [stretched()], {"poisson": -0.4})
    assert p.value(scenes[0]) == -0.4
    for scene, asked, start, words in [
            (stretched(model="springs"), "poisson", {}, "nothing here has poisson.*of a cloth it acts in the model 'membrane'"),
            (stretched(limit=np.inf), "strain_limit", {}, "nothing here has strain_limit.*where it is finite from the start"),
            (stretched(limit=0.0), "strain_limit", {}, "strain_limit is 0 at the start"),
            (stretched(), "poisson", {"poisson": 0.6}, "start is 0.6; allowed is between -1 and 0.5"),
            (stretched(), "strain_limit", {"strain_limit": -0.1}, "start is -0.1; allowed is a number > 0")]:
        with pytest.raises(SceneError, match=words):
            parameters_of_names(asked, [scene], start)
