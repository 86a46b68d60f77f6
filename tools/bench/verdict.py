"""Who is faster for the same error: arithmetic on rows of run time and error. Pure Python; peers.py feeds it.

A row is a dict with `ms` (of a frame) and errors under `key`; a row that failed or is not finite has neither said nor shown
anything and is left out, and so is one whose error reaches that of a cloth that never moved (`worst`): it is no solution.

    (a) speedup     for every row on the peer's front: its ms over the ms of our fastest row of at most its error
    (b) tenth       for every row on its explicit front: our ms at a tenth of its error, over its ms
    (c) accuracy    for every row on its front: its error over our least error in at most its ms

None stands for "no row of ours does that". The verdict of (a) and (c) is the least over the front, of (b) the largest: a
peer's best case, not ours.
"""

from collections.abc import Iterable

Row = dict


def usable(rows: Iterable[Row], key: str, worst: float) -> list[Row]:
    """Rows that ran, stayed finite and err by less than `worst`."""
    return [r for r in rows if r.get("finite") and r.get(key) is not None and 0.0 <= r[key] < worst and r["ms"] > 0.0]


def front(rows: Iterable[Row], key: str) -> list[Row]:
    """The Pareto front, fastest first: rows that no other beats in one of ms and error and equals in the other."""
    best: list[Row] = []
    for row in sorted(rows, key=lambda r: (r["ms"], r[key])):
        if not best or row[key] < best[-1][key]:
            best.append(row)
    return best


def fastest(rows: Iterable[Row], key: str, limit: float) -> Row | None:
    """The fastest row whose error is at most `limit`."""
    return min((r for r in rows if r[key] <= limit), key=lambda r: r["ms"], default=None)


def sharpest(rows: Iterable[Row], key: str, ms: float) -> Row | None:
    """The row of least error that takes at most `ms`."""
    return min((r for r in rows if r["ms"] <= ms), key=lambda r: r[key], default=None)


def least(pairs: list[dict]) -> dict | None:
    """The pair of smallest ratio; one without (None) is smaller than all."""
    return min(pairs, key=lambda p: -1.0 if p["ratio"] is None else p["ratio"], default=None)


def largest(pairs: list[dict]) -> dict | None:
    """The pair of largest ratio; one without (None) is larger than all."""
    return max(pairs, key=lambda p: float("inf") if p["ratio"] is None else p["ratio"], default=None)


def verdicts(own: Iterable[Row], implicit: Iterable[Row], explicit: Iterable[Row], key: str, worst: float) -> dict:
    """(a), (b), (c) over the peer's fronts: {"speedup": {"pairs", "verdict", "best"}, ...}.

    A pair holds the peer's row, ours (None: no such row) and the ratio. `verdict` is the peer's best case, `best` the pair
    of the peer's row of least error; both None where the peer has no usable row."""
    own = usable(own, key, worst)
    implicit, explicit = front(usable(implicit, key, worst), key), front(usable(explicit, key, worst), key)

    def summed(theirs, find, ratio, choose) -> dict:
        pairs = []
        for peer in theirs:
            ours = find(peer)
            pairs.append({"peer": peer, "ours": ours, "ratio": None if ours is None else ratio(peer, ours)})
        return {"pairs": pairs, "verdict": choose(pairs), "best": pairs[-1] if pairs else None}

    def over(a: float, b: float) -> float:
        return a / b if b > 0.0 else float("inf")

    return {
        "speedup": summed(implicit, lambda p: fastest(own, key, p[key]), lambda p, o: over(p["ms"], o["ms"]), least),
        "tenth": summed(explicit, lambda p: fastest(own, key, 0.1 * p[key]), lambda p, o: over(o["ms"], p["ms"]), largest),
        "accuracy": summed(implicit, lambda p: sharpest(own, key, p["ms"]), lambda p, o: over(p[key], o[key]), least),
    }
