"""The constraints of XPBD as forces with gradients, in tables of their own: what a reaction is evaluated by, see
`wsim.gradient.reactions.law`. XPBD's tables hold compliances, and get what a loss says by them:

    length, hinge   k = 1 / alpha, c = tau k:     by alpha: -k^2 (by k + tau by c)         by tau: k by c
    membrane        S = A^-1 of plane stress:     by A: -S (by S) S                        (by an entry off the diagonal: both)
"""

import copy

import numpy as np
import warp as wp

from wsim.gradient.tables import sum_over_spring_ends
from wsim.kernels.math.real import ADJOINT
from wsim.physics.cloth.elements import CornerElements
from wsim.physics.cloth.kind import SPRINGS
from wsim.physics.motion.forces import ForceGather
from wsim.simulation.measure.reaction import constraints_with_force
from wsim.simulation.plan import SimulationPlan


class ForcesBesideTape:
    """Gradients beside the tape, of a plan that sweeps."""

    def __init__(self, plan: SimulationPlan):
        own = copy.copy(plan.model)
        own.module, own.modules, own.tables, own.tape = f"{own.module}_reactions{ADJOINT}", {}, {}, None
        self.pull = ForceGather(own, plan.ports.constants, constraints_with_force(plan.model), None, shared=False)
        self.elements = {e.kind: e for e in self.pull.elements if isinstance(e, CornerElements)}
        self.batches = [b for b in plan.ports.xpbd_batches if not b.hard]

    def arrays(self) -> list[wp.array]:
        """Arrays that get gradients."""
        net, tables = self.pull.net, [e.data for e in self.elements.values()]
        found = [self.pull.lengths, *(getattr(net, name) for name in ("k", "rest", "damping"))] if self.pull.springs else []
        found += [e.curvature.data.value for e in self.elements.values() if e.curvature]
        return [a for a in (*found, *(getattr(d, name) for d in tables for name in ("rest", "stiffness", "tau"))) if a]

    def zero(self) -> None:
        for array in self.arrays():
            array.grad.zero_()

    def by_batches(self) -> dict[int, np.ndarray]:
        """Gradients by compliances, rest values and relaxation times of XPBD's tables, by their address."""
        found = {}
        for batch in self.batches:
            alpha, rest, tau = self.springs(batch) if batch.row.gather == SPRINGS else self.flat(batch)
            data = batch.data
            for array, by in ((data.alpha, alpha), (batch.lengths or data.rest, rest), (data.tau, tau)):
                if array:
                    found[array.ptr] = by[batch.order]
            if batch.curvature:                          # slots of a triangle stand in both tables alike
                by = self.elements[batch.kind].curvature.data.value.grad
                found[batch.curvature.data.value.ptr] = by.numpy().astype(np.float64)
        return found

    def springs(self, batch) -> tuple[np.ndarray, ...]:
        """Gradients with respect to alpha, rest and tau, in the order of the rows."""
        (alpha, tau), net = batch.values(), self.pull.net
        by_k, by_rest = (sum_over_spring_ends(self.pull, a.grad.numpy().astype(np.float64))
                         for a in (net.k, self.pull.lengths or net.rest))
        by_c = sum_over_spring_ends(self.pull,
                                    net.damping.grad.numpy().astype(np.float64)) if self.pull.damped else np.zeros(len(alpha))
        return -(by_k + tau * by_c) / alpha**2, by_rest, by_c / alpha

    def flat(self, batch) -> tuple[np.ndarray, ...]:
        """Gradients as `springs` has them, of hinges and membranes."""
        data = self.elements[batch.kind].data
        by, rest, tau = (a.grad.numpy().astype(np.float64) for a in (data.stiffness, data.rest, data.tau))
        alpha, _ = batch.values()
        return -by / alpha**2 if by.ndim == 1 else gradient_by_compliance(alpha, by), rest, tau


def gradient_by_compliance(alpha: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Gradient with respect to A from that by S = A^-1, each (uu, uv, shear, vv), (m, 4)."""
    uu, uv, shear, vv = alpha.T
    S = np.linalg.inv(np.stack([uu, uv, uv, vv], axis=1).reshape(-1, 2, 2))
    B = (by[:, (0, 1, 1, 3)] * (1.0, 0.5, 0.5, 1.0)).reshape(-1, 2, 2)
    A = -S @ B @ S
    return np.stack([A[:, 0, 0], 2.0 * A[:, 0, 1], -by[:, 2] / shear**2, A[:, 1, 1]], axis=1)
