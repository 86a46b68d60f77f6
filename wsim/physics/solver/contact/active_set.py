"""Contacts in Newton steps: an active set of planes and of points that stick, with friction. Equations:
kernels/solver/contact/active_set.py, kernels/solver/contact/friction.py."""

from typing import Any

import warp as wp

from wsim.kernels.solver.contact import active_set as kernels
from wsim.kernels.solver.contact import friction
from wsim.model.ports import NewtonTerm
from wsim.model.stage import Clock
from wsim.physics.solver.assembly import Assembly


class ActiveSet(NewtonTerm):
    """Contacts as a term of Newton steps (`wsim.physics.solver.newton`)."""

    def __init__(self, assembly: Assembly, contacts):
        """contacts: `wsim.physics.contact.contacts.ColliderContacts`."""
        self.assembly, self.contacts, model = assembly, contacts, assembly.model
        factories = {"hold": kernels.active_set_filter_kernel, "clip": kernels.step_clip_kernel,
                     "rub": friction.friction_energy_kernel, "press": friction.contact_reprojection_kernel}
        self.kernels: dict[str, Any] = {name: make(model.real, model.module) for name, make in factories.items()}
        self.kernels["remain"] = kernels.active_set_residual_kernel(model.real, model.module, assembly.springs,
                                                                    assembly.elements)
        self.held = kernels.active_set_structs(model.real).Held()
        self.held.f, self.held.start, self.r = (wp.zeros_like(assembly.f) for _ in range(3))
        self.held.own = wp.zeros_like(assembly.A.own)
        self.A = type(assembly.A)()                        # with friction's drag
        for name in assembly.A._cls.vars:
            setattr(self.A, name, getattr(assembly.A, name))
        self.A.own = self.held.own

    def run(self, name: str, inputs: list, outputs: list, rows: int = 0) -> None:
        model = self.assembly.model
        model.launch(self.kernels[name], rows or model.points, inputs, outputs)

    def at(self, g: float):
        where, m = kernels.active_set_structs(self.assembly.model.real).Where(), self.assembly
        where.d, where.a, where.g = m.state.d, m.points.anchor, g
        return where

    @property
    def tables(self) -> list:
        c = self.contacts
        self.held.push = c.push                          # another array where there was not enough room
        return [c.table, c.points, c.slots]

    def adjust_system(self, g: float, fresh: bool) -> None:
        """Updates the active set after an assembly. fresh: of forces, not of the Newton step before."""
        m = self.assembly
        self.run("hold", [*self.tables, self.at(g), int(fresh), m.f], [m.A, self.held])

    def solve_step(self, clock: Clock, tolerance: float, cap: int) -> bool:
        """The way y of a Newton step, which ends outside of colliders."""
        m, held = self.assembly, self.held
        self.run("remain", [m.rows, self.A, held.start, held.f, held.f, held.f], [self.r])
        self.without(held.start)
        m.system.solve(self.r, tolerance, cap, (m.state.x, m.state.d), self.A)
        self.run("remain", [m.rows, self.A, m.v.y, m.f, self.r, held.f], [self.r])
        self.without(m.v.y)
        self.clamp_step(clock.effective_step, solved=True)
        return True

    def without(self, z: wp.array) -> None:
        """Takes from r what contacts between surfaces make of z."""
        if joined := self.assembly.system.joined:
            joined.subtract(z, self.r)

    def unbalanced_forces(self, f: wp.array) -> wp.array:
        """Forces that planes do not bear [N]."""
        return self.held.f

    def clamp_step(self, g: float, solved: bool = False) -> None:
        """Cuts the way y to what colliders leave of it."""
        m = self.assembly
        slots = self.tables[-1]
        self.run("clip", [slots, self.at(g), int(solved), m.A, self.held, self.r, m.v.y], [m.v.y])

    def extend_line_search(self, trial, g: float, rows: int) -> None:
        """Adds friction to what a line search looks at."""
        m = self.assembly
        c = self.contacts
        self.run("rub", [trial, c.slots, m.A.own, c.push, g, m.state.d, m.points.anchor, m.v.y], [], rows)

    def observe_displacement(self, clock: Clock, g: float = 0.0) -> None:
        """Presses d out of colliders, where it was moved without a look at contacts. g [s]: that of d, if it is another."""
        m, g = self.assembly, g or clock.effective_step
        self.run("press", [*self.tables, g, m.points.anchor], [m.state.d, self.contacts.push])
