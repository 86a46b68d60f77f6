"""Fits to smoke that was seen: a source's strength and place, by whole grids and by probes."""

import numpy as np
import pytest

import wsim
from wsim.fitting import Settings, Smoke
from wsim.physics.fluid.objects import Fluid, Source
from wsim.scene import Scene, SceneError, Sphere
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

FRAMES, NOISE = 10, 0.01
NAMES = ("/fire:strength", "/fire:place_x", "/fire:place_y")
TRUTH = np.array([1.0, 0.37, 0.21])


def plume(strength: float = 1.0, x: float = 0.37, y: float = 0.21) -> Scene:
    scene = Scene(fps=24.0, frames=FRAMES, gravity=(0.0, -9.81, 0.0))
    scene.add(Fluid("/air", (0.0, 0.0, 0.0), (0.8, 1.0, 0.05), 0.05, steps=1, tolerance=1e-10))
    scene.add(Source("/fire", Sphere(0.13), Motion.at_place((x, y, 0.025)), smoke=2.0, temperature=60.0, strength=strength))
    scene.collider("/ball", Sphere(0.12), at=(0.43, 0.55, 0.025))
    return scene


def grids() -> np.ndarray:
    """Smoke after each frame, without noise, (frames, 16, 20, 1)."""
    sim, found = Simulation(plume(), device="cpu", precision="float64"), []
    for _ in range(FRAMES):
        sim.step()
        found.append(sim.plan.method("fluid").arrays(0)["smoke"].reshape(16, 20, 1))
    return np.array(found)


def noisy(values: np.ndarray) -> np.ndarray:
    return values + NOISE * np.random.default_rng(0).normal(size=values.shape)


def test_strength_and_place_of_a_source_are_found_within_their_error_bars():
    seen = [Smoke("/air", range(1, FRAMES + 1), noisy(grids()))]
    found = wsim.fit(plume(0.6, 0.41, 0.25), seen, NAMES, settings=Settings(device="cpu"))
    values, errors = (np.array(list(each.values())) for each in (found.values, found.errors))
    assert found.converged and (np.abs(values - TRUTH) < 3.0 * errors).all()
    assert (errors < (0.01, 1e-3, 1e-3)).all() and found.sigma == pytest.approx(NOISE, rel=0.05)
    source = found.scene.things("Source")[0]
    assert source.strength.values[0] == values[0] and np.allclose(source.place[:2], values[1:], rtol=1e-15)


def test_probes_see_what_is_linear_between_centres():
    fluid = plume().things("Fluid")[0]
    centers, rng = fluid.centers(), np.random.default_rng(2)
    values = (2.0 + 3.0 * centers[..., 0] - centers[..., 1]).reshape(1, -1)
    places = rng.uniform((0.03, 0.03, 0.0), (0.77, 0.97, 0.05), size=(20, 3))
    seen = Smoke("/air", [1], np.zeros((1, 20)), places).seen(fluid, values)
    assert np.allclose(seen[0], 2.0 + 3.0 * places[:, 0] - places[:, 1], atol=1e-14)


def test_a_few_probes_find_them_too():
    rng, fluid = np.random.default_rng(4), plume().things("Fluid")[0]
    places = rng.uniform((0.2, 0.1, 0.0), (0.6, 0.5, 0.05), size=(12, 3))
    probes = Smoke("/air", range(1, FRAMES + 1), np.zeros((FRAMES, 12)), places)
    probes.values = noisy(probes.seen(fluid, grids().reshape(FRAMES, -1)))
    found = wsim.fit(plume(0.8, 0.39, 0.23), [probes], NAMES, settings=Settings(device="cpu"))
    values, errors = (np.array(list(each.values())) for each in (found.values, found.errors))
    assert (np.abs(values - TRUTH) < 4.0 * errors).all() and (errors < (0.1, 0.02, 0.02)).all()


def test_a_curve_of_strengths_keeps_its_proportions():
    source = Source("/fire", Sphere(0.1), strength=Curve(np.array([0.0, 1.0]), np.array([1.0, 3.0])))
    assert source.given("strength", 4.0).strength.values.tolist() == [2.0, 6.0]


@pytest.mark.parametrize("change, said", [({"path": "/other"}, "is no fluid of the scene"),
                                          ({"field": "soot"}, "field is 'soot'"),
                                          ({"values": np.zeros((1, 3))}, "allowed is"),
                                          ({"values": np.full((1, 16, 20, 1), np.nan)}, "none of its values was seen"),
                                          ({"frames": [11]}, "is observed at frames"), ({"sigma": -1.0}, "sigma is -1")])
def test_what_is_wrong_with_an_observation_is_said(change, said):
    given = {"path": "/air", "frames": [1], "values": np.zeros((1, 16, 20, 1))} | change
    with pytest.raises(SceneError, match=said):
        wsim.fit(plume(), [Smoke(**given)], NAMES, settings=Settings(device="cpu"))
