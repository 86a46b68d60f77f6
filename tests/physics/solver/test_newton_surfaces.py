"""Surfaces that touch each other and still colliders gain no energy by Newton's method: its steps solve for contacts with
stretch and bending, and end where the sum is less than where they began."""

import numpy as np
import pytest

from tests.make.physics.solver.newton_surfaces import caught, draped, thrown
from tests.physics.contact.selfcontact.rig import crossed, run, said
from wsim.scene import Scene


def energies(scene: Scene, frames: int) -> tuple:
    """Total energy [J] at the start and at the end of each frame; largest kinetic energy; the simulation."""
    sim = run(scene)
    found = [sim.indicators()]
    for _ in range(frames):
        sim.step()
        found.append(sim.indicators())
    return np.array([i["energy"] for i in found]), max(i["kinetic_energy"] for i in found), sim


@pytest.mark.parametrize("integrator", ["backward_euler", "bdf2", "implicit_midpoint"])
def test_cloth_on_a_still_box_only_loses_energy(integrator):
    """It gained 53 % by backward Euler, from stretch that contacts put in behind the solve. The midpoint keeps the energy of
    linear forces alone: it may have the part of the kinetic energy that the balance of a run allows."""
    energy, kinetic, sim = energies(draped(integrator), 7)
    rounding = 1e-6 * energy[0] if integrator != "implicit_midpoint" else 0.01 * kinetic
    assert (np.diff(energy) < rounding).all() and energy[-1] < 0.85 * energy[0]
    assert said(sim)["near_pairs"] > 0 and crossed(sim) == 0


@pytest.mark.parametrize("size", [0.1, 10.0])
def test_small_and_large_cloth_on_a_box_only_loses_energy(size):
    energy, kinetic, sim = energies(draped("backward_euler", size), 6)
    assert (np.diff(energy) < 1e-6 * energy[0]).all() and energy[-1] < 0.95 * energy[0] and crossed(sim) == 0


@pytest.mark.parametrize("integrator", ["backward_euler", "implicit_midpoint"])
def test_sheets_that_are_thrown_at_each_other_gain_no_energy(integrator):
    """By the midpoint 3.3 J became 33: what it does not resolve of crumpled sheets grows. It gives way to backward Euler."""
    energy, kinetic, sim = energies(thrown(integrator), 9)
    assert (energy - np.minimum.accumulate(energy) <= 0.01 * kinetic).all()
    assert energy[1] < 0.8 * energy[0] and crossed(sim) == 0


@pytest.mark.parametrize("integrator", ["backward_euler", "bdf2"])
def test_a_ball_that_falls_into_cloth_that_collides_with_itself_gives_it_no_energy(integrator):
    """Newton steps know the ball: pushed behind them, by their masses, points gained 3.3 times its kinetic energy."""
    sim, energy, kinetic = run(caught(integrator)), [], [1e-300]
    for _ in range(10):
        told = sim.indicators()
        energy.append(told["energy"] + told["rigid_energy"])
        kinetic.append(told["kinetic_energy"])
        sim.step()
    energy = np.array(energy)
    assert (energy - np.minimum.accumulate(energy) <= 0.01 * max(kinetic)).all() and energy[-1] < energy[0]
    assert sim.plan.integrator == integrator
