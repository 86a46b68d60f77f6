"""Rods are observed by their points; what is not observed of them is refused by name."""

import json

import numpy as np
import pytest

import wsim
from wsim import Scene, SceneError, Simulation, cli
from wsim.fitting import Functional, Pull, Scan, Settings, Track
from wsim.physics.rods.objects import Rods

FRAMES, NOISE = 20, 1e-4
TRUTH, START = {"gravity_z": -9.81, "air_drag": 0.6}, {"gravity_z": -5.0, "air_drag": 0.3}


def swinging() -> Scene:
    """A rod of silicone, clamped at one end, in air that slows it down."""
    scene = Scene(gravity=(0.0, 0.0, TRUTH["gravity_z"]), up="Z", fps=60.0, frames=FRAMES, substeps=4,
                  air_drag=TRUTH["air_drag"])
    rods = Rods("/rod", [[0.05 * k, 0.0, 0.0] for k in range(9)], [9], diameters=4e-3, young=2e7)
    rods.pin("/clamp", [0, 1])
    scene.add(rods)
    return scene


@pytest.fixture(scope="module")
def path() -> np.ndarray:
    sim, found = Simulation(swinging(), device="cpu", precision="float64"), []
    sim.run(FRAMES, lambda s: found.append(s.positions("/rod")))
    return np.array(found)


def fitted(seen) -> tuple[np.ndarray, np.ndarray]:
    """What was found beside the truth, and error bars."""
    found = wsim.fit(swinging(), [seen], list(TRUTH), start=START, settings=Settings(device="cpu"))
    assert found.converged
    return found.estimate.values - np.array(list(TRUTH.values())), found.estimate.errors


def test_gravity_and_air_come_back_from_the_points_of_a_rod(path):
    """Without noise to what a fit claims, with noise of 0.1 mm within four error bars; so from a mean of three points."""
    frames = np.arange(1, FRAMES + 1)
    away, errors = fitted(Track("/rod", frames, path))
    assert (np.abs(away) < errors).all() and (errors < 1e-5).all()
    noisy = path + NOISE * np.random.default_rng(0).normal(size=path.shape)
    for seen in (Track("/rod", frames, noisy), Functional.mean("/rod", frames, noisy[:, 6:].mean(axis=1), [6, 7, 8])):
        away, errors = fitted(seen)
        assert (np.abs(away) < 4.0 * errors).all() and (errors < 0.1).all()


def test_the_command_fits_what_a_run_has_written(tmp_path, capsys):
    """In a file's float32."""
    wsim.save(swinging(), tmp_path / "rod.usda")
    rod, seen = str(tmp_path / "rod.usda"), str(tmp_path / "seen.usdc")
    assert cli.main(["run", rod, "-o", seen, "--device", "cpu", "--precision", "float64"]) == 0
    capsys.readouterr()
    assert cli.main(["fit", rod, "--to", seen, "--parameters", "gravity_z,air_drag", "--start", "gravity_z=-5", "--json",
                     "--device", "cpu"]) == 0
    found = {p["name"]: p for p in json.loads(capsys.readouterr().out)["parameters"]}
    for name, truth in TRUTH.items():
        assert abs(found[name]["value"] - truth) < 4.0 * found[name]["error"] < 1e-3
        assert abs(found[name]["half_time_step_shift"]) < 0.02 * abs(truth)


@pytest.mark.parametrize("seen, where, said", [
    (Scan("/rod", 3, np.zeros((4, 3))), "/rod", "have no surface to scan; give the points that were seen"),
    (Pull("/clamp", [3], np.zeros((1, 2, 3)), sigma=1.0), "/clamp", "is a pin of the rods /rod, and fits cannot use")])
def test_what_is_not_observed_of_rods_is_refused_by_name(seen, where, said):
    with pytest.raises(SceneError, match=said) as raised:
        wsim.fit(swinging(), [seen], "gravity_z")
    assert [p.path for p in raised.value.problems] == [where]
