"""Sparks: x'' = (0, 0, -9.81), one lit after the other; spark k starts at the origin at (cos k, sin k, 3) m/s."""

from dataclasses import dataclass

import numpy as np

from wsim.scene.bodies import ArrayDataclass

GRAVITY = 9.81
WIDTH = 0.02               # [m]


@dataclass(eq=False)
class Sparks(ArrayDataclass):
    path: str
    count: int = 100
    lit: int = 10          # more of them in the result with every frame

    def velocities(self) -> np.ndarray:
        """At the start [m/s], (count, 3)."""
        k = np.arange(self.count)
        return np.stack([np.cos(k), np.sin(k), np.full(self.count, 3.0)], axis=1)
