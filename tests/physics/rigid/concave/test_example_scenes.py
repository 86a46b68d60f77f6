"""The example scenes of machines run as they say: a chain, gears, an arm that takes a box by friction."""

from pathlib import Path

import numpy as np
import pytest

from wsim.scene.check.scene import check_scene
from wsim.simulation.simulation import Simulation
from wsim.usd import load

SCENES = Path(__file__).resolve().parents[4] / "scenes"


def test_the_chain_carries_its_weight_and_gears_turn_at_their_ratio():
    """Links of 10 cm, 2.5 cm thick: none passes another, and they sink in by less than 1 mm. Teeth have a play of 0.01 rad."""
    scene = load(SCENES / "chain.usda")
    assert len(scene.things("Body")) == 13 and not scene.notes and not check_scene(scene)
    sim = Simulation(scene, device="cpu")
    sim.run(12)
    links = [sim.poses(body.path)[body.path][:3, 3] for body in scene.things("Body")]
    x = np.array([scene.colliders[0].motion.at(0.0)[:3, 3], *links])
    assert np.linalg.norm(np.diff(x, axis=0), axis=1).max() < 0.151 and x[-1, 1] < -1.5
    gears = load(SCENES / "gears.usda")
    assert len(gears.things("Body")) == 3 and not check_scene(gears)
    sim = Simulation(gears, device="cpu")

    def angles() -> np.ndarray:
        return np.array([np.arctan2(M[1, 0], M[0, 0]) for M in (sim.poses(b.path)[b.path] for b in gears.things("Body"))])
    turned, last = np.zeros(3), angles()
    for _ in range(24):
        sim.step()
        turned, last = turned + np.mod(angles() - last + np.pi, 2.0 * np.pi) - np.pi, angles()
    assert turned[0] > 1.5 and turned * [1.0, -20.0 / 12.0, 1.0] == pytest.approx([turned[0]] * 3, abs=0.04)


def test_the_arm_stacks_a_box_and_follows_its_angles():
    """The box begins at z = 0.3, hangs in the hand after 50 frames, and lies on the other in the end. Drives lag by damping
    over stiffness, 15 ms, times 2 rad/s at most, and bend by 40 N m over 23 kN m/rad."""
    scene, half = load(SCENES / "arm.usda"), 0.04
    assert not scene.notes and not check_scene(scene)
    sim = Simulation(scene, device="cpu")
    sim.run(50)
    assert sim.poses()["/World/Box"][1, 3] > 0.15 and abs(sim.poses()["/World/Under"][:3, 3] - (0.42, half, -0.25)).max() < 1e-3
    sim.run(94)
    poses = sim.poses()
    assert np.abs(poses["/World/Box"][:3, 3] - (0.42, 3 * half, -0.25)).max() < 2e-3
    drives = [varying.curve.values[-1] for varying in scene.varying if varying.path.startswith("/World/Joint")]
    found = sim.joints().position[0][:len(drives)]
    assert len(drives) == 7 and np.abs(found - np.ravel(drives)).max() < 0.03
