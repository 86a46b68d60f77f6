"""Parameters found again from noisy motion, how sure the fit says it is, what it cannot know, and what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.fitting.fit import CPU, bar, motion, sheet
from wsim import Scene, SceneError, Simulation
from wsim.fitting import Scan, Settings, Track, fit, read
from wsim.fitting.copies import BrokenRun, SceneCopies, scene_with_named_choices
from wsim.fitting.least_squares.bounds import FittingMap
from wsim.fitting.observations.observe import closest_on_triangle
from wsim.fitting.parameter import parameters_of_names
from wsim.scene import shapes

FAR = {"stretch": 400.0, "bend": 5e-4}                 # both wrong by a factor 2


def seen(x: np.ndarray, path: str, noise: float, seed: int = 0, sigma: float | None = None) -> list[Track]:
    noisy = x + noise * np.random.default_rng(seed).normal(size=x.shape)
    return [Track(path, np.arange(1, len(x) + 1), noisy, sigma=sigma)]


@pytest.fixture(scope="module")
def fall():
    scene = sheet()
    return scene, motion(scene)


@pytest.fixture(scope="module")
def swing():
    scene = bar()
    return scene, motion(scene)


# parameters

@pytest.mark.parametrize("map_, value", [(FittingMap("log"), 3.0), (FittingMap("plain", high=10.0), -9.81),
                                         (FittingMap("bounded", -1.0, 0.5), 0.3)])
def test_a_map_leads_there_and_back_and_knows_its_slope(map_, value):
    theta, h = map_.forward(value), 1e-6
    assert map_.inverse(theta) == pytest.approx(value, rel=1e-12)
    assert map_.slope(theta) == pytest.approx((map_.inverse(theta + h) - map_.inverse(theta - h)) / (2.0 * h), rel=1e-8)


def test_a_live_density_is_that_of_the_scene(fall):
    scene, _ = fall
    sim = Simulation(scene, device="cpu", precision="float64", worlds=2)
    sim.set("/sheet", "density", 250.0, world=1)
    sim.run(8)
    fabric = replace(scene.cloths[0].material, density=250.0)
    heavy = replace(scene.with_objects("Cloth", [replace(scene.cloths[0], material=fabric)]), frames=8)
    np.testing.assert_allclose(sim.positions("/sheet", 1), motion(heavy)[-1], rtol=0.0, atol=1e-12)
    assert np.abs(sim.positions("/sheet", 0) - sim.positions("/sheet", 1)).max() > 1e-3


def test_copies_begin_again_as_they_began(fall):
    scene, x = fall
    found, _ = parameters_of_names("stretch,gravity_y", [scene])
    copies = SceneCopies(scene, found, 2, "cpu")
    for _ in range(2):
        copies.begin(np.array([[200.0, -9.81], [250.0, -9.0]]))
        copies.to(5)
        np.testing.assert_allclose(copies.positions("/sheet")[0], x[4], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("integrator, steps", [("bdf2", 4), ("sdirk3", 4), ("auto", 2)])
def test_a_scene_that_is_settled_stays_so(integrator, steps):
    """As many steps, of one stage or two."""
    scene = bar()
    scene.integrator, scene.substeps = integrator, 4
    once = scene_with_named_choices(scene, "cpu")
    assert (once.substeps, once.integrator) == (steps, "sdirk3" if integrator == "auto" else integrator)
    assert scene_with_named_choices(once, "cpu").substeps == steps


# what is found

def test_two_parameters_of_a_noisy_sheet_within_a_percent_in_twelve_simulations(fall):
    """From half and double, 1 mm of noise; every copy counts for the part of the horizon that it ran. The
    run with half the time step at the end costs two more."""
    scene, x = fall
    found = fit(scene, seen(x, "/sheet", 1e-3), "stretch,bend", start=FAR, settings=Settings(device="cpu", accuracy=0.01))
    assert found.converged and found.simulations <= 12.0 + 2.0
    assert found.values == pytest.approx({"stretch": 200.0, "bend": 1e-3}, rel=0.01)
    assert found.scene.cloths[0].material.bend == found.values["bend"] and scene.cloths[0].material.bend == 1e-3


def test_warp_and_weft_are_found_apart(fall):
    """A weft that is twice the warp, from one value for both; what is fitted together keeps its ratio."""
    scene, _ = fall
    woven = replace(scene.cloths[0], material=replace(scene.cloths[0].material, weft=400.0))
    x = motion(replace(scene.with_objects("Cloth", [woven]), frames=12))
    found = fit(scene, seen(x, "/sheet", 1e-4), "stretch_warp,stretch_weft", settings=CPU)
    assert found.values == pytest.approx({"stretch_warp": 200.0, "stretch_weft": 400.0}, rel=1e-3)
    both, _ = parameters_of_names("stretch", [found.scene])
    material = both[0].written(found.scene, 100.0).cloths[0].material
    assert (material.stretch, material.weft) == pytest.approx((100.0, 200.0), rel=2e-3)


def test_a_live_weft_moves_no_energy(fall):
    """Forces and energies of a sheet with a weft of its own belong together: leapfrog keeps their sum."""
    scene, _ = fall
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.set("/sheet", "weft", 400.0)
    sim.step()
    before = sim.indicators()
    sim.run(8)
    after = sim.indicators()
    fallen = after["kinetic_energy"] - before["kinetic_energy"]
    assert abs(after["energy"] - before["energy"]) < 2e-3 * fallen and after["elastic_energy"] > 1e-3 * fallen


def test_error_bars_hold_the_truth(fall):
    """Six draws, two parameters: none beyond 3.5 error bars (1 in 180 chances), at least 9 of 12 within two."""
    scene, x = fall
    away = []
    for seed in range(6):
        found = fit(scene, seen(x, "/sheet", 1e-3, seed), "stretch,bend", start={"stretch": 220.0}, settings=CPU)
        assert found.sigma == pytest.approx(1e-3, rel=0.1) and found.misfit == pytest.approx(1.0, abs=1e-6)
        away += [(found.values[name] - true) / found.errors[name] for name, true in (("stretch", 200.0), ("bend", 1e-3))]
    assert np.abs(away).max() < 3.5 and (np.abs(away) < 2.0).sum() >= 9


def test_modulus_and_poisson_s_ratio_of_a_bar_in_fifteen_simulations(swing):
    """And two for the run with half the time step."""
    scene, x = swing
    found = fit(scene, seen(x, "/bar", 1e-4), "young,poisson", start={"young": 2e5, "poisson": 0.4}, settings=CPU)
    assert found.converged and found.simulations <= 15.0 + 2.0
    assert found.values["young"] == pytest.approx(1e5, rel=0.005) and found.values["poisson"] == pytest.approx(0.3, abs=0.02)


def test_gravity_alone_does_not_tell_stiffness_from_density(swing):
    scene, x = swing
    found = fit(scene, seen(x, "/bar", 1e-4), "young,poisson,density", start={"young": 1.5e5}, settings=CPU)
    assert found.errors["young"] == found.errors["density"] == np.inf
    assert found.values["young"] / found.values["density"] == pytest.approx(100.0, rel=0.005)
    assert found.values["poisson"] == pytest.approx(0.3, abs=0.02) and np.isfinite(found.errors["poisson"])
    assert "only the ratio of young to density matters" in found.text() and found.estimate.singular[-1] < 1e-2


def test_a_prior_says_what_the_data_do_not(swing):
    scene, x = swing
    found = fit(scene, seen(x, "/bar", 1e-4), "young,density", start={"young": 1.2e5}, priors={"density": (1e3, 0.05)},
                settings=CPU)
    assert not found.estimate.words
    assert found.errors["density"] == pytest.approx(50.0, rel=0.02) and found.errors["young"] == pytest.approx(5e3, rel=0.02)
    assert found.estimate.correlation[0, 1] > 0.999


def test_several_experiments_share_what_they_have_in_common(swing):
    """A second bar, turned sideways: both move by one modulus."""
    scene, x = swing
    other = replace(bar(), gravity=(0.0, 0.0, -5.0))
    found = fit(scene, seen(x, "/bar", 1e-4), "young", also=[(other, seen(motion(other), "/bar", 1e-4, 1))],
                start={"young": 1.3e5}, settings=CPU)
    assert found.values["young"] == pytest.approx(1e5, rel=1e-3)
    assert [s.softs[0].material.young for s in found.scenes] == [found.values["young"]] * 2


def test_some_points_at_some_frames_with_weights_are_enough(fall):
    scene, x = fall
    points, frames = np.array([27, 36, 63, 56]), np.array([3, 7, 12, 15])
    positions = x[frames - 1][:, points].copy()
    positions[0, 1] = np.nan                                 # not seen
    positions[:, 3] += 1.0                                   # wrong, and not counted
    track = Track("/sheet", frames, positions, points, weights=np.array([1.0, 1.0, 2.0, 0.0]))
    found = fit(scene, [track], "stretch", start={"stretch": 300.0}, settings=CPU)
    assert found.values["stretch"] == pytest.approx(200.0, rel=1e-6)


def test_a_scan_needs_no_correspondence(fall):
    """Places between the points, in no order."""
    scene, x = fall
    scans, rng = [], np.random.default_rng(2)
    for frame in (4, 8, 12):
        grid = x[frame - 1].reshape(8, 8, 3)
        corner = rng.integers(0, 7, (60, 2))
        a, b, c = (grid[corner[:, 0] + i, corner[:, 1] + j] for i, j in ((0, 0), (1, 0), (0, 1)))
        u, v = rng.uniform(0.0, 0.5, (2, 60, 1))
        scans.append(Scan("/sheet", frame, a + u * (b - a) + v * (c - a)))
    found = fit(scene, scans, "stretch", start={"stretch": 260.0}, settings=CPU)
    assert found.values["stretch"] == pytest.approx(200.0, rel=0.02)


def test_the_nearest_place_of_a_triangle():
    rng = np.random.default_rng(1)
    p, e, f = rng.normal(size=(3, 40, 3))
    u, v = closest_on_triangle(p, e, f).T
    assert (u >= -1e-12).all() and (v >= -1e-12).all() and (u + v <= 1.0 + 1e-12).all()
    distance = np.linalg.norm(p - u[:, None] * e - v[:, None] * f, axis=1)
    s, t = (w.ravel() for w in np.meshgrid(np.linspace(0.0, 1.0, 101), np.linspace(0.0, 1.0, 101)))
    s, t = s[s + t <= 1.0], t[s + t <= 1.0]
    tried = np.linalg.norm(p[:, None] - s[:, None] * e[:, None] - t[:, None] * f[:, None], axis=2).min(axis=1)
    assert (distance <= tried + 1e-12).all() and (distance > tried - 0.05).all()


# horizons

def test_a_chaotic_horizon_is_cut_and_its_growth_said():
    """Three links swing through; after 2 s a change of 0.1 % is no longer answered in proportion."""
    scene = Scene(fps=30, frames=200, solver="explicit", substeps=20)
    points = np.zeros((4, 3))
    points[:, 0] = 0.3 * np.arange(4)
    scene.pin("/pin", scene.net("/chain", points, [[0, 1], [1, 2], [2, 3]], [2000.0], [1.0]), [0])
    found = fit(scene, seen(motion(scene), "/chain", 1e-4), "stiffness,gravity_y", start={"stiffness": 2200.0}, settings=CPU)
    assert found.converged and 40 < found.frames < 150
    assert "chaotic" in found.notes[0] and "exp(" in found.notes[0]
    assert found.values["stiffness"] == pytest.approx(2000.0, rel=1e-4)


def test_frames_before_a_broken_one_are_used_and_it_is_named(fall, monkeypatch):
    scene, x = fall
    to = SceneCopies.to

    def breaks(self, frame):
        if frame > 9:
            raise BrokenRun(frame, "point 3 stopped being a number")
        to(self, frame)

    monkeypatch.setattr(SceneCopies, "to", breaks)
    found = fit(scene, seen(x, "/sheet", 1e-4), "stretch", start={"stretch": 250.0}, settings=CPU)
    assert found.frames == 9 and "frame 10: point 3 stopped being a number" in found.notes[0]
    monkeypatch.setattr(SceneCopies, "to", lambda self,
                        frame: (_ for _ in ()).throw(BrokenRun(1, "point 3 stopped being a number")))
    with pytest.raises(SceneError, match="frame 1: point 3"):
        fit(scene, seen(x, "/sheet", 1e-4), "stretch", settings=CPU)


def test_a_fit_goes_on_where_it_was_stopped(swing, tmp_path):
    scene, x = swing
    given = scene, seen(x, "/bar", 1e-4), "young,poisson"
    state, steps = str(tmp_path / "state.json"), []
    whole = fit(*given, start={"young": 2e5}, each=steps.append, settings=CPU)
    part = fit(*given, start={"young": 2e5}, settings=replace(CPU, state=state, limit=1.0))
    assert not part.converged and "not converged" in part.text()
    rest = fit(*given, start={"young": 2e5}, settings=replace(CPU, state=state))
    assert rest.values == whole.values and rest.steps == whole.steps == len(steps) and rest.converged
    with pytest.raises(SceneError, match="of a fit of young, poisson"):
        fit(*given[:2], "young", settings=replace(CPU, state=state))


# bad input

@pytest.mark.parametrize("asked, words", [
    ("", "none is named"), ("elasticity", "elasticity: is no parameter; allowed are stretch"),
    ("thickness", "is fixed while a scene runs"), ("/no/cloth:stretch", "/no/cloth: nothing here has stretch"),
    ("young", "it belongs to material points, soft;"), ("stretch,/sheet:stretch", "named twice"),
    ("damping", "give a start value"),
    ("wind", "no cloth has drag or lift"), ("stretch,stretch_weft", "named twice"),
    ("/sheet:gravity", "the whole scene's"), ("strain_limit", "where it is finite from the start")])
def test_a_parameter_that_cannot_be_fitted_is_named_with_those_that_can(asked, words):
    with pytest.raises(SceneError, match=words):
        parameters_of_names(asked, [sheet()])


def test_density_of_authored_masses_is_refused():
    scene = sheet()
    scene.cloths[0].mass = 0.2
    with pytest.raises(SceneError, match="/sheet: density changes nothing: masses are authored"):
        parameters_of_names("density", [scene])


@pytest.mark.parametrize("observed, words", [
    ([], "there are none"), ([Track("/curtain", [1], np.zeros((1, 64, 3)))], "/curtain: is observed and is no body"),
    ([Track("/sheet", [1], np.zeros((1, 63, 3)))], r"allowed is \(1, 64, 3\)"),
    ([Track("/sheet", [99], np.zeros((1, 64, 3)))], "allowed is 1 to 20"),
    ([Track("/sheet", [1, 1], np.zeros((2, 64, 3)))], "a frame twice"),
    ([Track("/sheet", [1], np.full((1, 64, 3), np.nan))], "none of its points was seen"),
    ([Track("/sheet", [1], np.zeros((1, 1, 3)), points=[64])], "allowed is 0 to 63"),
    ([Track("/sheet", [1], np.zeros((1, 64, 3)), sigma=-1.0)], "sigma is -1"),
    ([Scan("/sheet", 1, np.zeros((0, 3)))], "a scan needs points")])
def test_observations_that_cannot_be_are_named_with_what_is_allowed(observed, words):
    with pytest.raises(SceneError, match=words):
        fit(sheet(), observed, "stretch", settings=CPU)


# files

@pytest.fixture(scope="module")
def files(fall, tmp_path_factory):
    """The sheet as a stage, and its motion as a result."""
    folder = tmp_path_factory.mktemp("fit")
    scene, x = fall
    wsim.save(scene, folder / "sheet.usda")
    with wsim.Recorder(wsim.load(str(folder / "sheet.usda")), str(folder / "seen.usdc")) as recorder:
        for frame, positions in enumerate(x, 1):
            recorder.append(float(frame), {"/sheet": positions}, {"/sheet": np.zeros_like(positions)}, {})
    return folder


def test_the_command_writes_a_layer_with_what_was_found(files, capsys):
    from wsim import cli

    scene, out = files / "sheet.usda", files / "fitted.usda"
    given = ["fit", str(scene), "--to", str(files / "seen.usdc"), "--parameters", "stretch,gravity_y", "--start", "stretch=300",
             "--device", "cpu"]
    assert cli.main([*given, "-o", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    found = {p["name"]: p["value"] for p in said["parameters"]}
    assert found == pytest.approx({"stretch": 200.0, "gravity_y": -9.81}, rel=1e-5)
    loaded, before = wsim.load(str(out)), wsim.load(str(scene))
    assert loaded.cloths[0].material == replace(before.cloths[0].material, stretch=found["stretch"])
    assert loaded.gravity == pytest.approx((0.0, found["gravity_y"], 0.0)) and loaded.pins == before.pins
    assert sorted(p.name for p in files.iterdir()) == ["fitted.usda", "seen.usdc", "sheet.usda"]
    assert cli.main([*given, "-o", str(scene)]) == 1 and "never overwrites" in capsys.readouterr().err
    assert cli.main([*given, "--start", "bend"]) == 1 and "name=value" in capsys.readouterr().err


def test_a_material_of_others_is_left_alone(tmp_path):
    from wsim.usd.result.fitted import save_fitted

    scene = sheet()
    scene.cloth("/other", *shapes.sheet(1.0, 1.0, 2, 2), material=scene.cloths[0].material)
    wsim.save(scene, tmp_path / "two.usda")
    before = wsim.load(str(tmp_path / "two.usda"))
    found, _ = parameters_of_names("/sheet:bend", [before])
    save_fitted(before, found[0].written(before, 5e-4), tmp_path / "fitted.usda")
    after = wsim.load(str(tmp_path / "fitted.usda"))
    assert [c.material.bend for c in after.cloths] == [5e-4, 1e-3]


def test_a_file_of_another_mesh_or_without_the_frame_is_refused(files):
    scene = wsim.load(str(files / "sheet.usda"))
    with pytest.raises(SceneError, match="/sheet: has no frame 33"):
        read(files / "seen.usdc", scene, frames=[33])
    coarse = scene.with_objects("Cloth", [replace(scene.cloths[0], points=scene.cloths[0].points[:60])])
    with pytest.raises(SceneError, match="/sheet: has 64 points .* allowed is 60"):
        read(files / "seen.usdc", coarse)
