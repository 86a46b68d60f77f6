"""Adjoints of a recorded search for contacts and of their projections. See kernels/contact_adjoint.py."""

from dataclasses import dataclass

import warp as wp

from wsim.kernels import contact_adjoint as kernels
from wsim.kernels.real import types
from wsim.model import Model
from wsim.tape import Tape


@dataclass
class Found:
    """A recorded search: substep, the arrays that it has read, and how often its contacts were projected since."""

    k: int
    read: list[wp.array]
    projected: int = 0


class ContactAdjoint:
    """Of convex colliders. Lists are not kept: the search runs once more, of the same arrays, before the first adjoint that
    wants them."""

    def __init__(self, contacts, model: Model):
        """contacts: `wsim.contact.contacts.Contacts`."""
        self.contacts, self.model, self.real = contacts, model, model.real
        self.kernels = [make(contacts.kinds, model.real, model.module)
                        for make in (kernels.search_adjoint, kernels.project_adjoint)]
        t, n = types(model.real), model.points
        size = contacts.push.size

        def zeros(count, dtype):
            return wp.zeros(count, dtype=dtype, device=model.device)
        self.n, self.b, self.u, self.push = zeros(size, t.vec3), zeros(size, t.scalar), zeros(size, t.vec3), zeros(size, t.vec3)
        self.d, self.a, self.friction = zeros(n, t.vec3), zeros(n, t.vec3), zeros(n, t.vec2)
        self.wanted = zeros(1, int)
        self.found: Found | None = None

    def searched(self, k: int, x: wp.array, d: wp.array, a: wp.array):
        """What a tape takes as the adjoint of the search that is launched next."""
        tape: Tape = self.model.tape
        found = self.found = Found(k, [tape.read(x), tape.read(d), tape.read(a)])

        def backward(read: list, wrote: list) -> None:
            if not found.projected:
                self.again(found)
            (_, points, x, d, _, k), (slots, d_out, a_out, push_out, *_) = read, wrote
            push_out.grad.zero_()                            # pushes begin at zero
            o = self.gradients()
            o.x, o.d, o.d_out, o.a_out = x.grad, d.grad, d_out.grad, a_out.grad
            at = kernels.read(self.real)()
            at.x, at.d = x, d
            self.model.launch(self.kernels[0], self.contacts.count, [self.contacts.table, points, slots, at, o, k], [])
        return backward

    def projected(self):
        """What a tape takes as the adjoint of the projection that is launched next."""
        found = self.found
        assert found is not None
        found.projected += 1
        number = found.projected

        def backward(read: list, wrote: list) -> None:
            if number == found.projected:                    # the first of its substep, backwards
                self.again(found)
            (table, points, slots, d, a, push, g), (d_out, push_out) = read, wrote
            o = self.gradients()
            o.d_out, o.push_out, o.d, o.a, o.push = d_out.grad, push_out.grad, d.grad, a.grad, push.grad
            at = kernels.read(self.real)()
            at.d, at.a, at.push = d, a, push
            self.model.launch(self.kernels[1], self.contacts.count, [table, points, slots, at, o, g], [])
        return backward

    def gradients(self):
        o = kernels.grads(self.real)()
        o.n, o.b, o.u, o.friction = self.n, self.b, self.u, self.friction
        return o

    def again(self, found: Found) -> None:
        """The contacts of that search, with gradients that are zero."""
        c = self.contacts
        self.model.launch(c.search_kernel, c.count, [c.table, c.points, *found.read, found.k],
                          [c.slots, self.d, self.a, self.push, None, self.wanted])
        for array in (self.n, self.b, self.u):
            array.zero_()
