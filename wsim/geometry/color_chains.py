"""Kempe chains: the last constraints of two points find a colour where every one is taken at one of their ends.

Where u lacks colour a, and v lacks b, the path of colours a, b, a ... from v is turned to b, a, b ..., unless it ends
in u; then colour a is free at both (Kempe 1879; Vizing 1964: one colour above the largest number of constraints at a
point is always enough for a simple graph). If it ends in u, a path from u with another colour is turned first.

Paths are short and each depends on the last, so this is plain Python on the memory of the arrays.
"""

import numpy as np

STEPS = 1_000_000    # points that the paths of one call may visit: about a second
TRIES = 30           # paths tried for a constraint before it is left over


def kempe_chain(ids: np.ndarray, stuck: np.ndarray, count: int, owner: np.ndarray, mask: np.ndarray, colours: np.ndarray,
                rng: np.random.Generator) -> None:
    """Colours constraints `stuck` (indices of ids (m, 2)) with 0 .. count - 1, as far as it can.

    Changes `owner` (at colour * n + point the constraint there, or -1), `mask` (bit c of a point: colour c is used
    there) and `colours` (m,), which agree before and after.
    """
    every, steps, number = (1 << count) - 1, STEPS, mask.data
    draws = iter(rng.integers(0, count, TRIES * len(stuck)).tolist())
    paths = _KempePaths(ids, owner, mask, colours)
    for e in stuck.tolist():
        u, v = ids[e].tolist()
        for _ in range(TRIES):
            at_u, at_v = ~number[u] & every, ~number[v] & every
            if at_u & at_v or not at_u or not at_v:
                break
            a, b = _lowest_set_bit(at_u), _lowest_set_bit(at_v)
            path = paths.walk(v, a, b)
            steps -= len(path)
            if path[-1] != u:
                paths.turn(path, a, b)
            elif number[u] >> (b := next(draws)) & 1:
                paths.turn(paths.walk(u, b, a), a, b)
        both = ~number[u] & ~number[v] & every
        if both:
            paths.give(e, u, v, _lowest_set_bit(both))
        if steps < 0:
            return


def _lowest_set_bit(bits: int) -> int:
    """Number of the lowest set bit."""
    return (bits & -bits).bit_length() - 1


class _KempePaths:
    """Walks and changes on the memory of a partial colouring (see `kempe_chain`)."""

    def __init__(self, ids: np.ndarray, owner: np.ndarray, mask: np.ndarray, colours: np.ndarray):
        self.owner, self.mask, self.colours, self.n = owner.data, mask.data, colours.data, len(mask)
        self.other = ids.sum(axis=1, dtype=np.int64).data          # less one end is the other end

    def walk(self, p: int, a: int, b: int) -> list[int]:
        """Points from p, which has no constraint of colour b, along colours a, b, a, ..."""
        owner, other, n, found = self.owner, self.other, self.n, [p]
        while (e := owner[a * n + p]) >= 0:
            p, a, b = other[e] - p, b, a
            found.append(p)
        return found

    def turn(self, path: list[int], a: int, b: int) -> None:
        """Exchanges colours a and b along a path."""
        owner, colours, n = self.owner, self.colours, self.n
        for p in path:
            e, f = owner[a * n + p], owner[b * n + p]
            owner[a * n + p], owner[b * n + p] = f, e
            if e >= 0:
                colours[e] = b
            if f >= 0:
                colours[f] = a
        for p in (path[0], path[-1]):                               # within the path both colours are used
            self.mask[p] ^= 1 << a | 1 << b

    def give(self, e: int, u: int, v: int, c: int) -> None:
        """Colour c, free at both ends, for constraint e."""
        self.colours[e] = c
        for p in (u, v):
            self.owner[c * self.n + p] = e
            self.mask[p] |= 1 << c
