"""Forces and Jacobian of springs, hinges, triangles and tets at displacements d, assembled into one sparse system
(`wsim.physics.solver.linear`) for Newton's method. Equations: kernels/solver/newton.py, kernels/cloth/hessian.py.

What acts beside the forces of bodies (soft pins, contacts, the momentum of what is free) is a `Term`.
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from wsim.kernels.cloth import hessian
from wsim.kernels.math.real import types
from wsim.kernels.solver import newton
from wsim.model.model import Model
from wsim.model.stage import Clock
from wsim.model.state import State
from wsim.physics.cloth.constraints import Constraints, changed
from wsim.physics.cloth.table import Table, bending_of
from wsim.physics.solver import linear

KINDS = ("distance", "dihedral", "membrane")


class Term:
    """What acts in a Newton step beside the forces of bodies. Every hook may stay as it is; all only launch kernels."""

    def prepare(self, clock: Clock) -> None:
        """Adds to own and b of a prediction."""

    def press(self, clock: Clock) -> None:
        """Looks at a d that was moved without it."""

    def hold(self, g: float, fresh: bool) -> None:
        """After an assembly. fresh: of forces, not of the Newton step before."""

    def solve(self, clock: Clock, tolerance: float, cap: int) -> bool:
        """Finds the step y itself; False: it leaves that to the system's own solver."""
        return False

    def carry(self) -> None:
        """Adds to y what the step lacks."""

    def clip(self, g: float) -> None:
        """Takes from y what is not allowed."""

    def rub(self, trial, g: float, rows: int) -> None:
        """Adds to what a line search looks at."""

    def left(self, f: wp.array) -> wp.array:
        """Forces that are not borne, of forces f, after `hold`."""
        return f


class Assembly:
    """The system of all bodies: tables of what has forces, f and the matrix A, and b, where forces would be none.

    v     vectors of the solver: y is the step that is found
    """

    def __init__(self, model: Model, state: State, points, every: list[Constraints], h: float):
        """every: springs, hinges and triangles, of all worlds; h: a substep [s]."""
        self.model, self.state, self.points = model, state, points
        self.tables = {kind: Table(kind, [r for r in every if r.kind == kind], model)
                       for kind in KINDS if any(r.kind == kind for r in every)}
        self.solids: list = []
        if model.scene.softs:
            from wsim.physics.soft.fem import tables_of
            self.solids = tables_of(model)
            state.add(*(table.kept for table in self.solids if table.kept))
        self.springs = "distance" in self.tables
        self.elements = bool(self.solids or self.tables.keys() - {"distance"})
        self.bending = bending_of(model, self.tables.get("dihedral"))
        coarse, self.why = coarse_space(model, h) if self.solids else ([], "")
        self.system = linear.System(model, points.constants.w, self.ids("distance", 2), self.ids("dihedral", 4),
                                    [self.ids("membrane", 3), *(s.ids for s in self.solids)], coarse,
                                    self.bending.spans if self.bending else None)
        self.rows, self.A, self.v = self.system.rows, self.system.A, self.system.v
        self.work()
        self.triangles = hessian.triangles(model.real, model.module) if "membrane" in self.tables else None
        self.assemble = newton.assemble(model.real, model.module, self.springs, self.elements)
        self.stressed = {s.name: s.kernels() for s in self.solids}

    def ids(self, kind: str, corners: int) -> np.ndarray:
        return self.tables[kind].ids if kind in self.tables else np.zeros((0, corners), np.int32)

    def work(self) -> None:
        """Vectors over points, and forces and blocks of elements."""
        model, t, over = self.model, types(self.model.real), self.system.zeros
        self.b, self.f = (over(model.points, t.vec3) for _ in range(2))
        self.element = hessian.elements_of(model.real)()
        hinges, triangles = len(self.ids("dihedral", 4)), len(self.ids("membrane", 3))
        force, block = 4 * hinges + 3 * triangles, 3 * triangles
        for table in self.solids:
            table.place(force, block)
            corners = table.ids.shape[1]
            force, block = force + corners * table.size, block + corners * (corners - 1) // 2 * table.size
        self.element.block, self.element.force = over(block, t.mat33), over(force, t.vec3)
        if self.bending:
            self.bending.room(self.element)

    def forget(self) -> None:
        """Rotations of tets are sought anew."""
        for table in self.solids:
            table.forget()

    def linearise(self, rate: float) -> None:
        """Forces and Jacobian at d, without terms; rate: 1 / g."""
        s, a, launch = self.state, self.points.anchor, self.model.launch
        if self.bending:
            self.bending.linearise(s.x, s.d, a, rate, self.element)
        if self.triangles:
            triangles, offset = self.tables["membrane"], 4 * len(self.ids("dihedral", 4))
            launch(self.triangles, triangles.size, [triangles.data, s.x, s.d, a, rate, offset], [self.element])
        for table in self.solids:
            launch(self.stressed[table.name][0], table.size, [table.data, s.x, s.d, a, table.q, rate], [table.q, self.element])
        springs = self.tables["distance"].data if self.springs else hessian.batch_of("distance", self.model.real)()
        launch(self.assemble, self.model.points, [self.rows, springs, self.element, self.points.at(d=s.d, a=a), self.b, rate],
               [self.f, self.A])

    def solve(self, f: wp.array, tolerance: float, cap: int) -> None:
        """y of A y = f, by conjugate gradients."""
        self.system.solve(f, tolerance, cap, (self.state.x, self.state.d))

    def spring_tables(self) -> list:
        from wsim.physics.cloth.springs import SpringTable
        table = self.tables["distance"]
        return [SpringTable(table.rows, table.data.rest, np.arange(table.size), table.given)]

    def set(self, path: str, name: str, value, world: int | None, own: Sequence = ()) -> bool:
        """A live parameter of a body; own: further tables that have it."""
        hit = any([t.set(path, name, value, world) for t in (*self.solids, *own)])
        for table in self.tables.values():
            if changed(self.model, table.rows, path, name, value, world):
                table.stale = hit = True
            table.refresh()
        return hit

    @property
    def launches(self) -> int:
        """Of an assembly and a line search, of what stands in tables."""
        return 2 * len(self.tables) + 3 * len(self.solids) + 6 * bool(self.bending) + bool(self.triangles)

    @property
    def bytes(self) -> int:
        """Moved by one assembly and one iteration of conjugate gradients, when every gather hits the cache once."""
        entries = 2 * (self.A.link.capacity if self.springs else 0) + 2 * (self.A.block.capacity if self.elements else 0)
        return entries + self.model.points * (8 * self.springs + 8 * self.elements + 50 * np.dtype(self.model.dtype).itemsize)


def coarse_space(model: Model, h: float) -> tuple[list, str]:
    """Bodies solved with one, and what the plan says about it."""
    from wsim.physics.solver.coarse_space import wanted
    bodies, why = wanted(model, h)
    return bodies, f"; {why}"
