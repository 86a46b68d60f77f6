"""The table of constraints of one kind on the device: points, rest values, compliances and relaxation times of each, in one
struct (kernels/cloth/terms.py) whatever solver reads it, uploaded once a model and anew where a row has changed.

Derived from it, where time was measured to need it: inverse compliances of elements (`wsim.physics.cloth.elements`, rounded
once), springs by the entries of their points, in packets and by blocks of a cluster (`wsim.physics.motion.forces`: a gather
reads them in a row). XPBD's tables stand in the order of colours, and may have one compliance for all.
"""

from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types
from wsim.model import kernel_cache
from wsim.model.model import Model
from wsim.model.state import SimulationState
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.kind import CORNERS, SHEET, SPRINGS, kind_row, named_kinds

ORDER = (SPRINGS, SHEET, CORNERS)      # of kinds in a step of Newton's method
LANES = 4096          # threads that sum an energy


class ConstraintTable:
    """All constraints of one kind, in the order of the bodies or as `order` says: row at each place."""

    uniform = False       # whether compliance and relaxation time have one entry for all

    def __init__(self, model: Model, kind: str, rows: list[Constraints], order: np.ndarray | None = None):
        self.model, self.kind, self.rows, self.row = model, kind, rows, kind_row(kind)
        self.order: Any = slice(None) if order is None else order
        ids = np.concatenate([r.ids for r in rows]).astype(np.int32)[self.order]
        self.ids, t = model.shared(ids), types(model.real)
        self.size = len(ids)
        self.lengths: wp.array | None = None          # rest values before muscles or curvatures change them
        self.curvature: Any = None                    # of hinges
        self.kernel = self.at = None                  # type: Any
        rest = self.rest()
        self.matrices, self.entry = rest.ndim == 3, t.vec4 if rest.ndim == 3 else t.scalar
        self.data = batch_of(self.row.equation, model.real)()
        self.data.point = model.upload(self.ids, wp.types.vector(ids.shape[1], int))
        self.data.rest = model.upload(rest, t.mat22 if self.matrices else t.scalar)
        self.seen = self.now()

    def add_compliances(self) -> "ConstraintTable":
        """The table with compliances, which forces of explicit steps do not need."""
        if self.data.alpha is None:
            self.data.alpha = self.send(self.values()[0], self.entry)
        return self

    def relax(self) -> "ConstraintTable":
        """The table with relaxation times."""
        if self.data.tau is None:
            self.data.tau = self.send(self.values()[1], self.model.real)
        return self

    def bend(self, apart: bool = False) -> "ConstraintTable":
        """Hinges with the curvatures that they make; apart: the model's module gets no kernel for that."""
        if self.curvature is None and self.row.gather == SHEET:
            from wsim.physics.cloth.curvature import Curvature
            self.curvature = Curvature(self.model, self.rows, apart=apart)
        return self

    def rest(self) -> np.ndarray:
        """Rest values."""
        return np.concatenate([r.rest for r in self.rows])[self.order]

    def values(self) -> tuple[np.ndarray, np.ndarray]:
        """Compliance and relaxation time [s] of each constraint in the order of the rows."""
        return (np.concatenate([np.broadcast_to(r.alpha, (len(r.ids), *r.alpha.shape[1:])) for r in self.rows]),
                np.concatenate([np.full(len(r.ids), r.tau) for r in self.rows]))

    def sent(self, values: np.ndarray) -> np.ndarray:
        return values[:1] if self.uniform else values[self.order]

    def send(self, values: np.ndarray, dtype) -> wp.array:
        return self.model.upload(self.sent(values), dtype)

    def given(self, lengths: wp.array) -> None:
        """Rest lengths as they are without muscles."""
        self.lengths = lengths

    def now(self) -> list[tuple]:
        """Present objects of the rows: who changes them gives them other objects."""
        return [(r.rest, r.shape, r.stiffness, r.tau, r.coupling) for r in self.rows]

    def refresh(self) -> None:
        """Uploads anew what rows have changed, into the same arrays."""
        now = self.now()
        if any(a is not b for before, after in zip(self.seen, now, strict=True) for a, b in zip(before, after, strict=True)):
            self.seen = now
            self.renew()

    def renew(self) -> None:
        (alpha, tau), dtype = self.values(), self.model.dtype
        (self.lengths or self.data.rest).assign(self.rest().astype(dtype))
        for array, values in ((self.data.alpha, alpha), (self.data.tau, tau)):
            if array is not None:
                array.assign(self.sent(values).astype(dtype))
        if self.curvature:
            self.curvature.refresh()

    def energy_kernels(self, module: str) -> list:
        """Kernels that `energy` launches, made in that module."""
        from wsim.kernels.cloth.energy import strain_statistics_kernel
        return self.curvature.energy_kernels(module) if self.curvature else [
            strain_statistics_kernel(self.row.equation, real=self.model.real, module=module, uniform=self.uniform)]

    def energy(self, state: SimulationState, module: str, rest: wp.array | None = None) -> float:
        """Elastic energy [J] at x + e, summed in float64: 1/2 C alpha^-1 C; of hinges that of the curvatures of triangles.
        rest: values in place of those of the table. Few are summed on the host; kernels of that module are compiled when first
        asked for."""
        self.add_compliances().bend(apart=True)
        model, data = self.model, self.data
        if self.few:
            return self.stored(state, rest)
        if self.curvature:
            return self.curvature.energy(data, rest or self.lengths or data.rest, state.x, state.e, module)
        if rest:
            data = batch_of(self.row.equation, model.real)()
            data.point, data.rest, data.alpha, data.w = self.data.point, rest, self.data.alpha, self.data.w
        out = wp.zeros(min(LANES, self.size), dtype=wp.vec3d, device=model.device)
        (kernel,) = self.energy_kernels(module)
        kernel_cache.load_module_of_kernel(kernel, model)
        model.launch(kernel, out.size, [data, state.x, self.size, 1, state.e], [out])
        return float(out.numpy()[:, 2].sum())

    @property
    def few(self) -> bool:
        """True if the host sums their energy."""
        from wsim.physics.cloth.kinds import stored
        return self.size <= stored.FEW and (self.row.gather == SHEET or self.kind in stored.KINDS)

    def stored(self, state: SimulationState, rest: wp.array | None) -> float:
        """`energy` in NumPy."""
        from wsim.physics.cloth.kinds import stored
        x = state.x.numpy().astype(np.float64) + state.e.numpy()
        corners, data = x[self.data.point.numpy()], self.data
        mine = rest or (self.lengths if self.curvature else None) or data.rest
        rests, alpha = (a.numpy().astype(np.float64) for a in (mine, data.alpha))
        if self.curvature:
            return stored.of_sheets(corners, rests, alpha, self.curvature.data)
        return stored.KINDS[self.kind](corners, rests, alpha)

    # in a step of Newton's method

    def first(self) -> tuple[np.ndarray, int]:
        """Places of the first constraint of each system and the end, (systems + 1,); the most that one has."""
        systems = [self.model.system(r.body.number) for r in self.rows if r.body is not None]
        sizes = np.bincount(systems, [len(r.ids) for r in self.rows], len(self.model.starts) - 1)
        return np.r_[0, np.cumsum(sizes)].astype(np.int32), int(sizes.max())

    def place(self, force: int, block: int) -> None:
        """Places where elements leave forces on corners and blocks of pairs (kernels/solver/newton.py)."""
        equation, real, module = self.row.equation, self.model.real, self.model.step_modules[0]
        if equation.rows == 3:
            from wsim.kernels.cloth import hessian
            self.kernel, self.at = hessian.membrane_hessian_kernel(real, module), force
            return
        from wsim.kernels.cloth import general
        self.kernel, self.at = general.general_element_kernel(equation, real, module), wp.vec2i(force, block)

    def linearise(self, x: wp.array, d: wp.array, a: wp.array, rate: float, element) -> None:
        """Forces on the corners of elements and blocks of pairs, at x + d with the anchor a."""
        self.model.launch(self.kernel, self.size, [self.data, x, d, a, rate, self.at], [element])


def constraint_table(model: Model, kind: str) -> ConstraintTable:
    """The table of a kind in the order of the bodies, one for all who read it."""
    if kind not in model.tables:
        model.tables[kind] = ConstraintTable(model, kind, [r for r in model.constraints if r.kind == kind])
    return model.tables[kind]


def constraint_tables(model: Model, rows: list[Constraints]) -> dict[str, ConstraintTable]:
    """Tables of the kinds of some rows: springs, hinges, then elements, membranes first."""
    kinds = sorted(named_kinds({r.kind for r in rows}), key=lambda kind: (ORDER.index(kind.gather), kind.equation.rows == 1))
    return {kind.name: constraint_table(model, kind.name).add_compliances().relax().bend() for kind in kinds}


def bending_of(model: Model, tables: list[ConstraintTable]) -> Any:
    """`wsim.physics.cloth.curvature_newton.NewtonCurvature` of the table of hinges, or None."""
    if not tables:
        return None
    from wsim.physics.cloth.curvature_newton import NewtonCurvature
    return NewtonCurvature(model, tables[0])


def stored_energy(model: Model, rows: list[Constraints], state: SimulationState) -> float:
    """Energy [J] of the soft rows at x + e, with the rest values that they have: muscles give springs others."""
    total = 0.0
    for kind in sorted({r.kind for r in rows if not r.hard}):
        table, mine = constraint_table(model, kind), [r for r in rows if r.kind == kind]
        table.refresh()
        other = any(a is not b for a, b in zip(mine, table.rows, strict=True))
        rest = model.upload(np.concatenate([r.rest for r in mine]), table.data.rest.dtype) if other else None
        total += table.energy(state, kernel_cache.report_module(model, f"{kind} {table.uniform}"), rest)
    return total
