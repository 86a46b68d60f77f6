"""Colours of constraints: no point occurs twice in a colour, so a colour is projected in parallel without atomics.

The number of constraints at a point, largest over the points, bounds the colours from below; we start with that many:

    fill      greedy on bitmasks, all uncoloured constraints at once: each picks a colour free at all its points, the
              last to claim a colour at a point keeps it, the others pick again
    push      one without a free colour takes that of the fewest neighbours, which then look for another (partial
              colouring: Bloechliger and Zufferey 2008)
    chain     two points a constraint: change a for b along the path of colours a and b that begins at one end (Kempe
              1879; Vizing 1964: one colour above the bound always suffices for a simple graph)

When nothing gets better, one colour more is allowed. At the end the colours are brought to equal size.

    ids     points of each constraint, (m, k)        n     number of points
"""

import numpy as np

from wsim.topology import order_of

WORD = 64            # colours of one mask; where a point has more constraints, the next 64 start with what is left
PUSHES = 40          # rounds of pushing without a gain before it stops: more find fewer colours, each costs 0.1 ms
STEPS = 1_000_000    # constraints that chains may visit for each colour added: about a second
TRIES = 30           # paths tried for a constraint before it is left over
FEW = 0.004          # uncoloured share under which chains are quicker than pushing


class _Coloring:
    """A partial colouring: `colours` (m,), -1 where none; `owner`[colour, point] is the constraint there, or -1."""

    def __init__(self, ids: np.ndarray, n: int, seed: int):
        self.ids, self.n, self.rng = ids, n, np.random.default_rng(seed)
        self.colours = np.full(len(ids), -1, np.int32)
        repeated = np.zeros(ids.shape, bool)
        for j in range(1, ids.shape[1]):
            repeated[:, j] = (ids[:, :j] == ids[:, j:j + 1]).any(axis=1)
        self.count = min(int(np.bincount(ids[~repeated], minlength=n).max()), WORD)
        self.owner = np.full((self.count, n), -1, np.int32)

    def slots(self, which: np.ndarray, colours: np.ndarray) -> np.ndarray:
        """Places of constraints in the flat owner table if they had these colours, (., k)."""
        return colours.astype(np.int64)[:, None] * self.n + self.ids[which]

    def fill(self) -> np.ndarray:
        """Gives free colours at random; returns those that find none."""
        word = np.uint64 if self.count > 31 else np.uint32
        full, mask = word((1 << self.count) - 1), np.zeros(self.n, word)
        left, stuck = np.arange(len(self.ids), dtype=np.int32), [np.zeros(0, np.int32)]
        while len(left):
            points = self.ids.take(left, axis=0)
            used = mask[points[:, 0]]
            for j in range(1, points.shape[1]):
                used |= mask[points[:, j]]
            free = ~used & full
            some = np.flatnonzero(free)
            if len(some) < len(left):
                stuck.append(left[free == 0])
                left, free = left[some], free[some]
            pick = self._any_bit(free, word)
            order = np.argsort(pick, kind="stable")         # one colour's part of the table in turn, for the cache
            left, pick = left[order], pick[order]
            won = self._claim(left, pick)
            left, done, pick = left[~won], left[won], pick[won]
            bit = word(1) << pick.astype(word)
            for j in range(self.ids.shape[1]):
                p = self.ids[done, j]
                np.bitwise_or.at(mask, p, bit)
        return np.concatenate(stuck)

    def _any_bit(self, free: np.ndarray, word: type) -> np.ndarray:
        """Number of a set bit of each mask, the first one from a random bit on, uint8."""
        turn = self.rng.integers(0, self.count, len(free), dtype=np.uint8)
        t = turn.astype(word)
        turned = (free >> t) | (free << (word(self.count) - t)) & word((1 << self.count) - 1)
        pick = np.bitwise_count((turned & (~turned + word(1))) - word(1)) + turn
        return np.where(pick >= self.count, pick - np.uint8(self.count), pick).astype(np.uint8)

    def _claim(self, left: np.ndarray, pick: np.ndarray) -> np.ndarray:
        """Gives constraints free colours, except to those that meet a later one of the list: which got theirs, bool."""
        owner, slots = self.owner.ravel(), self.slots(left, pick)
        owner[slots] = left[:, None]                        # rows in turn, so that the last row wins all its points
        mine = owner[slots] == left[:, None]
        won = mine.all(axis=1)
        owner[slots[mine & ~won[:, None]]] = -1
        self.colours[left[won]] = pick[won]
        return won

    def push(self, stuck: np.ndarray) -> np.ndarray:
        """Uncoloured ones take a free colour, or that of the fewest others (not the colour they were driven from),
        which lose it; until none or few are left, or nothing gets better. Returns the uncoloured."""
        k, owner = self.ids.shape[1], self.owner.ravel()
        claim = np.empty(self.owner.size, np.int32)
        driven = np.full(len(self.ids), -1, np.int16)
        best, since = len(stuck), 0
        enough = FEW * len(self.ids) if k == 2 else 0
        while len(stuck) > enough and since < PUSHES:
            cost = (self.owner[:, self.ids[stuck]] >= 0).sum(axis=2) + self.rng.random((self.count, len(stuck)),
                                                                                         dtype=np.float32)
            again = np.flatnonzero(driven[stuck] >= 0)
            cost[driven[stuck[again]], again] += k * (cost[driven[stuck[again]], again] >= 1)
            pick = cost.argmin(axis=0)
            slots, row = self.slots(stuck, pick), np.arange(len(stuck), dtype=np.int32)[:, None]
            claim[slots] = row
            won = (claim[slots] == row).all(axis=1)
            losers = owner[slots[won]].ravel()
            losers = np.unique(losers[losers >= 0])
            driven[losers] = self.colours[losers]
            self._move(losers, -1)
            self._move(stuck[won], pick[won])
            stuck = np.concatenate([stuck[~won], losers])
            best, since = (len(stuck), 0) if len(stuck) < best else (best, since + 1)
        return self.chain(stuck) if k == 2 and len(stuck) else stuck

    def chain(self, stuck: np.ndarray) -> np.ndarray:
        """Colours constraints of two points one by one: where u lacks colour a, and v lacks b, the path of colours
        a, b, a ... from v is turned to b, a, b ..., unless it ends in u; then colour a is free at both. If it ends in
        u, a path from u with another colour is turned first, and u lacks that one. Returns the uncoloured."""
        owner, ends, total = memoryview(self.owner.ravel()), self.ids, self.ids.sum(axis=1, dtype=np.int64)
        other, n, steps = memoryview(total), self.n, STEPS

        def path(p: int, a: int, b: int) -> tuple[list[int], int]:
            found = []
            while (e := owner[a * n + p]) >= 0:
                found.append(e)
                p, a, b = other[e] - p, b, a
            return found, p

        def lacks(p: int) -> list[int]:
            return [c for c in range(self.count) if owner[c * n + p] < 0]

        draws = iter(self.rng.integers(0, self.count, TRIES * len(stuck)).tolist())
        for e in stuck.tolist():
            u, v = ends[e].tolist()
            for _ in range(TRIES):
                at_u, at_v = lacks(u), lacks(v)
                a = next((c for c in at_u if c in at_v), -1)
                if a < 0:
                    if not at_u or not at_v:                # more constraints there than a mask has colours
                        break
                    a, b = at_u[0], at_v[0]
                    found, last = path(v, a, b)
                    steps -= len(found)
                    if last == u:
                        b = next(draws)
                        found, _ = path(u, b, a) if b != a else ([], u)
                        self._swap(found, a, b)
                        continue
                    self._swap(found, a, b)
                self._move(np.array([e]), np.array([a]))
                break
            if steps < 0:
                break
        return stuck[self.colours[stuck] < 0]

    def _swap(self, path: list[int], a: int, b: int) -> None:
        """Exchanges colours a and b on a path."""
        if path:
            which = np.array(path)
            self._move(which, a + b - self.colours[which])

    def _move(self, which: np.ndarray, colours: np.ndarray | int) -> None:
        """Gives constraints other colours, or none (-1); the new places must be free, or be left in the same move."""
        owner, old = self.owner.ravel(), self.colours[which]
        had = old >= 0
        owner[self.slots(which[had], old[had])] = -1
        self.colours[which] = colours
        if np.ndim(colours):
            owner[self.slots(which, colours)] = which[:, None]

    def grow(self) -> None:
        """One colour more."""
        self.count += 1
        self.owner = np.concatenate([self.owner, np.full((1, self.n), -1, np.int32)])

    def balance(self) -> None:
        """Moves constraints from large colours to small ones where these are free, until all are about equal."""
        for _ in range(8):
            size = np.bincount(self.colours[self.colours >= 0], minlength=self.count)
            mean = size.sum() / self.count
            small = np.flatnonzero(size < 0.98 * mean)
            if len(small) == 0 or mean < 2:
                return
            excess = np.maximum(size - mean, 0) / np.maximum(size, 1)
            movable = np.flatnonzero((self.colours >= 0) & (self.rng.random(len(self.ids)) < excess[self.colours]))
            need = (mean - size[small]) / (mean - size[small]).sum()
            pick = self.rng.choice(small, len(movable), p=need).astype(np.int32)
            free = (self.owner.ravel()[self.slots(movable, pick)] < 0).all(axis=1)
            movable, pick = movable[free].astype(np.int32), pick[free]
            old = self.colours[movable]
            won = self._claim(movable, pick)
            self.owner.ravel()[self.slots(movable[won], old[won])] = -1


def color(ids: np.ndarray, n: int, seed: int = 0) -> np.ndarray:
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
        part = _Coloring(ids[left], n, seed)
        stuck = part.push(part.fill())
        while len(stuck) and part.count < WORD:
            part.grow()
            stuck = part.push(stuck)
        part.balance()
        got = part.colours >= 0
        colours[left[got]] = part.colours[got] + base
        base += part.count
        left = left[~got]
    return colours


def batches(ids: np.ndarray, n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Order of the constraints, (m,) int32, by colour and inside a colour by lowest point, and the start of each colour
    in it, (colours + 1,) int32."""
    colours = color(ids, n, seed)
    lowest = np.asarray(ids).min(axis=1, initial=n).astype(np.int64)
    starts = np.zeros(int(colours.max(initial=-1)) + 2, np.int32)
    np.cumsum(np.bincount(colours), out=starts[1:])
    return order_of(colours * (n + 1) + lowest).astype(np.int32), starts


def locality(points: np.ndarray, bits: int = 21) -> np.ndarray:
    """Order of points along Hilbert's curve, (n,) int32: point order[i] comes at place i. Cells of 2^-bits of the
    largest extent; directions without extent take no part. (Skilling 2004, Programming the Hilbert curve.)"""
    points = np.asarray(points, np.float64).reshape(-1, 3)
    if len(points) == 0:
        return np.zeros(0, np.int32)
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    size = extent.max()
    if not size > 0:
        return np.arange(len(points), dtype=np.int32)
    axes = np.flatnonzero(extent > 1e-3 * size)
    cells = np.minimum((points - low)[:, axes] * (2.0**bits / size), 2**bits - 1).astype(np.int64)
    return order_of(_hilbert([np.ascontiguousarray(cells[:, k]) for k in range(len(axes))], bits)).astype(np.int32)


def _hilbert(X: list[np.ndarray], bits: int) -> np.ndarray:
    """Place along Hilbert's curve of cells given by one integer array for each of 1 to 3 axes."""
    for b in range(bits - 1, 0, -1):
        below = (1 << b) - 1
        for x in X:
            set_ = (x >> b & 1).astype(bool)
            swap = np.where(set_, 0, (X[0] ^ x) & below)
            X[0] ^= np.where(set_, below, swap)
            x ^= swap
    for k in range(1, len(X)):
        X[k] ^= X[k - 1]
    turned = np.zeros_like(X[0])
    for b in range(bits - 1, 0, -1):
        turned ^= np.where(X[-1] >> b & 1, (1 << b) - 1, 0)
    key = np.zeros_like(X[0])
    for b in range(bits - 1, -1, -1):
        for x in X:
            key = key << 1 | (x ^ turned) >> b & 1
    return key
