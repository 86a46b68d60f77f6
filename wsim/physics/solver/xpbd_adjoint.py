"""Adjoint of the sweeps of `wsim.physics.solver.xpbd`: each leaves its multipliers behind, and is undone. See
kernels/solver/xpbd_adjoint.py."""

import numpy as np
import warp as wp

from wsim.geometry.topology import incident_rows
from wsim.kernels.cloth.constraint import distance_constraint
from wsim.kernels.math.real import types
from wsim.kernels.solver import xpbd_adjoint as kernels
from wsim.model.model import Model
from wsim.model.tape import Tape, adjoint_of, without_gradient


class TargetAdjoint:
    """The adjoint of the angles at rest that hinges are swept to: see kernels/cloth/curvature_adjoint.py."""

    def __init__(self, batch, model: Model):
        """batch: as that of `SweepAdjoint`, of hinges."""
        from wsim.kernels.cloth import curvature
        from wsim.kernels.cloth import curvature_adjoint as bent
        self.batch, self.model, real, module, vec3 = batch, model, model.real, model.module, types(model.real).vec3
        ids = np.concatenate([r.ids for r in batch.rows])[batch.order]
        begin, item = incident_rows(ids.reshape(-1, 1), model.points)
        self.begin, self.item = model.upload(begin.astype(np.int32), int), model.upload(item, int)
        self.swept = s = bent.swept_hinges(real)()
        s.rest, s.by_rest, s.by_target = batch.lengths, batch.lengths.grad, batch.data.rest.grad
        s.corners, s.rates = (wp.zeros(ids.size, dtype=vec3, device=model.device) for _ in range(2))
        how = real, module, batch.damped
        self.seeds, self.back, self.moved = (bent.target_seed_kernel(*how), bent.target_adjoint_kernel(*how),
                                             bent.point_adjoint_kernel(*how))
        self.sums, self.values = (curvature.curvature_sum_kernel(real, module, both=True),
                                  bent.curvature_adjoint_kernel(real, module))

    def backward(self, x: wp.array, d: wp.array, a: wp.array | None, rate: float, by_d: wp.array) -> None:
        """Passes from the gradients with respect to the targets of what stands at x + d to all others, to which it adds."""
        batch, cur, s = self.batch, self.batch.curvature, self.swept
        read = [batch.data, without_gradient(x), d, None if a is None else without_gradient(a), rate, cur.data, s]
        by_a = None if a is None else a.grad
        self.launch(self.seeds, batch.size, read)
        self.launch(self.sums, cur.triangles, [cur.data])
        self.launch(self.back, batch.size, [*read, adjoint_of(batch.data)])
        self.launch(self.values, cur.triangles, [cur.data, adjoint_of(cur.data)])
        self.launch(self.moved, self.model.points, [self.begin, self.item, s.corners, s.rates, x.grad, by_d, by_a])

    def launch(self, kernel, dim: int, inputs: list) -> None:
        how: dict = {"block_dim": self.model.block} if self.model.device.is_cuda else {}
        wp.launch(kernel, dim, inputs, device=self.model.device, **how)


class SweepAdjoint:
    """The adjoint of the constraints of one kind."""

    def __init__(self, batch, model: Model):
        """batch: a `wsim.physics.solver.xpbd.ColouredBatch`, whose tables are there."""
        self.batch, self.model = batch, model
        self.vec3, self.value = types(model.real).vec3, batch.lam.dtype
        self.kept = batch.row.equation.formula is not distance_constraint
        module = model.sweep_module if batch.fused else model.module
        # Each launch a colour, gradients by x would stream past with every one: they are taken from those by d once a sweep
        self.apart = not (batch.fused or batch.damped or batch.hard)
        how = batch.row.equation, model.real, module, batch.damped, self.kept, batch.fused
        self.kernels = kernels.recorded_sweep_kernel(*how), kernels.sweep_adjoint(*how, not self.apart)
        self.shift = kernels.gradient_shift_kernel(model.real, module) if self.apart else None
        self.zero, self.back = (wp.zeros(batch.size, dtype=self.value, device=model.device) for _ in range(2))
        self.left = None
        if batch.rest().ndim == 1 and not self.kept and model.real is wp.float32:
            self.left = batch.data.left = wp.empty(batch.size, dtype=model.real, device=model.device)
            self.refresh()
        self.aimed = TargetAdjoint(batch, model) if batch.curvature else None
        self.last = self.zero                   # multipliers of the sweep before, while a tape records

    def refresh(self) -> None:
        """Sets again the rounding remainders of the rest lengths in float32; of muscles, whose lengths are products, nothing
        is known."""
        if self.left:
            rest = self.batch.rest()
            self.left.assign((rest - rest.astype(np.float32)) * (self.batch.lengths is None))

    def record(self, tape: Tape, x: wp.array, a: wp.array | None, d: wp.array, clock) -> None:
        """A sweep over all colours, in place of d."""
        batch, rate = self.batch, 1.0 / clock.effective_step
        omega, final = batch.omega(clock), clock.i == clock.iterations - 1
        x, a = tape.read(x), None if a is None else tape.read(a)
        s, g = kernels.sweep_states(self.vec3, self.value)(), kernels.sweep_gradients(self.vec3, self.value)()
        s.x, s.a, s.lam = x, a, self.zero if clock.i == 0 else self.last
        s.lam_out = tape.slots.plain.take(batch.lam.dtype, batch.lam.shape)
        if self.kept:
            s.kept = tape.slots.plain.take(self.vec3, (self.points, batch.size))
        targets = batch.data.rest
        kept = tape.slots.plain.take(targets.dtype, targets.shape) if self.aimed else None
        g.x, g.a, g.lam = x.grad, None if a is None else a.grad, self.back
        self.last = self.zero if batch.hard else s.lam_out

        def run_recorded_sweep(version: wp.array) -> None:
            s.d = version
            if kept:
                before, self.model.tape = self.model.tape, None
                batch.aim(x, version, a, rate)
                self.model.tape = before
                wp.copy(kept, without_gradient(targets))
            self.launch(self.kernels[0], [batch.data, s], rate, omega)

        def run_sweep_adjoint(work: wp.array, grad: wp.array) -> None:
            if final:
                self.back.zero_()
            s.d, g.d = work, grad
            if kept:
                wp.copy(without_gradient(targets), kept)
                targets.grad.zero_()
            if self.apart:
                self.gain(grad, -1.0, x.grad)
            self.launch(self.kernels[1], [batch.data, adjoint_of(batch.data), s, g], rate, omega, -1)
            if self.apart:
                self.gain(grad, 1.0, x.grad)
            if self.aimed:
                self.aimed.backward(x, work, a, rate, grad)
        tape.within(d, run_recorded_sweep, run_sweep_adjoint)

    def gain(self, grad: wp.array, sign: float, into: wp.array) -> None:
        how: dict = {"block_dim": self.model.block} if self.model.device.is_cuda else {}
        wp.launch(self.shift, self.model.points, [grad, sign, into], device=self.model.device, **how)

    @property
    def points(self) -> int:
        """Points of a constraint."""
        return self.batch.rows[0].ids.shape[1]

    def launch(self, kernel, tables: list, rate: float, omega: float, way: int = 1) -> None:
        """Launches all colours, in their order or against it."""
        batch, more = self.batch, [rate, omega]
        if batch.fused:
            self.model.sweep(kernel, [*tables, batch.begin, 0, *more], [])
            return
        device, sizes = self.model.device, list(enumerate(batch.starts[1:] - batch.starts[:-1]))
        how: dict = {"block_dim": self.model.block} if device.is_cuda else {}
        for number, size in sizes[::way]:                # not by the model, whose tape would take each colour for itself
            wp.launch(kernel, int(size), [*tables, batch.begin, number, *more], device=device, **how)
