"""Rigid bodies in Newton steps of points. Equations: kernels/rigid/touch/lean.py."""

import warp as wp

from wsim.kernels.rigid.touch import lean
from wsim.model.ports import NewtonTerm
from wsim.model.stage import Clock, Remedy
from wsim.model.state import StateField
from wsim.physics.solver.rigid_translation import momentum_term

KEPT = (StateField("J", "N s", True, "impulse that points had of a body in the last substep (Newton's method)"),
        StateField("T", "N m s", True, "its moment"))

UNFORESEEN = "bodies under points went otherwise"        # status word
MOST = 0.25              # part of what points change of a body's velocity that may not have been foreseen
SLOW = 0.5               # [m/s] that is added to that: what is slower comes right in the substeps that follow
STEPS = 32               # Newton steps in a substep, at most



class ForeseenBodies(NewtonTerm):
    """The places where bodies will be when a Newton step is done."""

    def __init__(self, touch, assembly, lanes: int):
        """touch: `wsim.physics.rigid.touch.points.BodyPointContacts`; lanes: threads that sum over a system."""
        self.touch, self.assembly, model = touch, assembly, touch.model
        factories = {"lean": lean.newton_star_kernel, "recall": lean.previous_impulse_kernel, "owe": lean.owed_push_kernel,
                     "given": lean.unpushed_way_kernel, "keep": lean.kept_impulse_kernel, "miss": lean.foresight_error_kernel}
        self.kernels = {name: factory(model.real, model.module) for name, factory in factories.items()}
        self.V, self.missed = wp.zeros_like(touch.V), wp.zeros_like(touch.left)
        self.P, self.y = wp.zeros_like(assembly.A.P), wp.zeros_like(assembly.f)
        self.momentum = momentum_term(assembly, lanes)

    def run(self, name: str, dim: int, inputs: list, outputs: list) -> None:
        self.touch.model.launch(self.kernels[name], dim, inputs, outputs)

    def adjust_system(self, g: float, fresh: bool) -> None:
        """Keeps the blocks before contacts filter them."""
        self.touch.model.copy(self.P, self.assembly.A.P)

    def recall(self, clock: Clock) -> None:
        """Moves planes, behind a search, as the impulses of the substep before say."""
        touch, kept = self.touch, self.touch.rigid.part.arrays
        if touch.stars:
            touch.stars.recall(kept["J"], kept["T"])
        else:
            self.run("recall", len(touch.rigid.bodies), [touch.rows, touch.hubs, kept["J"], kept["T"]], [touch.V])
        touch.tell(clock)

    def lean(self, clock: Clock) -> None:
        """Lets planes give way behind a Newton step that is not the last."""
        touch = self.touch
        contacts, at = touch.contacts, touch.points(clock)
        self.run("lean", touch.room_for, [contacts.table, touch.shapes.of, contacts.slots, at, self.P, touch.V], [touch.rows])
        touch.solve(clock, 1.0, clock.h, clock.effective_step)
        touch.tell(clock)

    def owe(self, clock: Clock) -> None:
        """Gives points what bodies owe them, behind the last Newton step."""
        touch, own = self.touch, self.assembly
        wp.copy(self.V, touch.V)
        own.linearise(1.0 / clock.effective_step)
        if own.system.joined:
            own.system.joined.bear(own.f)
        self.run("owe", touch.model.points, [touch.shapes.of, touch.contacts.slots, touch.points(clock), own.f],
                 [touch.contacts.push])

    def miss(self) -> None:
        """Judges, behind the last contacts, whether bodies went as foreseen."""
        touch = self.touch
        self.run("miss", len(touch.rigid.bodies), [touch.hubs, touch.found, touch.V, self.V, SLOW, MOST],
                 [self.missed, touch.status.word(UNFORESEEN)])

    def find_remedies(self, clock: Clock) -> list[Remedy]:
        """Twice the Newton steps, up to STEPS."""
        def double_newton_steps() -> str:
            clock.iterations *= 2
            return ("bodies under points went otherwise than Newton steps had foreseen, and there are "
                    f"{clock.iterations} of them in a substep from here on")
        missed = self.touch.status.said(UNFORESEEN)[0] and clock.iterations <= STEPS // 2
        return [Remedy("grow", double_newton_steps)] if missed else []

    def balance(self, clock: Clock) -> None:
        """Balances momentum, behind the last contacts: what nothing outside holds has the momentum that its pushes say,
        whatever is not solved."""
        if self.momentum:
            touch = self.touch
            self.run("given", touch.model.points, [touch.contacts.slots, touch.points(clock), self.assembly.A.own], [self.y])
            self.momentum.add(self.y, self.assembly.state.d)

    def keep(self) -> None:
        kept = self.touch.rigid.part.arrays
        self.run("keep", len(self.touch.rigid.bodies), [self.touch.found], [kept["J"], kept["T"]])
