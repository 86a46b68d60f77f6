"""Cloth, springs, soft bodies by Newton's method and conjugate gradients (Baraff, Witkin 1998): kernels/solver/newton.py,
pcg.py.

An iteration of a substep is one Newton step: forces and Jacobian at d, conjugate gradients to TOLERANCE or CAP iterations, a
line search. d starts where Phi is least of: the prediction b; b and what forces did in the substep before; the place where the
substep began (bodies that nothing holds go on with their momentum from there, see kernels/solver/rigid_translation.py). So Phi
ends below what standing still costs, and backward Euler cannot gain energy, however few steps are taken. Every body is a system
of its own with its own steps: worlds do not see each other.

Contacts and soft pins enter the system (`wsim.physics.contact.active_set`, kernels/solver/soft_pin.py); tethers and strain
limits are projected behind the last step, as many sweeps as there were steps, contacts behind each (so do recordings of
gradients, `wsim.physics.solver.newton_adjoint`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp

from wsim.kernels.cloth import hessian
from wsim.kernels.cloth.constraint import DISTANCE
from wsim.kernels.math.real import types
from wsim.kernels.solver import line_search, newton
from wsim.model.model import Model
from wsim.model.stage import MISSED, UNSOLVED, Clock, Method, Remedy, Stage
from wsim.model.state import Field, State
from wsim.model.status import Status
from wsim.physics.cloth.constraints import Constraints, changed
from wsim.physics.cloth.kind import CORNERS, SHEET, SPRINGS
from wsim.physics.cloth.table import Table, bending_of, tables_of
from wsim.physics.solver import linear
from wsim.physics.solver.line_search import LineSearch

if TYPE_CHECKING:
    from wsim.simulation.methods import Build


TOLERANCE = 1e-2       # of conjugate gradients. 32 x 32 cloth, 4 x 1: error 3.5e-3 m at 0.25 s with 1e-3 and 1e-2, 4.0e-3 with
                       # 3e-2, 5.9e-3 with 1e-1, for 47, 19, 16 and 14 iterations; further Newton steps solve what is left
CAP = 300              # iterations of conjugate gradients: 1e5 N/m at 1/60 s takes them all, and still goes downhill
MET = 0.5              # largest residual with which BDF2 goes on. 32 x 32 cloth, 1e3 N/m, 1 to 8 substeps: runs that left up to
                       # 1.5 were as right as solved ones, with 8 or more not. float32 leaves 1e-3 at best, 0.2 with 1e5 N/m
MET_MIDPOINT = 1e-2    # as MET, for the implicit midpoint, which damps nothing of what is left. Rows of tools/stress (nets
                       # scattered, or in one place) gained energy with 0.1, and did not with this
MET_SDIRK3 = 0.1       # as MET, for sdirk3. A scrambled bar of nu 0.49 stayed so with 0.5, and came back with this


def build(b: Build) -> Implicit:
    return Implicit(b.model, b.state, b.methods["points"], b.status, b.clock, b.kept(soft=True))


def coarse_space(model: Model, h: float) -> tuple[list, str]:
    """Bodies solved with one, and what the plan says about it."""
    from wsim.physics.solver.coarse_space import wanted
    bodies, why = wanted(model, h)
    return bodies, f"; {why}"


class Implicit(Method):
    """Stage newton, and what it reports."""

    def __init__(self, model: Model, state: State, points, status: Status, clock: Clock, rows: list[Constraints]):
        """rows: soft constraints of all bodies."""
        super().__init__("implicit")
        self.model, self.state, self.points, self.status, self.clock = model, state, points, status, clock
        self.every = every = rows
        self.tables = tables_of(model, every)
        self.contact = self.pins = self.adjoint = self.hard = None          # type: Any
        self.free: Any = None                      # `wsim.physics.solver.rigid_translation.Momentum`
        self.soft: Any = None                      # `wsim.physics.solver.soft_pin.SoftPins`
        self.active: Any = None                    # `wsim.physics.contact.active_set.ActiveSet`
        self.solids: list = []
        self.present: Any = list                   # rows, with muscles as they are
        if model.scene.softs:
            from wsim.physics.soft import fem
            self.solids = fem.tables_of(model)
            state.add(*(table.kept for table in self.solids if table.kept))
        self.springs = bool(self.of(SPRINGS))
        self.elements = bool(self.solids or self.of(SHEET) or self.of(CORNERS))
        self.bending = bending_of(model, self.of(SHEET))
        coarse, why = coarse_space(model, self.clock.h) if self.solids else ([], "")
        self.system = linear.System(model, points.constants.w, self.ids(SPRINGS, 2), self.ids(SHEET, 4),
                                    [table.ids for table in (*self.of(CORNERS), *self.solids)], coarse,
                                    self.bending.spans if self.bending else None)
        self.rows, self.A, self.v = self.system.rows, self.system.A, self.system.v
        self.work()
        self.make()
        if model.gradients:
            from wsim.physics.solver.newton_adjoint import ImplicitAdjoint
            self.adjoint = ImplicitAdjoint(self, every)
        what = [f"{b.size} {b.kind}" for b in self.tables.values()] + [f"{t.size} {t.name} {t.noun}" for t in self.solids]
        stage = Stage("newton", "solve", self.iterate, self.launches, self.bytes, "iteration", ", ".join(what) + why)
        self.stages.append(stage)
        if any(s.plastic for s in self.solids):
            size = sum(s.size for s in self.solids if s.plastic)
            self.stages.append(Stage("flow", "deform", self.flow, 1, size * 150, what=f"{size} plastic tets"))

    def of(self, gather: str) -> list[Table]:
        return [table for table in self.tables.values() if table.row.gather == gather]

    def ids(self, gather: str, corners: int) -> np.ndarray:
        return next((table.ids for table in self.of(gather)), np.zeros((0, corners), np.int32))

    def work(self) -> None:
        """Vectors over points, and numbers of each body."""
        model, t = self.model, types(self.model.real)
        over = self.system.zeros
        self.b, self.c, self.f = (over(model.points, t.vec3) for _ in range(3))
        self.state.points.take(Field("c", "m", True, "what forces changed in the substep before (Newton's method)"), self.c)
        self.status.reserve(UNSOLVED, len(model.bodies))
        self.element = hessian.elements_of(model.real)()
        force, block = self.ids(SHEET, 4).size, 0
        for table in (*self.of(CORNERS), *self.solids):
            table.place(force, block)
            corners = table.ids.shape[1]
            force, block = force + corners * table.size, block + corners * (corners - 1) // 2 * table.size
        self.element.block, self.element.force = over(block, t.mat33), over(force, t.vec3)
        if self.bending:
            self.bending.room(self.element)
        self.residual = over(self.system.systems, model.real)

    def make(self) -> None:
        """Kernels."""
        real, module, block = self.model.real, self.model.module, self.model.sweep_module
        self.begin, self.stay, self.end = (f(real, module) for f in (newton.begin, newton.stay, newton.end))
        self.assemble = newton.assemble(real, module, self.springs, self.elements)
        self.stressed = {s.name: s.kernels() for s in self.solids}
        self.left, self.unmet = line_search.left(real, block), line_search.unmet(real, module)
        self.line = LineSearch(self)
        if self.clock.watched:
            self.status.reserve(MISSED)
            from wsim.kernels.solver.xpbd_residual import judge
            self.judge = judge(real, module)

    def spring_tables(self) -> list:
        from wsim.physics.cloth.springs import SpringTable
        table, found = next(iter(self.of(SPRINGS)), None), []
        if self.adjoint and table:
            pull = self.adjoint.pull
            found.append(SpringTable(pull.springs, pull.table.rest, pull.entry, pull.given))
        return found + ([SpringTable(table.rows, table.data.rest, np.arange(table.size), table.given)] if table else [])

    def drive(self, muscles) -> None:
        """The energy is that of the rest lengths that muscles have put."""
        self.present = muscles.present

    def meet(self, others: dict[str, Method]) -> None:
        """Takes contacts and soft pins into the system; tethers and strain limits are projected behind it."""
        pins, contact, hard = (cast(Any, others.get(name)) for name in ("pins", "contact", "xpbd"))
        self.hard, self.contact, self.pins = hard, contact, pins if pins and pins.groups["soft"] else None
        w, starts = self.rows.w.numpy(), self.system.starts
        free = [int(not contact and w[i:j].all()) for i, j in zip(starts[:-1], starts[1:], strict=True)]
        if any(free):
            from wsim.physics.solver.rigid_translation import Momentum
            self.free = Momentum(self, free)
        if self.contact:
            from wsim.physics.contact.active_set import ActiveSet
            self.active = ActiveSet(self, contact)
            contact.give_way(self.active.press if hard else None)
        if self.pins:
            from wsim.physics.solver.soft_pin import SoftPins
            self.soft = SoftPins(self, pins)
        if self.adjoint:
            self.adjoint.join(hard)

    def iterate(self, clock: Clock) -> None:
        """A Newton step; all of them where tethers or limits are projected behind them; of recorded gradients to a residual."""
        if self.adjoint and self.model.tape:
            if clock.i == 0:
                self.model.tape.solve(self.adjoint, clock)
        elif not self.hard:
            self.newton(clock)
        elif clock.i == 0:
            for i in range(clock.iterations):
                clock.i = i
                self.newton(clock)
            clock.i = 0

    def newton(self, clock: Clock) -> None:
        """One Newton step; after the last of a frame, or of any substep of the midpoint, its residual."""
        rate = 1.0 / clock.g
        if clock.i == 0 and clock.k == 0:
            for table in self.solids:
                table.forget()
        if clock.i == 0:
            self.start(clock)
        self.linearise(rate)
        if clock.i == 0 and self.springs:
            self.A.aside.zero_()
        if self.active:
            self.active.hold(clock.g, fresh=clock.i == 0)
            self.active.solve(clock, TOLERANCE, CAP)
        else:
            self.system.solve(self.f, TOLERANCE, CAP, (self.state.x, self.state.d))
            self.carry()
        self.line.search(rate, 0, 1, rubbed=self.active is not None)
        if clock.i == clock.iterations - 1:
            self.model.launch(self.end, self.model.points, [self.state.d, self.b], [self.c])
            if clock.k == clock.substeps - 1 or clock.beyond:      # one unsolved step of the midpoint can gain energy
                self.measure(clock)

    def flow(self, clock: Clock) -> None:
        """Tets beyond their yield, where a step has ended: between the stages of one no body has ever been."""
        for table in (s for s in self.solids if s.plastic and not (clock.staged and clock.k % 2 == 0)):
            table.plastic.flow(self.state.x, self.state.e)

    def start(self, clock: Clock) -> None:
        """d becomes the best of three: the prediction, that and the last step's forces, where the substep began, which is
        looked at when the others are out of colliders: Phi ends below what standing still costs."""
        s, rate = self.state, 1.0 / clock.g
        self.system.count.zero_()
        self.system.drop.zero_()
        self.A.aside.fill_(newton.ASIDE)
        self.prepare(s.d, clock)
        self.line.search(rate, 0)
        if self.active:
            self.active.press(clock)
        self.model.launch(self.stay, self.model.points, [self.rows, s.e, s.d], [self.v.y])
        self.carry()
        if self.active:
            self.active.clip(clock.g)
        self.line.search(rate, 0)

    def prepare(self, d: wp.array, clock: Clock) -> None:
        """own and b of the prediction d, with soft pins."""
        rate = 1.0 / clock.g
        self.model.launch(self.begin, self.model.points, [self.rows, d, self.c, rate], [self.A, self.b, self.v.y])
        if self.soft:
            self.soft.launch(clock.k, rate)

    def carry(self) -> None:
        """y gets what it lacks of the translation of free bodies."""
        if self.free:
            self.free.keep()

    def measure(self, clock: Clock) -> None:
        """What the frame's last Newton step left, and whether an integrator that needs it may go on."""
        self.linearise(1.0 / clock.g)
        if self.active:
            self.active.hold(clock.g, fresh=True)
        f = self.active.held.f if self.active else self.f
        self.system.launch(self.left, [self.points.constants, self.A, self.system.first, f, self.state.d, self.b],
                           [self.residual])
        self.model.launch(self.unmet, self.residual.size, [self.residual, self.status.offset(UNSOLVED)],
                          [self.status.array])
        if clock.watched:
            most = MET_MIDPOINT if clock.beyond else MET_SDIRK3 if clock.staged else MET
            self.model.launch(self.judge, self.residual.size, [self.residual, most], [self.status.word(MISSED)])

    def linearise(self, rate: float) -> None:
        """Forces and Jacobian at d, without contacts."""
        s, a, launch = self.state, self.points.anchor, self.model.launch
        if self.bending:
            self.bending.linearise(s.x, s.d, a, rate, self.element)
        for elements in self.of(CORNERS):
            elements.linearise(s.x, s.d, a, rate, self.element)
        for table in self.solids:
            launch(self.stressed[table.name][0], table.size, [table.data, s.x, s.d, a, table.q, rate], [table.q, self.element])
        springs = self.of(SPRINGS)[0].data if self.springs else hessian.batch_of(DISTANCE, self.model.real)()
        launch(self.assemble, self.model.points, [self.rows, springs, self.element, self.points.at(d=s.d, a=a), self.b, rate],
               [self.f, self.A])

    @property
    def launches(self) -> int:
        """Of a Newton step; conjugate gradients by several blocks take two more an iteration."""
        return (8 + 3 * (self.free is not None) + 2 * len(self.tables) + 3 * len(self.solids)
                + 6 * bool(self.bending) + len(self.of(CORNERS)))

    @property
    def bytes(self) -> int:
        """Moved by one assembly and one iteration of conjugate gradients, when every gather hits the cache once."""
        entries = 2 * (self.A.link.capacity if self.springs else 0) + 2 * (self.A.block.capacity if self.elements else 0)
        return entries + self.model.points * (8 * self.springs + 8 * self.elements + 50 * np.dtype(self.model.dtype).itemsize)

    def retry(self, status: Status) -> list[Remedy]:
        return [Remedy("give way")] if status.said(MISSED)[0] else []

    def indicators(self, x: np.ndarray, v: np.ndarray) -> dict[str, float]:
        """elastic_energy [J]; residual of the frame's last Newton step (kernels/solver/line_search.py, `left`), largest of all
        bodies; pcg_iterations of the last substep, largest of all bodies."""
        from wsim.physics.cloth.table import energy
        solid = self.solids[0].indicators(self.solids, self.state) if self.solids else {}
        stored = energy(self.model, self.present(self.every), self.state) + solid.get("solid_energy", 0.0)
        return {"elastic_energy": stored, **solid, "residual": float(self.residual.numpy().max()),
                "pcg_iterations": float(self.system.count.numpy().max())}

    def set(self, path: str, name: str, value, world: int | None = None) -> bool:
        """stretch, weft, shear, bend, poisson of a cloth, stiffness of a spring net, young [Pa], poisson, pressure [Pa] and
        yield_strain of a soft body, damping [s]; what a rest shape and rest lengths change."""
        own = self.adjoint.pull.tables if self.adjoint else ()
        hit = any([t.set(path, name, value, world) for t in (*self.solids, *own)])
        for table in self.tables.values():
            hit = bool(changed(self.model, table.rows, path, name, value, world)) or hit
            table.refresh()
        if self.adjoint:
            self.adjoint.pull.refresh()
        return hit
