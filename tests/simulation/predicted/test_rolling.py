"""Facets that pass below what rolls: counts and rates by closed form, the substeps that they take, and what a run says."""

import numpy as np
import pytest

from tools.bench.rigid.answers import coin, prism
from tools.bench.rigid.answers.shapes import prism as sided
from tools.bench.rigid.answers.stage import Stage, turned
from wsim.kernels.rigid import checks
from wsim.kernels.rigid.narrow import rolling as kernels
from wsim.scene import Cylinder, Plane
from wsim.scene.bodies import DefaultCount
from wsim.simulation.predicted import rolling
from wsim.simulation.predicted.sag import need_of_rigid_bodies
from wsim.simulation.simulation import Simulation

Z, X = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def test_the_bounds_are_those_of_the_device():
    assert (rolling.MANY, rolling.SAMPLES, rolling.SAME) == (checks.MANY, kernels.SAMPLES, kernels.SAME)


@pytest.mark.parametrize("sides", [8, 12, 64])
def test_a_prism_has_as_many_facets_as_sides_about_its_axis_and_four_across(sides):
    points = sided(sides, 0.3, 0.1).points
    assert rolling.facets_in_one_turn(points, Z, X) == sides and rolling.facets_in_one_turn(points, turned((1.0, 2.0, 0.0),
                                                                                                           1.0) @ Z, X) >= sides
    assert rolling.facets_in_one_turn(points, X, Z) <= 6


@pytest.mark.parametrize("name", coin.COINS)
def test_the_rim_of_a_coin_goes_round_as_it_precesses(name):
    s = coin.steady(*coin.COINS[name])
    slope = np.hypot(s["e3"][0], s["e3"][1])                        # sine of the lean: e = (-cos, 0, sin) turns about z
    assert rolling.rim_rate(s["e3"], s["w"], -Z) == pytest.approx(s["W"] * np.sqrt(1.0 - slope**2), rel=1e-3)
    assert rolling.rim_rate(X, 20.0 * X, -Z) == 0.0                                         # a wheel that rolls straight on


def stage(substeps, spin: float = 5.0 / 0.3, above: float = 0.0, lean: float = 0.0) -> Stage:
    made, r = Stage(24.0, substeps, lean=lean, turn=turned((1.0, 2.0, 3.0), 40.0)), prism.R
    made.collider("/floor", Plane())
    made.body("/prism", sided(64, r, 0.1), (0.0, 0.0, r * np.cos(np.pi / 64) + above), prism.on_side(64), (r * spin, 0.0, 0.0),
              (0.0, spin, 0.0))
    return made


def passed(sim: Simulation) -> float:
    return sim.plan.ports.balance.figures.rolling.passed()[0]


def test_a_prism_that_rolls_takes_four_substeps_a_facet_and_says_so():
    """64 facets x 5 m/s / (2 pi 0.3 m) = 170 a second, 0.707 in a substep at 24 x 10."""
    want = 64 * 5.0 / (2.0 * np.pi * 0.3)
    found = need_of_rigid_bodies(stage(DefaultCount(10)).scene)
    assert found.roll.rate == pytest.approx(want, rel=1e-6) and found.substeps(24.0) == np.ceil(want / 24.0 / rolling.FEW)
    sim = Simulation(stage(DefaultCount(10)).scene, device="cpu")
    assert sim.plan.clock.steps == 29 and "facets" in sim.report(profile=False)["raised"]
    few = Simulation(stage(10).scene, device="cpu")
    few.run(8)
    said = [w for w in few.warnings if "facets" in w]
    assert few.plan.clock.steps == 10 and len(said) == 1 and "--substeps 29" in said[0]
    assert passed(few) == pytest.approx(0.70, abs=0.03)                                    # the device counts alike


@pytest.mark.parametrize("more", [{"spin": 0.0}, {"above": 3.0, "spin": 50.0}])
def test_what_lies_still_or_flies_is_no_reason(more):
    sim = Simulation(stage(10, **more).scene, device="cpu")
    sim.run(6)
    assert need_of_rigid_bodies(stage(10, **more).scene).roll.rate == 0.0 and not sim.warnings and passed(sim) == 0.0


def test_a_prism_that_speeds_up_down_a_slope_is_warned_of_or_gets_more():
    few, free = (Simulation(stage(n, 6.0, lean=40.0).scene, device="cpu") for n in (10, DefaultCount(10)))
    for sim in (few, free):
        sim.run(36)
    assert any("/prism rolls over" in w and "--substeps" in w for w in few.warnings)
    assert not free.warnings and free.plan.clock.steps > 10 and free.repeats


def test_a_coin_that_goes_round_too_fast_is_warned_of():
    """The contact of a disc of 12.5 mm at 10 degrees goes round by 0.56 rad cos(10 deg) in a substep at 24 x 10."""
    s = coin.steady(0.0125, 0.001, 10.0, 0.0)
    made = Stage(24.0, 10)
    made.collider("/floor", Plane())
    turn = np.stack([np.cross((0.0, 1.0, 0.0), s["e3"]), (0.0, 1.0, 0.0), s["e3"]], axis=1)
    made.body("/coin", Cylinder(0.0125, 0.001), s["x"], turn, s["v"], s["w"])
    found = need_of_rigid_bodies(made.scene)
    assert found.roll.kind == "rim" and found.roll.rate / 240.0 == pytest.approx(0.562 * np.cos(np.radians(10.0)), abs=2e-3)
    assert any("precesses on its rim" in w for w in made.run(0.3).warnings)
