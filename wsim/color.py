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
    """A partial colouring: `colours` (m,), -1 where none; `owner` at colour * n + point is the constraint there, or -1;
    bit c of `mask`[point] says whether colour c is used there."""

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
        self.word = np.uint64 if self.count > 24 else np.uint32
        self.colours, self.mask = np.full(len(ids), -1, np.int8), np.zeros(n, self.word)
        self.owner = np.full(self.count * n, -1, np.int32)

    @property
    def full(self) -> np.unsignedinteger:
        return self.word((1 << self.count) - 1)

    def grow(self) -> None:
        """One colour more."""
        self.count += 1
        self.owner = np.concatenate([self.owner, np.full(len(self.mask), -1, np.int32)])
        if self.count > 32 and self.word is np.uint32:
            self.word, self.mask = np.uint64, self.mask.astype(np.uint64)

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

    def _move(self, which: np.ndarray, colours: np.ndarray | int) -> None:
        """Gives constraints other colours, or none (-1). No new place may be taken, but by one of them."""
        old, one = self.colours[which], self.word(1)
        had = which[old >= 0]
        old = old[old >= 0]
        self.owner[self.slots(had, old)] = -1
        for j in range(self.ids.shape[1]):
            np.subtract.at(self.mask, self.ids[had, j], one << old.astype(self.word))
        self.colours[which] = colours
        if np.ndim(colours):
            self.owner[self.slots(which, colours)] = which[:, None]
            for j in range(self.ids.shape[1]):
                np.add.at(self.mask, self.ids[which, j], one << colours.astype(self.word))

    def _winners(self, which: np.ndarray, pick: np.ndarray, claim: np.ndarray) -> np.ndarray:
        """Those that may take the colour they picked: where two meet with one colour, the later one, bool."""
        slots, row = self.slots(which, pick), np.arange(len(which), dtype=np.int32)[:, None]
        claim[slots] = row                                  # in turn, so the last one wins all its points
        return (claim[slots] == row).all(axis=1)

    def fill(self) -> np.ndarray:
        """Gives free colours at random; returns those that find none."""
        left, stuck = np.arange(len(self.ids), dtype=np.int32), [np.zeros(0, np.int32)]
        claim = np.empty_like(self.owner)
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
            won = self._winners(left, pick, claim)
            self._move(left[won], pick[won])
            left = left[~won]
        return np.concatenate(stuck)

    def push(self, stuck: np.ndarray) -> np.ndarray:
        """Uncoloured ones take a free colour, or that of the fewest others (not the colour they were driven from),
        which lose it; until none or few are left, or nothing gets better. Returns the uncoloured."""
        claim, driven = np.empty_like(self.owner), np.full(len(self.ids), 0, self.word)
        best, since = len(stuck), 0
        enough = FEW * len(self.ids) if self.ids.shape[1] == 2 else 0
        while len(stuck) > enough and since < PUSHES:
            pick = self._cheapest(stuck, driven[stuck])
            won = self._winners(stuck, pick, claim)
            losers = np.sort(self.owner[self.slots(stuck[won], pick[won])], axis=None)
            losers = losers[(losers >= 0) & (losers != np.r_[losers[1:], -1])]
            driven[losers] = self.word(1) << self.colours[losers].astype(self.word)
            self._move(losers, -1)
            self._move(stuck[won], pick[won])
            stuck = np.concatenate([stuck[~won], losers])
            best, since = (len(stuck), 0) if len(stuck) < best else (best, since + 1)
        return self.chain(stuck) if self.ids.shape[1] == 2 and len(stuck) else stuck

    def _cheapest(self, which: np.ndarray, forbidden: np.ndarray) -> np.ndarray:
        """For each constraint one of the colours that are used at the fewest of its points, uint8."""
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

    def chain(self, stuck: np.ndarray) -> np.ndarray:
        """Colours constraints of two points one by one: where u lacks colour a, and v lacks b, the path of colours
        a, b, a ... from v is turned to b, a, b ..., unless it ends in u; then colour a is free at both. If it ends in
        u, a path from u with another colour is turned first, and u lacks that one. Returns the uncoloured."""
        owner, other = memoryview(self.owner), memoryview(self.ids.sum(axis=1, dtype=np.int64))
        n, steps = len(self.mask), STEPS

        def path(p: int, a: int, b: int) -> tuple[list[int], int]:
            found = []
            while (e := owner[a * n + p]) >= 0:
                found.append(e)
                p, a, b = other[e] - p, b, a
            return found, p

        def lacks(p: int) -> list[int]:
            used = int(self.mask[p])
            return [c for c in range(self.count) if not used >> c & 1]

        draws = iter(self.rng.integers(0, self.count, TRIES * len(stuck)).tolist())
        for e in stuck.tolist():
            u, v = self.ids[e].tolist()
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
            free = (self.owner[self.slots(movable, pick)] < 0).all(axis=1)
            movable, pick = movable[free].astype(np.int32), pick[free]
            won = self._winners(movable, pick, np.empty_like(self.owner))
            self._move(movable[won], pick[won])


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
        colours[left[got]] = part.colours[got].astype(np.int32) + base
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
