"""Extrapolation: where in its keys a curve is looked up at a time outside of them. `extrapolation_formulas(m, real)` makes the
formula for the host (m = NumPy) and for the device (m = Warp, to be wrapped by `wp.func`).

    HELD       the end                                LINEAR     the end, going on with a slope
    REPEAT     periods on end: each begins where the last one ended
    RESET      periods, each as the first             OSCILLATE  there and back

t - first = n T + r, 0 <= r < T = last - first: REPEAT adds n (value(last) - value(first)), OSCILLATE runs back where n is odd.
"""

from types import SimpleNamespace
from typing import Any

HELD, LINEAR, REPEAT, RESET, OSCILLATE = range(5)
NAMES = {"held": HELD, "linear": LINEAR, "repeat": REPEAT, "reset": RESET, "oscillate": OSCILLATE}


def extrapolation_formulas(m, real) -> SimpleNamespace:
    """`time_inside_keys` (t, first, last, mode) -> (time within first .. last, periods n to add, direction 1 or -1)."""
    zero, one, two = real(0.0), real(1.0), real(2.0)

    def time_inside_keys(t: Any, first: Any, last: Any, mode: Any):
        period = last - first
        n = m.floor((t - first) / m.where(period > zero, period, one + zero * period))
        r = t - n * period
        odd = m.where(mode == OSCILLATE, n - two * m.floor(n / two), zero * n)
        looped = m.where(odd > zero, last - (r - first), r)
        held = m.where(t < first, first, m.where(t > last, last, t))
        return m.where(mode >= REPEAT, looped, held), m.where(mode == REPEAT, n, zero * n), one - two * odd

    return SimpleNamespace(inside=time_inside_keys)
