"""A pile of grains between walls, with a rigid box; angular velocities of grains that turn."""

import numpy as np

from wsim import Box, Plane, Scene
from wsim.physics.position_based.objects import Grains

R = 0.01                                           # [m]
MASS = 2600.0 * 4.0 / 3.0 * np.pi * R**3           # of a grain [kg]


def filled_box(ratio, buried, substeps=32, iterations=4, rolling=np.inf):
    """300 grains between walls, and a box of `ratio` times the mass of one, on them or within."""
    scene = Scene(fps=60, substeps=substeps, iterations=iterations)
    scene.collider("/floor", Plane(), static_friction=0.5, dynamic_friction=0.5)
    for k, (x, z) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        half = (0.02, 0.3, 0.12) if x else (0.12, 0.3, 0.02)
        scene.collider(f"/wall{k}", Box(half), at=(0.104 * x, 0.3, 0.104 * z), static_friction=0.5, dynamic_friction=0.5)
    points = 2.05 * R * (np.indices((8, 6, 8)).reshape(3, -1).T - [3.5, 0, 3.5]) + [0, R, 0]
    points += np.random.default_rng(0).uniform(-0.02 * R, 0.02 * R, points.shape)
    at = np.array([0.0, 0.0615, 0.0]) if buried else np.array([0.0, 2.05 * R * 6 + 0.042, 0.0])
    if buried:
        points = points[(np.abs(points - at) > 0.04 + 1.01 * R).any(axis=1)]
    grains = Grains(static_friction=0.5, dynamic_friction=0.5, rolling_friction=rolling)
    scene.particles("/grains", points=points, radius=R, material=grains)
    scene.body("/box", Box((0.04, 0.04, 0.04)), at=tuple(at), mass=ratio * MASS, static_friction=0.5, dynamic_friction=0.5)
    return scene, at[1]


def spin_part(simulation):
    return next(m for m in simulation.plan.methods if m.name == "grains").rolling.part


def spins(simulation, path):
    """Angular velocities [rad/s], (n, 3)."""
    part = spin_part(simulation)
    return part.arrays["spin"].numpy()[part.rows[path, 0]].astype(np.float64)


def set_spins(simulation, path, values):
    part = spin_part(simulation)
    all = part.arrays["spin"].numpy()
    all[part.rows[path, 0]] = values
    part.arrays["spin"].assign(all)
