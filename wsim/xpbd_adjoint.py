"""Adjoint of the sweeps of `wsim.xpbd`: each leaves its multipliers behind, and is undone. See kernels/xpbd_adjoint.py."""

import numpy as np
import warp as wp

from wsim.cloth import HARD
from wsim.kernels import xpbd_adjoint as kernels
from wsim.kernels.real import types
from wsim.model import Model
from wsim.tape import Tape, adjoint_of


class SweepAdjoint:
    """Of the constraints of one kind."""

    def __init__(self, batch, model: Model):
        """batch: a `wsim.xpbd.Batch`, whose tables are there."""
        self.batch, self.model = batch, model
        self.vec3, self.value = types(model.real).vec3, batch.lam.dtype
        self.kept = batch.kind in ("membrane", "dihedral")
        module = model.sweep_module if batch.fused else model.module
        # Each launch a colour, gradients by x would stream past with every one: they are taken from those by d once a sweep
        self.apart = not (batch.fused or batch.damped or batch.kind in HARD)
        how = batch.kind, model.real, module, batch.damped, self.kept, batch.fused
        self.kernels = kernels.sweep(*how), kernels.sweep_adjoint(*how, not self.apart)
        self.shift = kernels.shift(model.real, module) if self.apart else None
        self.zero, self.back = (wp.zeros(batch.size, dtype=self.value, device=model.device) for _ in range(2))
        self.left = None
        if batch.rest().ndim == 1 and not self.kept and model.real is wp.float32:
            self.left = batch.data.left = wp.empty(batch.size, dtype=model.real, device=model.device)
            self.refresh()
        self.last = self.zero                   # multipliers of the sweep before, while a tape records

    def refresh(self) -> None:
        """What float32 leaves of the rest lengths; of muscles, whose lengths are products, nothing is known."""
        if self.left:
            rest = self.batch.rest()
            self.left.assign((rest - rest.astype(np.float32)) * (self.batch.lengths is None))

    def record(self, tape: Tape, x: wp.array, a: wp.array | None, d: wp.array, clock) -> None:
        """A sweep over all colours, in place of d."""
        batch, rate = self.batch, 1.0 / clock.g
        omega, final = batch.omega(clock), clock.i == clock.iterations - 1
        x, a = tape.read(x), None if a is None else tape.read(a)
        s, g = kernels.seen(self.vec3, self.value)(), kernels.grads(self.vec3, self.value)()
        s.x, s.a, s.lam = x, a, self.zero if clock.i == 0 else self.last
        s.lam_out = tape.slots.plain.take(batch.lam.dtype, batch.lam.shape)
        if self.kept:
            s.kept = tape.slots.plain.take(self.vec3, (self.points, batch.size))
        g.x, g.a, g.lam = x.grad, None if a is None else a.grad, self.back
        self.last = self.zero if batch.kind in HARD else s.lam_out

        def forward(version: wp.array) -> None:
            s.d = version
            self.launch(self.kernels[0], [batch.data, s], rate, omega)

        def backward(work: wp.array, grad: wp.array) -> None:
            if final:
                self.back.zero_()
            s.d, g.d = work, grad
            if self.apart:
                self.gain(grad, -1.0, x.grad)
            self.launch(self.kernels[1], [batch.data, adjoint_of(batch.data), s, g], rate, omega, -1)
            if self.apart:
                self.gain(grad, 1.0, x.grad)
        tape.within(d, forward, backward)

    def gain(self, grad: wp.array, sign: float, into: wp.array) -> None:
        how: dict = {"block_dim": self.model.block} if self.model.device.is_cuda else {}
        wp.launch(self.shift, self.model.points, [grad, sign, into], device=self.model.device, **how)

    @property
    def points(self) -> int:
        """Points of a constraint."""
        return self.batch.rows[0].ids.shape[1]

    def launch(self, kernel, tables: list, rate: float, omega: float, way: int = 1) -> None:
        """Of all colours, in their order or against it."""
        batch, more = self.batch, [rate, omega]
        if batch.fused:
            self.model.sweep(kernel, [*tables, batch.first, 0, *more], [])
            return
        device, sizes = self.model.device, list(enumerate(batch.starts[1:] - batch.starts[:-1]))
        how: dict = {"block_dim": self.model.block} if device.is_cuda else {}
        for number, size in sizes[::way]:                # not by the model, whose tape would take each colour for itself
            wp.launch(kernel, int(size), [*tables, batch.first, number, *more], device=device, **how)
