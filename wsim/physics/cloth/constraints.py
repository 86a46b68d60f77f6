"""The list of constraints of a model, and how stiff each is. NumPy. One kind: `wsim.physics.cloth.kind`."""

from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

import numpy as np

from wsim.geometry.sheet_ordering import color_sheet
from wsim.model.model import Model, PointBody, hard_places
from wsim.model.stage import value_of_world
from wsim.physics.cloth.kind import TABLE, ClothConstraintKind, kind_row
from wsim.scene import Problem, SceneError

LOOKS = "looks, not accuracy: where they act the result is not that of the authored material"
AT_REST = ("rest_shape", "lengths")  # live values of bodies, see `wsim.physics.cloth.rest_shape`


@dataclass
class Constraints:
    """Constraints of one kind on one body. Compliance is shape / stiffness, so a live stiffness needs no rebuilding."""

    kind: str                     # name in the table of kinds
    ids: np.ndarray               # places in the arrays, (m, k)
    rest: np.ndarray              # length [m], angle [rad] (m,), or inverse edge matrix [1/m] (m, 2, 2)
    shape: np.ndarray             # compliance at stiffness 1, (m,)
    stiffness: dict               # by name in the scene, each (m,) or (1,): one for a spring; stretch, shear, weft, poisson
                                  # (membrane); strain_limit of a limit, which makes its rest of the length of its edge
    tau: float = 0.0              # relaxation time [s]
    body: PointBody | None = None
    coupling: Any = None          # `wsim.physics.cloth.bending.Coupling` of hinges
    colors: np.ndarray | None = None

    @property
    def row(self) -> ClothConstraintKind:
        """Row of the table of kinds."""
        return kind_row(self.kind)

    @property
    def hard(self) -> bool:
        return self.row.hard

    @property
    def alpha(self) -> np.ndarray:
        """Compliances, (m,), or (m, 4) of a membrane: (uu, uv, shear, vv) of plane stress."""
        return self.row.compliance(self)

    def moved(self, body: PointBody) -> "Constraints":
        """The same constraints on a copy of the body in another world."""
        assert self.body is not None
        return replace(self, ids=self.ids + (body.first - self.body.first), body=body)


def no_compliance(r: Constraints) -> np.ndarray:
    """Compliances of a hard kind: none."""
    return r.shape


def constraints_of_body(body: PointBody, pinned: np.ndarray | None = None) -> list[Constraints]:
    """Every constraint of a body, without colours; pinned: places in the arrays of hard-pinned points, of any body."""
    pinned = np.zeros(0, np.int64) if pinned is None else pinned
    made = [r for name, entry in TABLE.items() if entry.wanted(body.source) for r in kind_row(name).of(body, pinned)]
    for r in made:
        r.body = body
    return [r for r in made if len(r.ids)]


def fill_constraints(model: Model, made: Model | None = None) -> None:
    """Fills `Model.constraints`: those of the bodies of world 0, and copies for the bodies of every other. made: a model of the
    same scene that has its own, of which all are copies."""
    pinned = hard_places(model)
    if made is None:
        first = {b.path: constraints_of_body(b, pinned) for b in model.bodies if b.world == 0}
    else:
        first = {b.path: of_body(made, b) for b in made.bodies if b.world == 0}
    model.constraints = [r if r.body is b else r.moved(b) for b in model.bodies for r in first[b.path]]


def of_body(model: Model, body: PointBody) -> list[Constraints]:
    """Constraints of one body."""
    return [r for r in model.constraints if r.body is body]


def coloured_constraints(rows: list[Constraints]) -> list[Constraints]:
    """The rows of all worlds with colours; those of a kind on a body are launched together and coloured jointly, once for all
    worlds. Points that anchored ones share are not moved: these are of one colour."""
    worlds: dict[tuple, list[Constraints]] = {}
    for r in rows:
        assert r.body is not None
        worlds.setdefault((r.body.path, r.kind, r.body.world), []).append(r)
    for (path, kind, world), same in worlds.items():
        body = same[0].body
        assert body is not None
        if world != 0:
            for r, one in zip(same, worlds[path, kind, 0], strict=True):
                r.colors = one.colors
            continue
        ids = np.concatenate([r.ids for r in same])
        found = np.zeros(len(ids), np.int32) if same[0].row.equation.anchored else color_sheet(ids - body.first, body.count)
        for r, part in zip(same, np.split(found, np.cumsum([len(r.ids) for r in same])[:-1]), strict=True):
            r.colors = part
    return rows


def rest_distances(body: PointBody, ids: np.ndarray) -> np.ndarray:
    """Distances at rest between the points ids (m, 2), (m,) [m]."""
    p = body.rest[ids - body.first]
    return np.linalg.norm(p[:, 1] - p[:, 0], axis=1)


def apply_live_value(model: Model, rows: list[Constraints], path: str, name: str, value, world: int | None,
                     damped: bool = True) -> list[Constraints]:
    """Gives constraints a live value, and returns those that have it: a stiffness of theirs, damping [s] where some are damped,
    or what a new rest shape or new lengths of their body make of them. Raises SceneError, before anything is changed, for a
    strain limit where there is none from the start."""
    mine = [r for r in rows if r.body is not None and r.body.path == path and world in (None, r.body.world)]
    if name in AT_REST:  # `wsim.physics.cloth.rest_shape.reshape_bodies` has given them what is new
        return mine
    if name == "damping":
        for r in mine if damped else ():
            r.tau = float(value_of_world(value, r.body.world))                                 # type: ignore[union-attr]
        return mine if damped else []
    if mine and name == "strain_limit":
        _check_strain_limit(mine[0].body)
    mine = [r for r in mine if name in r.stiffness]
    for r in mine:
        r.stiffness = r.stiffness | {name: np.atleast_1d(np.asarray(value_of_world(value, r.body.world), np.float64))}  # type: ignore[union-attr]
        r.rest = r.row.longest(r) if r.row.longest else r.rest
    return mine


def _check_strain_limit(body: PointBody | None) -> None:
    """Of a cloth, whose limits are there from the start or not at all."""
    if body is None or not body.source.is_sheet:
        return
    if not isfinite(body.source.material_number("strain_limit", inf)):
        raise SceneError(Problem(body.path, "strain_limit is inf, so that no edge has a limit, and to give them one changes "
                                 "the constraints; give the scene a finite one and make another Simulation"))


def renew_rest_values(rows: list[Constraints], found: list[Constraints]) -> None:
    """Rest values and shapes of the rows become those of `found`, the same constraints of their body as it is now."""
    for r, new in zip(rows, found, strict=True):
        r.rest, r.shape, r.coupling = new.rest, new.shape, new.coupling
        r.rest = r.row.longest(r) if r.row.longest else r.rest
