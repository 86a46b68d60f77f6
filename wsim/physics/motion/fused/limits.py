"""Strain limits of sheets that blocks share: the edges of each block, and what blocks write each other while they sweep over
the colours. See kernels/motion/fused/limits.py.

    use       a block takes an edge that has a guest at one end: a point of another block
    letter    before such a use, if the last edge that moved the guest was one that the block does not take: the owner of the
              guest writes where it has got to, at the end of that edge's colour
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.geometry.topology import order_of
from wsim.kernels.motion.fused.limits import BLOCK, LISTS, SLOT
from wsim.model.model import Model
from wsim.physics.cloth.constraints import coloured_constraints
from wsim.physics.motion.fused.plan import FOUR, BlockPlan

if TYPE_CHECKING:
    from wsim.physics.motion.fused.domain_decomposition import Domains


def edges_of(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Edges with a limit (m, 2) and their colours (m,), as sweeps launch by launch have them."""
    rows = coloured_constraints([r for r in model.constraints if r.kind == "limit"])
    if not rows:
        return np.zeros((0, 2), np.int64), np.zeros(0, np.int64)
    return np.concatenate([r.ids for r in rows]).astype(np.int64), np.concatenate([r.colors for r in rows]).astype(np.int64)


class BlockLimits:
    """Lists of every block. `plan`: that of the domains with room for them, None where a block's memory does not suffice."""

    def __init__(self, domains: Domains, edges: np.ndarray, colours: np.ndarray):
        self.block, self.ends, self.colours = domains.block, edges, colours
        assert domains.plan is not None
        self.count, self.size = int(colours.max()) + 1, domains.plan.size
        owner = self.block[edges]                                                   # of both ends
        taken = np.concatenate([owner[:, 0], owner[owner[:, 0] != owner[:, 1], 1]])
        edge = np.concatenate([np.arange(len(edges)), np.flatnonzero(owner[:, 0] != owner[:, 1])])
        order = order_of((taken * self.count + colours[edge]) * len(edges) + edge)
        self.taken, self.edge = taken[order], edge[order]                           # block and edge of each copy
        self.first = np.searchsorted(self.taken, np.arange(self.size + 1))          # copy of each block
        self.slot = self.slots(domains)
        self.find_correspondence()
        most = {"edges": np.diff(self.first), "inbox": self.arrived[:, -1], "guests": np.diff(self.guest_first),
                "letters": np.bincount(self.sender, minlength=self.size), "firsts": np.bincount(
                    self.block[self.guest % len(self.block)], minlength=self.size)}
        sizes: dict[str, Any] = {name: max(FOUR, -(-int(each.max()) // FOUR) * FOUR) for name, each in most.items()}
        plan = replace(domains.plan, colours=self.count, **sizes)
        self.plan: Any = plan if 4 * plan.words <= plan.room else None

    def slots(self, domains: Domains) -> np.ndarray:
        """Places of the ends of each copy in its block, (copies, 2)."""
        found, at = np.empty((len(self.edge), 2), np.int64), np.full(len(self.block), -1)
        for b, lists in enumerate(domains.blocks):
            at[lists["point"]] = np.arange(len(lists["point"]))
            mine = slice(self.first[b], self.first[b + 1])
            found[mine] = at[self.ends[self.edge[mine]]]
        return found

    def find_correspondence(self) -> None:
        """Finds guests, letters, and where each end of a copy is read: `source` (copies, 2) of what `kept` says: 0 its own
        place, 1 a letter, 2 a guest's place where the sweep begins."""
        n, m = len(self.block), len(self.ends)
        point, colour = self.ends.ravel(), np.repeat(self.colours, 2)
        order = order_of(point * self.count + colour)
        before = np.full(2 * m, -1)                       # end of the edge that moved the point of an end last
        later = point[order[1:]] == point[order[:-1]]
        before[order[1:][later]] = order[:-1][later]
        ends = self.ends[self.edge]
        guest = self.block[ends] != self.taken[:, None]
        copy, side = np.nonzero(guest)
        q, b = ends[copy, side], self.taken[copy]
        self.guest, which = np.unique(b * n + q, return_inverse=True)
        self.guest_first = np.searchsorted(self.guest, n * np.arange(self.size + 1))
        last = before[2 * self.edge[copy] + side]
        told = (last >= 0) & (self.block[self.ends[last // 2, 1 - last % 2]] != b)
        self.kept, self.source = np.zeros(ends.shape, int), np.zeros(ends.shape, int)
        begins = last < 0
        self.kept[copy[begins], side[begins]] = 2
        self.source[copy[begins], side[begins]] = which[begins] - self.guest_first[b[begins]]
        self.kept[copy[told], side[told]] = 1
        self.source[copy[told], side[told]] = self.letters(b[told], last[told])

    def letters(self, to: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Numbers letters behind an end of an edge to a block, in the order of colours; returns the place of each there."""
        colour = self.colours[last // 2]
        order = order_of(to * self.count + colour)
        into = np.searchsorted(to[order], np.arange(self.size + 1))
        place = np.empty(len(to), int)
        place[order] = np.arange(len(to)) - into[to[order]]
        arrived = np.zeros((self.size, self.count + 1), int)
        np.add.at(arrived, (to, colour + 1), 1)
        self.arrived = np.cumsum(arrived, axis=1)
        self.sender = self.block[self.ends[last // 2, last % 2]]
        m = len(self.ends)
        at = np.searchsorted((self.taken * self.count + self.colours[self.edge]) * m + self.edge,
                             (self.sender * self.count + colour) * m + last // 2)
        self.letter_of, self.letter = at, place << SLOT | to << BLOCK | last % 2
        return place

    def lists(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First place and size of every list of every block, and all of them. place: of each edge in the table that has the
        longest lengths."""
        plan: BlockPlan = self.plan
        first = np.array([0, plan.points, plan.points + plan.inbox])               # of own places, letters, beginnings
        source = np.where(self.kept > 0, first[self.kept] + self.source, self.slot)
        colour = self.colours[self.edge]
        order = np.argsort(self.letter_of, kind="stable")
        written = np.searchsorted(self.letter_of[order], np.arange(len(self.edge) + 1))
        owner, guest = self.guest % len(self.block), np.arange(len(self.guest))
        holder = self.guest // len(self.block)
        word = (plan.inbox + guest - self.guest_first[holder]) << SLOT | holder << BLOCK
        by_owner = np.argsort(owner, kind="stable")
        each: list[np.ndarray] = []
        for b in range(self.size):
            mine = slice(self.first[b], self.first[b + 1])
            own = np.flatnonzero(self.block == b)
            begin = np.searchsorted(owner[by_owner], own, side="left"), np.searchsorted(owner[by_owner], own, side="right")
            letters = written[self.first[b]:self.first[b + 1] + 1]
            lists = {"edge": place[self.edge[mine]], "joint": self.slot[mine, 0] | self.slot[mine, 1] << 16,
                     "source": source[mine, 0] | source[mine, 1] << 16,
                     "colour": np.searchsorted(colour[mine], np.arange(self.count + 1)), "arrive": self.arrived[b],
                     "letter_begin": letters - letters[0], "letter": self.letter[order[letters[0]:letters[-1]]],
                     "first_begin": np.append(0, np.cumsum(begin[1] - begin[0])),
                     "first": np.concatenate([word[by_owner[i:j]] for i, j in zip(*begin, strict=True)]),
                     "guest": np.array([self.guest_first[b + 1] - self.guest_first[b]])}
            each += [lists[name] for name in LISTS]
        count = np.array([len(a) for a in each])
        return np.stack([np.cumsum(count) - count, count], axis=1).ravel(), np.concatenate(each)
