"""Shift of the result of a field fit by half the time step, by the adjoint. `wsim.fitting.least_squares.time_step` has the same
for a fit of numbers.

    g = J^T (r' - r) / s^2        r' residuals with half the time step
    d = -H^-1 g                   Newton step to the result of a fit with half the time step
    d^T H d = g^T H^-1 g          square of the shift of all values together, in error bars

For numbers beside fields, H^-1 e_k is known from their error bars. For all values, a few iterations of conjugate gradients
approximate g^T H^-1 g from below: the result is a lower bound.
"""

from math import sqrt

import numpy as np

from wsim.fitting.fields.error_bars import SOME, NewtonSystem, ThetaDeviation
from wsim.fitting.fields.misfit import AdjointMisfit
from wsim.scene import SceneError


class FieldHalfStep:
    """The shift. rms: of all values, root mean square in error bars; shifts: of theta of each number. None: not known, see
    `why`."""

    def __init__(self, misfit: AdjointMisfit, theta: np.ndarray, sigma: float, Y: np.ndarray, bars: list[ThetaDeviation]):
        """sigma: noise; Y: probes at theta; bars: of the numbers."""
        self.rms: float | None = None
        self.shifts: list[float | None] = [None] * len(bars)
        self.why = ""
        try:
            g = misfit.half_step(theta) / sigma**2
            z, _ = NewtonSystem(misfit, theta, sigma, Y).solve(g, SOME)
        except SceneError as error:
            self.why = f"the shift by the time step is unknown, as a run with half of it failed: {error}"
            return
        self.rms = sqrt(max(float(g @ z), 0.0) / len(theta))
        self.shifts = [-float(b.column @ g) for b in bars]

    @property
    def exceeds_error_bar(self) -> bool:
        """True if the shift is larger than an error bar."""
        return self.rms is not None and self.rms > 1.0

    def notes(self) -> list[str]:
        if self.why:
            return [self.why]
        return [f"half the time step shifts the values by at least {self.rms:.2g} error bars (root mean square), which account "
                "for noise only; take more substeps and fit again"] * self.exceeds_error_bar
