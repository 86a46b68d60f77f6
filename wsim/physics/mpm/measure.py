"""Indicators of the material point method: energies, momentum, steps, particles of a cell, penetration. On the host."""

from typing import Any

import numpy as np

from wsim.physics.mpm.flow import tally_flow
from wsim.scene import Surface
from wsim.scene.solids import shape_row


def deepest_point(colliders: list, x: np.ndarray, time: float) -> float:
    """Greatest depth of places x [m] within convex colliders [m], at a time of the scene [s]."""
    deepest = 0.0
    for collider in colliders:
        if not isinstance(collider.shape, Surface):
            M = collider.motion.at(time)
            q = (x - M[:3, 3]) @ M[:3, :3]
            deepest = max(deepest, -float(np.min(shape_row(collider.shape).distance(collider.shape, q), initial=0.0)))
    return deepest


def measure_bodies(method: Any) -> dict[str, float]:
    """Indicators of the first world."""
    every = [method.read_particles(k) for k in range(len(method.things))]
    x, v, m = (np.concatenate([each[name] for each in every]) for name in ("x", "v", "m"))
    said = method.status.said("mpm: grid")
    kinetic = 0.5 * float(m @ np.sum(v * v, axis=1))
    height = float(m @ ((x - method.corner) @ method.gravity[0]))
    own = np.concatenate([method.part.rows[thing.path, 0] for thing in method.things])
    elastic = float(method.elastic_energy()[own].sum())
    found = {"mpm_energy": kinetic - height + elastic, "mpm_kinetic": kinetic, "mpm_elastic": elastic,
             "mpm_momentum": float(np.linalg.norm(m @ v)),
             "mpm_speed": float(np.sqrt(np.max(np.sum(v * v, axis=1), initial=0.0))),
             "mpm_steps": float(said[3]), "mpm_cell_particles": float(said[1])}
    if not method.grid.waves:
        iterations, _, worst = method.status.said("mpm: solve")
        found |= {"mpm_iterations": float(iterations), "mpm_residual": float(worst) / 100.0}
    if method.scene_colliders:
        found["mpm_penetration"] = deepest_point(method.scene_colliders, x, method.time)
    if method.flow:
        there = [method.part.arrays["there"].numpy()[method.part.rows[thing.path, 0]] for thing in method.things]
        found |= tally_flow(method.things, method.flow.sinks, there, [method.masses(k) for k in range(len(there))])
    return found


def find_crowd(method: Any) -> int:
    """A row of the particles of the fullest cell."""
    node = np.stack([method.part.arrays[name].numpy() for name in "ijk"], axis=1)
    _, first, count = np.unique(node, axis=0, return_index=True, return_counts=True)
    return int(first[np.argmax(count)])


def find_fastest(method: Any) -> int:
    """The row of the particle with the greatest speed, of itself or of its waves."""
    arrays, grid = method.part.arrays, method.grid
    speed = np.linalg.norm(arrays["v"].numpy(), axis=1)
    density = grid.materials.density.numpy()[grid.points.row.numpy()]
    return int(np.argmax(np.nan_to_num(speed + np.sqrt(arrays["a"].numpy() / density), nan=np.inf)))
