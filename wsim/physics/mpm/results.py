"""What results have of a body of particles: places, velocities, widths, ids, and the colours of its source. NumPy only."""

import numpy as np

from wsim.physics.mpm.objects import MaterialPoints
from wsim.scene.samples import DROPS, ParticleSample

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
