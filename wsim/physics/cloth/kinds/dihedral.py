"""Hinges between the triangles of a cloth: the angles of which the curvatures of a sheet are made. NumPy.

Sheets store 1/2 bend |S|^2 per area, S the curvature that the angles of hinges make of each triangle, the same on every fine
mesh (cloth/bending.py). A hinge alone is at least as stiff.
"""

from typing import cast

import numpy as np

from wsim.geometry import topology
from wsim.kernels.cloth.constraint import DIHEDRAL
from wsim.model.model import PointBody
from wsim.physics.cloth.constraints import Constraints
from wsim.physics.cloth.kind import SHEET, ClothConstraintKind
from wsim.scene import Cloth

SLACK = 1e-20          # bend [N m] that is none, whose root still has a derivative


def hinge_constraints(body: PointBody, pinned: np.ndarray) -> list[Constraints]:
    found = topology.hinges_of_triangles(body.triangles)
    return [_build_hinges(body, cast(Cloth, body.source), found, pinned)] if len(found) else []


def _build_hinges(body: PointBody, cloth: Cloth, hinges: np.ndarray, pinned: np.ndarray) -> Constraints:
    p = body.rest[hinges - body.first]
    n2, n3 = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), np.cross(p[:, 3] - p[:, 0], p[:, 1] - p[:, 0])
    area = 0.5 * (np.linalg.norm(n2, axis=1) + np.linalg.norm(n3, axis=1))
    length = np.linalg.norm(p[:, 1] - p[:, 0], axis=1)
    sine = -((p[:, 3] - p[:, 0]) * n2).sum(1) * length
    rest = np.zeros(len(p)) if cloth.flat else np.arctan2(sine, (n2 * n3).sum(1))
    good = (length > 0.0) & (area > 0.0)
    from wsim.physics.cloth import bending
    held = np.zeros(body.count, bool)
    held[pinned[(pinned >= body.first) & (pinned < body.last)] - body.first] = True
    patches = bending.sheet_patches(body.rest, body.triangles - body.first, hinges[good] - body.first, held)
    coupling, shape = bending.hinge_coupling(body.rest, patches)
    bend = np.array([cloth.material.bend])
    if cloth.bends is not None:                              # the mean of the faces on both sides
        bend = cloth.bends[body.polygon[topology.triangles_beside_hinges(body.triangles,
                                                                         hinges[good])]].astype(np.float64).mean(axis=0)
    return Constraints("dihedral", hinges[good], rest[good], shape, {"bend": bend}, cloth.material.damping, body, coupling)


def hinge_compliance(r: Constraints) -> np.ndarray:
    return r.shape / np.maximum(r.stiffness["bend"], SLACK)


def hinge_slopes(r: Constraints, body: PointBody) -> np.ndarray:
    p = body.rest[r.ids - body.first]
    E, X2, X3 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0], p[:, 3] - p[:, 0]
    N2, N3 = np.cross(E, X2), np.cross(X3, E)
    L = np.linalg.norm(E, axis=1)[:, None]
    G2, G3 = (-L * N / (N * N).sum(1)[:, None] for N in (N2, N3))
    t2, t3 = ((E * X).sum(1)[:, None] / L**2 for X in (X2, X3))
    G1 = -(t2 * G2 + t3 * G3)
    return np.stack([-(G1 + G2 + G3), G1, G2, G3], axis=1)[:, None]


def hinge_stiffness_gradient(r: Constraints, name: str, by: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    return -by * alpha / np.maximum(r.stiffness[name], SLACK)


def hinge_rest_gradient(shape, r: Constraints, by_rest: np.ndarray, by_shape: np.ndarray, by_value: np.ndarray | None) -> None:
    from wsim.physics.cloth.bending import rest_point_gradient
    if not shape.body.source.flat:
        shape.add(r.ids, by_rest[:, None, None] * hinge_slopes(r, shape.body)[:, 0])
    assert by_value is not None
    shape.by += rest_point_gradient(shape.body.rest, r.coupling.patches, by_value, by_shape)


KIND = ClothConstraintKind(DIHEDRAL, hinge_constraints, SHEET, 9.5, packets=True, compliance=hinge_compliance,
                           slopes=hinge_slopes, by_compliance=hinge_stiffness_gradient, at_rest=hinge_rest_gradient)
