"""Soft pins that share points: a point rests where the forces of all of its pins are in balance."""

import numpy as np
import pytest

from tests.make.physics.motion.soft_pins import PULLS, balance, pulled
from tests.physics.contact.selfcontact.rig import SOLVERS, solvers
from wsim.gradient.recording import Recording
from wsim.physics.motion.pins import pin_turns
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("solver", solvers("xpbd", "xpbd bdf2", "newton", "leapfrog", "rk4"))
@pytest.mark.parametrize("count", [2, 3])
def test_a_point_between_soft_pins_rests_where_they_balance(solver, count):
    sim = Simulation(pulled(count, **solver), device="cpu", precision="float64")
    sim.run(120)
    np.testing.assert_allclose(sim.positions()[:40], np.tile(balance(count), (40, 1)), atol=1e-6)


def test_no_launch_has_two_soft_pins_of_one_point():
    """On a GPU each would write what it made of the point that both read."""
    places = np.random.default_rng(2).integers(0, 30, 200)
    found = pin_turns(places)
    assert sorted(np.concatenate(found)) == list(range(200)) and len(found) == np.bincount(places).max()
    assert all(len(set(places[pins])) == len(pins) for pins in found)
    sim = Simulation(pulled(3, **SOLVERS["xpbd"]), device="cpu")
    own = sim.plan.method("pins")
    assert [count for count, _ in own.turns] == [40, 40, 40]
    for count, soft in own.turns:
        assert len(set(soft.point.numpy()[soft.turn.numpy()])) == count


def test_soft_pins_of_different_points_take_one_launch():
    own = Simulation(pulled(1, **SOLVERS["xpbd"]), device="cpu").plan.method("pins")
    assert [count for count, _ in own.turns] == [40] and not own.turns[0][1].turn


@pytest.mark.parametrize("number", [0, 1, 2])
def test_gradients_by_the_stiffness_of_soft_pins_of_one_point(number):
    """Each in a launch of its own, by differences."""
    def ends(stiffness: float) -> Recording:
        changed = [(stiffness if k == number else s, a) for k, (s, a) in enumerate(PULLS)]
        more = SOLVERS["xpbd"] | {"substeps": 4}
        sim = Simulation(pulled(3, 4, pulls=changed, **more), device="cpu", precision="float64", gradients=True)
        return Recording(sim, 3)
    x, s = np.random.default_rng(4).normal(size=(5, 3)), PULLS[number][0]
    losses = [float((ends(s * (1.0 + e)).positions(3) * x).sum()) for e in (1e-4, -1e-4)]
    recording = ends(s)
    recording.run()
    found = recording.backward({3: {"/net": x}}, {}).pin(f"/pin{number}", "stiffness")
    assert found == pytest.approx((losses[0] - losses[1]) / (2e-4 * s), rel=1e-5)
