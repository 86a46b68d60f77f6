"""What tests/physics/contact/selfcontact/test_squeezed.py shares with other tests: squeezed."""

from dataclasses import replace

import numpy as np

from tests.physics.contact.selfcontact.rig import THIN, layers

HEAVY, GAP = 2000.0, 8e-3                # times as heavy as the sheet between; [m]


def squeezed(times: float = 1.0, **solver):
    """Three flat sheets, of which the first and the last come from either side, at 10 and 6 m/s, times a number; the middle one
    is finer."""
    scene = layers(3, 4, GAP, size=0.12, **solver)
    fine = layers(1, 13, GAP, size=0.11).cloths[0]
    scene.cloths[1] = replace(fine, path="/layer1", points=fine.points + (0.0, GAP, 0.0))
    for k, (cloth, v) in enumerate(zip(scene.cloths, (10.0, 0.0, -6.0), strict=True)):
        cloth.velocities = np.broadcast_to((0.0, times * v, 0.0), cloth.points.shape).copy()
        cloth.points[:] += (4e-3 * k, 0.0, 3e-3 * k)
        cloth.material = replace(THIN, stretch=100.0, shear=30.0, density=100.0 if k == 1 else 100.0 * HEAVY)
    return scene
