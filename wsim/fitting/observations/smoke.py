"""Smoke and heat that were seen: whole grids, or values at probes.

    Smoke(path, frames, values)                      of every cell, (k, nx, ny, nz): volumes, say; NaN: not seen
    Smoke(path, frames, values, places)              at places (m, 3) [m] in the world, (k, m): linear between centres of cells

of the fluid `path`, at k frames: smoke [1], or temperature [K] with field="temperature".
"""

from dataclasses import dataclass

import numpy as np

FIELDS = {"smoke": ("smoke", "1"), "temperature": ("heat", "K")}


@dataclass
class Smoke:
    """values of cells or probes of the fluid `path`, at frames."""

    path: str
    frames: np.ndarray
    values: np.ndarray
    places: np.ndarray | None = None         # [m], (m, 3); None: every cell
    field: str = "smoke"
    weights: np.ndarray | None = None        # of each cell or probe, (nx, ny, nz) or (m,): part of 1 / sigma^2; 0: not counted
    sigma: float | None = None               # standard deviation of a value; None: estimated
    source: str = "observations"             # file, for messages

    def __post_init__(self):
        self.frames = np.atleast_1d(np.asarray(self.frames, np.int64))
        self.values = np.asarray(self.values, np.float64)
        self.places = None if self.places is None else np.asarray(self.places, np.float64).reshape(-1, 3)
        self.weights = None if self.weights is None else np.asarray(self.weights, np.float64)

    @property
    def unit(self) -> str:
        return FIELDS.get(self.field, ("", "1"))[1]

    def prepare(self, model) -> None:
        """Nothing to look up."""

    def seen(self, fluid, values: np.ndarray) -> np.ndarray:
        """Values that are looked at of fields (worlds, cells) of a fluid, (worlds, m)."""
        if self.places is None:
            return values
        n = np.array(fluid.shape)
        s = np.clip((self.places - fluid.low) / fluid.cell - 0.5, 0.0, n - 1.0)
        low = np.minimum(s.astype(np.int64), np.maximum(n - 2, 0))
        part, grid = s - low, values.reshape(len(values), *n)
        found = np.zeros((len(values), len(s)))
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, part, 1.0 - part), axis=1)
            i, j, k = np.minimum(low + corner, n - 1).T
            found += weight * grid[:, i, j, k]
        return found

    def residuals(self, k: int, x: np.ndarray) -> np.ndarray:
        """sqrt(weight) times what each of x (worlds, m) misses at frame number k, (worlds, counted)."""
        seen = self.values[k].ravel()
        weight = np.ones(len(seen)) if self.weights is None else self.weights.ravel()
        good = np.isfinite(seen) & (weight > 0.0)
        return (x[:, good] - seen[good]) * np.sqrt(weight[good])

    def wrong(self, fluid) -> list[str]:
        """Problems of the observation, in words, of a fluid of a scene."""
        k, texts = len(self.frames), []
        own = fluid.shape if self.places is None else (len(self.places),)
        if self.field not in FIELDS:
            texts.append(f"field is {self.field!r}; allowed are {', '.join(FIELDS)}")
        if self.values.shape != (k, *own):
            texts.append(f"{self.source} has values of shape {self.values.shape}; allowed is {(k, *own)}: frames, then "
                         f"{'cells' if self.places is None else 'places'}")
        elif not np.isfinite(self.values).any():
            texts.append("none of its values was seen: every one is NaN or infinite")
        if len(np.unique(self.frames)) != k:
            texts.append("names a frame twice; give each frame once")
        if self.weights is not None and (self.weights.shape != own or not (self.weights >= 0.0).all()):
            texts.append(f"weights have shape {self.weights.shape}; allowed are numbers >= 0 of shape {own}")
        if self.places is not None and ((self.places < fluid.low) | (self.places > fluid.high)).any():
            texts.append("has a place outside of the fluid")
        return texts
