"""Colours of constraints: no point occurs twice in a colour, so a colour is projected in parallel without atomics.

The number of constraints at a point, largest over the points, bounds the colours from below; we start with that many:

    fill      greedy on bitmasks, all uncoloured constraints at once: each picks a colour free at all its points, the
              last to claim a colour at a point keeps it, the others pick again
    push      one without a free colour takes that of the fewest neighbours, which then look for another (partial
              colouring: Bloechliger and Zufferey 2008)
    chain     two points a constraint: exchange two colours along a path (`kempe`)

When nothing gets better, one colour more is allowed. At the end the colours of a small set, where launches cost most,
are brought to equal size. Those of a large set, where memory costs most, are filled from the first on, so that threads
in a row touch points in a row (H200, 3M edges of a Delaunay mesh in equal colours: 279 us a sweep, filled: 180).

    ids     points of each constraint, (m, k)        n     number of points
"""

from typing import Any

import numpy as np

from wsim.geometry.color_chains import kempe_chain
from wsim.geometry.ordering import colours_by_level, locality_order
from wsim.geometry.topology import order_of, smallest_point_of_row

__all__ = ["color_batches", "color_constraints", "locality_order"]

WORD = 64            # colours of one mask; where a point has more constraints, the next 64 start with what is left
LARGE = 200_000      # constraints from which on one or two colours more are taken at once: seconds less to wait
CROWDED = 0.2        # uncoloured share above which pushing gets nowhere (grid triangles: 0.25); half for a large set
WOVEN = 0.6          # share of the constraints that a pattern must serve; Delaunay meshes have 0.7, grids 0.99


class _PartialColoring:
    """A partial colouring: `colours` (m,), -1 where none; `owner` at colour * n + point is the constraint there, or -1;
    bit c of `mask`[point] says whether colour c is used there; `full` has all bits set."""

    def __init__(self, ids: np.ndarray, n: int, seed: int):
        self.rng, self.ids = np.random.default_rng(seed), ids
        repeated = np.zeros(ids.shape, bool)
        for j in range(1, ids.shape[1]):
            repeated[:, j] = (ids[:, :j] == ids[:, j:j + 1]).any(axis=1)
        if repeated.any():                                  # a point of its own in the place of each repetition
            self.ids, fresh = ids.copy(), int(repeated.sum())
            self.ids[repeated] = np.arange(n, n + fresh)
            n += fresh
        self.count = min(int(np.bincount(self.ids.ravel()).max()), WORD)
        self.word: Any = np.uint64 if self.count > 24 else np.uint32
        self.colours, self.mask = np.full(len(ids), -1, np.int8), np.zeros(n, self.word)
        self.owner, self.full = np.full(self.count * n, -1, np.int32), self.word((1 << self.count) - 1)

    def grow(self) -> None:
        """One colour more."""
        self.count += 1
        self.owner = np.concatenate([self.owner, np.full(len(self.mask), -1, np.int32)])
        if self.count > 32 and self.word is np.uint32:
            self.word, self.mask = np.uint64, self.mask.astype(np.uint64)
        self.full = self.word((1 << self.count) - 1)

    def slots(self, which: np.ndarray, colours: np.ndarray) -> np.ndarray:
        """Places of constraints in the owner table if they had these colours, (., k)."""
        return colours.astype(np.int64)[:, None] * len(self.mask) + self.ids.take(which, axis=0)

    def _any_bit(self, masks: np.ndarray) -> np.ndarray:
        """Number of a set bit of each mask, the first one from a random bit on, uint8."""
        turn, one = self.rng.integers(0, self.count, len(masks), dtype=np.uint8), self.word(1)
        t = turn.astype(self.word)
        turned = ((masks >> t) | (masks << (self.word(self.count) - t))) & self.full
        pick = np.bitwise_count((turned & (~turned + one)) - one) + turn
        return np.where(pick >= self.count, pick - np.uint8(self.count), pick)

    def _recolour_constraints(self, which: np.ndarray, colours: np.ndarray | None) -> None:
        """Gives constraints other colours, or none. No new place may be taken, but by one of them."""
        old, one = self.colours[which], self.word(1)
        had = which[old >= 0]
        old = old[old >= 0]
        self.owner[self.slots(had, old)] = -1
        for j in range(self.ids.shape[1]):
            np.subtract.at(self.mask, self.ids[had, j], one << old.astype(self.word))
        self.colours[which] = -1 if colours is None else colours
        if colours is not None:
            self.owner[self.slots(which, colours)] = which[:, None]
            for j in range(self.ids.shape[1]):
                np.add.at(self.mask, self.ids[which, j], one << colours.astype(self.word))

    def _winners_of_claims(self, which: np.ndarray, pick: np.ndarray, claim: np.ndarray) -> np.ndarray:
        """Those that may take the colour they picked: where two meet with one colour, the later one, bool."""
        slots, row = self.slots(which, pick), np.arange(len(which), dtype=np.int32)[:, None]
        claim[slots] = row                                  # in turn, so the last one wins all its points
        return (claim[slots] == row).all(axis=1)

    def adopt_woven_pattern(self) -> bool:
        """Takes over the pattern that the numbers of the points suggest, if it serves most constraints."""
        pick = colours_by_level(self.ids, len(self.mask))
        some = np.flatnonzero(pick < self.count).astype(np.int32)
        pick = pick[some]
        won = self._winners_of_claims(some, pick, np.empty_like(self.owner))
        fits = bool(won.sum() >= WOVEN * len(self.ids))
        if fits:
            self._recolour_constraints(some[won], pick[won])
        return fits

    def fill(self, left: np.ndarray) -> np.ndarray:
        """Gives free colours at random; returns those that find none."""
        stuck, claim = [np.zeros(0, np.int32)], np.empty_like(self.owner)
        while len(left):
            used = self.mask.take(self.ids[left, 0])
            for j in range(1, self.ids.shape[1]):
                used |= self.mask.take(self.ids[left, j])
            free = ~used & self.full
            stuck.append(left[free == 0])
            left, free = left[free != 0], free[free != 0]
            pick = self._any_bit(free)
            order = np.argsort(pick, kind="stable")         # one colour's part of the table in turn, for the cache
            left, pick = left[order], pick[order]
            won = self._winners_of_claims(left, pick, claim)
            self._recolour_constraints(left[won], pick[won])
            left = left[~won]
        return np.concatenate(stuck)

    def push(self, stuck: np.ndarray) -> np.ndarray:
        """Uncoloured ones take a free colour, or that of the fewest others (not the colour they were driven from),
        which lose it. Ends when none is left, or too few find a place for the time it takes. Returns the uncoloured."""
        claim, driven = np.empty_like(self.owner), np.zeros(len(self.ids), self.word)
        pairs, lengths = self.ids.shape[1] == 2, [len(stuck)]
        while len(stuck) and not _pushing_has_stalled(lengths, pairs):
            small = self.count * stuck.size * self.ids.shape[1] < 1 << 21
            pick = (self._least_contested_colour if small else self._fewest_points)(stuck, driven[stuck])
            won = self._winners_of_claims(stuck, pick, claim)
            losers = np.sort(self.owner[self.slots(stuck[won], pick[won])], axis=None)
            losers = losers[(losers >= 0) & (losers != np.r_[losers[1:], -1])]
            driven[losers] = self.word(1) << self.colours[losers].astype(self.word)
            self._recolour_constraints(losers, None)
            self._recolour_constraints(stuck[won], pick[won])
            stuck = np.concatenate([stuck[~won], losers])
            lengths.append(len(stuck))
        if pairs and len(stuck):
            kempe_chain(self.ids, stuck, self.count, self.owner, self.mask, self.colours, self.rng)
        return stuck[self.colours[stuck] < 0]

    def _least_contested_colour(self, which: np.ndarray, forbidden: np.ndarray) -> np.ndarray:
        """For each constraint one of the colours that it can take from the fewest others, uint8."""
        there = self.owner.reshape(self.count, -1)[:, self.ids[which]]          # (colours, which, k)
        cost = self.rng.random(there.shape[:2], dtype=np.float32)
        for j in range(there.shape[2]):
            other = there[..., j] >= 0
            for i in range(j):
                other &= there[..., j] != there[..., i]
            cost += other
        bits = self.word(1) << np.arange(self.count, dtype=self.word)
        cost[(forbidden & bits[:, None] != 0) & (cost >= 1)] += there.shape[2]
        return cost.argmin(axis=0).astype(np.uint8)

    def _fewest_points(self, which: np.ndarray, forbidden: np.ndarray) -> np.ndarray:
        """The same by the number of points where the colour is used: coarser for k > 2, quicker for many."""
        used: list[np.ndarray] = []                         # bits of the colours used at more than 0, 1, ... points
        for j in range(self.ids.shape[1]):
            here = self.mask.take(self.ids[which, j])
            for i, bits in enumerate(used):
                used[i], here = bits | here, bits & here
            used.append(here)
        choice = ~used[0] & self.full
        for i in range(1, len(used) + 1):
            level = used[i - 1] & ~forbidden & self.full
            choice = np.where(choice, choice, level if i == len(used) else level & ~used[i])
        return self._any_bit(np.where(choice, choice, self.full))

    def solve(self) -> None:
        """Colours everything, or what 64 colours can hold."""
        m, pairs = len(self.ids), self.ids.shape[1] == 2
        crowded = 0.5 * CROWDED if m > LARGE else 1.0 if pairs else CROWDED
        if pairs and self.adopt_woven_pattern() and m > LARGE and self.count < WORD:
            self.grow()                                     # room for what is left, so that chains spare the pattern
        stuck = self.fill(np.flatnonzero(self.colours < 0).astype(np.int32))
        while len(stuck):
            if len(stuck) <= crowded * m:
                stuck = self.push(stuck)
            if len(stuck) == 0 or self.count == WORD:
                return
            self.grow()
            stuck = self.fill(stuck)

    def pack(self) -> None:
        """Moves each constraint to the first colour that is free for it, colour after colour (Culberson 1992)."""
        for c in range(1, self.count):
            which = np.flatnonzero(self.colours == c).astype(np.int32)
            free = self.word((1 << c) - 1)
            for j in range(self.ids.shape[1]):
                free = free & ~self.mask.take(self.ids[which, j])
            which, free = which[free != 0], free[free != 0]
            self._recolour_constraints(which, np.bitwise_count((free & (~free + self.word(1))) - self.word(1)))

    def balance(self) -> None:
        """Moves constraints from large colours to small ones where these are free, until all are about equal. Each
        large colour gives those of a stretch of points, no two the same stretch, so that patterns stay."""
        which = np.flatnonzero(self.colours >= 0)
        which = which[order_of(smallest_point_of_row(self.ids)[which])]
        for turn in range(12):
            size = np.bincount(self.colours[which], minlength=self.count)
            need, excess = np.maximum(size.mean() - size, 0), np.maximum(size - size.mean(), 0)
            if need.max() <= max(0.05 * size.mean(), 1):
                return
            order = which[np.argsort(self.colours[which], kind="stable")]
            colour = self.colours[order]
            share = excess / np.maximum(size, 1)
            start = np.cumsum(share) - share
            place = (np.arange(len(order)) - (np.cumsum(size) - size)[colour]) / size[colour]
            along = (place - start[colour] - 0.38 * turn) % 1.0     # other stretches each time
            giving = np.flatnonzero(along < share[colour])
            target = (start[colour] + along)[giving] * (need.sum() / share.sum())
            movable = order[giving].astype(np.int32)
            pick = np.minimum(np.searchsorted(np.cumsum(need), target), self.count - 1)
            free = (self.owner[self.slots(movable, pick)] < 0).all(axis=1)
            won = np.flatnonzero(free)[self._winners_of_claims(movable[free], pick[free], np.empty_like(self.owner))]
            self._recolour_constraints(movable[won], pick[won])


def _pushing_has_stalled(lengths: list[int], pairs: bool) -> bool:
    """Whether pushing should end, by the numbers left after each round so far. A round costs 0.1 ms and a microsecond
    for each constraint; a chain about 60 for one. Without chains wait longer for the last few."""
    rounds, now = len(lengths), lengths[-1]
    if pairs:
        return rounds > 8 and lengths[-9] - now < 13 + 0.13 * now
    if now > 32:
        return rounds > 16 and min(lengths[-8:]) > 0.95 * min(lengths[-16:-8])
    waited = max(40, rounds // 2)
    return rounds > waited and min(lengths[-waited:]) >= min(lengths[:-waited])


def color_constraints(ids: np.ndarray, n: int, seed: int = 0) -> np.ndarray:
    """Colour of each constraint, (m,) int32, from 0; the number of colours is near the largest number of constraints at
    a point. The same input gives the same colours. A point named twice by a constraint counts once.
    Raises ValueError for an index outside 0 .. n - 1."""
    ids = np.ascontiguousarray(ids, np.int32)
    if ids.ndim != 2 or ids.shape[1] == 0:
        raise ValueError(f"ids has shape {ids.shape}; it must be (constraints, points of each)")
    if ids.size and (ids.min() < 0 or ids.max() >= n):
        raise ValueError(f"ids go from {ids.min()} to {ids.max()}; allowed is 0 to {n - 1}")
    colours = np.full(len(ids), -1, np.int32)
    left, base = np.arange(len(ids)), 0
    while len(left):
        part = _PartialColoring(ids[left], n, seed)
        part.solve()
        (part.pack if len(ids) > LARGE else part.balance)()
        got = part.colours >= 0
        number = np.cumsum(np.bincount(part.colours[got]) > 0) + base       # without colours that nothing has
        colours[left[got]] = number[part.colours[got]] - 1
        base = number[-1]
        left = left[~got]
    return colours


def color_batches(ids: np.ndarray, n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Order of the constraints, (m,) int32, by colour and inside a colour by lowest point, and the start of each colour
    in it, (colours + 1,) int32."""
    colours = color_constraints(ids, n, seed)
    starts = np.zeros(int(colours.max(initial=-1)) + 2, np.int32)
    np.cumsum(np.bincount(colours), out=starts[1:])
    return order_of(colours * np.int64(n + 1) + smallest_point_of_row(np.asarray(ids))).astype(np.int32), starts
