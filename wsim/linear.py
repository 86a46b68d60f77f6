"""Sparse structure of systems over points, from who touches whom. NumPy only.

    springs     (m, 2) points of each spring; row i of the system has an entry for each spring end at point i
    hinges      (h, 4), triangles (t, 3): row i has a block for each other point that shares one with i
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np

from wsim import topology

BLOCK, TURNED = -1, -2          # as kernels/tangent.py has them
PLACE = {(0, 1): 0, (0, 2): 1, (1, 2): 2}      # block of a triangle's pair of corners


@dataclass
class Entries:
    """Springs by point: entries first[i] .. first[i + 1] of point i, each with the `other` end and the spring's number."""

    first: np.ndarray
    other: np.ndarray
    number: np.ndarray


def entries(springs: np.ndarray, n: int) -> Entries:
    """Springs of each of n points, ascending."""
    first, number = topology.incident(springs, n)
    own = np.repeat(np.arange(n), np.diff(first))
    return Entries(first, springs[number].sum(axis=1) - own, number)


@dataclass
class Blocks:
    """Blocks by point, and what each is the sum of.

    first, column     blocks first[i] .. first[i + 1] of point i, each with its other point
    part, item        items part[b] .. part[b + 1] of block b: places of two hinge corners (4 hinge + corner), or of a
                      triangle's block (3 triangle + pair) and BLOCK or TURNED
    corner, pull      places pull[corner[i] .. corner[i + 1]] of the corners at point i: 4 hinge + corner, then triangles
    """

    first: np.ndarray
    column: np.ndarray
    part: np.ndarray
    item: np.ndarray
    corner: np.ndarray
    pull: np.ndarray


def blocks(hinges: np.ndarray, triangles: np.ndarray, n: int) -> Blocks:
    """Blocks of n points; their items in the order hinges, triangles, ascending."""
    keys, items = [np.zeros(0, np.int64)], [np.zeros((0, 2), np.int64)]
    for ids, corners in ((hinges, 4), (triangles, 3)):
        every = np.arange(len(ids))
        for a, b in permutations(range(corners), 2):
            keys.append(ids[:, a].astype(np.int64) * n + ids[:, b])
            pair = PLACE.get((min(a, b), max(a, b)), 0)
            found = (4 * every + a, 4 * every + b) if corners == 4 else \
                (3 * every + pair, np.full(len(ids), BLOCK if a < b else TURNED))
            items.append(np.stack(found, axis=1))
    key, item = np.concatenate(keys), np.concatenate(items)
    order = topology.order_of(key)
    key, item = key[order], item[order]
    new = np.flatnonzero(np.r_[np.ones(min(len(key), 1), bool), key[1:] != key[:-1]])
    first = np.searchsorted(key[new], np.arange(n + 1, dtype=np.int64) * n)
    corner, pull = topology.incident(np.concatenate([hinges.ravel(), triangles.ravel()])[:, None], n)
    return Blocks(first, key[new] % n, np.r_[new, len(key)], item, corner, pull)
