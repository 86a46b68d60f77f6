"""What a fit of fields knows where it stands: error bars of numbers beside them, and what Newton's step would still gain.

    H = J^T J / s^2 + R,    sigma_k^2 = (H^-1)_kk,    F - min F = g H^-1 g / 2        R of priors, and of what is believed of
                                                                                   neighbours
(that every element is near its start, where no prior says so, is left out of bars: many together would seem to know a number)

by conjugate gradients on H z = b, begun from the metric of the search. J v is a central difference of residuals, J^T of that
a run backward: three runs and one back an iteration. b z errs by the square of what is left of the right side, and is too
small.
"""

from dataclasses import dataclass, replace

import numpy as np

from wsim.fitting.fields.misfit import AdjointMisfit
from wsim.fitting.fields.preconditioner import SketchedHessian
from wsim.fitting.fields.prior import WIDE, NeighbourBelief

CLOSE = 0.05                 # of the right side
MOST, SOME = 40, 4           # iterations for an error bar; for a gain, which 4 tell to a factor 3 and 12 to 1.5
UNKNOWN = 100.0 * WIDE       # units of theta


class NewtonSystem:
    """H at theta. Y: probes there."""

    def __init__(self, misfit: AdjointMisfit, theta: np.ndarray, sigma: float, Y: np.ndarray,
                 beliefs: list[NeighbourBelief] | None = None):
        self.misfit, self.theta, self.weight = misfit, theta, 1.0 / sigma**2
        self.metric = SketchedHessian(beliefs or misfit.beliefs, misfit.parts(theta), Y)

    def product(self, v: np.ndarray) -> np.ndarray:
        parts = zip(self.misfit.parts(v), self.metric.matrices, strict=True)
        own = np.concatenate([A[0](p).ravel() for p, A in parts])
        return self.misfit.gauss_newton(self.theta, v) * self.weight + own

    def solve(self, b: np.ndarray, most: int) -> tuple[np.ndarray, bool]:
        """H^-1 b, and whether it came CLOSE."""
        z, r = np.zeros_like(b), b.copy()
        p = y = self.metric(r, self.weight)
        first = ry = float(r @ y)
        for _ in range(most):
            if ry <= CLOSE**2 * first:
                break
            q = self.product(p)
            a = ry / float(p @ q)
            z, r = z + a * p, r - a * q
            y = self.metric(r, self.weight)
            before, ry = ry, float(r @ y)
            p = y + ry / before * p
        return z, ry <= CLOSE**2 * first


@dataclass
class ThetaDeviation:
    """Error bar of one theta[k]. sigma: sigma_k; close: True if it has converged, False: a lower bound; column: H^-1 e_k."""

    sigma: float
    close: bool
    column: np.ndarray


def theta_deviations(misfit: AdjointMisfit, theta: np.ndarray, rows: list[int], sigma: float,
                     Y: np.ndarray) -> list[ThetaDeviation]:
    """Error bar of theta[k] for each k of rows. Y: probes at theta."""
    beliefs = [b if b.wide != WIDE else replace(b, wide=UNKNOWN) for b in misfit.beliefs]
    newton, found = NewtonSystem(misfit, theta, sigma, Y, beliefs), []
    for k in rows:
        z, close = newton.solve(np.eye(len(theta))[k], MOST)
        found.append(ThetaDeviation(float(np.sqrt(max(float(z[k]), 0.0))), close, z))
    return found


def newton_step_gain(misfit: AdjointMisfit, theta: np.ndarray, gradient: np.ndarray, sigma: float, Y: np.ndarray) -> float:
    """Decrease of F that Newton's step promises."""
    if not gradient.any():
        return 0.0
    return 0.5 * float(gradient @ NewtonSystem(misfit, theta, sigma, Y).solve(gradient, SOME)[0])
