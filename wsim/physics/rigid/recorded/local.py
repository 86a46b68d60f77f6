"""Derivatives of what a joint or a contact does, by all that it reads: complex steps of a function for all of them at once."""

from collections.abc import Callable

import numpy as np

STEP = 1.0e-30
Values = dict[str, np.ndarray]                 # (elements, size) each


def complex_derivatives(function: Callable[[Values], Values], values: Values) -> dict[tuple[str, str], np.ndarray]:
    """{(what comes out, what goes in): (elements, out, in)} of a function of arrays (..., elements, size)."""
    count = sum(v.shape[1] for v in values.values())
    given, first = {}, 0
    for name, v in values.items():
        given[name] = np.tile(v.astype(np.complex128), (count, 1, 1))
        for k in range(v.shape[1]):
            given[name][first + k, :, k] += 1j * STEP
        first += v.shape[1]
    out = {name: found.imag / STEP for name, found in function(given).items()}          # (count, elements, out)
    slices, first = {}, 0
    for name, v in values.items():
        slices[name] = slice(first, first + v.shape[1])
        first += v.shape[1]
    return {(each, name): np.moveaxis(found[s], 0, 2) for each, found in out.items() for name, s in slices.items()}


def residual_values(function: Callable[[Values], Values], values: Values, name: str = "rest") -> np.ndarray:
    """Residual by the function of that name, (elements, size)."""
    return function(values)[name].real
