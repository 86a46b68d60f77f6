"""Order of implicit integrators where something moves or is taken apart: pins on curves, drag of the air."""

from dataclasses import replace

import numpy as np
import pytest

from tests.make.physics.solver.newton import DOUBLE, INTEGRATORS, make
from wsim.scene import shapes
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation


def test_a_pin_that_swings_leaves_sdirk3_its_order():
    """Two springs hang on a pin that moves in a circle: stages have it where it is then. Against RK4."""
    times = np.arange(0.0, 0.31, 1.0 / 9600.0)
    circle = np.stack([0.2 * np.sin(9.0 * times), 0.2 * np.cos(9.0 * times), 0.0 * times], axis=1)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, 3] = circle

    def ends(substeps: int, **more) -> np.ndarray:
        scene = make(**{"substeps": substeps, "iterations": 6, "integrator": "sdirk3"} | more)
        net = scene.net("/net", [[0, 0.2, 0], [0.3, 0.2, 0], [0.6, 0.2, 0]], [[0, 1], [1, 2]], [40.0], [0.1] * 3)
        scene.pin("/pin", net, [0], motion=Motion(times, poses), places=[[0.0, 0.0, 0.0]])
        sim = Simulation(scene, **DOUBLE)
        sim.run(15)
        assert np.abs(sim.positions()[0] - poses[2400, :3, 3]).max() < 1e-12 and sim.plan.integrator == scene.integrator
        return sim.positions()
    wanted = ends(200, solver="explicit", integrator="rk4", iterations=1)
    errors = [np.abs(ends(n) - wanted).max() for n in (2, 4, 8)]
    assert -np.polyfit(np.log([2, 4, 8]), np.log(errors), 1)[0] == pytest.approx(3.0, abs=0.4)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_drag_of_the_air_leaves_order_one(integrator):
    """It is taken in the prediction, which keeps rest exact. Against RK4; auto takes no sdirk3 of half as many steps there."""
    def end(substeps: int, **more) -> np.ndarray:
        scene = make(**{"substeps": substeps, "iterations": 6, "integrator": integrator, "air_drag": 2.0} | more)
        net = scene.net("/net", [[0, 0, 0], [1.125, 0, 0]], [[0, 1]], [100.0], [1.0], lengths=[1.0])
        scene.pin("/pin", net, [0])
        sim = Simulation(scene, **DOUBLE)
        sim.run(30)
        return sim.positions()
    wanted = end(200, solver="explicit", integrator="rk4", iterations=1)
    errors = [np.abs(end(n) - wanted).max() for n in (4, 8)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.05)
    scene = make(integrator="auto", iterations=2, air_drag=1.0)
    scene.soft("/bar", *shapes.block((0.2, 0.1, 0.1), (2, 1, 1)))
    assert [Simulation(replace(scene, air_drag=k), device="cpu").plan.integrator for k in (1.0, 0.0)] == ["bdf2", "sdirk3"]
