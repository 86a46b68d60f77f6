"""Cloth in smoke: a wall that moves as it does, through which nothing goes."""

import numpy as np
import pytest

from tests.make.physics.fluid.obstacles.walls import CELL, N, duct
from tests.physics.fluid.flows import box, method
from wsim.scene import SceneError, shapes
from wsim.scene.check.scene import check_scene
from wsim.simulation.simulation import Simulation


def test_no_air_and_no_smoke_goes_through_a_sheet_that_is_held():
    """A wind of 2 m/s from one side, and a way out at the side of both halves: the sheet keeps them apart."""
    sim = Simulation(duct(("wind", "open", "open", "open", "closed", "closed"), wind=(2.0, 0.0, 0.0)), device="cpu")
    sim.run()
    now = method(sim).arrays(0)
    assert np.abs(now["u"][12]).max() < 1e-6 and np.abs(now["u"][4]).max() > 0.1
    assert now["smoke"][14:].max() == 0.0 and now["smoke"][:11].max() > 0.9
    assert sim.indicators()["fluid_divergence"] < 0.02


def test_a_sheet_that_is_moved_takes_the_air_along():
    """At half a metre a second, to within what its thickness of a cell hides: the air behind and before stretches evenly."""
    sim = Simulation(duct(("closed",) * 6, speed=0.5), device="cpu")
    sim.run()
    u, face = method(sim).arrays(0)["u"], np.arange(N[0] + 1) / N[0]
    at = float(sim.positions("/sheet")[:, 0].mean())
    assert at == pytest.approx(0.5 + 0.5 * 4.0 / 24.0, abs=1e-4)
    expected = np.where(face < at, 0.5 * face / at, 0.5 * (1.0 - face) / (1.0 - at))
    away = np.abs(face - at) > 2.0 * CELL
    assert np.abs(u - expected[:, None, None])[away].max() < 0.5 * 1.5 * CELL / (1.0 - at)
    assert sim.indicators()["fluid_speed"] < 0.53


def test_a_flag_in_the_wind_stirs_no_storm():
    """A sheet that bends has a divergence of its own: it is no flow through its slits, which would blow at 100 m/s."""
    scene = box((20, 12, 12), size=1.0, seconds=0.5, frames=12, sides=("wind", *("open",) * 5), wind=(3.0, 0.0, 0.4))
    points, counts, indices = shapes.sheet(0.4, 0.3, 10, 8, at=(0.45, 0.3, 0.3))
    flag = scene.cloth("/flag", points, counts, indices)
    flag.drag, flag.lift = 1.0, 2.0
    scene.pin("/pole", flag, np.flatnonzero(points[:, 0] < 0.26))
    sim = Simulation(scene, device="cpu")
    fastest = 0.0
    for _ in range(12):
        sim.step()
        fastest = max(fastest, sim.indicators()["fluid_speed"])
    assert 3.0 < fastest < 9.0


def test_what_is_no_wall_is_said_and_has_no_gradient():
    scene = duct(("open",) * 6)
    assert not [p for p in check_scene(scene) if "passes through" in str(p)]
    scene.things("Fluid")[0].margin = 0.5
    assert any("/sheet passes through its air, as it is solved in a part" in str(p) for p in check_scene(scene))
    scene.things("Fluid")[0].margin = 0.0
    scene.frames = 1
    with pytest.raises(SceneError, match="/fluid: has /sheet in its air as a wall"):
        Simulation(scene, device="cpu", precision="float64", gradients=True)
