"""Curves of a scene that rods carry: plain data in SI units, NumPy only."""

from dataclasses import dataclass, field

import numpy as np

from wsim.scene.bodies import ArrayDataclass
from wsim.scene.curve import Motion
from wsim.scene.values.arrays import contiguous_array, real_array


@dataclass(eq=False)
class Followers(ArrayDataclass):
    """Strands that are not simulated, and go along with the strands of `Rods` whose roots are nearest to theirs at the start.

    path      prim path
    points    (n, 3) [m], own frame, strand behind strand, root first
    counts    points of each strand, (strands,), 1 or more
    guides    prim path of the rods
    kind      how USD draws the curves through their points: "linear", or the basis of cubic ones, "bezier", "bspline", ...
    motion    own frame to world at the start, lengths [m]
    """

    path: str
    points: np.ndarray
    counts: np.ndarray
    guides: str = ""
    kind: str = "linear"
    motion: Motion = field(default_factory=Motion.still)

    def __post_init__(self):
        self.points, self.counts = real_array(self.points, -1, 3), contiguous_array(self.counts, np.int32, -1)
