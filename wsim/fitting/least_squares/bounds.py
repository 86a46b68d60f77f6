"""Maps of parameters to a line without ends.

Maps: moduli, densities, times and strain limits, which are positive, by their logarithm; Poisson's ratio by a bounded map, from
0 of soft bodies, from -1 of membranes; the rest as it is.
"""

from dataclasses import dataclass

import numpy as np

from wsim.scene.values.value import LARGE, ThetaMap


@dataclass(frozen=True)
class FittingMap(ThetaMap):
    """theta of a value, the value of theta, and d value / d theta, by what a row of the table of values says: low, high of
    "bounded"; of "plain" high is the value of theta = 1."""

    @staticmethod
    def of(row: ThetaMap) -> "FittingMap":
        return FittingMap(row.kind, row.low, row.high)

    def forward(self, value):
        """theta of a number or an array. Raises ValueError, with what is allowed, outside the range."""
        if self.kind == "plain":
            return value / self.high
        if self.kind == "log":
            if not np.all(value > 0.0):
                raise ValueError("allowed is a number > 0")
            return np.log(value)
        if not np.all((self.low < value) & (value < self.high)):
            raise ValueError(f"allowed is between {self.low:g} and {self.high:g}")
        return np.log((value - self.low) / (self.high - value))

    def inverse(self, theta):
        if self.kind == "plain":
            return theta * self.high
        theta = np.clip(theta, -300.0, 300.0)
        return np.exp(theta) if self.kind == "log" else self.low + (self.high - self.low) / (1.0 + np.exp(-theta))

    def slope(self, theta):
        if self.kind == "plain":
            return np.full_like(theta, self.high) if isinstance(theta, np.ndarray) else self.high
        if self.kind == "log":
            return self.inverse(theta)
        value = self.inverse(theta)
        return (value - self.low) * (self.high - value) / (self.high - self.low)


LOG, PLAIN = FittingMap("log"), FittingMap("plain", high=LARGE)
WIDE = FittingMap("bounded", -1.0, 0.5)
