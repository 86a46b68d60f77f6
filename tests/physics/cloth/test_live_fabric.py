"""Poisson's ratio of a membrane and the strain limit of a cloth: live, as in a scene that is built with them; and gradients by
them, of the cloth and of each element, in float64 against differences of order 8. Steps and schemes stand with each test."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.gradient.gradients import Run, sheet
from tests.make.gradient.reaction_adjoint import Run as Borne
from tests.make.physics.cloth.rest_shape import SOLVERS
from tests.make.physics.solver.newton_adjoint_limits import pulled
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.scene import Scene, SceneError
from wsim.simulation.simulation import Simulation

BACKWARD = {"integrator": "backward_euler"}
LIMITED: dict = {"xpbd": {"solver": "xpbd", "integrator": "backward_euler", "substeps": 4, "iterations": 2},
                 "leapfrog": {"solver": "explicit", "integrator": "leapfrog", "substeps": 20},
                 "newton": {"integrator": "bdf2"}}


def of(scene: Scene, **material) -> Scene:
    """The same with another material."""
    scene.cloths[0].material = replace(scene.cloths[0].material, **material)
    return scene


def membrane(solver: str, poisson: float, **more) -> Scene:
    return of(sheet("membrane", damping=2e-4, **SOLVERS[solver] | more), poisson=poisson)


def limited(solver: str, limit: float, model: str = "springs") -> Scene:
    """A soft sheet that falls and is pulled away from two pins: its limits move it by millimetres."""
    more = dict(LIMITED[solver])
    return of(pulled(more.pop("integrator"), "limit", model, **more), strain_limit=limit)


def check(run: Run, name: str, step: float, within: float) -> None:
    """By the value of the cloth, and along a random direction of one of each element."""
    value, each = getattr(run.scene.cloths[0].material, name), run.gradient.material(name, elements=True)
    way = np.random.default_rng(7).normal(size=each.shape)
    run.check(run.gradient.material(name), lambda s: ("/cloth", name, value + s), step, within)
    run.check(each @ way, lambda s: ("/cloth", name, value + s * way), step, within)
    assert each.sum() == pytest.approx(run.gradient.material(name), rel=1e-12)


@pytest.mark.parametrize("solver, more, nu, weft", [
    *((solver, {}, nu, weft) for solver in ("leapfrog", "xpbd", "newton") for nu, weft in ((0.2, 25.0), (0.0, 0.0))),
    ("rk4", {}, -0.4, 25.0), ("xpbd", {}, -0.4, 25.0), ("newton", BACKWARD, -0.4, 25.0)])
def test_by_poisson_s_ratio(solver, more, nu, weft):
    """3 frames of 50 (RK4 50, XPBD 8 of 4 iterations, Newton 2) substeps; steps of 1e-3. At 0 the entry uv of the compliance is
    0, and is what depends on it; a weft of 0 follows stretch."""
    run = Run(of(membrane(solver, nu, **more), weft=weft))
    check(run, "poisson", 1e-3, 2e-9 if solver == "newton" else 1e-9)


@pytest.mark.parametrize("solver", ["leapfrog", "xpbd", "newton"])
def test_what_a_pin_bears_by_poisson_s_ratio(solver):
    """As above: what a pin bears is a law of the material beside the steps."""
    check(Borne(membrane(solver, 0.0)), "poisson", 1e-3, 5e-9)


@pytest.mark.parametrize("solver", list(LIMITED))
@pytest.mark.parametrize("model", ["springs", "membrane"])
def test_by_a_strain_limit(solver, model):
    """2 frames of 4 substeps of 2 iterations (leapfrog 20, Newton 2 of BDF2); steps of 2e-6, so that what pulls goes on
    pulling: at least every eighth edge does, and those that never do have a derivative of 0. Leapfrog meets a kink within
    1e-6, and of steps of 5e-7 rounding leaves 2e-8."""
    run, free = Run(limited(solver, 0.01, model), 2), Run(limited(solver, 10.0, model), 2)
    assert np.abs(run.recording.positions(2) - free.recording.positions(2)).max() > 1e-3
    each = run.gradient.material("strain_limit", elements=True)
    assert (each != 0.0).sum() >= len(each) // 8 and not free.gradient.material("strain_limit", elements=True).any()
    check(run, "strain_limit", *((5e-7, 5e-8) if solver == "leapfrog" else (2e-6, 5e-9)))


@pytest.mark.parametrize("name, values, make", [
    *(("poisson", (0.1, 0.4), lambda nu, s=s: membrane(s, nu)) for s in SOLVERS),
    *(("strain_limit", (0.02, 0.006), lambda e, s=s: limited(s, e)) for s in LIMITED)])
def test_a_live_value_is_that_of_a_scene_built_with_it(name, values, make):
    """To the last bit; in the second of two worlds alone."""
    live = Simulation(make(values[0]), device="cpu", precision="float64", worlds=2)
    live.set("/cloth", name, values[1], 1)
    live.run(2)
    for world, value in enumerate(values):
        plain = Simulation(make(value), device="cpu", precision="float64", worlds=2)
        plain.run(2)
        assert np.array_equal(live.positions(world=world), plain.positions(world=world))
    assert np.abs(live.positions(world=1) - live.positions()).max() > 1e-6


@pytest.mark.parametrize("solver", ["xpbd", "newton"])
def test_limits_of_a_new_rest_shape_are_live_ones(solver):
    """Set before it or after it; and so are the gradients by it."""
    found, rest = [], limited(solver, 0.01).cloths[0].rest_points.astype(float) * (1.002, 0.997, 1.0)
    for limit, changes in [(0.004, ["rest_shape"]), (0.01, ["rest_shape", "strain_limit"]),
                           (0.01, ["strain_limit", "rest_shape"])]:
        sim = Simulation(limited(solver, limit), device="cpu", precision="float64", gradients=True)
        for name in changes:
            sim.set("/cloth", name, rest if name == "rest_shape" else 0.004)
        recording = Recording(sim, 2)
        gradient = recording.backward({2: np.random.default_rng(5).normal(size=(25, 3))})
        found.append((recording.positions(2), gradient.rest_shape(), gradient.material("strain_limit", elements=True)))
    assert all(np.array_equal(a, b) for other in found[1:] for a, b in zip(found[0], other, strict=True))
    free = Recording(Simulation(limited(solver, 10.0), device="cpu", precision="float64", gradients=True), 2)
    assert np.abs(found[0][0] - free.positions(2)).max() > 1e-3


def test_what_would_change_the_constraints_or_cannot_be_is_named_and_changes_nothing():
    for solver in LIMITED:
        sim, bare = (Simulation(limited(solver, limit), device="cpu") for limit in (0.01, np.inf))
        for value, text in [(np.inf, "/cloth: strain_limit is inf; allowed is a finite number >= 0 .* another Simulation"),
                            (-0.1, "strain_limit is -0.1; allowed is a finite"), (np.nan, "strain_limit is nan; allowed")]:
            with pytest.raises(SceneError, match=text):
                sim.set("/cloth", "strain_limit", value)
        with pytest.raises(SceneError, match="/cloth: strain_limit is inf, so that no edge has a limit.*another Simulation"):
            bare.set("/cloth", "strain_limit", 0.01)
        assert sim.changes == bare.changes == []
    for solver in SOLVERS:
        sim = Simulation(membrane(solver, 0.2), device="cpu")
        for value in (0.5, -1.0, np.nan, np.array([0.2, 0.7])):
            with pytest.raises(SceneError, match=r"/cloth: poisson is (0.5|-1|nan|0.7); allowed is > -1 and < 0.5"):
                sim.set("/cloth", "poisson", value)
        assert sim.changes == []
    with pytest.raises(SceneError, match="/cloth: has no live parameter 'poisson': the model 'springs' has none; there are"):
        Simulation(sheet("springs"), device="cpu").set("/cloth", "poisson", 0.1)


def test_explicit_steps_follow_a_poisson_s_ratio_that_stiffens():
    """The sheet is 1 / (1 - nu^2) times as stiff: at 0.49 it needs the substeps of a scene that is built with it."""
    sim, stiff = (Simulation(membrane("leapfrog", nu, substeps=1, integrator="auto"), device="cpu") for nu in (0.0, 0.49))
    substeps = [s.plan.clock.substeps for s in (sim, stiff)]
    sim.set("/cloth", "poisson", 0.49)
    assert sim.plan.clock.substeps == substeps[1] > substeps[0] and "poisson was set" in sim.warnings[-1]
    sim = Simulation(membrane("leapfrog", 0.0, substeps=substeps[0]), device="cpu", gradients=True)
    rollout = Rollout(Recording(sim, 1), ["/cloth:poisson"])
    with pytest.raises(SceneError, match=f"found {substeps[0]}; these values want {substeps[1]}"):
        rollout.run({"/cloth:poisson": 0.49})


@pytest.mark.parametrize("name, make", [("poisson", lambda: membrane("newton", 0.2)),
                                        ("strain_limit", lambda: limited("xpbd", 0.01))])
@pytest.mark.parametrize("each", [False, True])
def test_as_an_input_of_a_rollout(name, make, each):
    """After another value was written, one or one for each element: J^T s is exact, J d is extrapolated."""
    sim = Simulation(make(), device="cpu", precision="float64", gradients=True)
    key, other, rng = f"/cloth:{name}", "/cloth:stretch", np.random.default_rng(5)
    rollout = Rollout(Recording(sim, 2), [key, other], [2])
    before, value = rollout.run(), rollout.values()[key]
    assert value == getattr(sim.scene.cloths[0].material, name)
    many = rollout.recording.backward({2: np.zeros((25, 3))}).material(name, elements=True).shape
    new = value * (1.1 + 0.1 * rng.random(many if each else ()))
    s, d = rng.normal(size=before.shape), {key: rng.normal(size=new.shape), other: 0.2}
    assert np.abs(rollout.run({key: new}) - before).max() > 1e-5 and np.array_equal(rollout.values()[key], new)
    product, by = rollout.jvp(d, 1e-6), rollout.vjp(s)
    assert by[key].shape == new.shape
    assert sum((by[k] * way).sum() for k, way in d.items()) == pytest.approx((product.value * s).sum(), rel=1e-6)
