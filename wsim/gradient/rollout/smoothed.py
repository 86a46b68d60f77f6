"""Whether a gradient says what small changes do: exact derivatives beside randomised ones, of the same runs.

A branch (a contact that is met or missed, stick or slip, a strain limit) has a derivative on either side, and says nothing of
the other side: exact, and useless for a search. With L_sigma(p) = E[L(p + sigma s d)], s a standard normal number, the
derivative of the smoothed loss along d,

    dL_sigma = E[s (L(p + sigma s d) - L(p - sigma s d))] / (2 sigma)                 (Nesterov, Spokoiny 2017; antithetic)

sees what happens within about sigma. Its difference to the exact slope g is estimated from the same copies, in one batch,

    e = mean of s ((L+ - L-) / 2 - sigma s g) / sigma,

whose scatter is that of what g has not foreseen: where the loss is smooth it is nearly none, however large the slope (Suh et
al. 2022, Do differentiable simulators give better policy gradients?, compare both for this reason). Curvature of third order
counts as a difference too: take a smaller spread where that is not wanted.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wsim.gradient.rollout.products import Rollout, range_in_words
from wsim.scene import Problem, SceneError

CERTAIN = 3.0          # standard errors


@dataclass
class GradientTrust:
    """One input, along its gradient (a single number: along itself)."""

    name: str
    exact: float           # slope, by the adjoint
    smoothed: float        # slope of the smoothed loss
    error: float           # standard error of the difference of both
    spread: float          # sigma, in the unit of the input
    verdict: str           # "agree", "differ", or "unsure"

    def __str__(self) -> str:
        said = {"agree": "trustworthy", "differ": "not trustworthy: it does not foresee what changes of that size do",
                "unsure": "unsure: take more samples, or another spread"}[self.verdict]
        return (f"{self.name}: exact {self.exact:.4g}, over {self.spread:.3g} {self.smoothed:.4g} +- {self.error:.2g}: {said}")


def trust(rollout: Rollout, loss: Callable, slope: Callable, *, spreads: dict[str, float] | None = None, samples: int = 64,
          within: float = 0.1, seed: int = 0) -> list[GradientTrust]:
    """One verdict for each input of a rollout, at its present values.

    loss(y), slope(y)   a number, and its derivatives by a motion y as `Rollout.run` gives it, of the same shape
    spreads    sigma by input, in its unit: what a search may change it by; else a part of it (`RecordingInput.scale`)
    samples    pairs of runs for each input, in one batch of 2 x samples worlds in float64; by where a collider is, which worlds
               share, one after the other
    within     part of the larger of both slopes by which they may differ
    "agree": they differ by less than that, with CERTAIN standard errors; "differ": by more, with as many; else "unsure".
    Raises SceneError for several worlds, names that are none, spreads that are not above 0, and inputs whose copies would have
    values that may not be (a friction below 0).
    """
    if rollout.sim.worlds > 1:
        raise SceneError(Problem("worlds", f"found {rollout.sim.worlds}; copies are made of one"))
    if samples < 4:
        raise SceneError(Problem("samples", f"found {samples}; allowed is 4 or more"))
    spreads = spreads or {}
    for name, value in spreads.items():
        if name not in rollout.inputs or not 0.0 < value < np.inf:
            raise SceneError(Problem(name, f"found a spread of {value}; allowed are numbers above 0, for "
                                     f"{', '.join(rollout.inputs)}"))
    y = rollout.run()
    gradient, base = rollout.vjp(slope(y)), rollout.values()
    draws = np.random.default_rng(seed).normal(size=samples)
    found = []
    for name, by in gradient.items():
        d, exact = _direction_of_gradient(np.asarray(by))
        sigma = spreads[name] if name in spreads else rollout.scale(name)
        rows = base[name] + sigma * np.multiply.outer(np.concatenate([draws, -draws]), d)
        _require_allowed_copies(rollout, name, base[name], rows, sigma)
        losses = np.array([loss(each) for each in rollout.run_varied_copies({name: rows}, 2 * samples)])
        found.append(_judge_slopes(name, exact, losses[:samples] - losses[samples:], draws, sigma, within))
    rollout.copied.pop(2 * samples, None)                # so many worlds take room
    return found


def _require_allowed_copies(rollout: Rollout, name: str, base: np.ndarray, rows: np.ndarray, sigma: float) -> None:
    """Raises SceneError where copies would have values that may not be."""
    if rollout.inputs[name].allows_value(rows):
        return
    low, high = rollout.inputs[name].bounds()
    room, taken = min(float((base - low).min()), float((high - base).min())), float(np.abs(rows - base).max())
    mend = f"give spreads={{{name!r}: {0.99 * sigma * room / taken:.2g}}} or less" if room > 0.0 else \
        "a smoothed loss needs both sides of it: set it off that end, or leave it out of the rollout"
    raise SceneError(Problem(name, f"is {range_in_words(base)}, and copies with a spread of {sigma:.3g} have "
                                   f"{range_in_words(rows)}; allowed are "
                             f"{low:g} to {high:g}; {mend}"))


def _direction_of_gradient(g: np.ndarray) -> tuple[np.ndarray, float]:
    """The direction of a gradient, and the slope along it; of a number the direction is 1; where there is none, some."""
    if not g.ndim:
        return np.ones(()), float(g)
    size = float(np.linalg.norm(g))
    return (g / size, size) if size else (np.ones(g.shape) / g.size**0.5, 0.0)


def _judge_slopes(name: str, exact: float, change: np.ndarray, draws: np.ndarray, sigma: float, within: float) -> GradientTrust:
    """change: L+ - L- of each pair."""
    off = draws * (0.5 * change - sigma * draws * exact) / sigma
    e, error = float(off.mean()), float(off.std(ddof=1) / len(off)**0.5)
    allowed = within * max(abs(exact), abs(exact + e))
    verdict = "unsure"
    if abs(e) + CERTAIN * error <= allowed:
        verdict = "agree"
    elif abs(e) > allowed and abs(e) > CERTAIN * error:
        verdict = "differ"
    return GradientTrust(name, exact, exact + e, error, sigma, verdict)
