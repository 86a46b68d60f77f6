"""What tests/physics/fluid/pressure/test_islands.py shares with other tests: stretched."""

import numpy as np

from tests.physics.fluid.flows import box, method
from wsim.scene import Motion
from wsim.scene.solids import Box
from wsim.simulation.simulation import Simulation


def piston(n: tuple[int, ...], sides, frames: int = 2, device: str = "cpu") -> Simulation:
    """A wall of 12 cells across a box of 1 m, ends in the middle of cells, goes by a cell a frame, at 1 m/s."""
    scene = box(n, size=1.0, seconds=frames / n[0], frames=frames, sides=sides, steps=1)
    M = np.tile(np.eye(4), (2, 1, 1))
    M[:, :3, 3] = np.array([0.5 + np.array([0.5, 0.5 + frames]) / n[0], [0.5] * 2, [0.5] * 2]).T
    scene.collider("/piston", Box((6.0 / n[0], 2.0, 2.0)), motion=Motion(np.array([0.0, frames / n[0]]), M))
    return Simulation(scene, device=device)


def stretched(n: tuple[int, ...], right: str, device: str) -> float:
    """How far u is from x / L between wall and piston, which alone has that divergence; as one to an open side."""
    sim = piston(n, ("closed", right, *("closed",) * 4), device=device)
    sim.run()
    u, face = method(sim).arrays(0)["u"], np.arange(n[0] + 1)
    left, beyond = n[0] // 2 - 6 + 3, n[0] // 2 + 6 + 2               # first and last face that it shuts
    beside = (n[0] - face) / (n[0] - beyond) if right == "closed" else np.ones(n[0] + 1)
    expected = np.where(face <= left, face / left, np.where(face >= beyond, beside, 1.0))
    return float(np.abs(u - expected[:, None, None]).max())
