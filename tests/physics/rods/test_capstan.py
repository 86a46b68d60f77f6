"""A rope round a fixed cylinder: T2 = T1 exp(mu phi) (Euler 1769, Eytelwein 1808), where it slips, and where it begins to."""

import numpy as np
import pytest

from tests.physics.rods.rig import simulated
from wsim.physics.rods.objects import Rods
from wsim.scene import Cylinder, Motion, Scene

RADIUS, THIN, ARC, TAIL, MU = 0.1, 0.004, 40, 6, 0.3      # 40 edges round half of a cylinder


def rope(low: float, high: float, pulled: float = 0.0) -> tuple[Scene, Rods]:
    """A light rope over a cylinder, half a turn, with masses [kg] at both ends; the second is pulled down at a speed [m/s]."""
    angle, out = np.linspace(np.pi, 0.0, ARC + 1), RADIUS + THIN
    arc = np.stack([out * np.cos(angle), out * np.sin(angle), 0.0 * angle], axis=1)
    down = np.arange(1, TAIL + 1)[:, None] * np.array([0.0, -np.pi * out / ARC, 0.0])
    x = np.concatenate([(arc[0] + down)[::-1], arc, arc[-1] + down])
    masses = np.full(len(x), 1e-5)
    masses[0], masses[-1] = low, high
    scene = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, substeps=4)
    rods = scene.add(Rods("/rope", x, [len(x)], 2.0 * THIN, young=1e7, bend=1e-6, twist=1e-6, masses=masses,
                          static_friction=MU, dynamic_friction=MU))
    scene.collider("/post", Cylinder(RADIUS, 1.0), static_friction=MU, dynamic_friction=MU)
    if pulled:
        times, frames = np.array([0.0, 4.0]), np.tile(np.eye(4), (2, 1, 1))
        frames[:, :3, 3] = x[-1] + times[:, None] * (0.0, -pulled, 0.0)
        rods.pin("/pull", [len(x) - 1], motion=Motion(times, frames), places=np.zeros((1, 3)))
    return scene, rods


def tensions(method) -> np.ndarray:
    """[N] of the edges."""
    length = np.linalg.norm(np.diff(method.points(0)[0], axis=0), axis=1)
    return method.table.values["A"][:-1, 0] * (length - method.table.values["length"][:-1, 0])


def test_the_tension_of_a_rope_that_slips_grows_by_the_exponential_law():
    simulation, method = simulated(rope(0.1, 0.1, pulled=0.05)[0])
    ratios = []
    for frame in range(60):
        simulation.step()
        if frame >= 20:
            T = tensions(method)
            ratios.append(T[-1] / T[0])
    assert np.mean(ratios) == pytest.approx(np.exp(MU * np.pi), rel=0.01)
    assert np.abs(np.array(ratios) / np.exp(MU * np.pi) - 1.0).max() < 0.05


@pytest.mark.parametrize("part, slips", [(0.97, False), (1.03, True)])
def test_a_rope_sticks_and_slips_within_3_percent_of_it(part, slips):
    made, rods = rope(0.1, 0.1 * part * np.exp(MU * np.pi))
    simulation, method = simulated(made)
    simulation.run(60)
    x, v = method.points(0)
    assert (v[-1, 1] < -0.1) if slips else abs(v[-1, 1]) < 1e-3
    assert (x[-1, 1] - rods.points[-1, 1] < -0.05) == slips
