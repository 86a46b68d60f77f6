"""Strain limits: no edge of a cloth becomes longer than (1 + strain_limit) times its length at rest. NumPy."""

import numpy as np

from wsim.kernels.cloth.constraint import LIMIT
from wsim.model.model import Body
from wsim.physics.cloth.constraints import Constraints, hard, lengths
from wsim.physics.cloth.kind import Kind
from wsim.scene import Cloth


def limits(body: Body, pinned: np.ndarray) -> list[Constraints]:
    assert isinstance(body.source, Cloth)
    limit = {"strain_limit": np.array([body.source.material.strain_limit])}
    return [Constraints("limit", body.edges, longest(body, body.edges, limit), np.zeros(len(body.edges)), limit)]


def longest(body: Body, ids: np.ndarray, stiffness: dict) -> np.ndarray:
    """Length that edges may have at most [m], (m,)."""
    return (1.0 + stiffness["strain_limit"]) * lengths(body, ids)


def now(r: Constraints) -> np.ndarray:
    assert r.body is not None
    return longest(r.body, r.ids, r.stiffness)


def by_longest(r: Constraints, name: str, by: np.ndarray) -> np.ndarray:
    return by * r.rest / (1.0 + r.stiffness[name])


def at_rest(shape, r: Constraints, by_rest: np.ndarray, by_shape: np.ndarray, by_value: np.ndarray | None) -> None:
    shape.lengths(r.ids, by_rest * (1.0 + r.stiffness["strain_limit"]))


KIND = Kind(LIMIT, limits, held="edges at their strain limit", compliance=hard, longest=now, by_longest=by_longest,
            at_rest=at_rest)
