"""Cloth, springs, soft bodies by Newton's method and conjugate gradients (Baraff, Witkin 1998): kernels/solver/newton.py,
pcg.py.

An iteration of a substep is one Newton step: forces and Jacobian at d, conjugate gradients to TOLERANCE or CAP iterations, a
line search. d starts where Phi is least of: the prediction b; b and what forces did in the substep before; the place where the
substep began (bodies that nothing holds go on with their momentum from there, see kernels/solver/rigid_translation.py). So Phi
ends below what standing still costs, and backward Euler cannot gain energy, however few steps are taken. Every body is a system
of its own with its own steps: worlds do not see each other.

Contacts and soft pins enter the system (`wsim.physics.solver.contact.active_set`, kernels/motion/soft_pins/soft_pin.py), and so
do contacts of surfaces, which make one system of a world where surfaces are near
(`wsim.physics.contact.selfcontact.rows.newton_rows`); tethers and strain limits are projected behind the last step, as many
sweeps as there were steps, contacts behind each (so do recordings of gradients, `wsim.physics.solver.newton_adjoint`). Substeps
of the implicit midpoint take further steps until their residual is met (`wsim.physics.solver.further`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.math.real import types
from wsim.kernels.solver import newton
from wsim.model.model import Model
from wsim.model.ports import NewtonTerm
from wsim.model.stage import MISSED, Clock, Method, Methods, Ports, Remedy, Stage
from wsim.model.state import SimulationState, StateField
from wsim.model.status import FrameStatus
from wsim.model.vjp import beside
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.solver.assembly import Assembly
from wsim.physics.solver.line_search import LineSearch
from wsim.physics.solver.residual import Residual

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


TOLERANCE = 1e-2       # of conjugate gradients. 32 x 32 cloth, 4 x 1: error 3.5e-3 m at 0.25 s with 1e-3 and 1e-2, 4.0e-3 with
                       # 3e-2, 5.9e-3 with 1e-1, for 47, 19, 16 and 14 iterations; further Newton steps solve what is left
CAP = 300              # iterations of conjugate gradients: 1e5 N/m at 1/60 s takes them all, and still goes downhill


def build(b: Build) -> Implicit:
    return Implicit(b.model, b.state, b.ports.points, b.status, b.clock, b.kept(soft=True))


class Implicit(Method):
    """Stage newton. `terms` is the port where others enter a Newton step."""

    sweeps: Any = None                             # before each step, where some bodies meet others as balls

    def __init__(self, model: Model, state: SimulationState, points, status: FrameStatus, clock: Clock,
                 rows: list[Constraints]):
        """rows: soft constraints of all bodies."""
        super().__init__("implicit")
        self.model, self.state, self.every, self.terms = model, state, rows, list[NewtonTerm]()
        self.assembly = own = Assembly(model, state, points, self.every, clock.h)
        if any(body.meets_as_balls for body in model.scene.bodies()):
            from wsim.physics.solver.contact.pushed import NewtonSweeps
            self.sweeps = NewtonSweeps(own)
        self.c = own.system.zeros(model.points, types(model.real).vec3)
        state.points.take(StateField("c", "m", True, "what forces changed in the substep before (Newton's method)"), self.c)
        self.kernels = {f.__name__: f(model.real, model.step_modules[0]) for f in (newton.begin, newton.stay, newton.end)}
        self.line, self.residual = LineSearch(own), Residual(own, status, clock)
        self.further: Any = None                   # `wsim.physics.solver.further.Further`
        if clock.integrator.beyond:
            from wsim.physics.solver.further import Further
            self.further = Further(self)
        self.behind = False                        # something is projected behind the last step
        self.present: Any = list                   # rows, with muscles as they are
        self.adjoint = beside(model, __name__, "ImplicitAdjoint", self, self.every)
        self.offer()
        self.by_world = not (self.assembly.solids or self.adjoint)
        what = [f"{b.size} {b.kind}" for b in own.tables.values()] + [f"{t.size} {t.name} {t.noun}" for t in own.solids]
        stage = Stage("newton", "solve", self.iterate_newton, 8 + own.launches, own.bytes, "iteration",
                      ", ".join(what) + own.why)
        self.stages.append(stage)
        if any(s.plastic for s in own.solids):
            size = sum(s.size for s in own.solids if s.plastic)
            self.stages.append(Stage("flow", "deform", self.flow, 1, size * 150, what=f"{size} plastic tets"))

    def offer(self) -> None:
        own = self.assembly
        self.offers = Ports(constraint_rows=self.every, tet_tables=own.solids, newton_tables=list(own.tables.values()),
                            newton_assembly=own, newton_terms=self.terms, line_search_lanes=self.line.lanes,
                            newton_sweeps=self.sweeps)
        if self.adjoint:
            self.offers.force_gather, self.offers.solve_adjoint = self.adjoint.pull, self.adjoint
        if own.springs:
            before = self.adjoint.spring_tables if self.adjoint else list
            self.offers.spring_tables = lambda: [*before(), *own.spring_tables()]

    def connect_ports(self, others: Methods) -> None:
        """Tethers and strain limits are projected behind the last step; muscles give rest lengths."""
        self.behind = bool(others.ports.xpbd_batches or others.ports.shape_matching)
        if muscles := others.ports.muscles:
            self.present = muscles.present
        if not others.ports.contacts:
            from wsim.physics.solver.rigid_translation import momentum_term
            if (term := momentum_term(self.assembly, self.line.lanes)):
                self.terms.append(term)

    def iterate_newton(self, clock: Clock) -> None:
        """A Newton step; all of them where tethers or limits are projected behind them; of recorded gradients to a residual."""
        if self.adjoint and self.model.tape:
            if clock.i == 0:
                self.model.tape.solve(self.adjoint, clock)
        elif not self.behind:
            self.newton(clock)
        elif clock.i == 0:
            for i in range(clock.iterations):
                clock.i = i
                self.newton(clock)
            clock.i = 0

    def newton(self, clock: Clock) -> None:
        """One Newton step; after the last of a frame, or of any substep of the midpoint, its residual, and what that takes."""
        own = self.assembly
        if clock.i == 0 and clock.k == 0:
            own.forget()
        if self.sweeps:
            self.sweeps.run(clock)
        if clock.i == 0:
            self.start(clock)
        self.assemble(clock, clock.i == 0)
        self.step(clock)
        if clock.i == clock.iterations - 1:
            for term in self.terms:
                term.take_further_steps(clock, lambda: self.again(clock), lambda: self.residual.measure(clock, self.terms))
            beyond = clock.integrator.beyond       # one unsolved step of the midpoint can gain energy: it takes further ones
            if clock.k == clock.substeps - 1 or beyond:
                self.residual.measure(clock, self.terms)
                if beyond and self.further:
                    self.further.go(clock)
                self.residual.say(clock)
            for term in self.terms:
                term.end_solve(clock)
            self.model.launch(self.kernels["end"], self.model.points, [self.state.d, own.b], [self.c])

    def assemble(self, clock: Clock, first: bool) -> None:
        """The system at d. first: of a substep."""
        own = self.assembly
        own.linearise(1.0 / clock.effective_step)
        if first and own.springs:
            own.A.aside.zero_()
        for term in self.terms:
            term.adjust_system(clock.effective_step, fresh=first)

    def again(self, clock: Clock) -> None:
        """A further Newton step."""
        self.assemble(clock, False)
        self.step(clock)

    def step(self, clock: Clock, stand: Callable[[], None] | None = None) -> None:
        """The way y of a Newton step that is assembled, and as far along it as Phi says. stand: takes y from who needs none."""
        own = self.assembly
        if not any(term.solve_step(clock, TOLERANCE, CAP) for term in self.terms):
            own.solve(own.f, TOLERANCE, CAP)
        self.complete_step()
        if stand:
            stand()
        self.line.search(1.0 / clock.effective_step, 0, 1, terms=self.terms)

    def flow(self, clock: Clock) -> None:
        """Tets beyond their yield, where a step has ended: between the stages of one no body has ever been."""
        for table in (s for s in self.assembly.solids if s.plastic and clock.ends):
            table.plastic.flow(self.state.x, self.state.e)

    def start(self, clock: Clock) -> None:
        """d becomes the best of three: the prediction, that and the last step's forces, where the substep began, which is
        looked at when the others are out of colliders: Phi ends below what standing still costs."""
        s, own, rate = self.state, self.assembly, 1.0 / clock.effective_step
        own.system.count.zero_()
        own.system.drop.zero_()
        own.A.aside.fill_(newton.ASIDE)
        self.add_prediction(s.d, clock)
        self.line.search(rate, 0)
        for term in self.terms:
            term.observe_displacement(clock)
        self.stay(clock)
        self.line.search(rate, 0)
        for term in self.terms:
            term.begin_solve(clock, lambda: self.stay(clock), self.line)

    def stay(self, clock: Clock) -> None:
        """y becomes the way back to where the substep began."""
        s, own = self.state, self.assembly
        self.model.launch(self.kernels["stay"], self.model.points, [own.rows, s.e, s.d], [own.v.y])
        self.complete_step()
        for term in self.terms:
            term.clamp_step(clock.effective_step)

    def add_prediction(self, d, clock: Clock) -> None:
        """own and b of the prediction d, with soft pins."""
        own = self.assembly
        self.model.launch(self.kernels["begin"], self.model.points, [own.rows, d, self.c, 1.0 / clock.effective_step],
                          [own.A, own.b, own.v.y])
        for term in self.terms:
            term.add_to_prediction(clock)

    def complete_step(self) -> None:
        """y gets what it lacks of the translation of free bodies."""
        for term in self.terms:
            term.complete_step()

    def find_remedies(self, status: FrameStatus) -> list[Remedy]:
        return [Remedy("give way")] if status.said(MISSED)[0] else []

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """elastic_energy [J]; residual of the frame's last Newton step (kernels/solver/line_search.py, `left`), largest of all
        bodies; pcg_iterations of the last substep, largest of all bodies."""
        from wsim.physics.cloth.table import stored_energy
        solids = self.assembly.solids
        solid = solids[0].indicators(solids, self.state) if solids else {}
        stored = stored_energy(self.model, self.present(self.every), self.state) + solid.get("solid_energy", 0.0)
        return {"elastic_energy": stored, **solid, "residual": float(self.residual.array.numpy().max()),
                "pcg_iterations": float(self.assembly.system.count.numpy().max())}

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """stretch, weft, shear, bend, poisson of a cloth, stiffness of a spring net, young [Pa], poisson, pressure [Pa] and
        yield_strain of a soft body, damping [s]; what a rest shape and rest lengths change."""
        hit = self.assembly.set_value(path, name, value, world, self.adjoint.pull.tables if self.adjoint else ())
        if self.adjoint:
            self.adjoint.pull.refresh()
        return hit
