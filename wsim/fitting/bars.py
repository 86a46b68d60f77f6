"""Error bars of the numbers of a fit that has fields too: what is left unknown of them once the fields are.

    H = J^T J / s^2 + R,    sigma_k^2 = (H^-1)_kk        R of priors, and of what is believed of neighbours

(that every element is near its start, where no prior says so, is left out: many together would seem to know a number)

by conjugate gradients on H z = e_k, begun from the metric of the search. J v is a central difference of residuals, J^T of that
a run backward: three runs and one back an iteration. z_k errs by the square of what is left of the right side.
"""

from dataclasses import replace

import numpy as np

from wsim.fitting.by_adjoint import Adjoint
from wsim.fitting.metric import Metric
from wsim.fitting.regular import WIDE

CLOSE, MOST = 0.05, 12       # of the right side; iterations for each number
UNKNOWN = 100.0 * WIDE       # units of theta


def deviations(misfit: Adjoint, theta: np.ndarray, rows: list[int], sigma: float, Y: np.ndarray) -> np.ndarray:
    """sigma_k of theta[k], for each of rows. Y: probes at theta."""
    beliefs = [b if b.wide != WIDE else replace(b, wide=UNKNOWN) for b in misfit.beliefs]
    metric = Metric(beliefs, misfit.parts(theta), Y)

    def product(v: np.ndarray) -> np.ndarray:
        parts = zip(misfit.parts(v), metric.matrices, strict=True)
        return misfit.gauss_newton(theta, v) / sigma**2 + np.concatenate([A[0](p).ravel() for p, A in parts])
    found = []
    for k in rows:
        b = np.eye(len(theta))[k]
        z, r = np.zeros_like(b), b.copy()
        y = metric(r, 1.0 / sigma**2)
        p, ry = y, float(r @ y)
        for _ in range(MOST):
            q = product(p)
            a = ry / float(p @ q)
            z, r = z + a * p, r - a * q
            y = metric(r, 1.0 / sigma**2)
            before, ry = ry, float(r @ y)
            if ry <= CLOSE**2 * float(b @ metric(b, 1.0 / sigma**2)):
                break
            p = y + ry / before * p
        found.append(np.sqrt(max(float(z[k]), 0.0)))
    return np.array(found)
