"""A kind of constraint in one file: areas of the triangles of a cloth whose material is a `Film`.

    C = |X1 x X2| / 2 - A0 [m^2],   G_1 = X2 x n / 2,   G_2 = n x X1 / 2,   n the unit normal;   energy k C^2 / 2, k [N/m^3]

All else is derived (`wsim.physics.cloth.kind`). `VALUE` is its stiffness in the table of values, by which it is set and fitted.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from wsim.geometry import topology
from wsim.kernels.cloth.constraint import Constraint, inverse_or_zero
from wsim.model.model import PointBody
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.kind import ClothConstraintKind, KindRow
from wsim.scene import Cloth
from wsim.scene.fabric import Fabric
from wsim.scene.values.value import ThetaMap, ValueRange, ValueRow


@dataclass(frozen=True)
class Film(Fabric):
    area: float = 0.0               # stiffness of the area of a triangle [N/m^3]


@wp.func
def area(X: Any, A0: Any):
    """C and rows of G. A triangle without area: G = 0."""
    half = type(A0)(0.5)
    N = wp.cross(X[0], X[1])
    size = wp.length(N)
    n = (half * inverse_or_zero(size)) * N
    return half * size - A0, wp.matrix_from_rows(wp.cross(X[1], n), wp.cross(n, X[0]))


def areas(body: PointBody, pinned: np.ndarray) -> list[Constraints]:
    assert isinstance(body.source, Cloth)
    film = body.source.material
    rest = topology.triangle_areas(body.rest, body.triangles - body.first)
    return [Constraints("area", body.triangles, rest, np.ones(len(rest)), {"area": np.array([film.area])}, film.damping)]


KIND = ClothConstraintKind(Constraint("area", area, 3, 1, "m^2", "m^3/N"), areas)
VALUE = ValueRow("Cloth", "area", "N/m^3", ValueRange(strict=True), varies=True, stiffens=True, fit=ThetaMap("log"),
                 gradient="material")
ROW = KindRow("tests.make.rows.area", lambda source: getattr(getattr(source, "material", None), "area", 0.0) > 0.0)
