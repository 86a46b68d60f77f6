"""Easing by name on the host: from a fraction of the time between two keys to a fraction of the way. NumPy only; the formulas
are those of kernels/animation/easing.py, which the device evaluates too.

    linear, smoothstep, smootherstep, hold
    ease, ease-in, ease-out, ease-in-out                                as CSS has them
    quad, cubic, quart, quint, sine, expo, circ, back, elastic, bounce  each with -in, -out, -in-out
"""

import numpy as np

from wsim.kernels.animation import easing

CSS = {"ease": (0.25, 0.1, 0.25, 1.0), "ease-in": (0.42, 0.0, 1.0, 1.0), "ease-out": (0.0, 0.0, 0.58, 1.0),
       "ease-in-out": (0.42, 0.0, 0.58, 1.0)}
FAMILIES = ("quad", "cubic", "quart", "quint", "sine", "expo", "circ", "back", "elastic", "bounce")
WHOLE = ("linear", "hold", "smoothstep", "smootherstep")
NAMES = (*WHOLE, *CSS, *(f"{family}-{form}" for family in FAMILIES for form in ("in", "out", "in-out")))
HOST = easing.easings(np, float)


def handles(name) -> tuple[float, float, float, float] | None:
    """(x1, y1, x2, y2) of an easing that is a cubic Bezier: four numbers, or a name of CSS; None of others. Raises ValueError
    where x leaves 0 .. 1, or a name is unknown."""
    if isinstance(name, str):
        if name not in NAMES:
            raise ValueError(f"no easing is called {name!r}; there are {', '.join(NAMES)}, and (x1, y1, x2, y2)")
        return CSS.get(name)
    found = tuple(float(v) for v in name)
    if len(found) != 4 or not np.all(np.isfinite(found)) or not (0.0 <= found[0] <= 1.0 and 0.0 <= found[2] <= 1.0):
        raise ValueError(f"the handles of an easing are (x1, y1, x2, y2) with both x in 0 .. 1, not {tuple(name)}")
    return found


def eased(name, s) -> tuple[np.ndarray, np.ndarray]:
    """(e, de/ds) [1] at fractions s in 0 .. 1, any shape; name: one of NAMES, or (x1, y1, x2, y2). Raises ValueError as
    `handles`."""
    s = np.clip(np.asarray(s, np.float64), 0.0, 1.0)
    of = handles(name)
    if of is not None:
        return HOST.bezier(s, *of)
    if name == "linear":
        return s, np.ones_like(s)
    if name == "hold":
        return np.where(s < 1.0, 0.0, 1.0), np.zeros_like(s)
    family, _, form = name.partition("-")
    function = getattr(HOST, family)
    if form == "out":
        function = easing.turned_round(function, float)
    elif form == "in-out":
        function = easing.halves(function, np, float)
    return function(s)
