"""Velocities of BDF2, leapfrog and Runge-Kutta steps behind contacts of surfaces. Equations:
kernels/contact/selfcontact/velocity_solve.py."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.contact.selfcontact import pairs, rows, velocity_solve
from wsim.kernels.math.real import types
from wsim.model.structs import PlacedStruct

if TYPE_CHECKING:
    from wsim.model.stage import Clock, Methods
    from wsim.physics.contact.selfcontact.method import SelfContactMethod

SWEEPS = 12            # fewer leave more of a bounce; momentum is kept by any number


class VelocitySolve:
    """memory: of a multistep integrator; halved: of one that is read behind half a kick, or lags by as much
    where a contact lasts. Neither: nothing is done."""

    def __init__(self, method: SelfContactMethod):
        self.method, self.model, self.state = method, method.model, method.state
        self.clock = method.clock
        m = self.clock.integrator
        self.memory, self.halved = m.memory > 0.0, m.lags
        self.capacity = 0
        self.kernels = self.make_kernels(self.model.real, self.model.module)
        self.aims_at = PlacedStruct(velocity_solve.aim_type(self.model.real), self.model.device)
        self.aims_at.put(count=wp.zeros(1, dtype=int, device=self.model.device))
        if self.kernels:
            self.room()

    def make_kernels(self, real, module: str) -> dict:
        """Kernels by name, and arrays of points; none where nothing is to be done."""
        if not (self.memory or self.halved):
            return {}
        factories = {"gather": velocity_solve.pair_aim_kernel, "spread": velocity_solve.aim_weight_kernel,
                     "strike": velocity_solve.aim_sweep_kernel, "combine": velocity_solve.combination_kernel}
        found = {name: factory(real, module) for name, factory in factories.items()}
        if self.memory:
            found |= {"aim": velocity_solve.motion_aim_kernel(real, module),
                      "lacking": velocity_solve.lacking_velocity_kernel(real, module)}
        if self.halved:
            found["give"] = velocity_solve.aim_impulse_kernel(real, module)
        n, vec3 = self.method.surfaces.total, types(real).vec3
        self.v, self.given, self.lasting = (wp.zeros(n, dtype=vec3, device=self.model.device) for _ in range(3))
        if self.clock.integrator.stages:
            found["stand"] = velocity_solve.sustained_contact_kernel(real, module)
            self.went = [wp.zeros(n, dtype=vec3, device=self.model.device) for _ in range(2)]
        return found

    def room(self) -> None:
        """Arrays for so many pairs as the list has room for; not captured."""
        if not self.kernels or self.capacity == self.method.near.capacity:
            return
        t, device = types(self.model.real), self.model.device
        n = self.capacity = self.method.near.capacity
        scalars = ("aim", "least", "most", "q", "swept", "keep")
        dtypes = {"ids": wp.vec4i, "b": t.vec4, "n": t.vec3, **dict.fromkeys(scalars, t.scalar)}
        self.aims_at.put(**{name: wp.zeros(n, dtype=dtype, device=device) for name, dtype in dtypes.items()})
        self.aims.count.zero_()

    @property
    def aims(self):
        """The pairs that push."""
        return self.aims_at.struct

    def connect_ports(self, others: Methods) -> None:
        if self.halved and (port := others.ports.before_half_kick) is not None:
            port.append(self.half)
            self.earlier = others.ports.earlier_change

    @property
    def staged(self) -> bool:
        """True for Runge-Kutta steps, more than one in a frame: what stands on colliders is read by how it moves."""
        return bool(self.clock.integrator.stages) and self.clock.substeps > 1

    def pairs(self, name: str, inputs: list, outputs: list) -> None:
        threads = self.method.near.threads
        self.model.launch(self.kernels[name], threads, [*inputs, threads], outputs)

    def combine(self, a: float, x: wp.array, b: float, y: wp.array, out: wp.array, colliders: bool = False) -> None:
        """out = a x + b y, of points of surfaces. colliders: of theirs, too."""
        s = self.method.surfaces
        count = len(s.points) if colliders else s.own["points"]
        self.model.launch(self.kernels["combine"], count, [s.data.point, a, x, b, y], [out])

    def add(self, v: wp.array) -> None:
        method = self.method
        point = method.surfaces.data.point
        self.model.launch(method.guarantee.add, len(point), [point, v, 1, method.near.sums], [v])

    def sweep(self, v: wp.array) -> None:
        """Sweeps; by BDF2 more of them while a pair lacks much."""
        self.sweeps(v, SWEEPS, False)
        if self.memory:
            self.look(v, 1)
            wp.capture_while(self.method.near.word(pairs.NEARER), lambda: self.more(v))

    def more(self, v: wp.array) -> None:
        self.sweeps(v, rows.MORE, True)
        self.look(v, 0)

    def look(self, v: wp.array, first: int) -> None:
        """Launches the test whether sweeps go on."""
        near = self.method.near
        near.word(pairs.NEARER).zero_()
        self.pairs("lacking", [v, self.aims_at.at, self.clock.h, first], [near.words])
        self.method.go_on()

    def sweeps(self, v: wp.array, count: int, leads: bool) -> None:
        w, near = self.method.surfaces.data.w, self.method.near
        for k in range(count):
            self.pairs("spread", [self.aims_at.at], [near.sums])
            self.pairs("strike", [w, v, self.aims_at.at, k if leads else -1, near.words], [near.sums])
            self.add(v)

    def expected(self, clock: Clock):
        """State of the points where a substep begins, with the way that they are expected to go."""
        return self.method.at()

    def ahead_of(self, clock: Clock) -> float:
        """How far a substep goes, over where it is solved for."""
        return 1.0

    def asked(self, clock: Clock) -> bool:
        """True for a substep behind which velocities are settled, and the one before it."""
        return self.memory or self.halved and clock.k >= clock.substeps - 2

    def gather(self, clock: Clock) -> None:
        """Behind the sweeps of a substep: pairs that push, and what they have given."""
        if not self.asked(clock):
            return
        near = self.method.near
        self.aims.count.zero_()
        back = -clock.effective_step if self.memory else 2.0 * clock.h
        wp.capture_if(near.word(pairs.NEAR), lambda: self.pairs("gather", [near.table, back], [self.aims_at.at]))
        if self.halved:
            self.given.zero_()
            self.pairs("give", [self.method.surfaces.data, self.method.at(), self.aims_at.at, 2.0], [near.sums])
            self.add(self.given)
            self.combine(1.0, self.given, -1.0 / clock.h, self.state.d, self.given)

    def settle(self, clock: Clock) -> None:
        """Behind the guarantee."""
        if not self.asked(clock):
            return
        s = self.state
        if self.halved:
            last = clock.k == clock.substeps - 1
            self.combine(1.0, self.given, 1.0 / clock.h, s.d, self.given if last else self.lasting)
            if self.staged:
                self.combine(1.0, s.d, -1.0, s.e, self.went[last])
        else:
            wp.capture_if(self.aims.count, lambda: self.forget(clock))

    def forget(self, clock: Clock) -> None:
        """No history across a contact: the anchor that gives such velocities, and the velocity before."""
        s, v, at, g = self.state, self.v, self.method.at(), clock.effective_step
        strands = self.method.strands
        sweep = partial(strands.settled, sweep=self.sweep) if strands else lambda v, past: self.sweep(v)
        self.pairs("aim", [at, clock.h], [self.aims_at.at])
        self.combine(1.0 / g, at.d, -1.0 / g, at.a, v, colliders=True)
        sweep(v, past=False)
        self.combine(1.0, s.d, -g, v, self.method.points.anchor)
        self.pairs("aim", [at, clock.h], [self.aims_at.at])
        self.combine(1.0, s.v, 0.0, s.v, v)
        sweep(v, past=True)
        self.combine(1.0, v, 0.0, v, s.v)

    def half(self, change: wp.array) -> None:
        """Behind leapfrog's last half kick; change: what others changed velocities by in the last substep."""
        if self.clock.free:
            return
        if self.method.strands:
            self.method.strands.kick.zero_()
        self.combine(1.0, change, -1.0, self.given, change)
        if self.clock.substeps > 1:
            earlier = self.earlier()
            self.combine(1.0, earlier, -1.0, self.lasting, earlier)
        wp.capture_if(self.aims.count, self.take)
        if self.staged:
            before, now = self.went
            self.combine(1.5 / self.clock.h, now, -0.5 / self.clock.h, before, before)
            data, v = self.method.surfaces.data, self.state.v
            self.model.launch(self.kernels["stand"], self.method.surfaces.own["points"],
                              [data.point, before, earlier, v, change], [v, change])

    def take(self) -> None:
        """Contacts take back their part of the kick."""
        s = self.state
        self.combine(1.0, s.v, -1.0, s.b, self.v)
        if self.method.strands:
            self.method.strands.still(self.v)            # no kick, but their part of what contacts take back
        self.pairs("give", [self.method.surfaces.data, self.method.at(), self.aims_at.at, 1.0], [self.method.near.sums])
        self.add(self.v)
        self.sweep(self.v)
        self.combine(1.0, s.b, 1.0, self.v, s.v)
        if self.method.strands:
            self.method.strands.read(self.v)
