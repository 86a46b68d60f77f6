"""Momentum of bodies that nothing holds, in the steps of `wsim.physics.solver.newton`. Equations:
kernels/solver/rigid_translation.py."""

import numpy as np
import warp as wp

from wsim.kernels.solver import rigid_translation as kernels
from wsim.physics.solver.assembly import Assembly, Term


class Momentum(Term):
    """The momentum of translation that a Newton step lacks."""

    def __init__(self, assembly: Assembly, lanes: int, free: list[int]):
        """lanes: threads that sum over a system; free: 1 for each system that nothing holds."""
        self.assembly, self.lanes, model = assembly, lanes, assembly.model
        self.amount, self.mean = kernels.amount(model.real, model.module), kernels.mean(model.real, model.sweep_module)
        self.translate, self.free = kernels.translate(model.real, model.module), model.upload(np.array(free, np.int32), int)
        self.part = wp.zeros(len(free) * lanes, dtype=wp.vec4d, device=model.device)
        self.shift = wp.zeros(len(free), dtype=wp.vec3d, device=model.device)

    def carry(self) -> None:
        """Adds it to y."""
        m, y = self.assembly, self.assembly.v.y
        self.shift_by(y)
        m.model.launch(self.translate, m.model.points, [m.system.of, self.shift, y], [y])

    def shift_by(self, y: wp.array) -> None:
        """The translations that a step y lacks."""
        m = self.assembly
        m.model.launch(self.amount, self.part.size, [m.system.first, self.lanes, m.A, m.state.d, m.b, y], [self.part])
        m.system.launch(self.mean, [self.lanes, self.free, self.part], [self.shift])
