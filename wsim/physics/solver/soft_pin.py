"""Soft pins within a Newton step (`wsim.physics.solver.newton`). Equations: kernels/solver/soft_pin.py."""

import numpy as np

from wsim.geometry import topology
from wsim.kernels.solver.soft_pin import pinned


class SoftPins:
    """first, item: of each point that a pin pulls, which ones do; none is there without."""

    def __init__(self, method, pins):
        """method: `wsim.physics.solver.newton.Implicit`; pins: `wsim.physics.motion.pins.Pins`."""
        self.method, self.pins, model = method, pins, method.model
        self.kernel = pinned(model.real, model.module)
        first, item = topology.incident(pins.place["soft"].numpy()[:, None], model.points)
        pins.give_way()
        self.first, self.item = (model.upload(values.astype(np.int32), int) for values in (np.unique(first), item))
        pins.soft.first, pins.soft.item = self.first, self.item

    def launch(self, k: int, rate: float) -> None:
        """Their part of own and b, in substep k; rate: 1 / g."""
        m = self.method
        m.model.launch(self.kernel, self.first.size - 1,
                       [self.pins.soft, self.pins.target["soft"], m.state.x, m.points.anchor, k, rate], [m.A, m.b])
