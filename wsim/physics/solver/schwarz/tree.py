"""The domains of a Schwarz preconditioner: a tree of leaves of 8 points over each system, and who shares blocks with whom. See
kernels/solver/schwarz/setup.py."""

from dataclasses import dataclass

import numpy as np

from wsim.geometry import topology
from wsim.kernels.solver.schwarz.setup import LEAF, NODES, TWELVE
from wsim.physics.solver.schwarz.bisection import bisect_coordinates

POINTS = 8             # of a leaf, at most
RUN = 16               # pairs of leaves that one thread sums a row of: blocks of the last levels have thousands


@dataclass
class DomainTree:
    """Arrays of `wsim.kernels.solver.schwarz.setup.schwarz_tables`, by the same names; matrices: number of all domains."""

    order: np.ndarray
    rank: np.ndarray
    first: np.ndarray
    leaf: np.ndarray
    group: np.ndarray
    place: np.ndarray
    pair: np.ndarray
    part: np.ndarray
    entry: np.ndarray
    block: np.ndarray
    about: np.ndarray
    leaves: np.ndarray
    run: np.ndarray
    into: np.ndarray
    joined: np.ndarray
    upper: np.ndarray
    node: np.ndarray
    above: np.ndarray
    size: np.ndarray
    levels: int

    @property
    def groups(self) -> int:
        return int(self.group[-1])

    @property
    def matrices(self) -> int:
        return 3 * self.groups + len(self.node)


def depth_of(n: int) -> int:
    """Cuts that leave leaves of POINTS at most; 3 make a group."""
    return max(NODES.bit_length() - 1, int(np.ceil(np.log2(max(n, 1) / POINTS))))


def equal_key_runs(keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(order, first) of equal keys: rows order[first[k]] .. order[first[k + 1]] are one key."""
    order = topology.order_of(keys)
    sorted_ = keys[order]
    new = np.flatnonzero(np.r_[np.ones(min(len(keys), 1), bool), sorted_[1:] != sorted_[:-1]])
    return order, np.r_[new, len(keys)]


def build_domain_tree(places: np.ndarray, starts: np.ndarray, first: np.ndarray, column: np.ndarray) -> DomainTree:
    """The tree over points at `places` [m], (n, 3); system b has points starts[b] .. starts[b + 1]. first, column: who shares a
    block with whom."""
    n, systems = len(places), len(starts) - 1
    depths = [depth_of(starts[b + 1] - starts[b]) for b in range(systems)]
    group = np.r_[0, np.cumsum([1 << (d - 3) for d in depths])]
    leaf = np.concatenate([NODES * group[b] + bisect_coordinates(places[starts[b]:starts[b + 1]], d)
                           for b, d in enumerate(depths)])
    order = np.lexsort((np.arange(n), leaf))
    begin = np.searchsorted(leaf[order], np.arange(NODES * group[-1] + 1))
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n) - begin[LEAF * (leaf[order] // LEAF)]
    middle = (begin[:-1] + begin[1:]) // 2
    place = order[np.minimum(middle, n - 1)]
    place = np.r_[place, place[NODES * np.arange(group[-1]) + NODES // 2]]
    node, upper, above, place = _domains_above(group, place)
    pair, part, entry = _leaf_pairs(leaf, first, column)
    block, about, pairs, leaves = _node_blocks(pair, group, place, node, upper, above)
    own = np.minimum(NODES, -(-(node[:, 2] - node[:, 0]) // np.maximum(node[:, 1], 1)))
    size = np.r_[3 * np.diff(begin[::LEAF]), np.full(group[-1], NODES * TWELVE), TWELVE * own]
    return DomainTree(order, rank, begin, leaf, group, place, pair, part, entry, block, about, leaves, *_block_runs(pairs),
                      upper, node, above, size, above.shape[1])


def _block_runs(pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """run, into and joined of blocks with pairs[e] .. pairs[e + 1] of `DomainTree.leaves`."""
    counts = -(-np.diff(pairs) // RUN)
    block = np.repeat(np.arange(len(counts)), counts)
    first = pairs[block] + RUN * (np.arange(len(block)) - np.repeat(np.cumsum(counts) - counts, counts))
    run = np.stack([block, first, np.minimum(first + RUN, pairs[block + 1])], axis=1)
    several = counts[block] > 1
    place = np.where(several, np.cumsum(several) - 1, -1)
    long = np.flatnonzero(counts > 1)
    end = np.cumsum(counts[long])
    return run, place, np.stack([long, end - counts[long], end], axis=1)


def _domains_above(group: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Domains above groups: node, upper, above (groups, levels, 3), and place with those of their nodes."""
    leaves, groups = NODES * group[-1], group[-1]
    nodes: list[tuple[int, int, int, int]] = []
    upper, levels, places = [0], [], list(place)
    for b in range(len(group) - 1):
        g0, g1, span, own = int(group[b]), int(group[b + 1]), 1, []
        while span < g1 - g0:
            of = np.arange(g1 - g0) // span
            row = np.stack([len(nodes) + of // NODES, of % NODES, np.zeros_like(of)], axis=1)
            for begin in range(g0, g1, NODES * span):
                nodes.append((begin, span, g1, len(places)))
                at = np.minimum(begin + span * np.arange(NODES) + span // 2, g1 - 1)
                places += list(place[leaves + at])
            row[:, 2] = [nodes[q][3] + a for q, a in row[:, :2]]
            own.append(row)
            span *= NODES
        levels.append(own)
        upper.append(len(nodes))
    above = np.full((groups, max(map(len, levels), default=0), 3), -1)
    for b, own in enumerate(levels):
        for level, row in enumerate(own):
            above[group[b]:group[b + 1], level] = row
    return np.array(nodes, np.int64).reshape(-1, 4), np.array(upper), above, np.array(places)


def _leaf_pairs(leaf: np.ndarray, first: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs K <= J of leaves, and their blocks: of K with itself all of its points, of others those that lead to J."""
    owner = np.repeat(np.arange(len(leaf)), np.diff(first))
    K, J = leaf[owner], leaf[column]
    wide = int(leaf.max()) + 1
    own = np.arange(len(column))
    across = np.flatnonzero(K < J)
    alone = np.arange(wide)                                  # a leaf without blocks has the masses of its points
    keys = np.r_[K * wide + K, (K * wide + J)[across], alone * wide + alone]
    block = np.r_[own, across, np.full(wide, -1)]
    order, begin = equal_key_runs(keys)
    keys, block = keys[order], block[order]
    pair = np.stack([keys[begin[:-1]] // wide, keys[begin[:-1]] % wide], axis=1)
    kept = block >= 0
    part = np.r_[0, np.cumsum(kept)][begin]
    return pair, part, np.stack([block[kept], owner[block[kept]]], axis=1)


def _node_blocks(pair, group, place, node, upper, above) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Blocks of nodes of domains, all levels: (matrix, a, b), places of a and b, and pairs of leaves of each."""
    groups = int(group[-1])
    K, J = pair.T
    found = [(2 * groups + K // NODES, 2 * groups + J // NODES, K % NODES, J % NODES, place[K], place[J])]
    for level in range(above.shape[1]):
        p, q = above[K // NODES, level], above[J // NODES, level]
        domain = [np.where(x[:, 0] >= 0, 3 * groups + x[:, 0], -1 - side) for side, x in enumerate((p, q))]
        found.append((*domain, p[:, 1], q[:, 1], place[np.maximum(p[:, 2], 0)], place[np.maximum(q[:, 2], 0)]))
    rows = np.concatenate([np.stack([*map(np.asarray, f), np.arange(len(pair))], axis=1) for f in found])
    rows = rows[rows[:, 0] == rows[:, 1]]
    order, begin = equal_key_runs((rows[:, 0] * NODES + rows[:, 2]) * NODES + rows[:, 3])
    rows = rows[order]
    head = rows[begin[:-1]]
    return head[:, [0, 2, 3]], head[:, 4:6], begin, rows[:, 6]
