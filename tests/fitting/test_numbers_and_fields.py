"""Fields from scans and from forces, and numbers among them: gradients against differences, what is found, error bars."""

import json

import numpy as np
import pytest

import wsim
from tests.make.fitting.fields import CPU, QUICK, bar, halves, net, seen, sheet
from tests.make.physics.contact.restitution import ball
from wsim import SceneError, Simulation
from wsim.fitting import Pull, Scan, Settings
from wsim.fitting.fields.misfit import AdjointMisfit
from wsim.fitting.fields.number import numbers_and_fields
from wsim.gradient import checkpoints


def pulled(scene, frames, noise=0.0, sigma=None, sets=()) -> list[Pull]:
    """Of every pin."""
    sim = Simulation(scene, device="cpu", precision="float64")
    for name, values in sets:
        sim.set(scene.bodies()[0].path, name, values)
    found = {p.path: [] for p in scene.pins}
    for frame in frames:
        sim.run(frame - sim.frame)
        for path, each in found.items():
            each.append(sim.reactions(path))
    rng = np.random.default_rng(4)
    return [Pull(path, frames, np.array(f) + noise * rng.normal(size=np.shape(f)), sigma=sigma) for path, f in found.items()]


def scanned(scene, frame, away=2e-3) -> list[Scan]:
    """Around a surface: over triangles, beyond their borders too, in the air beside them."""
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.run(frame)
    body, x = sim.model.body(None), sim.positions()
    rng = np.random.default_rng(8)
    author = np.zeros(sim.model.points, np.int64)
    author[body.index] = np.arange(len(x))
    part = rng.dirichlet(np.ones(3), len(body.triangles))
    places = np.einsum("tki,tk->ti", x[author[body.triangles]], part) + away * rng.normal(size=part.shape)
    border = x[::3] + 20.0 * away * rng.normal(size=x[::3].shape)
    return [Scan(body.path, frame, np.concatenate([places, border]))]


def adjoint(scene, tracks, names) -> tuple[AdjointMisfit, np.ndarray]:
    found, (scene,) = numbers_and_fields(names, [scene], {})
    misfit = AdjointMisfit([(scene, tracks)], found, "cpu")
    misfit.set_beliefs(misfit.start)
    return misfit, misfit.theta(misfit.start)


# gradients

@pytest.mark.parametrize("make, observe, names", [
    (lambda: bar((3, 1, 1), **QUICK), scanned, ["young[]"]), (lambda: sheet("membrane"), scanned, ["velocities[]"]),
    (lambda: bar((3, 1, 1), **QUICK), lambda s, f: pulled(s, [f - 1, f]), ["young[]"]),
    (lambda: net(), lambda s, f: pulled(s, [f - 1, f]), ["stiffness[]", "gravity", "air_drag"]),
    (lambda: bar((3, 1, 1), **QUICK), lambda s, f: seen(s, [f]) + pulled(s, [f]), ["density", "poisson", "young[]"]),
    (lambda: sheet("membrane", weft=80.0), lambda s, f: seen(s, [f]), ["stretch", "damping", "density", "bend[]"]),
    (lambda: sheet("membrane", weft=80.0), lambda s, f: seen(s, [f]), ["stretch_weft", "stretch_warp", "velocities[]"]),
    (lambda: net(solver="xpbd", iterations=3), lambda s, f: seen(s, [f]), ["stiffness", "velocities[]"]),
    (lambda: net(solver="xpbd", iterations=3), lambda s, f: pulled(s, [f - 1, f]), ["stiffness[]", "gravity", "air_drag"]),
    (lambda: sheet("membrane", weft=80.0, solver="xpbd", iterations=3), lambda s, f: pulled(s, [f - 1, f]),
     ["density", "damping", "weft[]", "shear[]"])])
def test_the_gradient_of_the_misfit_is_that_of_differences(make, observe, names):
    """Along a random direction, about random values; differences of order 4 of the misfit itself."""
    scene = make()
    if "air_drag" in names:
        scene.air_drag = 0.5
    if "damping" in names:
        scene.cloths[0].material = wsim.Fabric(stretch=50.0, shear=30.0, bend=1e-2, density=200.0, weft=80.0, damping=1e-3)
    misfit, start = adjoint(scene, observe(scene, scene.frames), names)
    rng = np.random.default_rng(3)
    theta, way = start + 0.05 * rng.normal(size=start.shape), rng.normal(size=start.shape)
    _, slope = misfit.look(theta)
    h = 1e-4 if observe is scanned else 1e-3
    value = {k: misfit.look(theta + k * h * way, slope=False)[0][0] for k in (-2, -1, 1, 2)}
    expected = (8.0 * (value[1] - value[-1]) - value[2] + value[-2]) / (12.0 * h)
    assert abs(expected) > 1e-9 and slope[0] @ way == pytest.approx(expected, rel=1e-6)
    eye = np.eye(len(theta))[: len(misfit.fields)]                 # and along each number
    for k, f in enumerate(misfit.fields):
        if f.belief == "free":
            value = {j: misfit.look(theta + j * h * eye[k], slope=False)[0][0] for j in (-2, -1, 1, 2)}
            expected = (8.0 * (value[1] - value[-1]) - value[2] + value[-2]) / (12.0 * h)
            assert slope[0][k] == pytest.approx(expected, rel=1e-5, abs=1e-9 * abs(slope[0]).max()), f.name


def test_friction_and_restitution_of_a_collider_among_fields():
    """A ball that slides over a floor and bounces on it; steps within which the order of contacts stays."""
    scene = ball(e=0.7, height=0.05, v=(1.5, 0.0, 0.0), solver="xpbd", integrator="backward_euler", frames=12)
    scene.colliders[0].dynamic_friction = scene.colliders[0].static_friction = 0.3
    misfit, theta = adjoint(scene, seen(scene, [10, 12]), ["dynamic_friction", "restitution", "velocities[]"])
    theta[:2] += 0.05
    _, slope = misfit.look(theta)
    for k in range(2):
        way = 1e-6 * np.eye(len(theta))[k]
        ends = [misfit.look(theta + s * way, slope=False)[0][0] for s in (1.0, -1.0)]
        assert slope[0][k] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-5) and slope[0][k] != 0.0


def test_products_with_the_hessian_of_what_was_seen_are_those_of_the_jacobian():
    scene = net()
    misfit, theta = adjoint(scene, seen(scene, [5, 6]), ["gravity_y", "stiffness[]"])
    J = []
    for k in range(3):
        way = 1e-4 * np.eye(len(theta))[k]
        ends = [np.concatenate([np.concatenate(e.residuals(f)) for e, f in misfit.begun(theta + s * way)]) for s in (1.0, -1.0)]
        J.append((ends[0] - ends[1]) / 2e-4)
    found = misfit.gauss_newton(theta, np.eye(len(theta))[0])
    assert found[:3] == pytest.approx(np.array(J) @ J[0], rel=1e-5)


# what is found

def test_a_stiffness_field_is_found_from_scans_without_correspondence():
    """The bent bar of two halves by its surface: one point on each triangle, to 0.1 mm, no one says which."""
    scene = bar((4, 2, 2))
    sim = Simulation(scene, device="cpu", precision="float64")
    sim.set("/bar", "young", halves(scene))
    sim.run(8)
    x, rng = sim.positions(), np.random.default_rng(1)
    scan = Scan("/bar", 8, x, sigma=1e-4)
    scan.prepare(sim.model)
    part = rng.dirichlet(np.ones(3), len(scan.triangles))
    scan.points = np.einsum("tki,tk->ti", x[scan.triangles], part) + 1e-4 * rng.normal(size=part.shape)
    found = wsim.fit(scene, [scan], "young[tv]", settings=CPU)
    truth = halves(scene)
    away = np.log(found.values["young[]"] / truth)
    assert found.converged and 0.6 < found.misfit < 1.2
    assert [float(np.sqrt(np.mean(away[half]**2))) < 0.12 for half in (truth < 1e5, truth > 1e5)] == [True, True]


@pytest.fixture(scope="module")
def hung():
    """The bar of two halves, 1.1 times as dense as the scene says, at rest: where it is, and what the wall bears."""
    scene = bar((4, 2, 2))
    sets = [("young", halves(scene)), ("density", 1.1e3)]
    return scene, seen(scene, [4, 8], 1e-4, 1e-4, sets=sets), pulled(scene, [4, 8], 0.3, 0.3, sets)


def test_a_number_and_a_field_are_found_together(hung):
    """The shape alone tells ratios of stiffness to density, and the fit says so; with the wall's force both come out."""
    scene, tracks, forces = hung
    found = wsim.fit(scene, tracks + forces, "density,young[tv]", settings=CPU)
    truth = halves(scene)
    assert found.converged and found.unit == "sigma"
    assert 0.0 < found.errors["density"] < 10.0 and abs(found.values["density"][0] - 1100.0) < 3.5 * found.errors["density"]
    away = np.log(found.values["young[]"] / truth)
    assert [float(np.sqrt(np.mean(away[half]**2))) < 0.08 for half in (truth < 1e5, truth > 1e5)] == [True, True]
    assert found.scene.softs[0].material.density == pytest.approx(1100.0, rel=0.02)
    assert "density  1" in found.text() and "error bar" in found.text()
    said = json.loads(json.dumps(found.as_dict()))
    assert said["parameters"][0]["name"] == "density" and len(said["fields"]) == 1
    alone = wsim.fit(scene, tracks, "density,young[tv]", settings=Settings(device="cpu", limit=8.0))
    assert alone.errors["density"] == np.inf and "not identifiable" in alone.text()


def test_a_field_and_a_density_are_found_by_sweeps():
    """A swinging sheet by XPBD, three times as stiff in the half away from its two pins: where it is, and what they bear."""
    scene = sheet("membrane", solver="xpbd", substeps=4, iterations=6, frames=8)
    body = Simulation(scene, device="cpu").model.body(None)
    x = np.empty((body.count, 3))
    x[body.index - body.first] = scene.cloths[0].points
    truth = np.where(x[body.triangles - body.first].mean(axis=1)[:, 2] < 0.0, 30.0, 90.0)
    sets = [("stretch", truth), ("density", 220.0)]
    observed = seen(scene, [4, 6, 8], 8e-5, 8e-5, sets=sets) + pulled(scene, [4, 6, 8], 0.015, 0.015, sets)
    found = wsim.fit(scene, observed, "density,stretch[tv]", settings=CPU)
    assert found.converged and found.unit == "sigma" and 0.8 < found.misfit < 1.2
    assert abs(found.values["density"][0] - 220.0) < 3.5 * found.errors["density"] < 10.0
    away = np.log(found.values["stretch[]"] / truth)
    assert [float(np.sqrt(np.mean(away[half]**2))) < 0.08 for half in (truth < 50.0, truth > 50.0)] == [True, True]
    alone = wsim.fit(scene, pulled(scene, range(1, 9), 1e-3, 1e-3, sets[:1]), "stretch[tv]", settings=CPU)
    assert alone.converged and 0.8 < alone.misfit < 1.2              # near the pins; what is away from them is not seen
    assert np.abs(np.log(alone.values["stretch[]"] / truth))[x[body.triangles].mean(axis=1)[:, 2] < -0.3].max() < 0.15


def test_a_prior_of_a_number_counts(hung):
    scene, tracks, _ = hung
    found = wsim.fit(scene, tracks, "density,young[tv]", priors={"density": (1100.0, 0.05)}, start={"density": 1050.0},
                     settings=Settings(device="cpu", limit=20.0))
    assert found.errors["density"] == pytest.approx(55.0, rel=0.1) and abs(found.values["density"][0] - 1100.0) < 110.0


def test_what_cannot_be_recorded_is_not_put_down_to_the_start(monkeypatch):
    scene = sheet("membrane", solver="xpbd", iterations=3)
    forces = pulled(scene, [6])
    scene.cloths[0].tethers = True
    with pytest.raises(SceneError, match="/sheet: has tethers or a strain limit, which pull at pins without a law"):
        wsim.fit(scene, forces, "stretch[]", settings=CPU)
    monkeypatch.setattr(checkpoints, "free_bytes", lambda device: 1e4)
    with pytest.raises(SceneError, match="memory: recording .* frames of 20 substeps keeps"):
        wsim.fit(net(), seen(net(), [6]), "stiffness[]", settings=CPU)
