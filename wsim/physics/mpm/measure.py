"""Indicators of the material point method: energies, momentum, steps, particles of a cell, penetration; and what results have
of a body of particles: places, velocities, widths, ids, and the colours of its source. On the host."""

from typing import Any

import numpy as np

from wsim.physics.mpm.objects import MaterialPoints
from wsim.physics.mpm.sources.flow import tally_flow
from wsim.scene import Surface
from wsim.scene.samples import DROPS, ParticleSample
from wsim.scene.solids import shape_row

# Linear colours of particles whose source has none, by law.
COLORS = {"neo_hookean": (0.16, 0.52, 0.22), "corotational": (0.16, 0.52, 0.22), "snow": (0.86, 0.90, 0.94),
          "sand": (0.66, 0.46, 0.24), "water": (0.05, 0.22, 0.46)}


def particle_sample(thing: MaterialPoints, now: dict[str, np.ndarray], volume: np.ndarray,
                    there: np.ndarray | None = None) -> ParticleSample:
    """The sample of a body. now: x, v of those that are there; volume [m^3] of all; there: which of all are there, None: all.

    Points keep what their prim says of colours, as long as all are there; particles of a shape are a prim of their own."""
    count, all_there = len(volume), there is None or bool(there.all())
    chosen = slice(None) if there is None else there
    width = (6.0 / np.pi * volume) ** (1.0 / 3.0) if thing.widths is None else np.broadcast_to(thing.widths, (count,))
    ids = np.arange(count) if thing.ids is None else thing.ids
    color = thing.colors
    if thing.points is None and color is None:
        color = np.array(COLORS[thing.material.law])
    elif thing.points is not None and all_there:
        color = None
    if color is not None and np.ndim(color) > 1:
        color = color[chosen]
    path = thing.path + DROPS * (thing.points is None)
    return ParticleSample(path, now["x"], width[chosen], ids[chosen], now["v"], color)


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
