"""Scalars by tiles: what is far from all smoke is not carried, and nothing of the rest changes."""

import numpy as np
import pytest

from tests.physics.fluid.flows import box, method
from wsim.physics.fluid.objects import Source
from wsim.scene import Motion
from wsim.scene.solids import Sphere
from wsim.simulation.simulation import Simulation


def puff(n: tuple[int, ...], sides: tuple[str, ...], **more) -> Simulation:
    """Smoke in a corner of a box, and air that blows it through the sides."""
    smoke = np.zeros((*n, 1)[:3])
    smoke[2:30, 1:6] = 1.0
    velocity = np.zeros((*smoke.shape, 3))
    velocity[..., :2] = (-2.0, 1.0)
    scene = box(n, size=1.0, sides=sides, seconds=0.1, frames=4, smoke=smoke, velocity=velocity, wind=(-2.0, 1.0, 0.0), **more)
    return Simulation(scene, device="cpu")


def carried_everywhere(sim: Simulation) -> Simulation:
    tiles = method(sim).domains[0].tiles
    tiles.near.fill_(1)
    tiles.count = 0
    return sim


@pytest.mark.parametrize(("n", "sides", "steps"), [((100, 84), ("periodic",) * 4 + ("closed",) * 2, 2),
                                                   ((100, 84), ("periodic",) * 4 + ("closed",) * 2, 1),
                                                   ((132, 76), ("open",) * 4 + ("closed",) * 2, 3),
                                                   ((44, 40, 12), ("periodic",) * 6, 1)])
def test_what_is_far_from_all_smoke_need_not_be_carried(n, sides, steps):
    """At 2 to 5 cells a step, through sides too, whose last tiles are not full. To the bit."""
    some, all_ = puff(n, sides, steps=steps), carried_everywhere(puff(n, sides, steps=steps))
    for sim in (some, all_):
        sim.run()
    near = method(some).domains[0].tiles.near.numpy()
    assert 0.0 < near.mean() < 1.0
    now = [method(sim).arrays(0)["smoke"] for sim in (some, all_)]
    assert now[0].any() and np.array_equal(*now)


def test_of_a_large_box_a_small_part_is_carried():
    scene = box((128, 128), size=1.0, seconds=0.1, frames=2, gravity=(0.0, -9.81, 0.0))
    scene.add(Source("/fire", Sphere(0.08), smoke=2.0, temperature=100.0, motion=Motion.at_place((0.5, 0.2, 0.0))))
    sim = Simulation(scene, device="cpu")
    sim.run()
    assert method(sim).arrays(0)["smoke"].any()
    assert 0.0 < method(sim).domains[0].tiles.near.numpy().mean() < 0.25


def test_amounts_that_nobody_sees_are_none():
    sim = puff((100, 84), ("closed",) * 6, steps=4)
    sim.run()
    smoke = method(sim).arrays(0)["smoke"]
    assert np.abs(smoke[smoke != 0.0]).min() >= 1e-10
