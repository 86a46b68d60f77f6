"""Whether what a fit leaves looks like noise, and what is said where it does not: then error bars are not to be trusted.

    chi^2 / (n - p)     1 +- sqrt(2 / (n - p)) where the noise was given and the model is right; bars are widened by its root
                        where it is more (Birge 1932)
    rho                 correlation of residuals with those of the moment before: 0 +- 1 / sqrt(n) of noise. What a model misses
                        stays for frames, and is no noise that more data average out
"""

from math import sqrt

import numpy as np

from wsim.fitting.least_squares.levenberg_marquardt import LOUD
from wsim.fitting.least_squares.search import FitSearch

MOST = 4.0             # deviations of chance that are not yet told
ALIKE = 0.1            # rho that is told


def origin_of_noise(search: FitSearch, noise: float) -> str:
    """Origin of the noise: "given", "estimated", or "floor"."""
    best = search.best
    assert best is not None
    return "floor" if noise <= search.floor(best) and noise != 1.0 else "given" if search.known else "estimated"


def notes_on_goodness(search: FitSearch, noise: float, left: float) -> list[str]:
    """left: root of chi^2 / (n - p)."""
    best, found = search.best, []
    assert best is not None
    free = max(best.count - len(best.theta), 1)
    if search.known and left > 1.0 and left**2 - 1.0 > MOST * sqrt(2.0 / free):
        found.append(f"what is left is {left:.3g} times the noise that was given: the model, or the noise, is not right; error "
                     "bars were widened by that, and are not to be trusted all the same")
    if noise > 3.0 * LOUD * max(best.quiet, search.floor(best)) and not search.known:
        found.append(f"what is left grows from {sqrt(best.quiet):.2g} to {sqrt(noise):.2g} {search.misfit.unit} with time: "
                     "the model misses something, or this is a wrong valley; try other start values, and do not trust the "
                     "error bars")
    found += _notes_on_symmetry(search, noise)
    rho = best.alike / max(best.misfit, 1e-300)
    if origin_of_noise(search, noise) != "floor" and rho > max(ALIKE, MOST / sqrt(free)):
        found.append(f"what is left is alike from frame to frame (correlation {rho:.2f}) and so no noise: the model misses "
                     "something (a coarse mesh, say), and error bars do not say how much; do not trust them")
    return found


def _notes_on_symmetry(search: FitSearch, noise: float) -> list[str]:
    """Directions in which first derivatives are 0 and second ones are not: a place of symmetry, where no step begins."""
    best, spectrum = search.best, search.spectrum(search.best)        # type: ignore[arg-type]
    if best is None or best.second is None:
        return []
    lost, along = spectrum.V[~spectrum.kept], best.steps
    moved = best.second * along.h**4 / 4.0                            # |K h^2 / 2|^2
    own = [k for k in range(len(along.h)) if moved[k] > noise and (np.abs(lost @ along.B[:, k]) > 0.9).any()]
    names = [search.names[int(np.argmax(np.abs(along.B[:, k])))] for k in own]
    return [f"{n} shows in second order alone, as at a place of symmetry, from where no step begins: give another start value"
            for n in dict.fromkeys(names)]
