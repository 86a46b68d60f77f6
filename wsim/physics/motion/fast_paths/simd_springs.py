"""Springs in packets and blocks, as a march on a CPU takes them. See kernels/motion/fast_paths/simd_springs.py. NumPy only.

The bits of a result follow from the order of its sums, and so from the net alone: worlds, copies of it behind each other, have
tables that are copies. Missing springs of a packet (-1 in `entry`) pull at nothing: where the others of a run would lead, for
which each world ends with a group of no points, or at the place past the last.
"""

import numpy as np

from wsim.geometry.color import color_constraints
from wsim.kernels.motion.fast_paths.simd_springs import EIGHT, FOUR, LANES

LOT = 256              # springs of a block, more or less: their missing ones cost least, but threads are cut between blocks
RUN = 6                # springs from which a packet is a run: loose, five cost less than three that are missing
MOVE = 1.5             # cost of moving a point, in springs


class Packets:
    """Tables of `lots.list_of`, before they are uploaded; `entry` (slots,): the spring of each lane, or -1."""

    def __init__(self, ids: np.ndarray, order: np.ndarray, worlds: int = 1):
        """ids: springs (m, 2) among n points; order: point of each place, (n,); both world after world."""
        n, m = len(order) // worlds, len(ids) // worlds
        place = np.empty(n, np.int64)
        place[order[:n]] = np.arange(n)
        group, runs, start, ends, entry = _packed_springs(place[ids[:m]], n)
        world, places = np.arange(worlds)[:, None], EIGHT * len(runs)
        self.springs, self.runs = len(ids), np.tile(runs, worlds)
        self.group, self.start = (np.append((a[:-1] + world * a[-1]).ravel(), worlds * a[-1]) for a in (group, start))
        self.order = np.pad(order.reshape(worlds, n), ((0, 0), (0, places - n)), constant_values=-1).ravel()
        self.entry = np.where(entry >= 0, entry + world * m, -1).ravel()
        self.ends = np.where(ends >= 0, ends + world[:, :, None] * places, worlds * places).reshape(-1, 2)
        self.cost = np.diff(self.start) + MOVE * EIGHT * np.diff(self.group)             # of each block

    def words(self) -> np.ndarray:
        """Words with both ends in one, (slots,)."""
        low, high = (FOUR * self.ends).astype(np.uint64).T
        return low | high << np.uint64(32)

    def joined_blocks(self) -> np.ndarray:
        """Blocks that are joined by a spring, or by a missing one of a run, (m, 2)."""
        found = np.minimum(self.ends[self.ends[:, 0] < len(self.order)], len(self.order) - 1)
        block = np.repeat(np.arange(len(self.cost)), np.diff(self.group))
        return np.unique(block[found // EIGHT], axis=0)


def _rank_among_equal(keys: np.ndarray) -> np.ndarray:
    """Place of each among those of the same key."""
    order, rank = np.argsort(keys, kind="stable"), np.empty(len(keys), np.int64)
    begin = np.flatnonzero(np.diff(keys[order], prepend=-1))
    rank[order] = np.arange(len(keys)) - np.repeat(begin, np.diff(np.append(begin, len(keys))))
    return rank


def _packed_springs(ids: np.ndarray, n: int) -> tuple[np.ndarray, ...]:
    """group, runs, start, ends, entry of one world. A run is of one group, and its springs have one difference of ends; of
    springs between the same two points, which would be one lane, each goes into another run."""
    low, high, groups = ids.min(1), ids.max(1), -(-n // EIGHT) + 1
    springs = np.bincount(low // EIGHT, minlength=groups)
    block = np.unique((np.cumsum(springs) - springs) // LOT, return_inverse=True)[1].ravel()             # of each group
    blocks, group = int(block[-1]) + 1, np.searchsorted(block, np.arange(block[-1] + 2))
    again = _rank_among_equal(low * n + high)
    kind = (low // EIGHT * (again.max() + 1) + again) * n + high - low
    first, which, count = np.unique(kind, return_index=True, return_inverse=True, return_counts=True)[1:]
    run, tight = first[count >= RUN], count[which] >= RUN                      # a spring of each; springs that are in one
    loose = np.flatnonzero(~tight)
    of = block[low // EIGHT]
    if len(loose):
        loose = loose[np.lexsort((low[loose], color_constraints(ids[loose], n), of[loose]))]
    begun = np.bincount(of[run], minlength=blocks)
    start = EIGHT * np.append(0, np.cumsum(begun - -np.bincount(of[loose], minlength=blocks) // EIGHT))
    ends, entry = np.full((start[-1], 2), -1), np.full(start[-1], -1)
    slot = np.zeros(len(count), np.int64)
    slot[count >= RUN] = start[of[run]] + EIGHT * _rank_among_equal(of[run])
    lanes, base = np.arange(EIGHT), low[run] // EIGHT * EIGHT
    ends[slot[count >= RUN][:, None] + lanes] = np.stack([base, base + high[run] - low[run]], axis=1)[:, None] + lanes[:, None]
    entry[slot[which[tight]] + low[tight] % EIGHT] = np.flatnonzero(tight)
    at = start[of[loose]] + EIGHT * begun[of[loose]] + _rank_among_equal(of[loose])
    ends[at], entry[at] = np.stack([low, high], axis=1)[loose], loose
    return group, np.bincount(low[run] // EIGHT, minlength=groups), start, ends, entry.reshape(-1, EIGHT)[:, LANES].ravel()
