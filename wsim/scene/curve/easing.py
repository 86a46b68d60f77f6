"""Easing by name on the host: from a fraction of the time between two keys to a fraction of the way. NumPy only; the formulas
are those of kernels/animation/easing.py, which the device evaluates too.

    linear, smoothstep, smootherstep, hold
    ease, ease-in, ease-out, ease-in-out                                as CSS has them
    quad, cubic, quart, quint, sine, expo, circ, back, elastic, bounce  each with -in, -out, -in-out

A piece of a curve has one code: STRAIGHT, HOLD, BEZIER (with x of two handles), or that of a name (CODES).
"""

import numpy as np

from wsim.kernels.animation import cubic, easing

CSS = {"ease": (0.25, 0.1, 0.25, 1.0), "ease-in": (0.42, 0.0, 1.0, 1.0), "ease-out": (0.0, 0.0, 0.58, 1.0),
       "ease-in-out": (0.42, 0.0, 0.58, 1.0)}
FAMILIES = ("quad", "cubic", "quart", "quint", "sine", "expo", "circ", "back", "elastic", "bounce")
WHOLE = ("linear", "hold", "smoothstep", "smootherstep")
NAMED = (*(f"{family}-{form}" for family in FAMILIES for form in ("in", "out", "in-out")),)
NAMES = (*WHOLE, *CSS, *NAMED)
STRAIGHT, HOLD, BEZIER = 0, 1, 2
CODES = {"linear": STRAIGHT, "hold": HOLD, **dict.fromkeys(CSS, BEZIER),
         **{name: 3 + k for k, name in enumerate(("smoothstep", "smootherstep", *NAMED))}}
BY_CODE = {code: name for name, code in CODES.items() if code > BEZIER}
HOST = easing.easing_formulas(np, float)


def easing_handles(name) -> tuple[float, float, float, float] | None:
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


def easing_function(name: str, of=HOST, m=np, real=float):
    """(s) -> (e, de/ds) of a name with a code behind BEZIER. of, m, real: functions of kernels/animation/easing.py for the
    host, or for the device."""
    family, _, form = name.partition("-")
    found = getattr(of, family)
    return {"out": lambda: easing.turned_round(found, real), "in-out": lambda: easing.in_out_halves(found, m, real)}.get(
        form, lambda: found)()


def warp_fractions(code: np.ndarray, x: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(u, du/ds) [1] at fractions s (n,) of pieces with codes (n,) and x of handles (n, 2)."""
    u, rate = s.copy(), np.ones_like(s)
    for one in np.unique(code).tolist():
        at = code == one
        if one == HOLD:
            u[at], rate[at] = 0.0, 0.0
        elif one == BEZIER:
            u[at], rate[at] = HOST.parameter(s[at], x[at, 0], x[at, 1])
        elif one != STRAIGHT:
            u[at], rate[at] = easing_function(BY_CODE[one])(s[at])
    return u, rate


def ease_fractions(name, s) -> tuple[np.ndarray, np.ndarray]:
    """(e, de/ds) [1] at fractions s in 0 .. 1, any shape; name: one of NAMES, or (x1, y1, x2, y2). Raises ValueError as
    `easing_handles`."""
    s = np.clip(np.asarray(s, np.float64), 0.0, 1.0)
    of = easing_handles(name)
    if of is not None:
        u, du = HOST.parameter(s, of[0], of[2])
        a, b, c, d = cubic.hermite_coefficients(0.0, 1.0, 3.0 * of[1], 3.0 * (1.0 - of[3]))
        return cubic.cubic_piece_value(a, b, c, d, u), cubic.cubic_piece_rate(b, c, d, u) * du
    if name == "linear":
        return s, np.ones_like(s)
    if name == "hold":
        return np.where(s < 1.0, 0.0, 1.0), np.zeros_like(s)
    return easing_function(name)(s)
