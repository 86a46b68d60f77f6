"""The search of a fit on residuals that are given as functions: what it does where no step is any better."""

from collections.abc import Callable

import numpy as np
import pytest

from wsim.fitting.least_squares.levenberg_marquardt import NormalPrior
from wsim.fitting.least_squares.search import FitSearch
from wsim.fitting.observations.residuals import Misfit

NOISE, COUNT, MOMENTS = 1e-2, 40, 16


class Given(Misfit):
    """residual(theta, number of the moment) in the place of simulations."""

    central, eps, floor = True, 1e-5, 1e-9
    experiments, parameters = [], []

    def __init__(self, residual: Callable[[float, int], float]):
        self.residual, self.moments, self.lasts = residual, [0.1 * (k + 1) for k in range(MOMENTS)], [MOMENTS]
        self.walked, self.launches = 0.0, 0

    def walk(self, theta, derivatives=True, steps=None, finer=1):
        for k, time in enumerate(self.moments):
            noise = NOISE * np.random.default_rng(k).normal(size=COUNT)
            each = self.worlds(np.asarray(theta, np.float64), steps)
            self.walked += len(each) / MOMENTS
            yield self.part(time, k + 1, np.array([noise + self.residual(float(x[0]), k) for x in each]), steps)


def trapped(x: float) -> float:
    """Falls with x down to a jump just below the start, at 1."""
    return 2.0 + x + 5.0 * (x - 1.0)**2 if x > 1.0 - 1e-4 else 3.6


def searched(residual: Callable[[float, int], float]) -> FitSearch:
    search = FitSearch(Given(residual), np.ones(1), NormalPrior(np.zeros(1), np.zeros(1)), sigma=False, limit=200.0)
    search.run()
    return search


@pytest.mark.parametrize("early", [1, 4, 8])
def test_a_fit_that_is_stuck_in_early_frames_goes_on_to_later_ones(early):
    """The first frames hold it at a jump; all the others know that theta is 0, to noise / sqrt(residuals) / 3."""
    found = searched(lambda x, k: trapped(x) if k < early else 3.0 * (1 + k) * np.tanh(x))
    assert found.converged and found.misfit.walked < 40.0
    assert abs(found.best.theta[0]) < 5.0 * NOISE / 3.0 / np.sqrt(COUNT)


def test_a_fit_without_a_step_that_is_any_better_stops_in_words():
    found = searched(lambda x, k: trapped(x))
    assert not found.converged and found.misfit.walked < 100.0
    assert any("no step" in note for note in found.notes)
