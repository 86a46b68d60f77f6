"""Substeps that a scene takes by the speed at which its surfaces meet.

A pair that meets within a substep goes where it may be, and points beside it that meet nothing go on: by a substep's motion
over an edge the edges between are stretched. Two sheets of edges of 12 and 30 mm (300 N/m, 0.12 kg/m^2) that meet at 20 m/s, by
edges that they come nearer in a substep: the largest strain, and the most energy over that before (backward Euler):

    2.3     Newton's method 2.0, 3.9    XPBD 0.8, 1.8
    1.2                     0.9, 1.5         0.5, 1.1
    0.9                     0.7, 1.3         0.6, 1.07
    0.5                     0.4, 1.03        0.3, 1.00
    0.3                     0.4, 1.00        0.3, 1.00

More than one is told, with as many substeps as would make it EDGES; where the scene leaves its solver open, the frame is
repeated with these. Stiff sheets that meet slowly store more than their motion holds at less than that, and lose it again.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from wsim.kernels.contact.selfcontact import step_clamp

if TYPE_CHECKING:
    from wsim.model.model import Model
    from wsim.model.stage import Clock

EDGES = 0.5            # mean edges that surfaces which meet come nearer in a substep, at most
MOST = 16              # times the substeps of the plan that are taken, at most
WHY = "surfaces that met came nearer by more than an edge in a substep, and stretched for it"


class SubstepShortening:
    def __init__(self, model: Model, clock: Clock):
        self.model, self.clock, self.most = model, clock, MOST * clock.substeps

    def needed_substeps(self, said: np.ndarray) -> int:
        """Substeps by which surfaces that met come nearer by EDGES in each; 0 where they came by less than one edge."""
        return ceil(self.clock.substeps * float(said[step_clamp.FAST]) / 100.0 / EDGES)

    def must_shorten_substeps(self, said: np.ndarray) -> bool:
        """Whether the frame is to be repeated with shorter substeps: where the scene names no solver, and there is one world,
        since what one does must not depend on others."""
        open_ = self.model.scene.solver == self.model.scene.integrator == "auto" and self.model.worlds == 1
        return open_ and not self.clock.apart and self.clock.substeps < min(self.needed_substeps(said), self.most)

    def shorten(self, said: np.ndarray) -> str:
        """Takes them, as at a start, since history is of other steps; the words for it."""
        before, self.clock.substeps = self.clock.substeps, min(self.needed_substeps(said), self.most)
        self.clock.starting = True
        return f"{WHY}; {self.clock.substeps} substeps instead of {before} from here on"
