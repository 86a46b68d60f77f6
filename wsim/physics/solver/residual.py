"""What Newton steps leave: the residual of every system at the end of a frame. Equations: kernels/solver/line_search.py,
`left`."""

from collections.abc import Iterable

import warp as wp

from wsim.kernels.solver import line_search
from wsim.model.ports import NewtonTerm
from wsim.model.stage import MISSED, UNSOLVED, Clock
from wsim.model.status import FrameStatus
from wsim.physics.solver.assembly import Assembly


class Residual:
    """The residual of each system, and the words of the status that say where it is too large."""

    def __init__(self, assembly: Assembly, status: FrameStatus, clock: Clock):
        model, self.assembly, self.status = assembly.model, assembly, status
        status.reserve(UNSOLVED, len(model.bodies))
        self.array = assembly.system.zeros(assembly.system.systems, model.real)
        module, block = model.step_modules
        self.left, self.unmet = (line_search.newton_residual_kernel(model.real, block),
                                 line_search.unmet_residual_kernel(model.real, module))
        self.rounded = line_search.rounding_test_kernel(model.real, block)
        if clock.watched:
            status.reserve(MISSED)
            from wsim.kernels.solver.sweeps.residual import residual_verdict_kernel
            self.judge = residual_verdict_kernel(model.real, model.module)

    def measure(self, clock: Clock, terms: Iterable[NewtonTerm]) -> wp.array:
        """Measures what the last Newton step left of each system, by the matrix at its end, which is assembled."""
        own, f = self.assembly, self.assembly.f
        own.linearise(1.0 / clock.effective_step)
        for term in terms:
            term.adjust_system(clock.effective_step, fresh=True)
            f = term.unbalanced_forces(f)
        if own.system.schwarz:
            own.system.schwarz.left(own, f, self.array)
        else:
            own.system.launch(self.left, [own.points.constants, own.A, own.system.first, f, own.state.d, own.b], [self.array])
        own.system.launch(self.rounded, [own.points.constants, own.A, own.system.first, f, own.state.x, own.state.d, own.b],
                          [self.array])
        return self.array

    def say(self, clock: Clock) -> None:
        """Says what is left, and whether an integrator that needs it may go on."""
        self.launch(self.unmet, [self.array, self.status.offset(UNSOLVED)], [self.status.array])
        if clock.watched:
            self.launch(self.judge, [self.array, clock.integrator.met[0]], [self.status.word(MISSED)])

    def launch(self, kernel, inputs: list, outputs: list[wp.array]) -> None:
        self.assembly.model.launch(kernel, self.array.size, inputs, outputs)
