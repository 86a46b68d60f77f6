"""How far the time step shifts what a fit of fields finds: as `wsim.fitting.least_squares.time_step`, by the adjoint.

    g = J^T (r' - r) / s^2        r' residuals with half the time step
    d = -H^-1 g                   the step of Newton to what a fit with it would find
    d^T H d = g^T H^-1 g          its square in error bars, of all values together

Of numbers beside fields H^-1 e_k is known from their error bars. Of all values g^T H^-1 g is taken by a few conjugate
gradients, which find too little of it and never too much.
"""

from math import sqrt

import numpy as np

from wsim.fitting.fields.error_bars import SOME, Deviation, Newton
from wsim.fitting.fields.misfit import Adjoint
from wsim.scene import SceneError


class HalfStep:
    """rms: shift of all values in error bars, root of the mean square; shifts: of theta of each number. None: not known, `why`.
    """

    def __init__(self, misfit: Adjoint, theta: np.ndarray, sigma: float, Y: np.ndarray, bars: list[Deviation]):
        """sigma: noise; Y: probes at theta; bars: of the numbers."""
        self.rms: float | None = None
        self.shifts: list[float | None] = [None] * len(bars)
        self.why = ""
        try:
            g = misfit.half_step(theta) / sigma**2
            z, _ = Newton(misfit, theta, sigma, Y).solve(g, SOME)
        except SceneError as error:
            self.why = f"how far the time step shifts the values is not known: with half of it {error}"
            return
        self.rms = sqrt(max(float(g @ z), 0.0) / len(theta))
        self.shifts = [-float(b.column @ g) for b in bars]

    @property
    def matters(self) -> bool:
        """True if the shift is larger than an error bar."""
        return self.rms is not None and self.rms > 1.0

    def notes(self) -> list[str]:
        if self.why:
            return [self.why]
        return [f"half the time step shifts the values by {self.rms:.2g} error bars or more in the root mean square: these "
                "know noise alone; take more substeps and fit again"] * self.matters
