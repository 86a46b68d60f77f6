"""Contacts of surfaces by the implicit midpoint: they act where its steps end. Equations: kernels/selfcontact/prolonged.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import pairs, settle
from wsim.kernels.selfcontact import prolonged as kernels
from wsim.model.stage import MET, Clock, Stage
from wsim.physics.selfcontact.settle import Settle

if TYPE_CHECKING:
    from wsim.physics.selfcontact.method import SelfContact


class Prolonged(Settle):
    """Stage prolong, and velocities behind the guarantee. Nothing is done once the midpoint has given way to backward Euler."""

    def __init__(self, method: SelfContact):
        self.motion = method.points.motion           # `wsim.physics.motion.points.Prolonged`
        self.motion.meet()
        super().__init__(method)
        self.extends = True
        before = next(k for k, stage in enumerate(method.stages) if stage.phase == "solve")
        method.stages.insert(before, Stage("prolong", "solve", self.prolong, 1, 0, what="ends of substeps", frames=MET))

    def make(self, real, module: str) -> dict:
        made = (kernels.gather, kernels.aim, kernels.strike, settle.lacking, settle.combine)
        return {f.__name__: f(real, module) for f in made} | {"spread": settle.spread(real, module, 1)}

    def rows(self) -> dict:
        return super().rows() | dict.fromkeys(("along", "turn", "whole", "ahead"), types(self.model.real).vec3)

    def asked(self, clock: Clock) -> bool:
        return clock.integrator.beyond

    def expected(self, clock: Clock):
        at = self.method.at()
        if self.asked(clock):
            at.d, more = self.motion.ahead, self.motion.more
            self.combine(1.0 + more, self.state.d, -more, self.state.e, at.d)
        return at

    def prolong(self, clock: Clock) -> None:
        if self.asked(clock):
            self.motion.prolong(clock)

    def gather(self, clock: Clock) -> None:
        """Behind the sweeps of a substep: pairs that push, and what moment their pushes are short of."""
        if not self.asked(clock):
            return
        method, near = self.method, self.method.near
        given = [method.surfaces.data, method.at(), near.pairs, self.motion.ahead, self.state.v, clock.h]
        self.aims.count.zero_()
        wp.capture_if(near.word(pairs.NEAR), lambda: self.pairs("gather", given, [self.aims]))

    def settle(self, clock: Clock) -> None:
        """Behind the guarantee: v gets what contacts have changed, then what impulses do."""
        if not self.asked(clock):
            return
        s, rate = self.state, 1.0 / clock.h
        self.combine(1.0, s.v, rate, s.d, s.v)
        self.combine(1.0, s.v, -rate, self.motion.ahead, s.v)
        wp.capture_if(self.aims.count, lambda: self.even(clock))

    def even(self, clock: Clock) -> None:
        """Velocities of pairs that push are those of their motions."""
        method, v = self.method, self.state.v
        self.pairs("aim", [method.surfaces.data, method.at(), clock.h], [self.aims, method.near.sums])
        self.add(v)
        self.sweep(v)

    def strike(self, v: wp.array, more: int) -> None:
        near, at = self.method.near, self.method.at()
        at.v = v
        self.pairs("strike", [self.method.surfaces.data, at, self.clock.h, self.aims, more, near.words], [near.sums])
