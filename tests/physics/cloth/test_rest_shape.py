"""Rest shapes and rest lengths: live, as a scene that is built with them; and the gradients of whole runs by them, against
differences of order 8 of runs without gradients."""

from dataclasses import replace

import numpy as np
import pytest

import wsim
from tests.make.fitting.fields import seen
from tests.make.fitting.fields import sheet as field_sheet
from tests.make.gradient.gradients import WEIGHTS, Run, bar, net, sheet
from tests.make.physics.cloth.muscles import muscled
from tests.make.physics.cloth.rest_shape import SOLVERS, by_rest_shape, crooked
from tests.make.physics.solver.xpbd_adjoint import Fresh
from tests.make.simulation.ties import laid
from wsim.fitting import Settings
from wsim.gradient.rest_shape import RestShape, by_masses
from wsim.model.model import make_body
from wsim.physics.cloth.constraints import constraints_of_body
from wsim.physics.cloth.rest_shape import current_rest_shape, masses_of
from wsim.physics.solver import xpbd_adjoint
from wsim.scene import SceneError, shapes
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("model, solver, more", [
    ("membrane", "leapfrog", {}), ("springs", "leapfrog", {}), ("membrane", "xpbd", {}), ("springs", "xpbd", {}),
    ("membrane", "newton", {"integrator": "backward_euler"}), ("springs", "newton", {})])
def test_a_sheet(model, solver, more):
    """Lengths, areas, angles, frames of warp and weft, and masses."""
    newton = solver == "newton"
    by_rest_shape(Run(crooked(model, 0.2 if newton else 1.0, **SOLVERS[solver] | more)), within=2e-9 if newton else 1e-10)


@pytest.mark.parametrize("material, quadratic, solver", [("corotational", False, "leapfrog"), ("neo_hookean", False, "newton"),
                                                         ("corotational", True, "leapfrog"), ("neo_hookean", True, "newton")])
def test_a_bar(material, quadratic, solver):
    scene = bar(material, damping=1e-4, **SOLVERS[solver])
    if quadratic:
        scene.softs[0].quadratic, scene.softs[0].pressure = True, 400.0
        scene.substeps = 160 if solver == "leapfrog" else 2
    by_rest_shape(Run(scene, frames=1 if quadratic else 3), 4e-5)


@pytest.mark.parametrize("make", [net, muscled])
@pytest.mark.parametrize("solver", list(SOLVERS))
def test_a_net(solver, make):
    """Its rest lengths, which are live; and its rest shape, where they are those of the points. Muscles shorten what is set."""
    run = Run(make(**SOLVERS[solver]))
    by_rest_shape(run, 4e-4)
    way, points = np.random.default_rng(8).normal(size=11), run.scene.springs[0].points.astype(float)
    start = np.linalg.norm(np.diff(points, axis=0), axis=1)
    run.check(run.gradient.lengths() @ way, lambda s: ("/chain", "lengths", start + s * way), 2e-4, 1e-10)
    run = Run(make(lengths=start, **SOLVERS[solver]))
    with pytest.raises(SceneError, match="rest lengths of their own, and no rest shape; take lengths"):
        run.gradient.rest_shape()


@pytest.mark.parametrize("limit, tethers", [(0.01, False), (np.inf, True)])
def test_strain_limits_and_tethers(limit, tethers, monkeypatch):
    """They are on and off from sweep to sweep: differences would meet the kinks. Against Warp's own adjoint."""
    scene = crooked("springs", 0.2, **SOLVERS["xpbd"])
    scene.cloths[0].tethers = tethers
    scene.cloths[0].material = replace(scene.cloths[0].material, strain_limit=limit, stretch=4.0, bend=0.0)
    ours = Run(scene, 5)
    monkeypatch.setattr(xpbd_adjoint, "SweepAdjoint", Fresh)
    a, b = ours.gradient.rest_shape(), Run(scene, 5).gradient.rest_shape()
    assert np.abs(a - b).max() < 1e-11 * np.abs(b).max()
    hard = [by for r, by, *_ in ours.gradient.at_rest(ours.sim.model.body(None)) if r.kind in ("limit", "tether")]
    assert len(hard) == 1 and np.abs(hard[0]).max() > 1e-3


def test_what_constraints_are_at_rest():
    """Rest values and shapes of every kind, in NumPy: differences of order 8."""
    pinned = np.array([20, 24])
    for model in ("membrane", "springs"):
        cloth = crooked(model).cloths[0]
        cloth.tethers, cloth.material = True, replace(cloth.material, strain_limit=0.1)
        if model == "springs":                                                   # polygons of four, with diagonals
            cloth.counts, cloth.indices = shapes.sheet(0.2, 0.2, 4, 4, cut="quads")[1:]
        body = make_body(cloth, 0, 0, 0)
        rng, pins = np.random.default_rng(4), body.index[pinned]
        way, rows = rng.normal(size=body.rest.shape), constraints_of_body(body, pins)
        assert {r.kind for r in rows} >= {"dihedral", "limit", "tether", {"membrane": "membrane", "springs": "distance"}[model]}
        for k, r in enumerate(rows):
            by = [rng.normal(size=r.rest.shape), rng.normal(size=len(r.ids)) * (r.shape.any() > 0.0)]
            by += [rng.normal(size=r.coupling.value.shape)] if r.coupling else []

            def loss(s: float, k=k, by=by, body=body, way=way, pins=pins) -> float:
                r = constraints_of_body(replace(body, rest=body.rest + s * way), pins)[k]
                parts = [r.rest, r.shape, *([r.coupling.value] if r.coupling else [])]
                return sum((part * each).sum() for part, each in zip(parts, by, strict=True))
            step = 2e-6 if r.kind in ("tether", "dihedral") else 2e-5
            slope = sum(w * (loss(j * step) - loss(-j * step)) for j, w in enumerate(WEIGHTS, 1)) / step
            shape = RestShape(body)
            shape.rows(r, *by)
            assert (shape.by * way).sum() == pytest.approx(slope, rel=1e-8), (r.kind, r.stiffness)


def test_points_that_bodies_share():
    scene, _, _ = laid(solver="explicit", integrator="leapfrog", substeps=150)
    run = Run(scene, frames=1)
    run.path = "/bar"
    with pytest.raises(SceneError, match="rest_shape changes masses of points that bodies share"):
        run.sim.set("/bar", "rest_shape", 1.01 * scene.softs[0].points)
    for body in scene.bodies():
        body.masses = np.full(len(body.points), 0.01, np.float32)
    run = Run(scene, frames=1)
    run.path = "/bar"
    run.gradient = run.recording.backward({1: {"/blanket": run.x}}, {1: {"/blanket": run.v}})
    start, way, losses = current_rest_shape(run.sim.model.body("/bar")), np.random.default_rng(6).normal(size=(len(
        scene.softs[0].points), 3)), []
    for s in (1e-6, -1e-6):
        sim = Simulation(scene, device="cpu", precision="float64")
        sim.set("/bar", "rest_shape", start + s * way)
        sim.run(1)
        losses.append((sim.positions("/blanket") * run.x).sum() + (sim.velocities("/blanket") * run.v).sum())
    assert (run.gradient.rest_shape("/bar") * way).sum() == pytest.approx((losses[0] - losses[1]) / 2e-6, rel=1e-6)


@pytest.mark.parametrize("change", [{}, {"mass": 2.0}, {"masses": np.linspace(1.0, 2.0, 30)}, {"quadratic": True},
                                    {"quadratic": True, "mass": 2.0}, {"quadratic": True, "masses": np.linspace(1.0, 2.0, 30)},
                                    {"thicknesses": np.linspace(1e-3, 2e-3, 25)},
                                    {"mass": 2.0, "thicknesses": np.full(25, 1e-3)}])
def test_masses_that_follow_a_shape(change):
    """Differences of order 8 of the masses alone."""
    source = crooked("membrane").cloths[0] if "thicknesses" in change else bar("corotational").softs[0]
    body = make_body(replace(source, **change), 0, 0, 0)
    rng, start, n = np.random.default_rng(4), current_rest_shape(body), len(body.own)
    way, by = rng.normal(size=start.shape), rng.normal(size=body.count)

    def loss(s: float) -> float:
        masses = masses_of(body, start + s * way)
        return 0.0 if masses is None else masses @ by
    step = 1e-4
    slope = sum(w * (loss(k * step) - loss(-k * step)) for k, w in enumerate(WEIGHTS, 1)) / step
    found = by_masses(body, by[np.concatenate([body.index, body.middles])], None)
    assert (found * way).sum() == pytest.approx(slope, rel=1e-9, abs=1e-12) and found.shape == (n, 3)
    masses = masses_of(body, start)
    assert masses is None or np.allclose(masses, body.masses, rtol=1e-12)


@pytest.mark.parametrize("make", [lambda: crooked("membrane", **SOLVERS["xpbd"]), lambda: crooked("springs", **SOLVERS["xpbd"]),
                                  lambda: crooked("springs", **SOLVERS["newton"]), lambda: bar("corotational"),
                                  lambda: sheet("membrane", integrator="leapfrog")])
def test_a_live_rest_shape_is_that_of_a_scene_built_with_it(make):
    """In the second of two worlds alone; by so little that the order of points stays."""
    scene = make()
    source = scene.bodies()[0]
    rest = source.points if source.rest_points is None else source.rest_points
    other = make()
    other.bodies()[0].rest_points = (rest * (1.001, 0.999, 1.0) + 1e-3 * rest[:, ::-1] ** 2).astype(np.float32)
    plain = Simulation(other, device="cpu", precision="float64")
    live = Simulation(scene, device="cpu", precision="float64", worlds=2)
    live.run(1)
    live.frame = 0
    for sim in (plain, live):
        sim.set(source.path, "positions", source.points.astype(np.float64), *[1] * (sim is live))
        sim.set(source.path, "velocities", 0.0 * source.points, *[1] * (sim is live))
    live.set(source.path, "rest_shape", other.bodies()[0].rest_points.astype(np.float64) + 3.0, 1)
    for sim in (plain, live):
        sim.run(2)
    assert np.abs(live.positions(world=1) - plain.positions()).max() < 1e-9
    assert np.abs(live.positions() - plain.positions()).max() > 1e-7


@pytest.mark.parametrize("make, name, values", [
    (lambda: sheet("membrane", **SOLVERS["xpbd"]), "rest_shape", lambda p: p * (1.0 + 0.3 * p)),
    (lambda: net(**SOLVERS["xpbd"]), "stiffness", lambda p: np.linspace(20.0, 60.0, 11))])
def test_one_compliance_becomes_many(make, name, values):
    """Where there is one world, XPBD has a kernel for one that all constraints share."""
    sims, path = [Simulation(make(), device="cpu", precision="float64", worlds=n) for n in (1, 2)], make().bodies()[0].path
    assert any(b.uniform for b in sims[0].plan.method("xpbd").batches)
    for sim in sims:
        sim.run(1)
        sim.set(path, name, values(sim.scene.bodies()[0].points.astype(float)))
        sim.run(2)
    assert np.abs(sims[0].positions() - sims[1].positions()).max() < 1e-13


@pytest.mark.filterwarnings("error")
def test_what_cannot_be_a_rest_shape_is_named_and_changes_nothing():
    sim = Simulation(sheet("membrane", integrator="leapfrog"), device="cpu")
    for values, text in [(np.zeros((24, 3)), r"shape \(25, 3\); found \(24, 3\)"), (np.full((25, 3), np.nan), "must be finite"),
                         (np.zeros((25, 3)), "rest_shape: an edge, triangle or tet has no size")]:
        with pytest.raises(SceneError, match=text):
            sim.set("/cloth", "rest_shape", values)
    with pytest.raises(SceneError, match="/cloth: has no live parameter 'lengths', which is of springs; there are stretch"):
        sim.set("/cloth", "lengths", np.ones(56))
    assert sim.changes == []
    solid = Simulation(bar("corotational"), device="cpu")
    with pytest.raises(SceneError, match="inside out"):
        solid.set("/bar", "rest_shape", solid.scene.softs[0].points * (1.0, 1.0, -1.0))


def test_a_fit_finds_a_shape():
    """A sheet that was cut 4 cm wider on one side, from 15 frames with 1 mm of noise: its edges to 0.3 mm."""
    scene, sides = field_sheet("membrane", frames=15), []
    body = Simulation(scene, device="cpu").model.body(None)
    start, truth = current_rest_shape(body), current_rest_shape(body).copy()
    truth[:, 0] += 0.04 * start[:, 0] * (start[:, 2] + 0.5)
    tracks = seen(scene, list(range(1, 16)), 1e-3, 1e-3, sets=[("rest_shape", truth)])
    found = wsim.fit(scene, tracks, "rest_shape[]", settings=Settings(device="cpu"))
    for values in (found.values["rest_shape[]"], truth, start):            # turned or moved, it is the same shape
        places = np.empty((body.count, 3))
        places[body.own - body.first] = values
        sides.append(np.linalg.norm(np.diff(places[body.edges - body.first], axis=1)[:, 0], axis=1))
    away, before = (np.sqrt(np.mean((each - sides[1]) ** 2)) for each in (sides[0], sides[2]))
    assert found.converged and away < 4e-4 < 5e-3 < before
