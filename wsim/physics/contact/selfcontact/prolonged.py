"""Contacts of surfaces by the implicit midpoint: they act where its steps end. Equations:
kernels/contact/selfcontact/prolonged.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import warp as wp

from wsim.kernels.contact.selfcontact import pairs, velocity_solve
from wsim.kernels.contact.selfcontact import prolonged as kernels
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.model.stage import MET, Clock, Stage
from wsim.model.structs import PlacedStruct, fill_struct
from wsim.physics.contact.selfcontact.velocity_solve import SWEEPS, VelocitySolve

if TYPE_CHECKING:
    from wsim.physics.contact.selfcontact.method import SelfContactMethod


class MidpointContacts(VelocitySolve):
    """Stage prolong, and velocities behind the guarantee. Nothing is done once the midpoint has given way to backward Euler."""

    def __init__(self, method: SelfContactMethod):
        motion: Any = method.points.motion           # `wsim.physics.motion.points.ProlongedEuler`
        self.colliders = method.prolonged            # `wsim.physics.contact.prolonged.MidpointContacts`, or None
        self.motion = motion
        self.motion.meet()
        if not self.colliders:
            self.motion.surfaces()
        self.slips_at = PlacedStruct(kernels.slip_type(method.model.real), method.model.device)
        super().__init__(method)
        surfaces, t, device = method.surfaces, types(self.model.real), self.model.device
        self.ahead = wp.zeros(surfaces.total, dtype=t.vec3, device=device)     # d before surfaces act on it [m]
        self.v = wp.zeros(surfaces.total, dtype=t.vec3, device=device) if surfaces.state else self.state.v
        before = next(k for k, stage in enumerate(method.stages) if stage.phase == "solve")
        method.stages.insert(before, Stage("prolong", "solve", self.prolong, 1, 0, what="ends of substeps", frames=MET))

    def make_kernels(self, real, module: str) -> dict:
        factories = {"gather": kernels.pushing_pair_kernel, "aim": kernels.wanted_velocity_kernel,
                     "spread": kernels.push_weight_kernel, "strike": kernels.push_sweep_kernel,
                     "combine": velocity_solve.combination_kernel}
        return {name: factory(real, module) for name, factory in factories.items()}

    def room(self) -> None:
        before, t, device = self.capacity, types(self.model.real), self.model.device
        super().room()
        if (n := self.capacity) != before:
            dtypes = dict.fromkeys(("p", "turn", "Q"), t.vec3) | {"sticks": int}
            self.slips_at.put(**{name: wp.zeros(n, dtype=dtype, device=device) for name, dtype in dtypes.items()})

    def asked(self, clock: Clock) -> bool:
        return clock.integrator.beyond

    def ahead_of(self, clock: Clock) -> float:
        return 1.0 + self.motion.more if self.asked(clock) else 1.0

    def expected(self, clock: Clock):
        at = self.method.at()
        if not self.asked(clock):
            return at
        more = self.motion.more
        if self.method.surfaces.state:                                         # what colliders do is known to the end
            self.combine(1.0, at.d, 0.0, at.d, self.ahead, colliders=True)
        self.combine(1.0 + more, self.state.d, -more, self.state.e, self.ahead)
        return self.state_of(d=self.ahead)

    def state_of(self, **others: wp.array):
        """State of all points, with other arrays."""
        at = self.method.at()
        return fill_struct(point_states(self.model.real), **{"x": at.x, "e": at.e, "d": at.d, "a": at.a} | others)

    def prolong(self, clock: Clock) -> None:
        """Colliders have done so before, where there are some."""
        if not self.asked(clock):
            return
        if self.colliders:
            self.combine(1.0, self.state.d, 0.0, self.state.d, self.ahead)
        else:
            self.motion.prolong(clock, self.ahead)

    def speeds(self) -> wp.array:
        """Velocities of all points, of colliders those that they go by."""
        if self.method.surfaces.state:
            at, rate = self.method.at(), 1.0 / self.method.clock.h
            self.combine(rate, at.d, -rate, at.e, self.v, colliders=True)
            self.combine(1.0, self.state.v, 0.0, self.state.v, self.v)
        return self.v

    def gather(self, clock: Clock) -> None:
        """Behind the sweeps of a substep: pairs that push, and what moment their pushes are short of."""
        if not self.asked(clock):
            return
        near = self.method.near
        given = [self.method.surfaces.data, self.state_of(v=self.speeds()), near.table, self.ahead, clock.h]
        self.aims.count.zero_()
        wp.capture_if(near.word(pairs.NEAR), lambda: self.pairs("gather", given, [self.aims_at.at, self.slips_at.at]))

    def settle(self, clock: Clock) -> None:
        """Behind the guarantee: v gets what contacts have changed, then what impulses do."""
        if not self.asked(clock):
            return
        s, rate = self.state, 1.0 / clock.h
        self.combine(1.0, s.v, rate, s.d, s.v)
        self.combine(1.0, s.v, -rate, self.ahead, s.v)
        wp.capture_if(self.aims.count, lambda: self.even(clock))
        if self.colliders:
            self.colliders.even(s.v)

    def even(self, clock: Clock) -> None:
        """Velocities of pairs that push are those of their motions, and colliders bear what they are given."""
        data, v, sums, h = self.method.surfaces.data, self.speeds(), self.method.near.sums, clock.h
        self.pairs("aim", [data, self.method.at(), h], [self.aims_at.at, self.slips_at.at, sums])
        self.add(v)
        for _ in range(SWEEPS):
            if self.colliders:
                self.colliders.even(v)
            self.pairs("spread", [self.aims_at.at], [sums])
            self.pairs("strike", [data, self.state_of(v=v), h, self.aims_at.at, self.slips_at.at], [sums])
            self.add(v)
        if self.method.surfaces.state:
            self.combine(1.0, v, 0.0, v, self.state.v)
