"""Soft pins within a Newton step (`wsim.physics.solver.newton`). Equations: kernels/motion/soft_pins/soft_pin.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wsim.geometry import topology
from wsim.kernels.motion.soft_pins.soft_pin import pin_stiffness_kernel
from wsim.model.ports import NewtonTerm
from wsim.model.stage import Clock

if TYPE_CHECKING:
    from wsim.physics.solver.assembly import Assembly


class NewtonSoftPins(NewtonTerm):
    """first, item: of each point that a pin pulls, which ones do; none is there without."""

    def __init__(self, assembly: Assembly, pins):
        """pins: `wsim.physics.motion.pins.Pins`."""
        self.assembly, self.pins, model = assembly, pins, assembly.model
        self.kernel = pin_stiffness_kernel(model.real, model.module)
        first, item = topology.incident_rows(pins.place["soft"].numpy()[:, None], model.points)
        self.first, self.item = (model.upload(values.astype(np.int32), int) for values in (np.unique(first), item))

    def add_to_prediction(self, clock: Clock) -> None:
        """Their part of own and b."""
        m = self.assembly
        m.model.launch(self.kernel, self.first.size - 1,
                       [self.pins.soft, self.pins.target["soft"], m.state.x, m.points.anchor, clock.k,
                        1.0 / clock.effective_step], [m.A, m.b])
