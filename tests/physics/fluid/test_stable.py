"""Stable for any step: long steps, violent sources, fast obstacles stay finite and bounded; steps are as many as air needs."""

import numpy as np
import pytest

from tests.physics.fluid.flows import TURN, box, method, put, taylor_green
from wsim.physics.fluid.objects import Source
from wsim.scene import Motion, SceneError
from wsim.scene.solids import Box, Sphere
from wsim.simulation.simulation import Simulation


def finite(sim: Simulation) -> dict[str, np.ndarray]:
    now = method(sim).arrays(0)
    assert all(np.isfinite(values).all() for values in now.values())
    return now


@pytest.mark.parametrize("scheme", ["reflection", "maccormack"])
def test_air_that_crosses_twenty_cells_a_step_gains_no_energy(scheme):
    n = 32
    steps = 10
    seconds = steps * 20.0 * TURN / n
    sim = Simulation(box((n, n), seconds=seconds, sides=("periodic",) * 6, steps=steps, advection=scheme), device="cpu")
    put(sim, taylor_green(0.5))
    before = sim.indicators()["fluid_energy"]
    sim.step()
    finite(sim)
    assert sim.indicators()["fluid_energy"] <= 1.05 * before


@pytest.mark.parametrize("dt", [1e-4, 1.0])
def test_sources_of_a_million_stay_bounded(dt):
    """Heat of 1e6 K/s, smoke of 1e6 /s and air of 1e3 m/s in a box of 1 m, in steps of dt."""
    scene = box((16, 16, 16), size=1.0, sides=("open",) * 6, seconds=4.0 * dt, frames=4, gravity=(0.0, -9.81, 0.0), steps=1,
                vorticity=1.0, weight=1e-6)
    place = Motion.at_place((0.5, 0.3, 0.5))
    scene.add(Source("/hot", Sphere(0.15), smoke=1e6, temperature=1e6, motion=place))
    scene.add(Source("/jet", Sphere(0.1), velocity=(0.0, 1e3, 0.0), motion=place))
    sim = Simulation(scene, device="cpu")
    sim.run()
    now = finite(sim)
    assert now["smoke"].min() >= 0.0
    assert now["smoke"].max() <= 1.0001e6 * 4.0 * dt
    assert max(np.abs(now[name]).max() for name in "uvw") < 1e6 * max(1.0, 4.0 * dt) * 9.81


def test_an_obstacle_of_fifty_cells_a_step_leaves_finite_air():
    scene = box((32, 32), size=1.0, sides=("open",) * 4 + ("closed",) * 2, seconds=0.1, steps=1, smoke=np.ones((32, 32, 1)))
    M = np.tile(np.eye(4), (2, 1, 1))
    M[:, :3, 3] = (-0.8, 0.5, 0.0), (0.8, 0.5, 0.0)
    scene.collider("/bullet", Box((0.1, 0.1, 1.0)), motion=Motion(np.array([0.0, 0.1]), M))
    sim = Simulation(scene, device="cpu")
    sim.step()
    now = finite(sim)
    assert np.abs(now["u"]).max() < 100.0 and now["smoke"].min() >= 0.0 and now["smoke"].max() <= 1.0


def test_a_frame_has_as_many_steps_as_its_air_needs():
    """Air of 4 m/s in cells of 1/32 m, frames of 1/8 s: 16 cells, in steps of two each; at rest one step."""
    sim = Simulation(box((32, 32), size=1.0, seconds=0.25, frames=2, sides=("periodic",) * 6, cfl=2.0), device="cpu")
    sim.step()
    assert sim.indicators()["fluid_steps"] == 1.0
    put(sim, lambda axis, x, y, z: 4.0 * (axis == 0) + 0.0 * x)
    sim.step()
    assert sim.indicators()["fluid_steps"] == 8.0
    assert method(sim).arrays(0)["u"] == pytest.approx(4.0, rel=1e-6)


@pytest.mark.parametrize("most", [7, 8])
def test_a_frame_that_wants_more_steps_than_it_may_take_is_told(most):
    """As above: 8 steps are wanted."""
    sim = Simulation(box((32, 32), size=1.0, seconds=0.25, frames=2, sides=("periodic",) * 6, cfl=2.0, most_steps=most),
                     device="cpu")
    put(sim, lambda axis, x, y, z: 4.0 * (axis == 0) + 0.0 * x)
    sim.step()
    said = " ".join(sim.report()["warnings"])
    assert ("needed 8 steps at a CFL number of 2, and most_steps is 7" in said) == (most == 7)


def test_worlds_are_apart():
    scene = box((16, 16), size=1.0, seconds=0.5, sides=("closed",) * 6, gravity=(0.0, -9.81, 0.0), steps=2)
    scene.add(Source("/hot", Sphere(0.2), smoke=1.0, temperature=50.0, motion=Motion.at_place((0.5, 0.3, 0.03))))
    sim = Simulation(scene, device="cpu", worlds=2)
    sim.set("/", "gravity", (0.0, 9.81, 0.0), world=1)
    sim.step()
    up, down = (method(sim).arrays(k) for k in (0, 1))
    assert up["v"][8, 5].item() > 0.1 > -0.1 > down["v"][8, 5].item()


def test_a_domain_that_does_not_fit_is_refused_with_one_that_does():
    with pytest.raises(SceneError, match=r"/fluid: 10000x1000x100 cells take .* GB; free on cpu are .*; give cells of"):
        Simulation(box((10000, 1000, 100), size=1000.0, sides=("closed",) * 6, seconds=1.0), device="cpu")
