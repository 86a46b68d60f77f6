"""Clusters of all bodies and worlds as kernels read them: colour behind colour, and members cluster behind cluster. NumPy."""

from dataclasses import dataclass
from math import inf
from typing import cast

import numpy as np

from wsim.model.model import Model, PointBody
from wsim.physics.soft.clusters.groups import FLAT, colours_of_groups, group_starts
from wsim.physics.soft.clusters.objects import Clusters

HEAVY = 1e3            # mass of a pinned point in the fit over that of its cluster: the shape misses it by a thousandth


@dataclass
class ClusterTable:
    """One row a cluster, but for `starts`, `point`, `owner` and `rest`."""

    starts: np.ndarray           # first cluster of each colour, and the end, (colours + 1,)
    first: np.ndarray            # first member of each cluster, and the end, (clusters + 1,)
    point: np.ndarray            # place in the arrays of points of each member, (members,)
    owner: np.ndarray            # cluster of each member, (members,)
    rest: np.ndarray             # rest place from the centre of its cluster [m], (members, 3), float64
    body: np.ndarray             # number of the body of each cluster in `Model.bodies`, (clusters,)
    heavy: np.ndarray            # mass of a pinned point [kg], (clusters,)
    spread: np.ndarray           # sum m r r^T / M [m^2], (clusters, 3, 3)
    rows: dict                   # {(path, world): its clusters, in the author's order}

    @property
    def sizes(self) -> np.ndarray:
        """Members of each cluster, (clusters,)."""
        return np.diff(self.first)

    @property
    def flat(self) -> np.ndarray:
        """True of clusters that are too thin to flow, (clusters,)."""
        squares = np.linalg.eigvalsh(self.spread)
        return squares[:, 0] < FLAT**2 * squares[:, 2]


def cluster_bodies(model: Model) -> list[PointBody]:
    """The bodies that shape matching holds."""
    return [b for b in model.bodies if b.source.is_cluster]


def cluster_sources(model: Model) -> dict[int, Clusters]:
    """Their objects of the scene, by the number of the body."""
    return {b.number: cast(Clusters, b.source) for b in cluster_bodies(model)}


def build_cluster_table(model: Model) -> ClusterTable:
    """The table of a model's clusters. Bodies that share points are coloured together."""
    bodies = cluster_bodies(model)
    groups, owner, mine = [], [], []
    for body in bodies:
        for group in cast(Clusters, body.source).groups:
            groups.append(body.own[group])
            owner.append(body.number)
            mine.append(body)
    shared = [np.unique(model.shared(g)) for g in groups]
    colour = colours_of_groups(shared, model.points)
    order = np.lexsort((np.arange(len(groups)), colour))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    groups, mine = [groups[k] for k in order], [mine[k] for k in order]
    rests, heavy, spread = [], [], []
    for group, body in zip(groups, mine, strict=True):
        m, r = body.masses[group - body.first], body.rest[group - body.first]
        r = r - (m @ r) / m.sum()
        rests.append(r)
        heavy.append(HEAVY * m.sum())
        spread.append((r.T * m) @ r / m.sum())
    sizes = np.array([len(g) for g in groups], np.int64)
    rows: dict = {(b.path, b.world): place[np.flatnonzero(np.array(owner) == b.number)] for b in bodies}
    return ClusterTable(np.searchsorted(colour[order], np.arange(int(colour.max(initial=0)) + 2)), group_starts(sizes),
                        model.shared(np.concatenate(groups)), np.repeat(np.arange(len(groups)), sizes), np.concatenate(rests),
                        np.array(owner)[order], np.array(heavy), np.stack(spread), rows)


def compliance_of_stiffness(stiffness: float) -> float:
    """1 / k [s^2]; 0 of a rigid cluster."""
    return 0.0 if stiffness == inf else 1.0 / stiffness


def chunk_starts(first: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Chunks of at most so many members, which no two clusters share: where each begins in the members, and the end,
    (chunks + 1,); first chunk of each cluster, and the end, (clusters + 1,)."""
    counts = np.maximum(-(-np.diff(first) // most), 1)
    ends = group_starts(counts)
    within = np.arange(ends[-1]) - np.repeat(ends[:-1], counts)
    starts = np.repeat(first[:-1], counts) + within * most
    return np.append(starts, first[-1]), ends
