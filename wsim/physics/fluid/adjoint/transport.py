"""Adjoint of `wsim.physics.fluid.grid.transport.Transport`: kernels/fluid/adjoint/advection.py."""

from typing import Any

import warp as wp

from wsim.kernels.fluid.adjoint import advection as kernels
from wsim.physics.fluid.adjoint.launches import PLAIN, AdjointLaunches, air_number_slot


class TransportAdjoint:
    """Adjoint of one quantity: axis of a component, -1 of a scalar. lost: rows, of air that came in."""

    def __init__(self, launches: AdjointLaunches, transport: Any, axis: int, clamped: bool, third: bool, lost: wp.array):
        dim, real, module = launches.domain.layout.dim, launches.real, launches.module
        self.launches, self.transport, self.axis, self.lost = launches, transport, axis, lost
        cubic = transport.scheme == "cubic"
        self.kernel = kernels.advection_adjoint_kernel(dim, cubic, cubic and clamped, third, real, module)
        self.Carried = kernels.carried_adjoints(real)
        self.inflow = bool(sum(launches.domain.grid.outside)) and axis >= 0
        if transport.pairs:
            room = max(*launches.domain.sizes, launches.domain.layout.cells)
            self.Corrected, self.correct = kernels.maccormack_adjoint_kernel(dim, transport.scheme == "bfecc", real, module)
            self.ahead, self.turned, self.by_ahead, self.by_turned = (launches.threads.zeros(room) for _ in range(4))

    def back(self, u: Any, q: wp.array, by: wp.array, part: float, u_out: Any, q_out: wp.array) -> None:
        """by: cotangent of q carried along u over `part` of the step; adds those of u and q."""
        if self.transport.pairs:
            self._there_and_back(u, q, by, part, u_out, q_out)
        else:
            self._carry_one(u, q, by, part, u_out, q_out)

    def _carried_quantity(self, q: wp.array, by: wp.array, part: float) -> Any:
        return self.launches.struct(self.Carried, q=q, by=by, axis=self.axis, part=self.launches.real(part))

    def _carry_one(self, u: Any, q: wp.array, by: wp.array, part: float, u_out: Any, q_out: wp.array) -> None:
        run, lost = self.launches, self.lost[:q.size]
        run.over(self.kernel, q.size, [run.domain.grid, u, self._carried_quantity(q, by, part), run.domain.clock],
                 [u_out, q_out, lost])
        if self.inflow:
            run.sum(lost, PLAIN, 1.0, air_number_slot(0, self.axis))

    def _there_and_back(self, u: Any, q: wp.array, by: wp.array, part: float, u_out: Any, q_out: wp.array) -> None:
        """There and back: the three passes once more, then their adjoints."""
        run, t, n = self.launches, self.transport, q.size
        grid, clock, real = run.domain.grid, run.domain.clock, run.real
        ahead, turned, by_ahead, by_turned = (a[:n] for a in (self.ahead, self.turned, self.by_ahead, self.by_turned))

        def advect_again(q: wp.array, part: float, out: wp.array) -> None:
            run.over(t.advect, n, [grid, u, q, t.lifting, clock, real(part)], [out])
        advect_again(q, part, ahead)
        advect_again(ahead, -part, turned)
        p, middle = ahead, t.scheme == "bfecc"
        if middle:
            run.over(t.compensate, n, [q, turned], [turned])
            p = t.work["r"][:n]
            advect_again(turned, part, p)
        now = run.struct(self.Corrected, p=p, turned=turned)
        run.over(self.correct, n, [grid, u, self._carried_quantity(q, by, part), now, clock], [by_ahead, q_out, by_turned])
        if middle:
            by_turned.zero_()
            self._carry_one(u, turned, by_ahead, part, u_out, by_turned)
            run.add(by_turned, q_out, 1.5)
            by_ahead.zero_()
            run.add(by_turned, by_ahead, -0.5)
            wp.copy(by_turned, by_ahead)
            by_ahead.zero_()
        self._carry_one(u, ahead, by_turned, -part, u_out, by_ahead)
        self._carry_one(u, q, by_ahead, part, u_out, q_out)
