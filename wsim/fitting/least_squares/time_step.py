"""Shift of the result of a fit by half the time step, from one run with that step.

    d = -C J^T (r' - r) / s^2        C = (J^T J / s^2 + P)^-1        r' residuals at the result with half the time step

d is the Gauss-Newton step from the result to that of a fit with half the time step, in the mapped space. Observations have no
time step: if d is larger than an error bar, the time step limits the accuracy of the result, not the noise. For a scheme of
order k, the result at a step of 0 lies d / (2^k - 1) beyond that at half the step. The error of d is of the order of d^2, so
that larger shifts than FAR are reported as "over FAR".
"""

from dataclasses import dataclass

import numpy as np

from wsim.fitting.copies import BrokenRun
from wsim.fitting.least_squares.search import FitSearch
from wsim.fitting.least_squares.uncertainty import ParameterEstimate
from wsim.fitting.parameter import Parameter
from wsim.scene import SceneError

FAR = 1.0              # of theta: a factor e; beyond it the linear model is invalid


@dataclass
class TimeStepShift:
    """Shift of each parameter by half the time step, (p,); NaN: not known.

    values: in the parameters' units. bars: in error bars. far: True if the shift is larger than `values` has it.
    """

    values: np.ndarray
    bars: np.ndarray
    far: np.ndarray
    why: str = ""                # reason if nothing is known

    @property
    def exceeds_error_bar(self) -> np.ndarray:
        """Mask of the parameters that are shifted by more than their error bar."""
        return np.abs(np.nan_to_num(self.bars)) > 1.0

    def notes(self, parameters: list[Parameter], values: np.ndarray) -> list[str]:
        """Warnings about shifts that are larger than an error bar."""
        names = [f"{p.name} by {self.told(k, values[k])}"
                 for k, p in enumerate(parameters) if self.exceeds_error_bar[k]]
        return [self.why] * bool(self.why) + [
            f"half the time step shifts {', '.join(names)}: more than the error bars, which account for noise only; take "
            "more substeps (or fluid steps) and fit again"] * bool(names)

    def told(self, k: int, value: float) -> str:
        """Shift of a parameter in words."""
        if not np.isfinite(self.values[k]):
            return "unknown"
        shift = self.values[k]
        size = f"{100.0 * shift / abs(value):+.2g} %" if value else f"{shift:+.2g}"
        return f"{'over ' * bool(self.far[k])}{size} ({abs(self.bars[k]):.2g} error bars)"


def unknown_time_step_shift(count: int, why: str = "") -> TimeStepShift:
    return TimeStepShift(np.full(count, np.nan), np.full(count, np.nan), np.zeros(count, bool), why)


def shift_by_half_time_step(search: FitSearch, e: ParameterEstimate, noise: float) -> TimeStepShift:
    """The shift of the result of a search; noise: s^2 of the estimate. Costs two simulations of one copy."""
    best, misfit, count = search.best, search.misfit, len(e.theta)
    known = np.isfinite(e.errors)
    if best is None or not known.any():
        return unknown_time_step_shift(count)
    try:
        blocks = best.blocks or ((part.r, part.J) for part in misfit.walk(best.theta, steps=best.steps) if part.J is not None)
        slope = np.zeros(count)
        for (r, J), part in zip(blocks, misfit.walk(best.theta, derivatives=False, finer=2), strict=False):
            slope += J.T @ (part.r - r)
            if part.time >= best.time:
                break
    except (BrokenRun, SceneError) as error:
        return unknown_time_step_shift(count,
                                       f"the shift by the time step is unknown, as a run with half of it failed: {error}")
    d = np.where(known, -e.covariance @ slope / noise, np.nan)
    near = np.clip(d, -FAR, FAR)
    moved = [p.map.inverse(float(t)) if np.isfinite(t) else np.nan
             for p, t in zip(misfit.parameters, e.theta + near, strict=True)]
    sigma = np.sqrt(np.diag(e.covariance))
    return TimeStepShift(np.array(moved) - e.values, d / np.where(sigma > 0.0, sigma, np.nan), np.abs(np.nan_to_num(d)) > FAR)
