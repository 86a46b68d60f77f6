"""Muscles: rest lengths that follow a factor over time, against closed forms; gradients by the factors against differences."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import wsim
from tests.make.gradient.gradients import Run, net
from tests.make.physics.cloth.muscles import FACTORS, GROUPS, SOLVERS, TIMES, crawler, muscled
from wsim.cli.fit import _save_fitted_layer
from wsim.fitting import Settings, Track
from wsim.gradient.recording import Recording
from wsim.gradient.rollout.products import Rollout
from wsim.scene import Scene, SceneError
from wsim.scene.check.scene import check_scene
from wsim.scene.curve import Curve
from wsim.simulation.simulation import Simulation
from wsim.usd import save


def pulled(frames: int = 4, **more) -> Scene:
    """A mass on a spring along x whose rest length L grows at a constant rate, without gravity."""
    scene = Scene(**{"fps": 20.0, "frames": frames, "gravity": (0.0, 0.0, 0.0), "solver": "explicit"} | more)
    body = scene.net("/m", [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]], [[0, 1]], [40.0], [0.1],
                     actuation=Curve([0.0, 1.0], np.array([[1.0], [3.0]])))
    scene.pin("/pin", body, [0])
    return scene


@pytest.mark.parametrize("order, settings", [
    (2, {"integrator": "leapfrog"}), (4, {"integrator": "rk4"}), (1, SOLVERS["xpbd"]), (2, SOLVERS["midpoint"]),
    (2, SOLVERS["newton"] | {"iterations": 4}), (3, SOLVERS["sdirk3"] | {"iterations": 4})])
def test_a_mass_on_a_growing_spring_moves_by_the_closed_form(order, settings):
    """m x'' = k (L(t) - x), L = L0 (1 + a t) from rest at L0: x = L0 (1 + a (t - sin(w t) / w))."""
    errors = []
    for substeps in (10, 20):
        sim = Simulation(pulled(**settings | {"substeps": substeps}), device="cpu", precision="float64")
        sim.run(4)
        w, t, L = 20.0, 0.2, 0.1
        energy = 20.0 * (sim.positions()[1, 0] - L * (1.0 + 2.0 * t))**2
        assert sim.report()["error"]["elastic_energy"] == pytest.approx(energy, rel=1e-9)
        errors.append(np.hypot(sim.positions()[1, 0] - L * (1.0 + 2.0 * (t - np.sin(w * t) / w)),
                               (sim.velocities()[1, 0] - 2.0 * L * (1.0 - np.cos(w * t))) / w))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25) and errors[1] < 2e-3


@pytest.mark.parametrize("solver", ["leapfrog", "midpoint", "newton"])
def test_a_factor_that_stays_is_another_rest_length(solver):
    held, short = (net(**SOLVERS[solver]) for _ in range(2))
    lengths = np.full(11, 0.125, np.float32)
    held.springs[0].lengths, short.springs[0].lengths = lengths, 0.75 * lengths
    held.springs[0].actuation = Curve([0.0], np.array([[0.75]]))
    found = []
    for scene in (held, short):
        sim = Simulation(scene, device="cpu", precision="float64")
        sim.run(3)
        found.append((sim.positions(), sim.indicators()["elastic_energy"]))
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-13
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-12)


@pytest.mark.parametrize("solver", SOLVERS)
def test_gradients_by_the_factors(solver):
    run = Run(muscled(**SOLVERS[solver]))
    way = np.random.default_rng(3).normal(size=FACTORS.shape)
    run.check((run.gradient.actuation() * way).sum(), lambda s: ("/chain", "actuation", FACTORS + s * way), 0.01, 1e-10)
    run.material("stiffness", 40.0)
    run.state("positions")
    kept = Run(muscled(**SOLVERS[solver]), keep="checkpoints").gradient.actuation()
    assert np.abs(kept - run.gradient.actuation()).max() < 1e-14


@pytest.mark.parametrize("solver", ["leapfrog", "xpbd", "newton"])
def test_gradients_by_rest_lengths_have_the_factor(solver):
    """L = s L0, so that by L0 it is s times that by L; and the sum over springs of L0 dl/dL0 is s dl/ds."""
    scene, lengths = net(**SOLVERS[solver]), np.linspace(0.09, 0.11, 11).astype(np.float32)
    scene.springs[0].lengths, scene.springs[0].actuation = lengths, Curve([0.0], np.array([[0.9]]))
    gradient = Run(scene).gradient
    assert gradient.lengths() @ lengths.astype(float) == pytest.approx(0.9 * gradient.actuation()[0, 0], rel=1e-12)
    assert np.abs(gradient.lengths()).min() > 0.0


def test_muscles_move_a_soft_body_over_the_ground():
    """By friction alone; light springs tied to a soft body cost it no substeps; gradients through all of it."""
    scene = crawler()
    run, base = Run(scene, frames=6), scene.springs[0].actuation.values
    still = Simulation(scene, device="cpu")
    assert still.plan.clock.substeps == 110
    still.set("/muscles", "actuation", 1.0)
    still.run(6)
    went = run.recording.positions(6, "/block")[:, 0].mean() - run.recording.positions(0, "/block")[:, 0].mean()
    assert abs(went) > 1e-3 > 50.0 * abs(still.positions("/block")[:, 0].mean())
    way = np.random.default_rng(3).normal(size=base.shape)
    run.check((run.gradient.actuation("/muscles") * way).sum(), lambda s: ("/muscles", "actuation", base + s * way), 1e-9, 1e-5)


def test_newtons_method_moves_it_as_far_as_leapfrog():
    """And has the gradients of a tied net, of a body in the air."""
    ways, scene = [], crawler(solver="implicit", substeps=6, contact_width=0.0)
    for made in (crawler(contact_width=0.0, substeps=60),
                 crawler(solver="implicit", substeps=24, iterations=3, contact_width=0.0)):
        sim = Simulation(made, device="cpu", precision="float64")
        sim.run(8)
        ways.append(sim.positions("/block")[:, 0].mean())
    assert ways[1] == pytest.approx(ways[0], rel=0.03) and ways[0] > 0.01
    scene.colliders, base = [], scene.springs[0].actuation.values
    run, way = Run(scene, frames=2), np.random.default_rng(3).normal(size=base.shape)
    run.check((run.gradient.actuation("/muscles") * way).sum(), lambda s: ("/muscles", "actuation", base + s * way), 0.01, 1e-9)


def test_worlds_live_values_reset_and_restart():
    sim = Simulation(muscled(**SOLVERS["leapfrog"]), device="cpu", precision="float64", worlds=2)
    later = Curve(TIMES, 2.0 - FACTORS)
    sim.set("/chain", "actuation", later, world=1)
    sim.run(2)
    other = muscled(**SOLVERS["leapfrog"])
    other.springs[0].actuation = later
    for world, scene in enumerate((muscled(**SOLVERS["leapfrog"]), other)):
        alone = Simulation(scene, device="cpu", precision="float64")
        alone.run(2)
        assert np.array_equal(alone.positions(), sim.positions(world=world))
        half = alone.fields()
        alone.run(2)
        again = Simulation(scene, device="cpu", precision="float64")
        again.restart(2, {"/chain": half})
        again.run(2)
        assert np.array_equal(again.positions(), alone.positions())
    sim.reset()
    sim.run(1)
    assert np.array_equal(sim.positions(world=0), sim.positions(world=1))


@pytest.mark.parametrize("value, words", [
    (0.0, "factors > 0"), (np.ones((4, 3)), "3 groups"), (np.ones((3, 2)), "3 values"), (np.ones(3), "allowed are a Curve"),
    (Curve([0.0], np.ones((1, 5))), "5 groups"), (np.nan, "finite")])
def test_live_values_that_are_none_are_refused(value, words):
    sim = Simulation(muscled(), device="cpu")
    with pytest.raises(SceneError, match=words):
        sim.set("/chain", "actuation", value)


def test_a_net_without_muscles_has_no_actuation():
    sim = Simulation(net(), device="cpu", precision="float64", gradients=True)
    with pytest.raises(SceneError, match="no live parameter 'actuation'"):
        sim.set("/chain", "actuation", 1.0)
    with pytest.raises(SceneError, match="no net has muscles"):
        Recording(sim, 1).backward({1: np.ones((12, 3))}).actuation()
    kernels = wp.get_module(sim.model.module).kernels
    assert sim.plan.method("muscles") is None and not any(k.startswith(("contract", "shares", "release")) for k in kernels)


MISTAKES = {"no curve": ({"actuation": None}, "muscles without an actuation"),
            "too few": ({"muscles": GROUPS[:5].astype(np.int32)}, "5 muscles; allowed: 11"),
            "no group": ({"muscles": (GROUPS + 1).astype(np.int32)}, "muscle group 2"),
            "zero": ({"actuation": Curve(TIMES, FACTORS * [1.0, 0.0])}, "4 of 8 factors of actuation are too small"),
            "nan": ({"actuation": Curve(TIMES, FACTORS * [1.0, np.nan])}, "NaN or infinite")}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_found_by_their_path(mistake):
    scene, (change, words) = muscled(), MISTAKES[mistake]
    scene.springs[0] = replace(scene.springs[0], **change)
    found = [str(p) for p in check_scene(scene) if p.fatal]
    assert found and all("/chain" in p for p in found) and any(words in p for p in found), found


def test_a_group_without_springs_is_warned_of():
    scene = muscled()
    scene.springs[0].muscles = np.minimum(GROUPS, 0).astype(np.int32)
    assert [p.fatal for p in check_scene(scene)] == [False] and "muscle group 1" in check_scene(scene)[0].text


def test_factors_are_an_input_of_a_rollout():
    sim = Simulation(muscled(), device="cpu", precision="float64", gradients=True)
    f = Rollout(Recording(sim, 2), ["/chain:actuation"])
    y, way = f.run(), np.random.default_rng(4).normal(size=FACTORS.shape)
    assert np.array_equal(f.values()["/chain:actuation"], FACTORS)
    along, back = f.jvp({"/chain:actuation": way}), f.vjp(np.ones_like(y))["/chain:actuation"]
    assert (back * way).sum() == pytest.approx(np.sum(along.value), rel=1e-8)


def test_factors_are_found_again_from_a_motion(tmp_path):
    """A field of a fit: factors of two groups at each of their keys that is seen."""
    scene = muscled(frames=4)
    truth, start = scene.springs[0].actuation, Curve(TIMES, np.ones_like(FACTORS))
    sim, seen = Simulation(scene, device="cpu", precision="float64"), []
    sim.run(4, lambda s: seen.append(s.positions()))
    scene.springs[0].actuation = start
    save(scene, tmp_path / "scene.usda")
    found = wsim.fit(wsim.load(tmp_path / "scene.usda"), [Track("/chain", np.arange(1, 5), np.array(seen), sigma=1e-6)],
                     "actuation[free]", settings=Settings(device="cpu", limit=40.0))
    assert found.values["actuation[]"] == pytest.approx(truth.values, abs=2e-3)
    _save_fitted_layer(wsim.load(tmp_path / "scene.usda"), found, str(tmp_path / "fitted.usda"))
    written = wsim.load(tmp_path / "fitted.usda").springs[0].actuation
    assert written.values == pytest.approx(found.values["actuation[]"]) and np.array_equal(written.times, TIMES)
    with pytest.raises(SceneError, match="nothing there has actuation"):
        wsim.fit(net(), [Track("/chain", np.arange(1, 5), np.array(seen))], "actuation[]")
