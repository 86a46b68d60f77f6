"""Drag of the air on rods against closed forms."""

import numpy as np
import pytest

import wsim
from tests.make.physics.rods.air import ACROSS, AIR, DENSITY, DIAMETER, LENGTH, SKIN, WEIGHT, hair
from tests.physics.rods.rig import simulated
from wsim import Curve
from wsim.scene.scene import Varying
from wsim.simulation.simulation import Simulation

MASS = DENSITY * np.pi * DIAMETER**2 / 4.0 * LENGTH


@pytest.mark.parametrize("axis, area", [(0, ACROSS * DIAMETER * LENGTH), (1, SKIN * np.pi * DIAMETER * LENGTH)])
@pytest.mark.parametrize("touching", [False, True])
def test_a_straight_hair_falls_at_its_terminal_velocity(axis, area, touching):
    """m g = rho A v^2 / 2, across and along."""
    made, rods = hair(axis, gravity=(0.0, -WEIGHT, 0.0), self_collision=touching)
    simulation, method = simulated(made)
    exact = np.sqrt(2.0 * MASS * WEIGHT / (AIR * area))
    simulation.run(int(60 * 12 * exact / WEIGHT))
    v = method.points(0)[1]
    assert v == pytest.approx(np.broadcast_to([0.0, -exact, 0.0], v.shape), abs=1e-6 * exact)


def error_of_slowing(substeps: int) -> float:
    made, rods = hair(0, velocities=np.tile([0.0, 0.0, 5.0], (9, 1)))
    made.substeps = substeps
    simulation, method = simulated(made)
    simulation.run(20)
    exact = 5.0 / (1.0 + AIR * ACROSS * DIAMETER * LENGTH * 5.0 * 20.0 / 60.0 / (2.0 * MASS))
    return abs(method.points(0)[1][0, 2] / exact - 1.0)


def test_a_thrown_hair_slows_as_one_over_time_with_order_two():
    errors = np.array([error_of_slowing(n) for n in (8, 16, 32)])
    assert errors[-1] < 2e-4
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([2.0, 2.0], abs=0.2)


def test_the_decay_of_all_velocities_is_that_of_points():
    made, rods = hair(0, drag=0.0, skin_drag=0.0, velocities=np.tile([0.0, 0.0, 2.0], (9, 1)))
    made.air_drag, made.substeps = 3.0, 16
    simulation, method = simulated(made)
    simulation.run(30)
    assert method.points(0)[1][:, 2] == pytest.approx(2.0 * np.exp(-1.5), rel=1e-3)


def test_the_wind_carries_a_hair_along_and_may_be_set_and_sampled():
    made, rods = hair(0)
    made.wind = (0.0, 0.0, 3.0)
    simulation, method = simulated(made)
    simulation.run(240)
    assert method.points(0)[1][:, 2] == pytest.approx(3.0, rel=0.02)
    simulation.set("/", "wind", (0.0, 0.0, 0.0))
    before = method.points(0)[1][:, 2].mean()
    simulation.run(60)
    assert method.points(0)[1][:, 2].mean() < 0.5 * before
    made.varying.append(Varying("/", "wind", Curve([0.0, 1.0], [(0.0, 0.0, 1.0), (0.0, 0.0, 5.0)])))
    simulation, method = simulated(made)
    simulation.run(1)
    assert method.strands.wind.numpy()[0, 2] == pytest.approx(1.0 + 4.0 * 0.5 / 60.0, rel=1e-6)


def test_a_held_hair_in_a_storm_is_solved_and_bends_to_leeward():
    """Drag beyond its weight a hundred times over: no step is left unsolved."""
    made, rods = hair(1, n=17, gravity=(0.0, -WEIGHT, 0.0))
    rods.pin("/root", [15, 16])
    made.wind = (20.0, 0.0, 0.0)
    simulation, method = simulated(made)
    for _ in range(30):
        simulation.step()
        assert method.said.numpy()[0, 1] <= 1e-6
    assert method.points(0)[0][0, 0] > 0.8 * LENGTH
    assert np.abs(np.linalg.norm(np.diff(method.points(0)[0], axis=0), axis=1) / LENGTH * 16 - 1.0).max() < 1e-3


def test_a_file_carries_drag_and_says_nothing_of_wind(tmp_path):
    made, rods = hair(0)
    made.wind = (1.0, 0.0, 0.0)
    path = str(tmp_path / "hair.usda")
    wsim.save(made, path)
    loaded = wsim.load(path)
    assert loaded.things("Rods")[0] == rods
    assert not [note for note in loaded.notes if "drag" in str(note) or "wind" in str(note)]


def test_without_air_no_kernel_knows_it():
    made, rods = hair(0, drag=0.0, skin_drag=0.0)
    made.wind = (1.0, 0.0, 0.0)
    simulation = Simulation(made, device="cpu")
    assert not [name for name in simulation.model.modules if "air" in name]
    assert simulation.plan.method("rods").strands.across is None
    made.things("Rods")[0].drag = 1.0
    assert "wsim_rods_air" in Simulation(made, device="cpu").model.modules
