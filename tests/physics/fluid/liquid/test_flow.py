"""Liquid that comes and goes: sources, sinks, open sides, rooms that grow."""

import numpy as np
import pytest

from tests.make.physics.fluid.liquid.flow import CELL, tap
from tests.physics.fluid.liquid.tanks import method, particles, tank
from wsim.physics.fluid.liquid import method as liquids
from wsim.physics.fluid.liquid.objects import LiquidSource
from wsim.scene import Motion, Scene
from wsim.scene.curve import Curve
from wsim.scene.solids import Box
from wsim.simulation.simulation import Simulation


def run(scene: Scene, frames: int, **more) -> Simulation:
    sim = Simulation(scene, device="cpu", **more)
    for _ in range(frames):
        sim.step()
    return sim


def test_a_source_gives_as_much_as_flows_off():
    """Area times speed: 4 cells of 4 particles stand in the way of each cell of length."""
    sim = Simulation(tap(), device="cpu")
    counts = []
    for _ in range(45):
        sim.step()
        counts.append(int(method(sim).numbers[0].arrays["numbers"].numpy()[1]))
    assert (counts[-1] - counts[8]) / (36 / 24.0) == pytest.approx(16 / CELL, rel=0.05)
    found = particles(sim)
    assert found["id"].max() < counts[-1]
    assert np.abs(found["v"][:, 0] - 1.0).max() < 0.05 and np.abs(found["v"][:, 1]).max() < 0.05


@pytest.mark.slow
def test_what_passes_an_open_side_is_gone_and_ids_stay():
    sim = Simulation(tap(), device="cpu")
    for _ in range(48):
        sim.step()
    before = particles(sim)
    sim.step()
    after = particles(sim)
    assert before["id"][0] > 0 and len(np.unique(after["id"])) == len(after["id"])
    assert after["x"][:, 0].max() <= 1.0 and before["x"][:, 0].max() > 1.0 - CELL
    both = np.intersect1d(before["id"], after["id"])
    ways = [each["x"][np.searchsorted(each["id"], both)] for each in (before, after)]
    assert np.abs(ways[1] - ways[0] - np.array([1.0 / 24.0, 0.0, 0.0])).max() < 0.2 * CELL


@pytest.mark.slow
def test_a_source_is_shut_by_its_strength():
    shut = run(tap(strength=Curve(np.array([0.0, 0.25, 0.26]), np.array([1.0, 1.0, 0.0]))), 12)
    still = run(tap(strength=0.0), 12)
    count = shut.indicators()["liquid_particles"]
    assert still.indicators()["liquid_particles"] == 0.0 and count == pytest.approx(64 / 2 + 16 * 0.25 / CELL, rel=0.15)


@pytest.mark.slow
def test_a_sink_empties_its_shape():
    scene = tank((16, 16), [(0, 0), (1, 0.5)], cell=CELL)
    hole = Box((1.0, 2 * CELL, 1.0))
    scene.add(LiquidSource("/hole", hole, Motion.at_place((0.0, 0.0, 0.0)), role="sink"))
    sim = run(scene, 1)
    assert (particles(sim)["x"][:, 1] > CELL).all()
    assert run(scene, 24).indicators()["liquid_particles"] == 0.0


def test_a_frame_that_lacks_room_is_repeated_to_the_same_bits(monkeypatch):
    """Room for eight particles more grows; one that was large from the start ends as it."""
    large = run(tap(), 10)
    monkeypatch.setattr(liquids, "SPARE", 8)
    small = run(tap(), 10)
    assert method(small).parts[0].capacity < 8192 and any("more than there was room for" in w for w in small.repeats)
    a, b = particles(large), particles(small)
    assert all(np.array_equal(a[name], b[name]) for name in a)
