"""Gradients of fluids, float64, against central differences: every value, fields, both projections, through obstacles."""

from functools import cache

import numpy as np
import pytest

from tests.make.gradient.fluids import FRAMES, air, compared, deep, loss, one, recorded, stirred, weights
from wsim.gradient.inputs.by_name import inputs_by_name
from wsim.gradient.recording import Recording
from wsim.physics.fluid.objects import Fluid, Source
from wsim.scene import Scene, SceneError, Sphere
from wsim.scene.curve import Curve, Motion
from wsim.scene.values.coverage import differentiable_row
from wsim.simulation.simulation import Simulation

NUMBERS = ("lift", "weight", "vorticity", "viscosity", "smoke_decay", "cooling", "side_velocities", "velocity", "smoke",
           "temperature", "acceleration")
SOURCE = ("smoke", "temperature", "expansion", "velocity", "place", "strength")
ALL = [*(f"/air:{name}" for name in NUMBERS), *(f"/fire:{name}" for name in SOURCE), "/held:temperature", "/held:place",
       "/held:strength", "gravity", "wind"]


def slow_but(names: list[str], *fast: str) -> list:
    """Rows, of which all but these are slow."""
    return [name if name in fast else pytest.param(name, marks=pytest.mark.slow) for name in names]


def calm(**more) -> Scene:
    """Air that goes round, with a source that holds nothing: so nothing is constant along an axis."""
    scene = air(**{"n": (12, 8, 1), "sides": ("periodic",) * 6, "vorticity": 0.0, "viscosity": 0.0} | more)
    del scene.objects["Source"][1]
    scene.objects["Source"][0].velocity = None
    return scene


@pytest.mark.parametrize("name", slow_but(ALL, "/air:velocity", "/air:viscosity", "/fire:place", "/fire:strength", "wind"))
def test_every_value_has_the_slope_of_differences(name):
    compared(*one(stirred), name)


@pytest.mark.parametrize("name", slow_but(["/air:velocity", "/air:smoke", "/air:temperature", "/air:weight", "/fire:place",
                                  "/fire:strength", "gravity"], "/fire:place"))
@pytest.mark.parametrize("scheme", slow_but(["maccormack", "bfecc", "linear"], "maccormack"))
def test_schemes_that_carry_there_and_back(scheme, name):
    compared(*one(calm, advection=scheme, scalar_advection=scheme), name)


@pytest.mark.parametrize("name", ["/air:velocity", "/air:smoke", "/air:viscosity", "/air:vorticity", "/air:side_velocities",
                                  "/air:acceleration", "/fire:place", "/fire:velocity", "/fire:strength", "/held:place",
                                  "gravity"])
@pytest.mark.slow
def test_in_three_dimensions(name):
    compared(*one(deep), name)


def plume(frames: int = 25, **more) -> Scene:
    """A source under a ball in the open, two steps a frame."""
    x, y, _ = np.moveaxis((np.stack(np.meshgrid(*map(np.arange, (16, 20, 1)), indexing="ij"), -1) + 0.5) * 0.05, -1, 0)
    velocity = np.stack([0.06 * np.sin(3.0 * y + x), 0.1 + 0.05 * np.cos(2.0 * x + 0.7 * y), 0.0 * x], -1)
    scene = Scene(fps=24.0, frames=frames, gravity=(0.0, -9.81, 0.0))
    scene.add(Fluid("/air", (0.0, 0.0, 0.0), (0.8, 1.0, 0.05), 0.05, steps=2, tolerance=1e-13, velocity=velocity,
                    smoke=0.5 + 0.3 * np.sin(4.0 * x + 1.3 * y), temperature=1.0 + np.cos(3.0 * x - 2.2 * y + 0.4), **more))
    scene.add(Source("/fire", Sphere(0.13), Motion.at_place((0.37, 0.21, 0.025)), smoke=2.0, temperature=60.0,
                     strength=Curve(np.array([0.0, 0.31, 0.78]), np.array([1.0, 0.5, 1.2]))))
    scene.collider("/ball", Sphere(0.12), at=(0.43, 0.55, 0.025))
    return scene


@pytest.mark.parametrize("name", ["/fire:place", "/fire:strength", "/fire:temperature", "/air:lift", "/air:velocity"])
@pytest.mark.slow
def test_fifty_steps_round_an_obstacle(name):
    compared(*fifty(), name)


@cache
def fifty() -> tuple[Recording, dict]:
    r = recorded(plume(), 25)
    return r, weights(r, (25,))


def test_checkpoints_give_the_same_bits_in_less_memory():
    r, less = recorded(plume(9), 9), recorded(plume(9), 9, keep="checkpoints")
    by = weights(r, (4, 9))
    assert less.checkpoints and less.bytes < 0.6 * r.bytes
    whole, parts = r.backward(fluids=by), less.backward(fluids=by)
    for path, name in (("/fire", "place"), ("/fire", "strength"), ("/air", "velocity"), ("/air", "lift")):
        assert np.array_equal(whole.value(path, name), parts.value(path, name))


def test_a_recorded_run_is_the_plain_one_to_the_bit():
    r, plain = recorded(stirred()), Simulation(stirred(), device="cpu", precision="float64")
    r.run()
    for _ in range(FRAMES):
        plain.step()
    now, then = (sim.plan.method("fluid").arrays(0) for sim in (r.sim, plain))
    assert all(np.array_equal(now[name], then[name]) for name in then)


def test_the_adjoint_solve_meets_the_tolerance_and_says_so():
    r, by = one(stirred)
    r.backward(fluids=by)
    assert 0.0 < r.residuals["pressure adjoint"] < 1e-13


def test_worlds_are_apart():
    r = recorded(plume(2), 2, worlds=2)
    found = r.backward(fluids={2: {("/air", 1): {"smoke": np.ones((16, 20, 1))}}})
    assert found.value("/fire", "smoke", 1) > 0.0 and found.value("/fire", "smoke", 0) == 0.0
    assert np.any(found.value("/air", "velocity", 1)) and not np.any(found.value("/air", "velocity", 0))


def test_what_says_how_a_fluid_is_solved_is_refused_with_its_reason():
    for name in ("cell", "density", "tolerance", "cfl"):
        with pytest.raises(SceneError, match=f"has no derivative with respect to {name}: it says how a fluid is solved"):
            differentiable_row(air(), "/air", name)


def test_a_value_of_which_nothing_runs_is_refused():
    r = recorded(plume(2), 2)
    by = {2: {"/air": {"smoke": np.ones((16, 20, 1))}}}
    for name, why in (("/air:viscosity", "it is 0 at the start"), ("/fire:velocity", "it leaves the air alone"),
                      ("/fire:expansion", "it is 0 of all sources")):
        with pytest.raises(SceneError, match=f"nothing of its .* runs: {why}"):
            inputs_by_name(r, [name])
        with pytest.raises(SceneError, match=why):
            r.backward(fluids=by).value(*name.split(":"))


def test_losses_of_fields_that_there_are_not_are_refused():
    r = recorded(plume(2), 2)
    for given, said in (({5: {"/air": {}}}, "found frame 5"), ({1: {"/other": {}}}, "is no fluid"),
                        ({1: {"/air": {"pressure": 0.0}}}, "has no field 'pressure'"),
                        ({1: {"/air": {"smoke": np.ones(3)}}}, "must be finite with shape")):
        with pytest.raises(SceneError, match=said):
            r.backward(fluids=given)


@pytest.mark.slow
def test_a_source_over_time_makes_the_plume_that_is_wanted():
    """The strengths of a source at five keys are found that make the smoke of two frames that another course of them made."""
    minimize = pytest.importorskip("scipy.optimize").minimize
    keys, frames = np.linspace(0.0, 9 / 24.0, 5), (5, 9)
    wanted = np.array([0.4, 1.3, 0.2, 1.1, 0.7])
    scene = plume(9, viscosity=0.0)
    scene.objects["Source"][0].strength = Curve(keys, np.ones(5))
    r = recorded(scene, 9)
    (strength,) = inputs_by_name(r, ["/fire:strength"]).values()
    strength.write_value(wanted)
    r.run()
    seen = {f: r.fluid(f, "/air")["smoke"] for f in frames}

    def misfit(s: np.ndarray) -> tuple[float, np.ndarray]:
        strength.write_value(s)
        r.run()
        off = {f: r.fluid(f, "/air")["smoke"] - seen[f] for f in frames}
        found = r.backward(fluids={f: {"/air": {"smoke": each}} for f, each in off.items()})
        return 0.5 * sum(float((each**2).sum()) for each in off.values()), found.value("/fire", "strength")
    first = misfit(np.ones(5))[0]
    found = minimize(misfit, np.ones(5), jac=True, method="L-BFGS-B", options={"maxiter": 60, "ftol": 1e-16, "gtol": 1e-12})
    assert found.fun < 1e-8 * first and np.allclose(found.x, wanted, atol=1e-3)


def turning(rate: float = 3.0) -> Scene:
    """A ball that turns about its own axis in a sealed box: its openings stay, and its surface goes round."""
    scene = air(sides=("closed",) * 6, side_velocities=np.zeros((6, 3)), frames=2)
    for source in scene.objects["Source"]:
        source.expansion = 0.0
    times = np.arange(3) / 24.0
    c, s = np.cos(rate * times), np.sin(rate * times)
    M = np.tile(np.eye(4), (3, 1, 1))
    M[:, 0, 0], M[:, 0, 1], M[:, 1, 0], M[:, 1, 1], M[:, :3, 3] = c, -s, s, c, (0.6, 0.75, 0.05)
    scene.collider("/ball", Sphere(0.16), motion=Motion(times, M))
    return scene


@pytest.mark.slow
def test_by_the_turning_of_an_obstacle():
    r = recorded(turning(), 2)
    by, losses, step = weights(r, (1, 2)), [], 1e-5
    found = r.backward(fluids=by).value("/ball", "surface")
    for k in (-1, 1):
        losses.append(loss(recorded(turning(3.0 + k * step), 2), by))
    expected = (losses[1] - losses[0]) / (2.0 * step)
    assert found.shape == (2, 2, 3) and abs(expected) > 1e-3
    noise = 4e-16 * sum(map(abs, losses)) / step
    assert found[:, 1, 2].sum() == pytest.approx(expected, rel=1e-8, abs=noise) and noise < 1e-6 * abs(expected)


def test_values_of_sources_and_sides_are_set_while_a_scene_runs():
    sim = Simulation(plume(2), device="cpu", precision="float64")
    for path, name, wrong, said in (("/fire", "strength", [1.0, 2.0], "one finite number, or 3, one a key"),
                                    ("/fire", "strength", np.nan, "one finite number"), ("/fire", "place", 1.0, "three finite"),
                                    ("/air", "side_velocities", np.zeros(3), r"allowed are finite numbers \(6, 3\)")):
        with pytest.raises(SceneError, match=said):
            sim.set(path, name, wrong)
    sim.set("/fire", "strength", [0.0, 0.0, 0.0])
    sim.set("/air", "side_velocities", np.zeros((6, 3)))
    sim.step()
    sources = sim.plan.method("fluid").domains[0].sources
    assert not sources.table.strength.numpy().any()
    sim.set("/fire", "strength", 0.5)
    sim.set("/fire", "place", (0.3, 0.2, 0.025))
    sim.step()
    assert (sources.table.strength.numpy() == 0.5).all()
    assert sources.shapes.rows.pose.numpy()[0, 0, :3] == pytest.approx((0.3, 0.2, 0.025), rel=1e-15)
