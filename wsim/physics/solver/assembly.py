"""Forces and Jacobian of springs, hinges, triangles and tets at displacements d, assembled into one sparse system
(`wsim.physics.solver.linear`) for Newton's method. Equations: kernels/solver/newton.py, kernels/cloth/hessian.py.

What acts beside the forces of bodies (soft pins, contacts, the momentum of what is free) is a
`wsim.model.ports.NewtonTerm`.
"""

from collections.abc import Iterable, Sequence

import numpy as np
import warp as wp

from wsim.kernels.cloth import hessian
from wsim.kernels.cloth.constraint import DISTANCE
from wsim.kernels.math.real import types
from wsim.kernels.solver import newton
from wsim.model.model import Model
from wsim.model.state import SimulationState
from wsim.physics.cloth.constraints import Constraints, apply_live_value
from wsim.physics.cloth.kind import CORNERS, SHEET, SPRINGS
from wsim.physics.cloth.table import ConstraintTable, bending_of, constraint_tables
from wsim.physics.solver import linear
from wsim.scene.methods import has_tets


class Assembly:
    """The system of all bodies: tables of what has forces, f and the matrix A, and b, where forces would be none.

    v     vectors of the solver: y is the step that is found
    """

    def __init__(self, model: Model, state: SimulationState, points, every: list[Constraints], h: float):
        """every: springs, hinges and triangles, of all worlds; h: a substep [s]."""
        self.model, self.state, self.points = model, state, points
        self.tables = constraint_tables(model, every)
        self.solids: list = []
        if has_tets(model.scene):
            from wsim.physics.soft import fem
            self.solids = fem.tet_tables(model)
            state.add(*(table.kept for table in self.solids if table.kept))
        self.springs = bool(self.of(SPRINGS))
        self.elements = bool(self.solids or self.of(SHEET) or self.of(CORNERS))
        coarse, self.why = coarse_space(model, h) if self.solids else ([], "")
        schwarz = False
        if not (coarse or self.springs or model.gradients) and self.elements:
            schwarz, said = choose_schwarz(model, h)
            self.why += said
        solids = [s.name.replace(" ", "_") + "_damped" * s.damped for s in self.solids]
        model.step = newton_module(model, [*self.tables, *solids, *["coarse"] * bool(coarse), *["schwarz"] * schwarz])
        self.bending = bending_of(model, self.of(SHEET))
        self.system = linear.System(model, points.constants.w, self.ids(SPRINGS, 2), self.ids(SHEET, 4),
                                    [table.ids for table in (*self.of(CORNERS), *self.solids)], coarse,
                                    self.bending.spans if self.bending else None, schwarz)
        self.rows, self.A, self.v = self.system.rows, self.system.A, self.system.v
        self.work()
        self.apart = self.elements and model.device.is_cuda
        self.gather = newton.block_gather_kernel(model.real, model.step_modules[0]) if self.apart else None
        self.assemble = newton.newton_assembly_kernel(model.real, model.step_modules[0], self.springs, self.elements,
                                                      self.apart)
        self.stressed = {s.name: s.kernels() for s in self.solids}

    def of(self, gather: str) -> list[ConstraintTable]:
        return [table for table in self.tables.values() if table.row.gather == gather]

    def ids(self, gather: str, corners: int) -> np.ndarray:
        return next((table.ids for table in self.of(gather)), np.zeros((0, corners), np.int32))

    def work(self) -> None:
        """Vectors over points, and forces and blocks of elements."""
        model, t, over = self.model, types(self.model.real), self.system.zeros
        self.b, self.f = (over(model.points, t.vec3) for _ in range(2))
        self.element = hessian.elements_of(model.real)()
        force, block = self.ids(SHEET, 4).size, 0
        for table in (*self.of(CORNERS), *self.solids):
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
        for elements in self.of(CORNERS):
            elements.linearise(s.x, s.d, a, rate, self.element)
        for table in self.solids:
            launch(self.stressed[table.name][0], table.size, [table.data, s.x, s.d, a, table.q, rate], [table.q, self.element])
        springs = self.of(SPRINGS)[0].data if self.springs else hessian.batch_of(DISTANCE, self.model.real)()
        if self.apart:
            launch(self.gather, newton.LANES * self.model.points, [self.rows, self.element], [self.A])
        launch(self.assemble, self.model.points, [self.rows, springs, self.element, self.points.at(d=s.d, a=a), self.b, rate],
               [self.f, self.A])

    def solve(self, f: wp.array, tolerance: float, cap: int) -> None:
        """y of A y = f, by conjugate gradients."""
        self.system.solve(f, tolerance, cap, (self.state.x, self.state.d))

    def spring_tables(self) -> list:
        from wsim.physics.cloth.nets.springs import SpringTable
        table = self.of(SPRINGS)[0]
        return [SpringTable(table.rows, table.data.rest, np.arange(table.size), table.given)]

    def set_value(self, path: str, name: str, value, world: int | None, own: Sequence = ()) -> bool:
        """A live parameter of a body; own: further tables that have it."""
        hit = any([t.set_value(path, name, value, world) for t in (*self.solids, *own)])
        for table in self.tables.values():
            hit = bool(apply_live_value(self.model, table.rows, path, name, value, world)) or hit
            table.refresh()
        return hit

    @property
    def launches(self) -> int:
        """Launches of an assembly and a line search, of what stands in tables."""
        return self.apart + 2 * len(self.tables) + 3 * len(self.solids) + 6 * bool(self.bending) + len(self.of(CORNERS))

    @property
    def bytes(self) -> int:
        """Bytes moved by one assembly and one iteration of conjugate gradients, when every gather hits the cache once."""
        entries = 2 * (self.A.link.capacity if self.springs else 0) + 2 * (self.A.block.capacity if self.elements else 0)
        return entries + self.model.points * (8 * self.springs + 8 * self.elements + 50 * np.dtype(self.model.dtype).itemsize)


def newton_module(model: Model, what: Iterable[str]) -> str:
    """Name of the module of kernels that Newton steps of such forces and solvers need, which on a CPU all scenes share: it is
    compiled once, beside what the plan has of its own, and found in Warp's cache whatever else a scene has. On CUDA "", none.
    """
    if model.device.is_cuda:
        return ""
    name = "_".join(("wsim_newton", *sorted(what), types(model.real).name))
    model.modules[name] = 1
    return name


def coarse_space(model: Model, h: float) -> tuple[list, str]:
    """Bodies solved with one, and what the plan says about it."""
    from wsim.physics.solver.coarse_space import wants_coarse_space
    bodies, why = wants_coarse_space(model, h)
    return bodies, f"; {why}"


def choose_schwarz(model: Model, h: float) -> tuple[bool, str]:
    """True if sheets are solved by domains, and what the plan says about it."""
    from wsim.physics.solver.schwarz.solver import wants_schwarz
    return wants_schwarz(model, h)
