"""L-BFGS with a strong Wolfe line search. Nocedal, Wright 2006: algorithms 7.4 (two loops), 7.5, 3.5 and 3.6 (line search).

    d = -H g      H from the last MEMORY pairs s = x+ - x, y = g+ - g; gamma H0 before, gamma = s.y / y.H0 y
    f(x + a d) <= f + C1 a g.d,   |g(x + a d).d| <= C2 |g.d|

The function is a sum w . (f1, f2 ...) whose weights may change between steps: values, gradients and pairs are kept by part, so
that H follows at once. A value of inf (a simulation that broke) is too long a step.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

MEMORY = 40
C1, C2 = 1e-4, 0.9
TRIES = 20             # evaluations of a line search at most
Evaluate = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass
class FitPoint:
    """A point and what is known there, by part: values (k,), gradients (k, n)."""

    x: np.ndarray
    f: np.ndarray
    g: np.ndarray


@dataclass
class LbfgsDescent:
    """`step` until it says that none is left. evaluate: x -> (values (k,), gradients (k, n))."""

    evaluate: Evaluate
    at: FitPoint
    weights: np.ndarray                        # (k,)
    radius: float = np.inf                     # largest entry of a step
    pairs: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)      # s (n,), y (k, n)
    inverse: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None      # of a first Hessian: (q, weights) -> H0 q
    lost: bool = False                         # the last line search found nothing lower

    @property
    def value(self) -> float:
        return float(self.weights @ self.at.f)

    @property
    def gradient(self) -> np.ndarray:
        return self.weights @ self.at.g

    def look(self, x: np.ndarray) -> FitPoint:
        return FitPoint(x, *self.evaluate(x))

    def direction(self) -> np.ndarray:
        """-H g; without pairs and H0 along -g, its largest entry a tenth."""
        q = -self.gradient
        every = [(s, self.weights @ y) for s, y in self.pairs]
        pairs = [(s, y, float(s @ y)) for s, y in every if s @ y > 1e-10 * np.linalg.norm(s) * np.linalg.norm(y)]
        first = self.inverse
        if not pairs and first:
            return first(q, self.weights)
        if not pairs:
            return q * (0.1 / max(float(np.abs(q).max()), 1e-300))
        parts = []
        for s, y, sy in reversed(pairs):
            parts.append((s @ q) / sy)
            q = q - parts[-1] * y
        s, y, sy = pairs[-1]
        q = q * (sy / (y @ y)) if first is None else first(q, self.weights) * (sy / (y @ first(y, self.weights)))
        for (s, y, sy), a in zip(pairs, reversed(parts), strict=True):
            q = q + (a - (y @ q) / sy) * s
        return q

    def expected(self) -> float:
        """Decrease of the value that the next step should bring."""
        return -0.5 * float(self.gradient @ self.direction())

    def step(self) -> bool:
        """One step; False where no lower place is found along the way."""
        d = self.direction()
        if self.gradient @ d >= 0.0:
            self.pairs.clear()
            d = self.direction()
        d = d * min(1.0, self.radius / max(float(np.abs(d).max()), 1e-300))
        found = self.search(d)
        self.lost = found is None and not self.pairs
        if found is None:
            self.pairs.clear()                 # once more along the gradient, next time
            return not self.lost
        self.pairs = [*self.pairs[1 - MEMORY:], (found.x - self.at.x, found.g - self.at.g)]
        self.at = found
        return True

    def search(self, d: np.ndarray) -> FitPoint | None:
        """A place along d that meets both conditions; else the lowest that was seen, None: none is lower."""
        f0, slope0 = self.value, float(self.gradient @ d)
        low, high = (0.0, f0, slope0), None
        best: FitPoint | None = None
        a, longest = 1.0, self.radius / max(float(np.abs(d).max()), 1e-300)
        for _ in range(TRIES):
            place = self.look(self.at.x + a * d)
            f, slope = float(self.weights @ place.f), float(self.weights @ place.g @ d)
            good = np.isfinite(f) and f <= f0 + C1 * a * slope0 and f < f0
            if good and (best is None or f < self.weights @ best.f):
                best = place
            if good and abs(slope) <= -C2 * slope0:
                return place
            if not good or f >= low[1] and low[0] > 0.0:
                high = (a, f, slope)
            else:
                if slope * ((high[0] if high else np.inf) - low[0]) >= 0.0:
                    high = low
                low = (a, f, slope)
                if high is None and a >= longest:
                    return best
            a = min(2.5 * a, longest) if high is None else cubic_minimum(low, high)
            if abs(a - low[0]) * np.abs(d).max() < 1e-14 * max(1.0, float(np.abs(self.at.x).max())):
                break
        return best


def cubic_minimum(low: tuple[float, float, float], high: tuple[float, float, float]) -> float:
    """Place where the cubic through two (place, value, slope) is lowest (equation 3.59), kept a tenth away from both ends."""
    (a, fa, ga), (b, fb, gb) = low, high
    middle = 0.5 * (a + b)
    if not (np.isfinite(fb) and np.isfinite(gb)):
        return a + 0.25 * (b - a)
    d1 = ga + gb - 3.0 * (fa - fb) / (a - b)
    root = d1 * d1 - ga * gb
    if root < 0.0:
        return middle
    d2 = np.copysign(np.sqrt(root), b - a)
    bottom = gb - ga + 2.0 * d2
    place = b - (b - a) * (gb + d2 - d1) / bottom if bottom != 0.0 else middle
    edge = 0.1 * abs(b - a)
    return float(np.clip(place, min(a, b) + edge, max(a, b) - edge)) if np.isfinite(place) else middle
