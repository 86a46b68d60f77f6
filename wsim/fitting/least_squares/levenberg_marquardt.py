"""The step of Levenberg and Marquardt from normal equations, and whether it is the last. More 1978 (trust region); Transtrum,
Sethna 2012 (second derivatives along a step).

    (J^T J / s^2 + P + lam 1) d = -(J^T r / s^2 + P (theta - mean)),    |d| <= radius        s noise, P of the priors
    (J^T J / s^2 + P + lam 1) q = -J^T K d^2 / 2 s^2                    what curvature adds to the step d

Where no noise is given, s is what the linear model leaves, and never less than the floor
(`wsim.fitting.least_squares.noise_floor`, and CHANCE times what differences show of chance).

Converged means, at a theta that was run over all that is used: the step from there is less than DONE error bars (so that it
would take less than DONE^2 off chi^2) in all that is known to better than a factor e, and promises less than 1 off chi^2 in the
rest; something is known; and what seems not to be seen was looked at with the longest difference. That theta is the result.
"""

from dataclasses import dataclass

import numpy as np

from wsim.fitting.least_squares.normal_equations import FARTHEST, JacobianSpectrum, NormalEquations
from wsim.fitting.observations.residuals import DifferenceSteps

RADIUS = 1.0           # largest step of a mapped parameter: a factor e
OPEN = 1.0             # of theta: error bar of what counts as not known, a factor e
WEAK = 0.1             # lam: what the data leave open within 3 units of theta moves little
CURVED = 1e-5          # curvature of less than this (of theta) never ends a run early
DONE = 0.2             # error bars that the step from the last theta may have
CHANCE = 10.0          # noise is at least so many times what a simulation leaves to chance: that is alike from point to point
JITTER = 1e-9          # of the floor's unit: chance that forward differences, which cannot measure it, are taken to have
LOUD = 4.0             # s^2 over what it was at an earlier moment: the linear model is what is wrong, not the data


@dataclass
class NormalPrior:
    """Normal priors of the parameters in the mapped space: weight 1 / sigma^2 (0: none) and mean."""

    weight: np.ndarray
    mean: np.ndarray

    def misfit(self, theta: np.ndarray) -> float:
        return float((self.weight * (theta - self.mean)**2).sum())


class LevenbergMarquardt:
    """Steps, of residuals whose `floor` is the least noise that is claimed; eps: the shortest difference. `radius` and `end`,
    the time [s] up to which data are used, change as a fit goes on."""

    def __init__(self, prior: NormalPrior, *, sigma: bool, accuracy: float, floor: float, eps: float, end: float):
        """sigma: residuals are in units of a known noise. accuracy: two error bars of theta that are enough; 0: what all
        the data give."""
        self.prior, self.known, self.accuracy, self.claimed, self.eps, self.end = prior, sigma, accuracy, floor, eps, end
        self.radius = RADIUS

    # what is known at one theta

    def chance_of_residuals(self, sums: NormalEquations) -> float:
        """Chance of all residuals together, where forward differences cannot measure it."""
        return JITTER / 1e-7 * self.claimed * np.sqrt(sums.count)

    def floor(self, sums: NormalEquations) -> float:
        """s^2 below which nothing is claimed."""
        least = self.claimed**2
        if sums.second is None or not sums.count:
            return least
        seen = sums.second[sums.second > 0.0] * sums.steps.h[sums.second > 0.0]**4 / 6.0
        return max(least, CHANCE**2 * float(seen.min(initial=np.inf if len(seen) else 0.0)) / sums.count)

    def noise(self, sums: NormalEquations, left: float | None = None) -> float:
        """s^2. left: sum of r^2; None: after the step of the linear model."""
        left = sums.least if left is None else left
        return max(1.0 if self.known else left / max(sums.count - len(sums.theta), 1), self.floor(sums))

    def calm(self, sums: NormalEquations) -> float:
        """s^2, but at most LOUD times what it was at any earlier moment."""
        return min(self.noise(sums), max(LOUD * sums.quiet, self.floor(sums)))

    def spectrum(self, sums: NormalEquations) -> JacobianSpectrum:
        return sums.spectrum(self.chance_of_residuals(sums))

    # one step

    def prior_weighted_equations(self, sums: NormalEquations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """S, V and U^T (-side) of J over s above the roots of the priors, without what is lost."""
        s, root = np.sqrt(self.noise(sums)), np.sqrt(self.prior.weight)
        spectrum = self.spectrum(sums)
        seen = (spectrum.V @ (sums.J.T @ sums.R[:-1, -1])) / np.maximum(spectrum.S, 1e-300) / s
        rows = np.concatenate([spectrum.J / s, np.diag(root)])
        side = np.concatenate([np.where(spectrum.kept, seen, 0.0), root * (sums.theta - self.prior.mean)])
        U, S, V = np.linalg.svd(rows, full_matrices=False)
        known = 1e-12 * max(S[0], 1e-300) < S
        return S[known], V[known], -(U.T @ side)[known]

    def step(self, sums: NormalEquations) -> tuple[np.ndarray, np.ndarray]:
        """d and q."""
        S, V, side = self.prior_weighted_equations(sums)
        lam = WEAK
        while True:
            d = V.T @ (S / (S**2 + lam) * side)
            if np.abs(d).max(initial=0.0) <= self.radius or lam > 1e300:
                break
            lam *= 2.0
        if sums.bend is None:
            return d, np.zeros_like(d)
        square = 0.5 * (sums.steps.B.T @ d)**2 / self.noise(sums)
        return d, -V.T @ ((V @ (sums.bend @ square)) / (S**2 + lam))

    def bars(self, sums: NormalEquations, q: np.ndarray, noise: float) -> float:
        """Length of q in error bars of noise s^2."""
        return float(np.sqrt(((sums.J @ q)**2).sum() / noise + (self.prior.weight * q**2).sum()))

    def ends(self, sums: NormalEquations) -> bool:
        """True if more data would not make the step any better."""
        d, q = self.step(sums)
        if sums.bend is None:
            return bool(np.abs(d).max() > 0.1
                        and self.bars(sums, d, self.calm(sums)) > 3.0) or self.known_accurately_enough(sums, d)
        if np.abs(d).max() <= RADIUS / 2.0 and self.known_accurately_enough(sums, q):
            return True
        return bool(np.abs(q).max() > CURVED and self.bars(sums, q, self.calm(sums)) > 1.0)

    def known_accurately_enough(self, sums: NormalEquations, left: np.ndarray) -> bool:
        """True if what is left to go is less than `accuracy`, and all is known to it."""
        if not self.accuracy or np.abs(left).max() > 0.25 * self.accuracy:
            return False
        A = self.spectrum(sums).J
        A = A.T @ A / self.noise(sums) + np.diag(self.prior.weight)
        if np.linalg.eigvalsh(A)[0] < 1.0 / self.accuracy**2:
            return False
        return bool(2.0 * np.sqrt(np.diag(np.linalg.inv(A))).max() <= self.accuracy)

    def there(self, sums: NormalEquations) -> bool:
        """True if the fit has converged here."""
        if self.known_accurately_enough(sums, self.step(sums)[0]):
            return True
        strong, weak = self.promised_decrease(sums)
        return bool(sums.time >= self.end and strong is not None and strong <= DONE**2 and weak <= 1.0
                    and not self.hidden(sums))

    def promised_decrease(self, sums: NormalEquations) -> tuple[float | None, float]:
        """Decrease of chi^2 that a step promises in what is known to better than a factor e (None: nothing is), and in the
        rest."""
        S, _, side = self.prior_weighted_equations(sums)
        strong = S >= 1.0 / OPEN
        weak = side[~strong]**2 * S[~strong]**2 / (S[~strong]**2 + WEAK)
        return float((side[strong]**2).sum()) if strong.any() else None, float(weak.sum())

    def hidden(self, sums: NormalEquations) -> bool:
        """True if something seems not to be seen that a longer difference may show."""
        lost = self.spectrum(sums).V[~self.spectrum(sums).kept]
        short = np.abs(sums.steps.h) < 0.99 * max(FARTHEST, self.eps)
        return bool((np.abs(lost @ sums.steps.B[:, short]) > 0.1).any())

    def next_steps(self, best: NormalEquations | None, count: int) -> DifferenceSteps:
        """Steps for differences of so many parameters, after the best theta so far."""
        if best is None:
            return DifferenceSteps.axes(count, self.eps)
        return best.next_steps(self.eps, self.chance_of_residuals(best), (0.5 / CHANCE)**2 * self.noise(best))
