"""Fields found again: gradients against differences, a bar of two halves, what noise and beliefs do, what is refused."""

import json

import numpy as np
import pytest

import wsim
from tests.make.fitting.fields import CPU, QUICK, bar, halves, net, seen, sheet
from wsim import Scene, SceneError, Simulation
from wsim.fitting import Settings, Track
from wsim.fitting.fields.field import fields_of_names
from wsim.fitting.fields.lbfgs import FitPoint, LbfgsDescent
from wsim.fitting.fields.misfit import AdjointMisfit
from wsim.fitting.fields.preconditioner import SketchedHessian, graph_laplacian, solve_laplacian_columns
from wsim.fitting.fields.prior import NeighbourBelief, elements_sharing_points, tets_sharing_faces
from wsim.scene import shapes

# gradients

@pytest.mark.parametrize("scene, name", [
    (bar(frames=4), "young[]"), (bar(frames=4), "poisson[]"),
    (bar((3, 1, 1), **QUICK), "young[]"), (bar((3, 1, 1), **QUICK), "velocities[]"),
    (net(), "stiffness[]"), (net(solver="xpbd", iterations=3), "stiffness[]"), (net(), "velocities[]"),
    (net(), "lengths[]"), (sheet("membrane"), "rest_shape[]"), (bar((3, 1, 1), **QUICK), "rest_shape[]"),
    (net(), "motion[]"), (net(solver="xpbd", iterations=3), "motion[]"),
    (sheet(), "stretch[]"), (sheet(), "bend[]"), (sheet("membrane"), "bend[]"), (sheet("membrane"), "velocities[]"),
    (sheet("membrane"), "stretch[]"), (sheet("membrane"), "shear[]"), (sheet("membrane", weft=80.0), "stretch[]"),
    (sheet("membrane", weft=80.0), "weft[]"), (sheet("membrane", solver="xpbd", iterations=3), "stretch[]")])
def test_the_gradient_of_the_misfit_is_that_of_differences(scene, name):
    """Along a random direction, about random values; differences of order 4 of the misfit itself."""
    last = scene.frames
    tracks = seen(scene, [last - 1, last])
    rng = np.random.default_rng(3)
    misfit = AdjointMisfit([(scene, tracks)], fields_of_names([name], [scene]), "cpu")
    start = misfit.theta(misfit.start)
    misfit.set_beliefs(misfit.start)
    theta, way = start + 0.1 * rng.normal(size=start.shape), rng.normal(size=start.shape)
    _, slope = misfit.look(theta)
    h = 1e-3
    value = {k: misfit.look(theta + k * h * way, slope=False)[0] for k in (-2, -1, 1, 2)}
    expected = (8.0 * (value[1] - value[-1]) - value[2] + value[-2]) / (12.0 * h)
    assert abs(expected[0]) > 1e-9
    assert slope[0] @ way == pytest.approx(expected[0], rel=1e-6)
    assert slope[1] @ way == pytest.approx(expected[1], rel=1e-9)


# what is found

@pytest.fixture(scope="module")
def bent():
    """A bar of two halves at rest, and where it is, without noise."""
    scene = bar()
    return scene, seen(scene, [8], sets=[("young", halves(scene))])[0].positions


def noisy(bent, noise: float, sigma: float | None, seed: int = 0) -> list[Track]:
    positions = bent[1]
    return [Track("/bar", [8], positions + noise * np.random.default_rng(seed).normal(size=positions.shape), sigma=sigma)]


def apart(found, scene: Scene) -> tuple[float, float]:
    """rms of the logarithm of E over the truth, in the half that is held and in the other."""
    truth = halves(scene)
    away = np.log(found.values["young[]"] / truth)
    return tuple(float(np.sqrt(np.mean(away[half]**2))) for half in (truth < 1e5, truth > 1e5))


def test_a_soft_and_a_stiff_half_are_found_from_one_bent_shape(bent):
    """63 points to 0.1 mm, 120 tets, a start between the two: 4 times as stiff beyond a sharp edge, by total variation. What a
    tet near the free end is worth is not seen: it is as its neighbours are. The half time step takes 16 of the gradients."""
    scene = bent[0]
    found = wsim.fit(scene, noisy(bent, 1e-4, 1e-4), "young[tv]", settings=CPU)
    soft, stiff = apart(found, scene)
    assert found.converged and found.simulations <= 100.0 + 16.0 and 0.5 < found.misfit < 1.2
    assert soft < 0.05 and stiff < 0.05
    assert 5 <= found.unseen("young[]").sum() <= 30
    x = scene.softs[0].points[scene.softs[0].tets].mean(axis=1)[:, 0]
    assert x[found.unseen("young[]")].mean() > 0.15                  # the bar ends at 0.3
    again = Simulation(found.scene, device="cpu", precision="float64")
    again.run(8)
    assert np.sqrt(np.mean((again.positions() - bent[1])**2)) < 2e-4


@pytest.mark.parametrize("belief", ["smooth", "tv"])
def test_noise_does_not_blow_up(bent, belief):
    """Ten times the noise: smoother, and wrong where little is seen, but never far from what is possible."""
    scene = bent[0]
    found = wsim.fit(scene, noisy(bent, 1e-3, 1e-3), f"young[{belief}]", settings=CPU)
    values, (soft, stiff) = found.values["young[]"], apart(found, scene)
    assert found.converged and 0.8 < found.misfit < 1.2 and found.simulations <= 80.0
    assert soft < 0.25 and stiff < 0.6 and values.min() > 2e4 and values.max() < 5e5


def test_without_a_belief_noise_is_what_is_found(bent):
    scene = bent[0]
    found = wsim.fit(scene, noisy(bent, 1e-3, 1e-3), "young[free]", settings=Settings(device="cpu", limit=60.0))
    assert max(apart(found, scene)) > 0.7 and not found.converged and "NOT converged" in found.text()


@pytest.mark.slow
def test_the_noise_is_estimated_where_it_is_not_given(bent):
    scene = bent[0]
    side = bar(gravity=(0.0, 0.0, -9.81))
    also = seen(side, [4, 8], 1e-4, seed=1, sets=[("young", halves(side))])
    found = wsim.fit(scene, noisy(bent, 1e-4, None), "young[tv]", also=[(side, also)], settings=CPU)
    assert found.sigma == pytest.approx(1e-4, rel=0.15) and max(apart(found, scene)) < 0.05


def test_the_stiffness_of_each_spring_of_a_net_is_found():
    """40 % up and down along the net; all frames of a fall, 0.1 mm of noise, unknown."""
    scene = net(frames=20)
    middle = scene.springs[0].points[scene.springs[0].edges].mean(axis=1)
    truth = scene.springs[0].stiffness * (1.0 + 0.4 * np.sin(6.0 * middle[:, 0]))
    found = wsim.fit(scene, seen(scene, list(range(1, 21)), 1e-4, sets=[("stiffness", truth)]), "stiffness[]", settings=CPU)
    away, before = np.log(found.values["stiffness[]"] / truth), np.log(scene.springs[0].stiffness / truth)
    assert found.converged and found.sigma == pytest.approx(1e-4, rel=0.1)
    assert np.sqrt(np.mean(away**2)) < 0.12 < 0.25 < np.sqrt(np.mean(before**2))
    assert np.array_equal(found.scene.springs[0].stiffness, found.values["stiffness[]"])


def test_the_velocities_of_a_throw_are_found_from_where_it_ends():
    """No force but gravity and the cloth's own: mean velocity from the mean way, x = v t + g t^2 / 2."""
    scene = sheet("membrane")
    scene.pins.clear()
    target = scene.cloths[0].points.astype(np.float64) + (0.3, 0.1, 0.2)
    found = wsim.fit(scene, [Track("/sheet", [6], target[None], sigma=1e-4)], "velocities[]", settings=CPU)
    t = 0.1
    expected = (np.array([0.3, 0.1, 0.2]) + (0.0, 0.5 * 9.81 * t * t, 0.0)) / t
    assert found.converged and found.values["velocities[]"].mean(axis=0) == pytest.approx(expected, rel=1e-3)
    sim = Simulation(found.scene, device="cpu")
    sim.run(6)
    assert np.abs(sim.positions() - target).max() < 1e-3


def test_the_motion_of_a_pin_is_found_from_what_hangs_on_it():
    """A shift that swings once; 12 frames of the net below tell it to a millimetre, but in the last two."""
    scene = net(frames=12)
    times = np.arange(13) / 60.0
    values = np.stack([np.eye(4)] * 13)
    values[:, :3, 3] = 0.05 * np.sin(2.0 * np.pi * times / 0.2)[:, None] * (1.0, 0.5, 0.0)
    sim, x = Simulation(scene, device="cpu", precision="float64"), []
    sim.set("/pin", "motion", wsim.Motion(times, values))
    sim.run(12, lambda s: x.append(s.positions()))
    free = np.arange(5, 25)
    track = Track("/net", np.arange(1, 13), np.array(x)[:, free], free, sigma=1e-5)
    found = wsim.fit(scene, [track], "motion[]", settings=CPU)
    assert np.abs(found.values["motion[]"] - values[1:, :3, 3])[:-2].max() < 1e-3
    assert found.scene.pins[0].motion.values[5, :3, 3] == pytest.approx(values[5, :3, 3], abs=1e-3)


# parts

def test_l_bfgs_finds_the_bottom_of_a_bent_valley():
    """Rosenbrock's in 20 dimensions, to rounding; a wall of inf is only too long a step."""
    def look(x):
        if np.abs(x).max() > 3.0:
            return np.array([np.inf]), np.zeros((1, len(x)))
        a, b = x[1:] - x[:-1]**2, 1.0 - x[:-1]
        g = np.zeros(len(x))
        g[:-1] = -400.0 * x[:-1] * a - 2.0 * b
        g[1:] += 200.0 * a
        return np.array([(100.0 * a**2 + b**2).sum()]), g[None]
    x = np.tile([-1.2, 1.0], 10)
    descent = LbfgsDescent(look, FitPoint(x, *look(x)), np.ones(1), radius=1.0)
    steps = 0
    while np.linalg.norm(descent.gradient) > 1e-9 and descent.step():
        steps += 1
    assert np.abs(descent.at.x - 1.0).max() < 1e-9 and steps < 200


def test_a_quadratic_is_solved_at_once_from_its_own_hessian():
    """Beliefs about a chain, and what is seen of 3 sums: the metric is the Hessian."""
    rng = np.random.default_rng(0)
    belief = NeighbourBelief(np.stack([np.arange(29), np.arange(1, 30)], axis=1), mean=np.zeros((30, 1)))
    J, y = rng.normal(size=(3, 30)), rng.normal(size=3)

    def look(x):
        own, by = belief.look(x[:, None])
        return np.array([0.5 * ((J @ x - y)**2).sum(), own]), np.stack([J.T @ (J @ x - y), by[:, 0]])
    descent = LbfgsDescent(look, FitPoint(np.zeros(30), *look(np.zeros(30))), np.array([400.0, 1.0]))
    metric = SketchedHessian([belief], [np.zeros((30, 1))], J.T)
    descent.inverse = lambda q, weights: metric(q, weights[0])
    assert descent.step() and np.linalg.norm(descent.gradient) < 1e-2 and descent.expected() < 1e-6


@pytest.mark.parametrize("kind", ["smooth", "tv", "free"])
def test_beliefs_have_the_gradient_of_differences(kind):
    rng = np.random.default_rng(1)
    belief = NeighbourBelief(elements_sharing_points(np.array([[0, 1], [1, 2], [2, 3], [0, 3]]), 4), kind, 0.4,
                             rng.normal(size=(4, 2)), 2.0)
    t, way, h = rng.normal(size=(4, 2)), rng.normal(size=(4, 2)), 1e-5
    expected = (belief.look(t + h * way)[0] - belief.look(t - h * way)[0]) / (2.0 * h)
    assert (belief.look(t)[1] * way).sum() == pytest.approx(expected, rel=1e-8)
    A = graph_laplacian(belief.pairs, belief.curvature(t), belief.wide**-2, 4)
    b = rng.normal(size=(4, 3))
    assert A[0](solve_laplacian_columns(A, b)) == pytest.approx(b, rel=1e-5, abs=1e-5)


def test_tets_of_a_block_have_as_many_neighbours_as_inner_faces():
    _, tets = shapes.block((0.6, 0.2, 0.2), (6, 2, 2))
    corner = np.sort(tets[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]], axis=2).reshape(-1, 3)
    each, count = np.unique(corner, axis=0, return_counts=True)
    assert len(tets_sharing_faces(tets)) == (count == 2).sum() and (tets_sharing_faces(tets)[:,
                                                                                     0] != tets_sharing_faces(tets)[:, 1]).all()


# files, and what is refused

def test_a_fit_goes_on_from_its_file(bent, tmp_path):
    state = tmp_path / "state.json"
    tracks = noisy(bent, 1e-3, 1e-3)
    short = wsim.fit(bent[0], tracks, "young[]", settings=Settings(device="cpu", limit=8.0, state=str(state)))
    assert not short.converged and json.loads(state.read_text())["steps"] == short.steps
    steps = []
    whole = wsim.fit(bent[0], tracks, "young[]", settings=Settings(device="cpu", state=str(state)), each=steps.append)
    assert whole.converged and steps[0]["step"] == short.steps + 1 and steps[0]["values"].keys() == {"young[]"}
    with pytest.raises(SceneError, match="is the state of a fit of"):
        wsim.fit(bent[0], tracks, "poisson[]", settings=Settings(device="cpu", state=str(state)))


def test_the_command_writes_the_field_and_the_loader_reads_it(bent, tmp_path, capsys):
    from pxr import UsdGeom

    from wsim import cli
    from wsim.usd.result.fields import load_fields
    from wsim.usd.stage import StageReading, StageUnits, open_stage

    scene, out = bent[0], tmp_path / "fitted.usda"
    wsim.save(scene, tmp_path / "bar.usda")
    with wsim.Recorder(wsim.load(str(tmp_path / "bar.usda")), str(tmp_path / "seen.usdc")) as recorder:
        recorder.append(8.0, {"/bar": bent[1][0]}, {"/bar": np.zeros_like(bent[1][0])}, {})
    code = cli.main(["fit", str(tmp_path / "bar.usda"), "--to", str(tmp_path / "seen.usdc"), "--parameters", "young[tv]",
                     "--noise", "0.001", "--device", "cpu", "-o", str(out), "--json"])
    said = json.loads(capsys.readouterr().out)
    values = np.array(said["fields"][0]["values"])
    assert code == 0 and said["converged"] and len(values) == 120
    stage = open_stage(out)
    mesh = stage.GetPrimAtPath("/bar")
    assert np.array_equal(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("wsim:young").Get(), values)
    soft = load_fields(StageReading(stage, StageUnits.of(stage)), mesh, wsim.load(str(tmp_path / "bar.usda")).softs[0])
    assert np.array_equal(np.array([m.young for m in soft.materials])[soft.which], values)
    assert wsim.load(str(out)).softs[0].material.young == pytest.approx(np.median(values), rel=1e-6)


@pytest.mark.parametrize("make, names", [(net, "velocities[],/pin:motion[]"), (net, "stiffness[]"), (sheet, "velocities[]"),
                                         (sheet, "bend[]"), (net, "lengths[]"), (sheet, "rest_shape[]"),
                                         (lambda: bar((3, 1, 1), **QUICK | {"frames": 6}), "rest_shape[]")])
def test_other_fields_are_written_where_the_loader_finds_them(make, names, tmp_path):
    """A few steps of a fit of a loaded scene; what is loaded over it is what was found, in the precision of the file."""
    from wsim.cli import fit

    wsim.save(make(), tmp_path / "scene.usda")
    scene, out = wsim.load(str(tmp_path / "scene.usda")), tmp_path / "fitted.usda"
    track = seen(scene, [6], 1e-3, sigma=1e-3)
    found = wsim.fit(scene, track, names, settings=Settings(device="cpu", limit=4.0))
    fit._save_fitted_layer(scene, found, str(out))
    loaded, body = wsim.load(str(out)), scene.bodies()[0].path
    if "velocities" in names:
        assert loaded.bodies()[0].velocities == pytest.approx(found.values["velocities[]"], abs=1e-5)
    if "motion" in names:
        for k in range(7):
            assert loaded.pins[0].motion.at(k / 60.0) == pytest.approx(found.scene.pins[0].motion.at(k / 60.0), abs=1e-9)
    if "stiffness" in names:
        assert loaded.springs[0].stiffness == pytest.approx(found.values["stiffness[]"], rel=1e-6)
    if "lengths" in names:
        assert loaded.springs[0].lengths == pytest.approx(found.values["lengths[]"], rel=1e-6)
    if "rest_shape" in names:
        rest = loaded.bodies()[0].rest_points
        assert rest - rest.mean(axis=0) == pytest.approx(found.values["rest_shape[]"], abs=1e-6)
        assert np.abs(rest - loaded.bodies()[0].points).max() > 1e-6
    assert body == loaded.bodies()[0].path and names.split(",")[0] in found.text()


@pytest.mark.parametrize("name, words", [
    ("young[sharp]", "allowed are smooth, tv, free"), ("young[tv=0]", "number > 0"), ("mass[]", "is no field; allowed are"),
    ("/rod:young[]", "nothing there has young"), ("stiffness[]", "those that have it: none"),
    ("young[],/bar:young[]", "named twice"), ("young[],young", "are of one body"), ("young[],stiff", "is no parameter"),
    ("young[tv]x", "is no field")])
def test_fields_that_cannot_be_are_named_with_what_is_allowed(bent, name, words):
    with pytest.raises(SceneError, match=words.replace("[", r"\[")):
        wsim.fit(bent[0], noisy(bent, 1e-3, None), name, settings=CPU)


@pytest.mark.parametrize("scene, name", [(sheet(), "weft[]"), (sheet("membrane"), "weft[]")])
def test_a_stiffness_that_no_element_has_is_refused(scene, name):
    with pytest.raises(SceneError, match="/sheet: has no triangles|/sheet: has no .* of their own > 0"):
        wsim.fit(scene, seen(scene, [6]), name, settings=CPU)


@pytest.mark.parametrize("more, words", [
    ({"start": {"young[]": -1.0}}, "number > 0"), ({"start": {"young[]": np.ones(7)}}, "has shape"),
    ({"start": {"density": 1.0}}, "is not fitted"), ({"priors": {"young[]": (1e5, 0.0)}}, "finite number > 0"),
    ({"priors": {"bend": (1e5, 0.1)}}, "is not fitted")])
def test_starts_and_priors_that_cannot_be_are_named(bent, more, words):
    with pytest.raises(SceneError, match=words):
        wsim.fit(bent[0], noisy(bent, 1e-3, None), "young[]", settings=CPU, **more)

