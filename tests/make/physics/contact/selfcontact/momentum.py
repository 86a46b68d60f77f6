"""What tests/physics/contact/selfcontact/test_momentum.py shares with other tests: meeting, moments."""

from dataclasses import replace

import numpy as np

from tests.physics.contact.selfcontact.rig import THIN, layers


def meeting(friction: float, **more):
    """Two sheets beside each other that meet at 6 m/s, without gravity and air."""
    scene = layers(2, 9, 0.01, **more)
    material = replace(THIN, stretch=200.0, shear=50.0, static_friction=friction, dynamic_friction=friction)
    for cloth, sign in zip(scene.cloths, (1.0, -1.0), strict=True):
        cloth.velocities = np.broadcast_to((0.0, 3.0 * sign, 0.5), cloth.points.shape).copy()
        cloth.material = material
    scene.cloths[1].points[:] += (0.05, 0.0, 0.03)
    return scene


def moments(sim) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Momentum and its moment about the origin, and sums of the sizes of either, of all points."""
    m = np.concatenate([b.masses[b.index - b.first] for b in sim.model.bodies])[:, None]
    x, v = (np.concatenate([each(b.path) for b in sim.model.bodies]) for each in (sim.positions, sim.velocities))
    turn = m * np.cross(x, v)
    return (m * v).sum(axis=0), turn.sum(axis=0), np.linalg.norm(m * v, axis=1).sum(), np.linalg.norm(turn, axis=1).sum()
