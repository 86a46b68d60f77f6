"""The table of constraint kinds: all that solvers, reports and gradients ask of one kind is in its row.

A row names the module that has a `KIND`, and what can have such constraints, in the order of sweeps (long-range attachments
first, strain limits last); nothing is imported by it that no body has. A new kind is a module with an equation
(kernels/cloth/constraint.py) and those constraints of a body, and a row here. Where a `KIND` says no more, all is derived from
the formula (X, rest) -> C, G:

    forces, Hessian, adjoint     kernels/cloth/general.py
    bound of the frequency       G at rest, evaluated by the same formula
    compliance                   shape / stiffness, the first one by name
    chain rules                  of stiffness; of rest values as C of the points at rest, for constant shapes
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from wsim.kernels.cloth.constraint import Constraint

if TYPE_CHECKING:
    from wsim.model.model import PointBody
    from wsim.physics.cloth.constraints import Constraints

SPRINGS, SHEET, CORNERS = "springs", "sheet", "corners"        # how forces reach points, see `ClothConstraintKind.gather`


@dataclass(frozen=True)
class KindRow:
    """module: that has the `KIND`; wanted: whether an object of the scene may have constraints of it."""

    module: str
    wanted: Callable[[Any], bool] = lambda source: True


TABLE: dict[str, KindRow] = {
    "tether": KindRow("wsim.physics.cloth.kinds.tether", lambda s: s.tethers),
    "membrane": KindRow("wsim.physics.cloth.kinds.membrane", lambda s: s.model == "membrane"),
    "distance": KindRow("wsim.physics.cloth.kinds.distance", lambda s: s.model == "springs"),
    "dihedral": KindRow("wsim.physics.cloth.kinds.dihedral", lambda s: s.is_sheet and s.material_number("bend") > 0.0),
    "limit": KindRow("wsim.physics.cloth.kinds.limit", lambda s: isfinite(s.material_number("strain_limit", inf))),
}


def kind_row(name: str) -> ClothConstraintKind:
    """Kind that a row of the table leads to."""
    return import_module(TABLE[name].module).KIND


def named_kinds(names) -> list[ClothConstraintKind]:
    """Rows of the kinds of these names, in the order of the table."""
    return [kind_row(name) for name in TABLE if name in names]


def soft_compliance(r: Constraints) -> np.ndarray:
    """shape / stiffness, (m,)."""
    with np.errstate(divide="ignore"):                   # of what was slackened live
        return r.shape / next(iter(r.stiffness.values()))


def evaluate_kind(row: Constraint, points: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """C (m,) and G (m, 1, n, 3) at points (m, n, 3) [m], of rest values (m,): by the formula itself, in float64 on the CPU."""
    from wsim.kernels.cloth.general import constraint_probe_kernel
    count, m = len(points), row.points - 1
    X = wp.array(points[:, 1:] - points[:, :1], dtype=wp.types.matrix((m, 3), wp.float64), device="cpu")
    C, G = wp.zeros(count, dtype=wp.float64, device="cpu"), wp.zeros((count, m), dtype=wp.vec3d, device="cpu")
    wp.launch(constraint_probe_kernel(row), count, [X, wp.array(rest, dtype=wp.float64, device="cpu")], [C, G], device="cpu")
    others = G.numpy()
    return C.numpy(), np.concatenate([-others.sum(axis=1, keepdims=True), others], axis=1)[:, None]


def kind_gradients(r: Constraints, body: PointBody) -> np.ndarray:
    return evaluate_kind(r.row.equation, body.rest[r.ids - body.first], r.rest)[1]


def of_stiffness(r: Constraints, name: str, by: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    return by / r.shape


def of_compliance(r: Constraints, name: str, by: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    return -by * alpha / r.stiffness[name]


def as_measured(shape: Any, r: Constraints, by_rest: np.ndarray, by_shape: np.ndarray, by_value: np.ndarray | None) -> None:
    """Rest values that are C of the points at rest, and shapes that do not depend on them."""
    shape.add(r.ids, by_rest[:, None, None] * r.row.slopes(r, shape.body)[:, 0])


@dataclass(frozen=True)
class ClothConstraintKind:
    """All that is asked of one kind.

    equation       formula, points, values of C, units, for kernels; unilateral: hard, without compliance and multiplier
    of             (body that is wanted, places of hard-pinned points) -> constraints of that kind on it, or none
    gather         how forces reach points: SPRINGS, by both ends of each; SHEET, as curvatures of triangles; CORNERS, by
                   corners of elements. The first two are kernels of one kind each
    weight         work of a projection over that of a spring (CPU), see `wsim.simulation.cost`
    held           what reports say of those of a hard kind that act
    compliance     constraints -> compliances (m,), or (m, 4) of plane stress
    longest        constraints -> rest values that follow a live stiffness, or None
    slopes         (constraints, body) -> G at rest, (m, rows, k, 3)
    by_stiffness   (constraints, name of a stiffness, gradient by the table's alpha^-1, that table) -> by each one's stiffness
    by_compliance  (constraints, name, gradient by the table's alpha, that table) -> by each one's stiffness
    by_longest     (constraints, name, gradient by rest) -> by each one's stiffness, where rest values follow it
    at_rest        (`wsim.gradient.rest_shape.RestShape`, constraints, gradients by rest, by shape, by `Coupling.value`): adds
                   the gradient by where points are at rest
    packets        True: explicit steps on a CPU take them in packets (`wsim.physics.motion.fast_paths.simd_sheets`)
    """

    equation: Constraint
    of: Callable[[PointBody, np.ndarray], list[Constraints]]
    gather: str = CORNERS
    weight: float = 4.0
    held: str = ""
    compliance: Callable[[Constraints], np.ndarray] = soft_compliance
    longest: Callable[[Constraints], np.ndarray] | None = None
    slopes: Callable[[Constraints, PointBody], np.ndarray] = kind_gradients
    by_stiffness: Callable[..., np.ndarray] = of_stiffness
    by_compliance: Callable[..., np.ndarray] = of_compliance
    by_longest: Callable[..., np.ndarray] | None = None
    at_rest: Callable[..., None] = as_measured
    packets: bool = False

    @property
    def name(self) -> str:
        return self.equation.name

    @property
    def hard(self) -> bool:
        """True if it has neither compliance nor multiplier."""
        return self.equation.unilateral
