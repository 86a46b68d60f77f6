"""Coulomb friction on surfaces that accelerate, by every integrator that has contacts: the critical force, and what sticks."""

import numpy as np
import pytest

from tests.conftest import first_and_slow
from tests.make.physics.contact.midpoint import G, mass
from wsim.scene import Box
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

ROWS = {name: dict(zip(("solver", "integrator", "iterations"), row, strict=True)) for name, row in {
    "newton bdf2": ("implicit", "bdf2", 6), "leapfrog": ("explicit", "leapfrog", 1), "xpbd": ("xpbd", "backward_euler", 4),
    "xpbd bdf2": ("xpbd", "bdf2", 4), "newton": ("implicit", "backward_euler", 6), "rk4": ("explicit", "rk4", 1),
    "newton midpoint": ("implicit", "implicit_midpoint", 6)}.items()}
FRICTION, H = 0.5, 1.0 / 600.0


def carried(row: dict, a: float) -> np.ndarray:
    """How far the point stays behind a floor that is pulled by a [m/s^2], after half a second and each frame behind it [m]."""
    keys, places = np.linspace(0.0, 2.0, 201), np.zeros((201, 3))
    places[:, 0], places[:, 1] = 0.5 * a * keys**2, -1.0
    sim = Simulation(mass((0.0, 0.0, 0.0), shape=Box((9.0, 1.0, 9.0)), friction=FRICTION,
                          motion=Motion.through(keys, places, np.tile([0.0, 0.0, 0.0, 1.0], (201, 1))), **row),
                     device="cpu", precision="float64")
    sim.run(30)
    found = []
    for _ in range(30):
        found.append(0.5 * a * sim.time**2 - sim.positions()[0, 0])
        sim.step()
    return np.array(found)


@pytest.mark.parametrize("name", first_and_slow(list(ROWS)))
def test_a_point_on_a_floor_that_is_pulled_slips_at_the_critical_force(name):
    """Below it none is left behind, above it by a - mu g. BDF2's velocity is that at the end of a step, and a floor's its mean
    over it: what sticks goes by a h / 2 slower (kernels/contact/project.py)."""
    below, above = 0.99 * FRICTION * G, 1.03 * FRICTION * G
    stays, slips = carried(ROWS[name], below), carried(ROWS[name], above)
    lag = 0.5 * below * H if "bdf2" in name else 0.0
    np.testing.assert_allclose(np.diff(stays) * 60.0, lag, atol=0.01 * below * H)
    relative = np.diff(slips, 2) * 3600.0
    assert relative.mean() == pytest.approx(above - FRICTION * G, rel=0.02)
