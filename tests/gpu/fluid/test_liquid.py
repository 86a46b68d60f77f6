"""Liquids on a GPU: as on a CPU, the same to the bit from run to run, particles sorted and counted on the device."""

import numpy as np
import pytest
import warp as wp

from tests.physics.fluid.liquid.tanks import method, particles, tank, water
from wsim.physics.fluid.liquid import method as liquids
from wsim.scene import Motion
from wsim.scene.solids import Sphere
from wsim.simulation.simulation import Simulation

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a GPU")


def dam(device: str, frames: int = 6, *, ball: bool = False, tap: bool = False, precision: str = "float32",
        **more) -> Simulation:
    scene = tank((24, 20, 16), [(0, 0, 0), (0.25, 0.5, 0.5)], frames=frames, **more)
    if ball:
        M = np.tile(np.eye(4), (2, 1, 1))
        M[:, :3, 3] = (0.45, 0.1, 0.25), (0.35, 0.1, 0.25)
        scene.collider("/ball", Sphere(0.08), motion=Motion(np.array([0.0, 0.25]), M))
    if tap:
        scene.add(water((0.5, 0.4, 0.2), (0.6, 0.5, 0.3), path="/tap", role="source", velocity=(-1.0, 0.0, 0.0)))
    sim = Simulation(scene, device=device, precision=precision)
    for _ in range(frames):
        sim.step()
    return sim


@pytest.mark.parametrize("more", [{"transfer": "apic"}, {"transfer": "flip", "ball": True}, {"transfer": "pic", "tap": True}])
def test_a_dam_is_that_of_a_cpu(more):
    """float64; a splash grows what rounding differs by, so the first frames alone."""
    ends = [particles(dam(device, 3, precision="float64", tolerance=1e-10, **more)) for device in ("cuda:0", "cpu")]
    assert np.array_equal(ends[0]["id"], ends[1]["id"])
    assert np.abs(ends[0]["x"] - ends[1]["x"]).max() < 1e-6 and np.abs(ends[0]["v"] - ends[1]["v"]).max() < 1e-4


@pytest.mark.parametrize("more", [{}, {"ball": True}, {"tap": True, "transfer": "flip"}])
def test_runs_are_the_same_to_the_bit(more):
    ends = [method(dam("cuda:0", **more)).parts[0].arrays for _ in range(2)]
    assert all(np.array_equal(ends[0][name].numpy(), ends[1][name].numpy()) for name in ends[0])


def test_a_column_at_rest_stays_at_rest():
    sim = Simulation(tank((24, 24, 24), [(0, 0, 0), (0.75, 0.5, 0.75)], tolerance=1e-6), device="cuda:0")
    for _ in range(12):
        sim.step()
    said = sim.indicators()
    assert said["liquid_speed"] < 1e-4 and said["liquid_iterations"] <= 8 and not sim.warnings


def test_a_frame_that_lacks_room_is_repeated(monkeypatch):
    whole = particles(dam("cuda:0", tap=True))
    monkeypatch.setattr(liquids, "SPARE", 8)
    small = dam("cuda:0", tap=True)
    assert any("more than there was room for" in w for w in small.repeats)
    assert all(np.array_equal(whole[name], particles(small)[name]) for name in whole)


def test_volume_and_particles_stay():
    sim = dam("cuda:0", 48)
    said = sim.indicators()
    whole = said["liquid_particles"] / (8 * 32 ** 3)
    assert said["liquid_particles"] == 8 * 16 * 16 * 8 and said["liquid_volume"] == pytest.approx(whole, rel=0.03)
