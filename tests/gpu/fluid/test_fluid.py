"""Fluids on a GPU: as on a CPU, the same to the bit from run to run, as few iterations, steps counted on the device."""

import numpy as np
import pytest
import warp as wp

from tests.make.physics.fluid.pressure.islands import stretched
from tests.physics.fluid.flows import box, error, method, put, taylor_green
from wsim.physics.fluid.objects import Source
from wsim.scene import Motion
from wsim.scene.solids import Sphere
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


def plume(device: str, *, ball: bool, precision: str = "float32", frames: int = 4, **more) -> Simulation:
    scene = box((32, 48, 32), size=1.0, seconds=0.5, frames=frames, gravity=(0.0, -9.81, 0.0),
                sides=("closed", "closed", "closed", "open", "closed", "closed"), **more)
    scene.add(Source("/fire", Sphere(0.12), smoke=2.0, temperature=300.0, motion=Motion.at_place((0.5, 0.2, 0.5))))
    if ball:
        M = np.tile(np.eye(4), (2, 1, 1))
        M[:, :3, 3] = (0.4, 0.7, 0.5), (0.6, 0.7, 0.5)
        scene.collider("/ball", Sphere(0.15), motion=Motion(np.array([0.0, 0.5]), M))
    sim = Simulation(scene, device=device, precision=precision)
    sim.run()
    return sim


@pytest.mark.parametrize("ball", [False, True])
def test_a_plume_is_that_of_a_cpu(ball):
    ends = [method(plume(device, ball=ball, precision="float64", tolerance=1e-10)).arrays(0) for device in ("cuda:0", "cpu")]
    assert all(np.abs(ends[0][name] - ends[1][name]).max() <= 1e-6 * max(1.0, np.abs(ends[1][name]).max()) for name in ends[0])


@pytest.mark.parametrize("more", [{"ball": False}, {"ball": True, "vorticity": 0.3, "viscosity": 1e-4},
                                  {"ball": False, "pressure": "multigrid"}])
def test_runs_are_the_same_to_the_bit(more):
    ends = [method(plume("cuda:0", **more)).arrays(0) for _ in range(2)]
    assert all(np.array_equal(ends[0][name], ends[1][name]) for name in ends[0])


@pytest.mark.parametrize("pressure", ["direct", "multigrid"])
def test_vortices_of_taylor_and_green_stay(pressure):
    sim = Simulation(box((64, 64), sides=("periodic",) * 6, steps=20, tolerance=1e-6, pressure=pressure), device="cuda:0")
    put(sim, taylor_green())
    sim.step()
    assert error(sim, taylor_green()) <= 2e-4
    assert sim.indicators()["fluid_iterations"] <= (2 if pressure == "direct" else 7)


def test_steps_are_counted_on_the_device():
    sim = Simulation(box((32, 32), size=1.0, seconds=0.25, frames=2, sides=("periodic",) * 6, cfl=2.0), device="cuda:0")
    sim.step()
    assert sim.indicators()["fluid_steps"] == 1.0
    put(sim, lambda axis, x, y, z: 4.0 * (axis == 0) + 0.0 * x)
    sim.step()
    assert sim.indicators()["fluid_steps"] == 8.0


@pytest.mark.parametrize("right", ["closed", "open"])
def test_air_on_both_sides_of_a_piston_stretches_evenly(right):
    """Regions that a wall parts, found on the device."""
    assert stretched((64, 32, 32), right, "cuda:0") < 2e-4
