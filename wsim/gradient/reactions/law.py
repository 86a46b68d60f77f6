"""The law of the material at the end of a frame, f(x, v), and products with its derivatives: what
`wsim.gradient.reactions.adjoint` is made of. Tables are those of the solver, whose gradients are added to; XPBD has no forces,
and gets some (`reaction_xpbd`). Muscles have the factors of that time, and tets the shapes at rest that they flowed to. The
air: kernels/cloth/air.py.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from wsim.gradient.reactions.xpbd import ForcesBesideTape
from wsim.model import kernel_cache
from wsim.model.tape import add_and_clear_gradient, adjoint_of, without_gradient
from wsim.physics.motion.forces_adjoint import Forces


class ReactionLaw:
    """The law of elastic forces of a `wsim.gradient.recording.Recording`."""

    def __init__(self, recording):
        plan, pull = recording.plan, recording.parameters.pull
        self.beside = None if pull else ForcesBesideTape(plan)
        self.pull = self.beside.pull if self.beside else pull
        model = self.model = self.pull.model
        module = model.module if self.beside else f"{model.module}_reactions"
        self.forces = Forces(model, self.pull, module)
        self.p = wp.zeros_like(self.forces.f)
        muscles: Any = plan.ports.muscles
        self.muscles = ContractedSprings(muscles, self.pull) if muscles and self.pull.springs else None
        self.blown = AirOnTriangles(plan) if plan.ports.wind else None
        self.flowed = [FlowedShapes(recording, t.plastic) for t in self.pull.tables if t.plastic]
        kernel_cache.load_kernel_module(module, model.device, model.block if model.device.is_cuda else None)

    def zero(self) -> None:
        """Gradients that are its own."""
        if self.beside:
            self.beside.zero()
        if self.muscles:
            self.muscles.zero()

    def evaluate(self, frame: int, x: wp.array, e: wp.array | None, v: wp.array, time: float) -> np.ndarray:
        """f [N], (points, 3), of springs, elements and air at x + e with velocities v, after so many frames of the recording,
        at `time` [s]."""
        f, n = self.forces, self.model.points
        if self.beside:
            self.pull.refresh()
        if self.muscles:
            self.muscles.put(time)
        for flowed in self.flowed:
            flowed.put(frame)
        wp.copy(f.x, x)
        f.pair.zero_()
        if e is not None:
            wp.copy(f.pair, e, 0, 0, n)
        wp.copy(f.pair, v, 2 * n, 0, n)
        self.still(f.evaluate)
        return f.f.numpy().astype(np.float64) + (self.blown.evaluate(x, v) if self.blown else 0.0)

    def transposed(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(df/dx)^T p and (df/dv)^T p, (points, 3), where f was evaluated last; by all else into its gradients."""
        f, n = self.forces, self.model.points
        self.p.assign(p.astype(self.model.dtype))
        f.x.grad.zero_()
        f.transposed(self.p, True)
        if self.muscles:
            self.muscles.take()
        for flowed in self.flowed:
            flowed.take()
        by = f.x.grad.numpy().astype(np.float64), f.pair.grad.numpy()[2 * n:3 * n].astype(np.float64)
        more = self.blown.transposed(p) if self.blown else (0.0, 0.0)
        return by[0] + more[0], by[1] + more[1]

    def still(self, evaluate: Callable) -> None:
        """Tets do not flow because somebody looks, and their rotations, sought from none, are then as they were."""
        tables = [t for t in self.pull.tables if t.q]
        before = [(t, t.flows, wp.clone(t.q)) for t in tables]
        for t in tables:
            t.flows = False
            t.q.zero_()
        evaluate()
        for t, flows, q in before:
            t.flows = flows
            wp.copy(t.q, q)

    def by_batches(self) -> dict[int, np.ndarray]:
        """Gradients of XPBD's tables, by address."""
        return self.beside.by_batches() if self.beside else {}

    def by_keys(self) -> list[np.ndarray]:
        """Gradients with respect to the curves of muscles, as `wsim.physics.cloth.nets.muscles.Muscles.by_keys`."""
        return self.muscles.by if self.muscles else []


class ContractedSprings:
    """Springs of a `wsim.physics.motion.forces.ForceGather` as muscles have them at one time."""

    def __init__(self, muscles, pull):
        self.muscles, self.site, model = muscles, muscles.site(pull.springs, pull.table.rest, pull.entry), pull.model
        self.by: list[np.ndarray] = []
        pull.lengths = self.site.rest                    # where `Pull.refresh` writes, and gradients by rest lengths are
        self.factor = wp.ones((1, muscles.groups + 1), dtype=model.real, device=model.device, requires_grad=True)

    def zero(self) -> None:
        self.by = [np.zeros(m.curve.values.shape) for m in self.muscles.muscles]

    def put(self, time: float) -> None:
        self.time = time
        self.factor.assign(self.muscles.muscle_factors(time)[None].astype(self.muscles.model.dtype))
        self.muscles.shorten(self.site, self.factor, 0)

    def take(self) -> None:
        """Takes the derivatives with respect to the lengths."""
        self.site.adjoint.hand(self.muscles.launch, self.factor, 0)
        self.by = [a + b for a, b in zip(self.by, self.muscles.keyed(self.factor, [self.time]), strict=True)]


class FlowedShapes:
    """Rest shapes of plastic tets of a table, after a frame."""

    def __init__(self, recording, plastic):
        """plastic: a `wsim.physics.soft.plastic.PlasticFlow`."""
        self.recording, self.plastic = recording, plastic
        self.F = wp.zeros_like(plastic.F, requires_grad=True)

    def put(self, frame: int) -> None:
        number = next(k for k, (array, _) in enumerate(self.recording.flowed) if array.ptr == self.plastic.F.ptr)
        wp.copy(without_gradient(self.F), self.recording.shapes[number][frame])
        self.plastic.shape_from_flow(self.F)

    def take(self) -> None:
        """Passes from the derivatives by edges at rest to those by shapes, which the frame before hands on."""
        self.plastic.adjoint.shape(self.F)
        add_and_clear_gradient(self.F.grad, next(r.carried for r in self.recording.roots if r.base.ptr == self.plastic.F.ptr))


class AirOnTriangles:
    """Forces of the air on triangles, in arrays of their own."""

    def __init__(self, plan):
        self.model, self.air = plan.model, plan.ports.wind
        vec3, device = plan.state.x.dtype, self.model.device

        def zeros_with_gradient(count: int, dtype) -> wp.array:
            return wp.zeros(count, dtype=dtype, device=device, requires_grad=True)
        self.x, self.v, self.still = (zeros_with_gradient(self.model.points, vec3) for _ in range(3))
        self.force, self.k = zeros_with_gradient(self.air.k.size, vec3), zeros_with_gradient(self.air.k.size, self.model.real)
        self.read = [self.air.triangle, self.air.ended, self.x, self.still, self.v, 1.0]
        self.corners = self.air.triangle.numpy()

    def evaluate(self, x: wp.array, v: wp.array) -> np.ndarray:
        """[N], (points, 3)."""
        wp.copy(without_gradient(self.x), x)
        wp.copy(without_gradient(self.v), v)
        self.model.launch(self.air.press, self.k.size, self.read, [self.force, self.k])
        each = np.repeat(self.force.numpy().astype(np.float64), 3, axis=0)
        return np.stack([np.bincount(self.corners.ravel(), each[:, k], self.model.points) for k in range(3)], axis=1)

    def transposed(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transposed derivative as of `ReactionLaw`; by the air into the gradients of its table."""
        for array in (self.x, self.v, self.still, self.k):
            array.grad.zero_()
        self.force.grad.assign(p[self.corners].sum(axis=1).astype(self.model.dtype))
        wrote = [self.force, self.k]
        wp.launch(self.air.press, self.k.size, self.read, wrote, adj_inputs=[adjoint_of(a) for a in self.read],
                  adj_outputs=[a.grad for a in wrote], adjoint=True, device=self.model.device,
                  **({"block_dim": self.model.block} if self.model.device.is_cuda else {}))
        return self.x.grad.numpy().astype(np.float64), self.v.grad.numpy().astype(np.float64)
