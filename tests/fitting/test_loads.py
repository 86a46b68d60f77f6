"""Fits of loads and of the mass of a net, and of what is seen as a mean or a marker."""

import numpy as np
import pytest

import wsim
from tests.make.physics.motion.loads import GROWS, RATE, STAYS, T, pushed
from wsim.fitting import Functional, Track
from wsim.gradient.recording import Recording
from wsim.scene import SceneError
from wsim.scene.curve import Curve
from wsim.simulation.simulation import Simulation
from wsim.usd import save

NOISE = 1e-5         # [m]


@pytest.fixture(scope="module")
def truth() -> dict[str, list[np.ndarray]]:
    """Positions after each frame, with some noise."""
    sim, rng = Simulation(pushed(), precision="float64", device="cpu"), np.random.default_rng(3)
    found: dict[str, list[np.ndarray]] = {"/pair": [], "/chain": []}
    for _ in range(4):
        sim.step()
        for path, seen in found.items():
            x = sim.positions(path)
            seen.append(x + NOISE * rng.standard_normal(x.shape))
    return found


def mean(truth, path, count, **more) -> Functional:
    return Functional.mean(path, [1, 2, 3, 4], np.array(truth[path]).mean(axis=1), np.arange(count), **more)


def test_a_functional_is_its_weighted_sum_and_its_transpose():
    rng = np.random.default_rng(0)
    x, values = rng.standard_normal((2, 6, 3)), rng.standard_normal((1, 4))
    values[0, 1] = np.nan
    W = rng.standard_normal((4, 6, 3)) * (rng.random((4, 6, 1)) < 0.7)
    rows, points = np.nonzero(np.abs(W).sum(axis=2))
    seen = Functional("/b", [1], values, rows, points, W[rows, points], weights=[1.0, 1.0, 0.0, 4.0])
    expected = (np.einsum("mnk,wnk->wm", W, x) - values)[:, [0, 3]] * [1.0, 2.0]
    np.testing.assert_allclose(seen.residuals(0, x), expected, rtol=1e-13)
    r = rng.standard_normal(2)
    np.testing.assert_allclose(seen.back(0, x[0], r), np.tensordot(r * [1.0, 2.0], W[[0, 3]], 1), rtol=1e-13)
    corners, parts = np.array([[0, 1, 2], [3, 4, 5]]), np.array([[0.2, 0.3, 0.5], [1.0, 0.0, 0.0]])
    places = np.einsum("mc,mck->mk", parts, x[0][corners])
    assert np.abs(Functional.markers("/b", [1], places[None], corners, parts).residuals(0, x[:1])).max() < 1e-15
    by_share = Functional.mean("/b", [1], [x[0, :2].T @ [0.25, 0.75]], [0, 1], shares=[1.0, 3.0])
    assert np.abs(by_share.residuals(0, x[:1])).max() < 1e-15


@pytest.mark.parametrize("change, words", [
    ({"points": [0, 9]}, "points name 0 to 9; allowed is 0 to 2"), ({"rows": [0, 1]}, "rows name 0 to 1; allowed is 0 to 0"),
    ({"rows": [0]}, "1 rows, 2 points"), ({"parts": np.full((2, 3), np.nan)}, "not finite"),
    ({"values": [[np.nan]]}, "every one is NaN"), ({"frames": [9]}, "allowed is 1 to 4"), ({"path": "/none"}, "is no body"),
    ({"weights": [-1.0]}, "weights have shape"), ({"frames": [1, 2]}, "give each frame once"), ({"sigma": 0.0}, "sigma is")])
def test_bad_functionals_are_refused(change, words):
    good = {"path": "/chain", "frames": [1], "values": [[5.0]], "rows": [0, 0], "points": [0, 1], "parts": np.ones((2, 3))}
    with pytest.raises(SceneError, match=words):
        wsim.fit(pushed(), [Functional(**(good | change))], "gravity_y")


def test_a_force_is_found_from_the_mean_of_what_it_pushes(truth):
    start = {"/stays:force_x": 0.3, "/stays:force_y": 0.0, "/stays:force_z": 0.4}
    found = wsim.fit(pushed(), [mean(truth, "/chain", 3, sigma=NOISE)], "/stays:force", start=start)
    for k, axis in enumerate("xyz"):
        name = f"/stays:force_{axis}"
        assert abs(found.values[name] - STAYS[k]) < 4.0 * found.errors[name] < 4e-2
    assert found.scene.loads[1].curve.values.shape == (1, 3)


def test_keys_of_a_force_are_found_by_the_adjoint_of_a_mean(truth):
    scene = pushed()
    exact = scene.loads[0].curve.values
    scene.loads[0].curve = Curve([0.0, T], exact * 0.6 + 0.1)
    found = wsim.fit(scene, [mean(truth, "/pair", 2, sigma=NOISE)], "/grows:force[free]")
    np.testing.assert_allclose(found.values["/grows:force[]"], exact, atol=0.05)
    assert exact[1] @ GROWS == 4.0 * RATE * T


def test_mass_and_stiffness_of_a_net_are_known_by_their_ratio_unless_a_force_is(truth):
    seen = [Track("/chain", [1, 2, 3, 4], np.array(truth["/chain"]), sigma=NOISE)]
    start = {"/chain:mass": 0.3, "/chain:stiffness": 500.0}
    both = wsim.fit(pushed(), seen, "/chain:mass,/chain:stiffness", start=start)
    for name, value in (("/chain:mass", 0.4), ("/chain:stiffness", 400.0)):
        assert abs(both.values[name] - value) < 4.0 * both.errors[name] < 0.05 * value
    bare = pushed()
    bare.loads = bare.loads[:1]
    sim = Simulation(bare, precision="float64", device="cpu")
    sim.run(4)
    text = wsim.fit(bare, [Track("/chain", [4], sim.positions("/chain"), sigma=NOISE)], "/chain:mass,/chain:stiffness").text()
    assert "the ratio of /chain:mass to /chain:stiffness" in text or "the ratio of /chain:stiffness to /chain:mass" in text


def test_what_was_found_is_written_over_the_scene(tmp_path, truth):
    save(pushed(), tmp_path / "scene.usda")
    scene = wsim.load(tmp_path / "scene.usda")
    from wsim.fitting.parameter import parameters_of_names
    from wsim.usd.result.fitted import save_fitted
    found, _ = parameters_of_names("/other:force_y,/chain:mass", [scene])
    after = found[1].written(found[0].written(scene, -2.0), 0.8)
    save_fitted(scene, after, tmp_path / "fitted.usda")
    again = wsim.load(tmp_path / "fitted.usda")
    np.testing.assert_allclose(again.loads[2].curve.values, [[0.3, -2.0, 0.0]])
    np.testing.assert_allclose(again.springs[1].masses, [0.2, 0.2, 0.4])
    with pytest.raises(SceneError, match="has 2 keys, and /grows:force_x is one number"):
        parameters_of_names("/grows:force_x", [scene])


def test_a_load_is_an_input_of_a_recording():
    from wsim.gradient.inputs.by_name import inputs_by_name
    recording = Recording(Simulation(pushed(), gradients=True, precision="float64", device="cpu"), 4)
    recording.run()
    found = inputs_by_name(recording, ["/grows:force", "/stays:force", "/chain:mass"])
    assert found["/grows:force"].read_value().shape == (2, 3) and found["/stays:force"].read_value().tolist() == STAYS
    found["/stays:force"].write_value([1.0, 0.0, 0.0])
    assert found["/stays:force"].read_value().tolist() == [1.0, 0.0, 0.0]
    assert found["/chain:mass"].read_value() == pytest.approx(0.4)
    gradient = recording.backward({4: {"/chain": np.ones((3, 3))}})
    assert found["/stays:force"].gradient(gradient, 0, (3,)).shape == (3,)
    with pytest.raises(SceneError, match="/grows:force"):
        inputs_by_name(recording, ["/none:force"])
