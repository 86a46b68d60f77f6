"""Stiffnesses that are set live, and what is known of explicit steps without looking at the whole scene again.

The highest frequency was bounded last at some stiffnesses k. K is a sum of terms k K_k, K_k positive semidefinite, so that at
stiffnesses of at most r k it is at most r K, and the steps that are stable then, times r (r >= 1: with damping c goes with k,
without it omega with its root), are stable now. Where the frame has that many substeps already, nothing is bounded anew: a
parameter that is moved to and fro costs a scene's bound (14 ms of 1000 points) where it is set first, and where it is more than
ever before.
"""

from math import ceil
from typing import Any

import numpy as np

SCALED = ("stretch", "shear", "bend", "stiffness", "young")      # K is linear in each, the others as they are


class Headroom:
    """Stiffnesses at which `least` substeps were found to be stable, by (path, name)."""

    def __init__(self) -> None:
        self.least = 0
        self.bounded: dict[tuple[str, str], Any] = {}
        self.now: dict[tuple[str, str], Any] = {}

    def holds(self, thing, path: str, name: str, value, world: int | None, substeps: int) -> bool:
        """True if so many substeps are stable with that value too. What is no stiffness for all worlds, and membranes whose
        weft has a stiffness of its own, is never known."""
        if not self.known(thing, name, world):
            self.forget()
            return False
        self.now[path, name] = np.asarray(value, np.float64)
        if not all(key in self.bounded for key in self.now):
            return False
        ratios = [self._ratio(self.now[key], self.bounded[key]) for key in self.now]
        return ceil(self.least * max(1.0, *ratios)) <= substeps

    def found(self, least: int) -> None:
        """The bound of all as it is now takes so many substeps."""
        self.least, self.bounded = least, dict(self.now)

    def forget(self) -> None:
        self.bounded, self.now = {}, {}

    @staticmethod
    def known(thing, name: str, world: int | None) -> bool:
        weft = getattr(getattr(thing, "material", None), "weft", 0.0)
        return thing is not None and name in SCALED and world is None and not weft

    @staticmethod
    def _ratio(now: np.ndarray, then: np.ndarray) -> float:
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.nan_to_num(now / then, nan=1.0, posinf=np.inf).max())
