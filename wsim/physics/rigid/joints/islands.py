"""Islands of joints, and the order in which their blocks are eliminated. NumPy only; kernels/rigid/joint/elimination.py.

Two joints are near each other where they share a dynamic body. Of those that are left, one with the fewest near is eliminated
next (minimum degree: George, Liu 1981, chapter 5), which brings its own near ones next to each other. On a tree of chains this
is from the ends inward, and nothing fills in.
"""

from dataclasses import dataclass
from heapq import heapify, heappop, heappush

import numpy as np


@dataclass
class EliminationOrder:
    """Joints in their order, islands behind each other; blocks 0 .. n - 1 are diagonal ones, those below come behind."""

    joint: np.ndarray              # given number of each
    first_joint: np.ndarray        # of islands, and one more
    first_body: np.ndarray
    body: np.ndarray               # rows of bodies
    first_near: np.ndarray         # of joints, and one more
    near: np.ndarray               # row of each block below; its column is the joint whose it is
    first_target: np.ndarray
    target: np.ndarray             # block that the product of two of a joint's blocks is taken from

    @property
    def blocks(self) -> int:
        return len(self.joint) + len(self.near)

    def closed(self, pairs: np.ndarray) -> np.ndarray:
        """1 for joints of islands with a loop, (joints,) in their order; pairs: rows of the bodies of each, -1: the world."""
        found = np.zeros(len(self.joint), int)
        for first, last, own in zip(self.first_joint[:-1], self.first_joint[1:], np.diff(self.first_body), strict=True):
            hung = bool((pairs[first:last] < 0).any())
            found[first:last] = last - first > own - 1 + hung
        return found

    def single(self) -> np.ndarray:
        """1 for joints that are the only one of their island, (joints,)."""
        many = np.diff(self.first_joint)
        return np.repeat(many == 1, many).astype(int)

    def repeat_for_worlds(self, times: int, bodies: int) -> "EliminationOrder":
        """The same of several worlds with so many bodies each."""
        n, e = len(self.joint), len(self.near)

        def repeat_offset_rows(values, more):
            return np.concatenate([values + more * k for k in range(times)]) if times else values[:0]

        def repeat_first_rows(values):
            return np.append(repeat_offset_rows(values[:-1], values[-1]), values[-1] * times)
        target = np.concatenate([np.where(self.target < n, self.target + n * k, self.target + n * (times - 1) + e * k)
                                 for k in range(times)])
        return EliminationOrder(repeat_offset_rows(self.joint, n), repeat_first_rows(self.first_joint),
                                repeat_first_rows(self.first_body), repeat_offset_rows(self.body, bodies),
                                repeat_first_rows(self.first_near), repeat_offset_rows(self.near, n),
                                repeat_first_rows(self.first_target), target)


def _joint_island_labels(pairs: np.ndarray, bodies: int) -> np.ndarray:
    """A number for each body, the same within an island."""
    root = np.arange(bodies)

    def island_root(i: int) -> int:
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        return i
    for a, b in pairs.tolist():
        if a >= 0 and b >= 0:
            p, q = island_root(a), island_root(b)
            root[max(p, q)] = min(p, q)
    return np.array([island_root(i) for i in range(bodies)], int)


def _minimum_degree_order(joints: list[int], near: dict[int, set[int]]) -> tuple[list[int], dict[int, list[int]]]:
    """(order, those near each joint that come behind it)."""
    heap = [(len(near[j]), j) for j in joints]
    heapify(heap)
    done: set[int] = set()
    order, behind = [], {}
    while heap:
        degree, j = heappop(heap)
        if j in done or degree != len(near[j]):
            continue
        done.add(j)
        order.append(j)
        rest = sorted(near[j])
        behind[j] = rest
        for k in rest:
            near[k] |= near[j]
            near[k] -= {j, k}
        for k in rest:
            heappush(heap, (len(near[k]), k))
    return order, behind


def elimination_order(pairs: np.ndarray, bodies: int) -> EliminationOrder:
    """pairs: rows of the bodies of each joint, (joints, 2), -1 for none. Bodies without joints are islands of their own."""
    island = _joint_island_labels(pairs, bodies)
    at: dict[int, list[int]] = {}
    for j, pair in enumerate(pairs.tolist()):
        for body in pair:
            if body >= 0:
                at.setdefault(body, []).append(j)
    near: dict[int, set[int]] = {j: set() for j in range(len(pairs))}
    for joints in at.values():
        for j in joints:
            near[j].update(joints)
    for j, others in near.items():
        others.discard(j)
    of_joint = island[pairs.max(axis=1)] if len(pairs) else np.zeros(0, int)
    first_joint, first_body, order, rows = [0], [0], [], []
    behind: dict[int, list[int]] = {}
    for g in np.unique(of_joint):
        one, more = _minimum_degree_order(np.flatnonzero(of_joint == g).tolist(), near)
        order += one
        behind |= more
        rows += sorted({b for j in one for b in pairs[j].tolist() if b >= 0})
        first_joint.append(len(order))
        first_body.append(len(rows))
    for lone in sorted(set(range(bodies)) - set(rows)):
        rows.append(lone)
        first_joint.append(len(order))
        first_body.append(len(rows))
    return _block_elimination_program(order, behind, first_joint, first_body, rows)


def _block_elimination_program(order, behind, first_joint, first_body, rows) -> EliminationOrder:
    place = {j: k for k, j in enumerate(order)}
    first_near, near, block = [0], [], {}
    for j in order:
        for k in sorted(place[k] for k in behind[j]):
            block[k, place[j]] = len(order) + len(near)
            near.append(k)
        first_near.append(len(near))
    first_target, target = [0], []
    for i in range(len(order)):
        own = near[first_near[i]:first_near[i + 1]]
        for e, k in enumerate(own):
            target += [k if m == k else block[k, m] for m in own[:e + 1]]
        first_target.append(len(target))
    every = (order, first_joint, first_body, rows, first_near, near, first_target, target)
    return EliminationOrder(*(np.array(values, np.int64) for values in every))
