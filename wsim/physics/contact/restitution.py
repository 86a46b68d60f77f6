"""Colliders that throw points back: a stage after the last iteration of contacts. Equations: kernels/contact/restitution.py."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.contact import restitution as kernels
from wsim.model.model import Model
from wsim.model.stage import Clock, Methods, Stage
from wsim.model.state import SimulationState
from wsim.model.vjp import beside


class RestitutionStage:
    """Restitution of the contacts of a plan."""

    def __init__(self, model: Model, state: SimulationState, points, contacts, prolonged=None):
        """points: the method that owns gravity and the anchor; contacts: `wsim.physics.contact.contacts.ColliderContacts`;
        prolonged: of an integrator that goes on to the end of a step, `wsim.physics.contact.prolonged.MidpointContacts`."""
        self.model, self.state, self.points, self.contacts = model, state, points, contacts
        real, module, n = model.real, model.module, model.points
        rows, m, multistep = contacts.rows, points.integrator, contacts.struck is not None
        values = np.array([c.restitution for c in rows.colliders])
        values = np.tile(values[:, None], (1, n)) if model.gradients else values[rows.collider, None]
        self.restitution = wp.array(values, dtype=real, device=model.device, requires_grad=model.gradients)
        self.copies: Any = None                          # of an explicit integrator: which copy it predicts from, and all
        self.before, self.thrown = state.v, None         # velocity before this substep; who was thrown in it
        self.free = m.explicit and len(m.steps) != 1     # symplectic Euler goes as backward Euler does, in a straight line
        self.kernel = (kernels.explicit_restitution_kernel if self.free else kernels.implicit_restitution_kernel)(real, module)
        beside(model, type(contacts).__module__, "ReadingAdjoint", contacts, self.kernel)
        self.prolonged, self.beyond = prolonged, kernels.prolonged_restitution_kernel(real, module) if prolonged else None
        self.spare = kernels.impact_kick_kernel(real, module) if len(m.steps) == 2 else None
        self.normal = wp.zeros_like(state.v) if self.free else None
        self.surfaces = False                            # True: their sweeps come behind the last iteration
        self.own: Any = None                             # anchors that points were thrown by, where they are settled once more
        self.stages = [Stage("bounce", "solve", self.first, 1, n * 12 * state.v.strides[0], what="points that hit")]
        if multistep or prolonged or not (self.free or m.g):
            self.before = wp.zeros_like(state.v)
            self.stages.append(Stage("before", "pose", self.keep, 1, 2 * n * state.v.strides[0], what="velocities"))
        if multistep:
            self.thrown, self.renew_kernel = wp.zeros_like(contacts.struck), kernels.history_after_impact_kernel(real, module)
            self.stages.append(Stage("renew", "finish", self.renew, 1, n * 4, what="points that were thrown: history"))

    def set_value(self, rows: list[int], objects: list[int], value: float) -> None:
        """Gives rows of colliders among these objects another restitution."""
        values = self.restitution.numpy()
        if self.model.gradients:
            for o in objects:
                values[np.array(rows) % len(values), self.model.bodies[o].first:self.model.bodies[o].last] = value
        else:
            values[rows] = value
        self.restitution.assign(values)

    def of(self, row: int, point: int) -> float:
        """Restitution of a row for a point."""
        values = self.restitution.numpy()
        return float(values[row % values.shape[0], point % values.shape[1]])

    def connect_ports(self, others: Methods) -> None:
        """Takes what an explicit integrator predicts, and its last half kick."""
        self.copies = others.ports.predicted_copies
        if self.spare:
            others.ports.before_half_kick.append(self.passed)
        if (surfaces := others.ports.self_contact) is not None:
            self.surfaces = not surfaces.within
            if self.thrown is not None:
                self.own, self.stand = (wp.zeros_like(self.points.anchor),
                                        kernels.impact_anchor_kernel(self.model.real, self.model.module))

    def keep(self, clock: Clock) -> None:
        """Keeps the velocity before anything changes it."""
        self.model.copy(self.before, self.state.v)

    def renew(self, clock: Clock) -> None:
        """Renews what is kept after a substep of a multistep integrator."""
        s = self.state
        self.model.launch(self.renew_kernel, self.model.points, [self.points.constants, self.thrown, s.v, clock.h], [s.s, s.u])

    def behind(self, clock: Clock) -> bool:
        """True where it comes behind the sweeps of surfaces, which project contacts again, and would take back what it throws;
        of a step that goes on to its end they have nothing left to take."""
        return self.surfaces and not (self.prolonged and self.prolonged.asked(clock))

    def first(self, clock: Clock) -> None:
        if not self.behind(clock):
            self.launch(clock)

    def settled(self, settle: Callable[[Clock], None], clock: Clock) -> None:
        """Settles contacts once more; who was thrown keeps the anchor."""
        if self.thrown is None:
            return settle(clock)
        self.model.copy(self.own, self.points.anchor)
        settle(clock)
        self.model.launch(self.stand, self.model.points, [self.thrown, self.own], [self.points.anchor])

    def launch(self, clock: Clock) -> None:
        """Launches the restitution after the last iteration."""
        s, c, table = self.state, self.contacts, kernels.bounce_type(self.model.real)()
        table.restitution, table.h, table.g = self.restitution, clock.h, clock.effective_step
        d, a = s.d, self.points.anchor
        if self.prolonged and self.prolonged.asked(clock):
            at = c.read(v=self.before, d=d, a=a, push=c.push)
            self.model.launch(self.beyond, c.count, [table, self.points.constants, c.slots, at],
                              [d, s.v, c.push, self.prolonged.rest])
            return
        if self.free:
            table.source, pair = self.copies()
            table.bend = 2.0 if self.points.integrator.order > 1 else 1.0
            at = c.read(e=s.e, d=d, a=a, push=c.push)
            inputs, outputs = [table, c.slots, at, pair], [d, a, c.push, self.normal]
        else:
            at = c.read(v=self.before, e=a if self.thrown is None else s.e, d=d, a=a, push=c.push)
            inputs = [table, self.points.constants, c.slots, at]
            outputs = [d, a, c.push, self.thrown]
        self.model.launch(self.kernel, c.count, inputs, outputs)

    def passed(self, change: wp.array) -> None:
        """Launches what comes before leapfrog's last half kick."""
        self.model.launch(self.spare, self.model.points, [change, self.normal], [change])
