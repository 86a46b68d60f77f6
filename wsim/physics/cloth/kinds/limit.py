"""Strain limits: no edge of a cloth becomes longer than (1 + strain_limit) times its length at rest. NumPy."""

import numpy as np

from wsim.kernels.cloth.constraint import LIMIT
from wsim.model.model import PointBody
from wsim.physics.cloth.constraints import Constraints, no_compliance, rest_distances
from wsim.physics.cloth.kind import ClothConstraintKind


def limit_constraints(body: PointBody, pinned: np.ndarray) -> list[Constraints]:
    limit = {"strain_limit": np.array([body.source.material_number("strain_limit")])}
    return [Constraints("limit", body.edges, limit_lengths(body, body.edges, limit), np.zeros(len(body.edges)), limit)]


def limit_lengths(body: PointBody, ids: np.ndarray, stiffness: dict) -> np.ndarray:
    """Length that edges may have at most [m], (m,)."""
    return (1.0 + stiffness["strain_limit"]) * rest_distances(body, ids)


def present_limit_lengths(r: Constraints) -> np.ndarray:
    assert r.body is not None
    return limit_lengths(r.body, r.ids, r.stiffness)


def by_longest(r: Constraints, name: str, by: np.ndarray) -> np.ndarray:
    return by * r.rest / (1.0 + r.stiffness[name])


def limit_rest_gradient(shape, r: Constraints, by_rest: np.ndarray, by_shape: np.ndarray, by_value: np.ndarray | None) -> None:
    shape.lengths(r.ids, by_rest * (1.0 + r.stiffness["strain_limit"]))


KIND = ClothConstraintKind(LIMIT, limit_constraints, held="edges at their strain limit", compliance=no_compliance,
                           longest=present_limit_lengths, by_longest=by_longest, at_rest=limit_rest_gradient)
