"""Contacts of an implicit substep that is solved to a residual, and their adjoints. See kernels/contact/coulomb.py and
kernels/contact/coulomb_adjoint.py."""

import warp as wp

from wsim.kernels.contact import coulomb, coulomb_adjoint
from wsim.kernels.math.real import types
from wsim.model.model import Model
from wsim.model.structs import fill_struct


class ActiveSetAdjoint:
    """The adjoint of contacts of the active set."""

    def __init__(self, model: Model, contacts, after: bool):
        """contacts: `wsim.physics.contact.contacts.ColliderContacts`. after: something is projected behind a solve, and
        contacts once more behind that."""
        self.model, self.contacts, self.after = model, contacts, after
        real, t, n = model.real, types(model.real), model.points
        factories = {"turn": coulomb.contact_step_update_kernel, "bear": coulomb.contact_frame_kernel,
                     "screen": coulomb.preconditioner_filter_kernel,
                     "held_adjoint": coulomb_adjoint.held_contact_adjoint_kernel,
                     "spread_out": coulomb_adjoint.reaction_transpose_kernel}
        if after:
            factories |= {"remainder": coulomb_adjoint.free_remainder_kernel, "joined": coulomb_adjoint.reaction_sum_kernel,
                          "pushed_adjoint": coulomb_adjoint.push_adjoint_kernel}
        self.kernels = {name: factory(real, model.module) for name, factory in factories.items()}
        products = {"taken_back": coulomb_adjoint.free_adjoint_residual, "given": coulomb_adjoint.reaction_cotangent}
        self.kernels |= {name: coulomb_adjoint.contact_frame_product_kernel(formula, real, model.module)
                         for name, formula in products.items()}
        frame = self.frame = coulomb.coulomb_structs(real).Frame()

        def zeros(count, dtype):
            return wp.zeros(count, dtype=dtype, device=model.device)
        frame.S, frame.W, frame.K = (zeros(n, t.mat33) for _ in range(3))
        frame.bears = zeros(self.contacts.push.size, int)
        self.found = zeros(self.contacts.push.size, t.vec3)
        self.left = coulomb.coulomb_structs(real).Left()
        self.left.miss = zeros(n, t.vec3)
        self.by_push: wp.array | None = None             # gradient by the pushes of a solve, which is differentiated next
        self.given = zeros(n * after, t.vec3)            # what they give by forces

    def begin(self) -> None:
        """Begins a substep."""
        self.contacts.push.zero_()
        self.frame.bears.zero_()

    def run(self, name: str, inputs: list, outputs: list) -> None:
        self.model.launch(self.kernels[name], self.model.points, inputs, outputs)

    @property
    def tables(self) -> list:
        c = self.contacts
        return [c.table, c.points, c.slots]

    def state(self, d: wp.array, a: wp.array, b: wp.array, f: wp.array, rate: float):
        found = coulomb.coulomb_structs(self.model.real).State()
        found.d, found.a, found.b, found.f, found.rate = d, a, b, f, rate
        return found

    def bear(self, state, r: wp.array, scale: wp.array, found: bool = False) -> None:
        """The frame of a state, with what is left there (r, `left.miss`), and what that is small beside. found: of a solution
        with the pushes `found`, which are written over."""
        self.left.r, self.left.scale = r, scale
        push = self.found if found else self.contacts.push
        self.run("bear", [*self.tables, state, int(found), self.frame, self.left], [push])

    def turn(self, d: wp.array, a: wp.array, g: float, first: bool = False) -> None:
        """Projects d. first: of what projections have left (kernels/contact/project.py), whose pushes say what sticks."""
        out = fill_struct(coulomb.coulomb_structs(self.model.real).Pushed, push=self.contacts.push, bears=self.frame.bears)
        self.run("turn", [*self.tables, a, g, int(first)], [d, out])

    def screen(self, P: wp.array) -> None:
        self.run("screen", [self.frame.S], [P])

    def grads(self, y: wp.array, by_a: wp.array):
        by, adjoint = coulomb.coulomb_structs(self.model.real).Grads(), self.contacts.adjoint
        by.d, by.n, by.b, by.u, by.friction, by.a = y, adjoint.n, adjoint.b, adjoint.u, adjoint.friction, by_a
        return by

    def pushed(self, state, y: wp.array, by_a: wp.array, by_w: wp.array) -> None:
        """`given` of `by_push`, at the pushes `found` of `bear`; adds gradients by d (y), contacts, friction, a and w."""
        of = coulomb.coulomb_structs(self.model.real).Pushed()
        of.bears, of.push, of.by_push, of.by_w = self.frame.bears, self.found, self.by_push, by_w
        self.run("pushed_adjoint", [*self.tables, state, of, self.grads(y, by_a)], [self.given])

    def back(self, state, v: wp.array, q: wp.array, y: wp.array, by_a: wp.array) -> None:
        """Adds gradients by contacts, friction and a."""
        self.run("held_adjoint", [*self.tables, state, self.frame, v, q, self.grads(y, by_a)], [])
