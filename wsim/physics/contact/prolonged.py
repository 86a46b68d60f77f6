"""Contacts with colliders by the implicit midpoint: they hold where its steps end. Equations: kernels/contact/prolonged.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from wsim.kernels.contact import prolonged as kernels
from wsim.kernels.math.real import types
from wsim.model.stage import Clock, Methods, Stage
from wsim.model.state import StateField

if TYPE_CHECKING:
    from wsim.physics.contact.method import ContactMethod


class MidpointContacts:
    """What stands around the solution of a substep. Nothing is done once the midpoint has given way to backward Euler.

    ended   d, a and contacts are those of the end of the substep
    rest    what contacts have given beyond P / h [m/s], of each slot"""

    def __init__(self, contact: ContactMethod):
        self.contact, self.contacts, self.state, model = contact, contact.contacts, contact.state, contact.model
        self.model, self.points, self.motion = model, contact.points, contact.points.motion
        part, (real, module), t = self.motion.row.nodes[0], (model.real, model.module), types(model.real)
        factories = {"reach": kernels.end_displacement_kernel, "begin": kernels.prolonged_contact_kernel,
                     "end": kernels.prolonged_end_kernel}
        self.kernels = {name: factory(real, module, part) for name, factory in factories.items()}
        self.kernels["even"] = kernels.prolonged_velocity_kernel(real, module)
        self.motion.meet()
        self.ended = self.surfaces = False
        self.d = wp.zeros(model.points, dtype=t.vec3, device=model.device)
        self.was, now = (wp.zeros(model.points, dtype=t.vec4, device=model.device) for _ in range(2))
        kept = StateField("w", "m/s", True,
                          "velocity of the surface of the collider that a point touched alone, and its row + 1", "vec4")
        self.now = self.state.points.take(kept, now)
        self.room()
        size = model.points * self.state.x.strides[0]
        self.stage = Stage("ends", "solve", self.end, 2, 12 * size, what="points, where substeps end; impulses of contacts")

    def room(self) -> None:
        """An array for as many contacts as there is room for; not captured."""
        self.rest = wp.zeros_like(self.contacts.push)

    def connect_ports(self, others: Methods) -> None:
        self.surfaces = others.ports.self_contact is not None

    def asked(self, clock: Clock) -> bool:
        return clock.integrator.beyond

    def launch(self, name: str, inputs: list, outputs: list) -> None:
        self.model.launch(self.kernels[name], self.model.points, inputs, outputs)

    def reach(self) -> wp.array:
        """Displacements that are predicted where the substep ends [m]."""
        self.launch("reach", [self.state.e, self.state.d], [self.d])
        return self.d

    def search(self, clock: Clock) -> None:
        """Contacts where the substep ends, as they are where it is solved for."""
        c, s, a = self.contacts, self.state, self.contact.anchor
        c.search(clock.k, s.x, self.reach(), a, clock.loop)
        self.launch("begin", [c.slots, c.read(e=s.e, d=s.d, a=a), self.now], [s.d, a, self.was, self.now])
        self.ended = False

    def end(self, clock: Clock) -> None:
        """d, v and contacts go on to the end of the substep, and velocities lose what contacts do not throw back."""
        if not self.asked(clock):
            return
        c, s, a = self.contacts, self.state, self.contact.anchor
        at = c.read(v=s.v, e=s.e, d=s.d, a=a, push=c.push)
        self.launch("end", [c.slots, self.points.constants.w, at, clock.effective_step, int(self.surfaces)], [at, self.rest])
        self.ended = True
        self.even(s.v)

    def even(self, v: wp.array) -> None:
        """Velocities v [m/s] behind contacts, as far as they have pushed by now."""
        c = self.contacts
        self.launch("even", [c.table, c.points, c.slots, c.read(v=v, push=c.push), self.was],
                    [v, self.rest, self.now])
