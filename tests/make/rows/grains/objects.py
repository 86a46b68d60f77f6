"""Grains: balls of one size, that do not turn."""

from dataclasses import dataclass

import numpy as np

from wsim.scene.bodies import ArrayDataclass
from wsim.scene.values.arrays import contiguous_array


@dataclass(eq=False)
class Grains(ArrayDataclass):
    path: str
    places: np.ndarray                     # [m], (n, 3)
    radius: float = 0.02                   # [m]

    def __post_init__(self):
        self.places = contiguous_array(self.places, np.float64, -1, 3)
