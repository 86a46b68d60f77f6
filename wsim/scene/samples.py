"""What a method hands to a result, each frame: by prim path, in SI units and world space."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Transform:
    """Local-to-world (4, 4) [m], rigid or with scale, column vectors."""

    path: str
    matrix: np.ndarray


@dataclass(frozen=True)
class Value:
    """A number, as a sampled attribute of type double."""

    path: str
    name: str
    value: float


@dataclass(frozen=True)
class Colour:
    """Linear colours of the points of a body or skin, (n, 3), in the author's order."""

    path: str
    values: np.ndarray


Sample = Transform | Value | Colour
