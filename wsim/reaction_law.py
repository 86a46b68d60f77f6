"""The law of the material at the end of a frame, f(x, v), and products with its derivatives: what `wsim.reaction_adjoint` is
made of. Tables are those of the solver, whose gradients are added to; XPBD has no forces, and gets some (`reaction_xpbd`).
"""

import numpy as np
import warp as wp

from wsim.force_adjoint import Forces
from wsim.reaction_xpbd import Beside


class Law:
    """Of a `wsim.recording.Recording`."""

    def __init__(self, recording):
        plan, pull = recording.plan, recording.parameters.pull
        self.beside = None if pull else Beside(plan)
        self.pull = self.beside.pull if self.beside else pull
        model = self.model = self.pull.model
        module = model.module if self.beside else f"{model.module}_reactions"
        self.forces = Forces(model, self.pull, module)
        self.p = wp.zeros_like(self.forces.f)
        wp.load_module(module, device=model.device, block_dim=model.block if model.device.is_cuda else None)

    def zero(self) -> None:
        """Gradients that are its own."""
        if self.beside:
            self.beside.zero()

    def evaluate(self, x: wp.array, e: wp.array | None, v: wp.array) -> np.ndarray:
        """f [N], (points, 3), of springs and elements at x + e with velocities v."""
        f, n = self.forces, self.model.points
        if self.beside:
            self.pull.refresh()
        wp.copy(f.x, x)
        f.pair.zero_()
        if e is not None:
            wp.copy(f.pair, e, 0, 0, n)
        wp.copy(f.pair, v, 2 * n, 0, n)
        f.evaluate()
        return f.f.numpy().astype(np.float64)

    def transposed(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(df/dx)^T p and (df/dv)^T p, (points, 3), where f was evaluated last; by all else into its gradients."""
        f, n = self.forces, self.model.points
        self.p.assign(p.astype(self.model.dtype))
        f.x.grad.zero_()
        f.transposed(self.p, True)
        return f.x.grad.numpy().astype(np.float64), f.pair.grad.numpy()[2 * n:3 * n].astype(np.float64)

    def by_batches(self) -> dict[int, np.ndarray]:
        """What XPBD's tables get, by address."""
        return self.beside.by_batches() if self.beside else {}
