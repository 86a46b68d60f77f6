"""Contacts of surfaces by the implicit midpoint: they act where its steps end. Equations: kernels/selfcontact/prolonged.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.selfcontact import pairs, settle
from wsim.kernels.selfcontact import prolonged as kernels
from wsim.model.stage import MET, Clock, Stage
from wsim.model.structs import filled
from wsim.physics.selfcontact.settle import SWEEPS, Settle

if TYPE_CHECKING:
    from wsim.physics.selfcontact.method import SelfContact


class Prolonged(Settle):
    """Stage prolong, and velocities behind the guarantee. Nothing is done once the midpoint has given way to backward Euler."""

    def __init__(self, method: SelfContact):
        self.motion = method.points.motion           # `wsim.physics.motion.points.Prolonged`
        self.motion.meet()
        super().__init__(method)
        before = next(k for k, stage in enumerate(method.stages) if stage.phase == "solve")
        method.stages.insert(before, Stage("prolong", "solve", self.prolong, 1, 0, what="ends of substeps", frames=MET))

    def make(self, real, module: str) -> dict:
        made = (kernels.gather, kernels.aim, kernels.spread, kernels.strike, settle.combine)
        return {f.__name__: f(real, module) for f in made}

    def room(self) -> None:
        before, t, device = self.capacity, types(self.model.real), self.model.device
        super().room()
        if (n := self.capacity) != before:
            dtypes = dict.fromkeys(("p", "turn", "Q"), t.vec3) | {"sticks": int}
            self.slips = filled(kernels.slips(self.model.real),
                                **{name: wp.zeros(n, dtype=dtype, device=device) for name, dtype in dtypes.items()})

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
        near = self.method.near
        given = [self.method.surfaces.data, self.moving(self.state.v), near.pairs, self.motion.ahead, clock.h]
        self.aims.count.zero_()
        wp.capture_if(near.word(pairs.NEAR), lambda: self.pairs("gather", given, [self.aims, self.slips]))

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
        data, v, sums = self.method.surfaces.data, self.state.v, self.method.near.sums
        self.pairs("aim", [data, self.method.at(), clock.h], [self.aims, self.slips, sums])
        self.add(v)
        for _ in range(SWEEPS):
            self.pairs("spread", [self.aims], [sums])
            self.pairs("strike", [data, self.moving(v), clock.h, self.aims, self.slips], [sums])
            self.add(v)

    def moving(self, v: wp.array):
        """State of the points, with velocities [m/s]."""
        at = self.method.at()
        at.v = v
        return at
