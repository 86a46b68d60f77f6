"""What pins were seen to bear: forces as observations, beside `wsim.fitting.observations.observe`.

    Pull    forces [N] of a pin on its points at frames, or their sum; NaN: not seen. What they are:
            `wsim.simulation.measure.reaction`
"""

from dataclasses import dataclass

import numpy as np

from wsim.fitting.observations.observe import Track


@dataclass
class Pull(Track):
    """positions: forces (k, n, 3) [N] of the points of the pin `path`, or (k, 3): their sum. sigma [N]. `points` are counted in
    the order in which the pin names them."""

    unit = "N"
    total: bool = False

    def __post_init__(self):
        shape = np.shape(self.positions)
        if len(shape) == 2 and shape[0] == len(np.atleast_1d(self.frames)):
            self.total, self.positions = True, np.asarray(self.positions, np.float64)[:, None]
        super().__post_init__()

    def residuals(self, k: int, x: np.ndarray) -> np.ndarray:
        return super().residuals(k, x.sum(axis=1, keepdims=True) if self.total else x)

    def back(self, k: int, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        return np.repeat(super().back(k, x[:1], r), len(x), axis=0) if self.total else super().back(k, x, r)
