"""Points that two bodies share: one particle, which has the masses of both and moves both. NumPy only.

The first body's point gives way: its place in the arrays stays, idle, and what would refer to it refers to the other's
(`Model.alias`). Bodies that share points have one origin, since differences are taken across them.
"""

import numpy as np


def join_tied_points(bodies: list, ties: list) -> np.ndarray:
    """Changes the bodies of one world, and returns the place that stands for each place, (points,)."""
    by_path = {b.path: b for b in bodies}
    alias = np.arange(bodies[-1].last)
    for tie in ties:
        mine, other = by_path[tie.body], by_path[tie.other]
        alias[mine.own[tie.points]] = alias[other.own[tie.others]]
    while (alias[alias] != alias).any():                     # a point that gave way to one that gave way
        alias = alias[alias]
    for body in bodies:
        gone = body.first + np.flatnonzero(alias[body.first:body.last] != np.arange(body.first, body.last))
        body.idle = np.concatenate([body.idle, gone])
        for other in bodies:
            here = gone[(alias[gone] >= other.first) & (alias[gone] < other.last)]
            np.add.at(other.masses, alias[here] - other.first, body.masses[here - body.first])
            np.maximum.at(other.reach, alias[here] - other.first, body.reach[here - body.first])
    for group in _groups_of_tied_bodies(bodies, ties):
        origin = np.round(np.mean([b.origin for b in group], axis=0))
        for body in group:
            body.places, body.origin = body.places + (body.origin - origin), origin
    for body in bodies:
        body.index = alias[body.own]
    return alias


def _groups_of_tied_bodies(bodies: list, ties: list) -> list[list]:
    """Bodies that hang together by ties, those of each group."""
    root = {b.path: b.path for b in bodies}

    def root_of_tied_group(path: str) -> str:
        while root[path] != path:
            path = root[path]
        return path
    for tie in ties:
        root[root_of_tied_group(tie.body)] = root_of_tied_group(tie.other)
    found: dict[str, list] = {}
    for b in bodies:
        found.setdefault(root_of_tied_group(b.path), []).append(b)
    return [group for group in found.values() if len(group) > 1]
