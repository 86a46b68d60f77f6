"""Rigid bodies in air: it pushes them, and they push it."""

import numpy as np
import pytest

from tests.make.physics.fluid.bodies import CELL, RADIUS, room
from wsim.simulation.simulation import Simulation


@pytest.mark.parametrize("advection", ["reflection", "cubic"])
def test_a_body_that_is_pushed_takes_as_much_air_along_as_it_displaces(advection):
    """The added mass of a cylinder is that of the air that it displaces: half the acceleration that it has without."""
    mass = 1.2 * np.pi * RADIUS ** 2 * CELL
    sim = Simulation(room(advection=advection, force=(mass * 1.0, 0.0, 0.0)), device="cpu")
    for _ in range(6):
        sim.step()
    v = sim.plan.method("rigid").velocities()[0]
    assert v[0] == pytest.approx(0.5 * 6.0 / 24.0, rel=0.08)
    assert abs(v[1]) < 1e-3


def test_without_air_it_is_twice_as_fast():
    mass = 1.2 * np.pi * RADIUS ** 2 * CELL
    scene = room(force=(mass * 1.0, 0.0, 0.0))
    scene.objects.pop("Fluid")
    sim = Simulation(scene, device="cpu")
    for _ in range(6):
        sim.step()
    assert sim.plan.method("rigid").velocities()[0][0] == pytest.approx(6.0 / 24.0, rel=1e-5)


def test_a_gust_takes_a_light_body_along():
    """Air that moves at 1 m/s past a body at rest: it is pushed along, by no more than the air moves."""
    velocity = np.broadcast_to([1.0, 0.0, 0.0], (64, 64, 1, 3))
    sim = Simulation(room(velocity=velocity), device="cpu")
    for _ in range(12):
        sim.step()
    v = sim.plan.method("rigid").velocities()[0]
    assert 0.2 < v[0] < 1.2 and not sim.warnings
