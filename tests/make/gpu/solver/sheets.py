"""What tests/gpu/solver/test_sheets.py shares with other tests: BLOCKS, end, moves_alike."""

import numpy as np

import wsim
from wsim.model.launches import KernelLaunches
from wsim.physics.motion.fused import domain_decomposition
from wsim.scene import Scene

BLOCKS = {"cluster of 8": 8, "cluster": 16, "grid": 64}


def end(scene: Scene, frames: int = 4):
    sim = wsim.Simulation(scene, device="cuda:0")
    for _ in range(frames):
        sim.step()
    return sim.state.x.numpy(), sim.state.v.numpy(), sim.plan.ports.force_gather


def moves_alike(make, blocks: int, rounding: float, monkeypatch) -> None:
    """Asserts that a scene ends twice with the same bits by so many blocks, and within rounding [m] launch by launch."""
    monkeypatch.setattr(domain_decomposition, "blocks_of", lambda *given: [blocks])
    x, v, pull = end(make())
    assert pull.cluster is not None and pull.cluster.size == blocks
    again, rate, _ = end(make())
    assert np.array_equal(x, again) and np.array_equal(v, rate)
    monkeypatch.setattr(KernelLaunches, "fuses", False)
    apart, _, pull = end(make())
    assert pull.cluster is None
    assert np.abs(x - apart).max() < rounding and np.abs(v).max() > 0.1
