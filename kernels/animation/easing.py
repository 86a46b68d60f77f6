"""Easing: how far a value has come, e(s), and de/ds, at the fraction s in 0 .. 1 of the time between two keys.

`easing_formulas(m, real)` makes the same formulas for the host (m = NumPy, real = float) and for the device (m = Warp, real =
wp.float64, each to be wrapped by `wp.func`): m gives where, sin, cos, sqrt and exp under one name in both.

    in        of a family             e(s)
    out       the same turned round   1 - e(1 - s)
    in-out    half of each            e(2 s) / 2,  then 1 - e(2 - 2 s) / 2

    power n   s^n          sine  1 - cos(pi s / 2)          expo  (2^(10 s) - 1) / 1023     circ  1 - sqrt(1 - s^2)
    back      s^2 ((k + 1) s - k), k = 1.70158: goes back by a tenth first
    elastic   expo(s) cos(2 pi (s - 1) / 0.3)               bounce  parabolas of a ball that keeps half of its speed
    smoothstep 3 s^2 - 2 s^3, smootherstep 6 s^5 - 15 s^4 + 10 s^3 (Perlin 2002)
    bezier    y(u) where x(u) = s, of P0 = 0, (x1, y1), (x2, y2), P3 = 1, 0 <= x <= 1 (CSS Easing Functions 1, section 2.2)

Names: Penner 2001, Robert Penner's Programming Macromedia Flash MX, chapter 7, but that expo here begins at 0 and elastic ends
at 1 exactly. At the ends of circ the rate is infinite: it is bounded by LIMIT.
"""

from types import SimpleNamespace
from typing import Any

LIMIT = 1.0e6                             # de/ds that a vertical tangent counts as
PI = 3.14159265358979323846
LN2 = 0.69314718055994530942
OVERSHOOT = 1.70158                       # of `back`: 10 % of the way
PERIOD = 0.3                              # of `elastic`
STEPS = 40                                # Newton steps with a bracket: x(u) = s to rounding, for flat and steep x alike


def easing_formulas(m, real) -> SimpleNamespace:
    """Functions (s) -> (e, de/ds) by name, each family's `in` form, and `bezier_fraction` (s, x1, x2) -> (u, du/ds)."""
    zero, half, one, two, three, six = real(0.0), real(0.5), real(1.0), real(2.0), real(3.0), real(6.0)
    ten, fifteen, thirty, four, five = real(10.0), real(15.0), real(30.0), real(4.0), real(5.0)
    quarter_turn, rise_rate, whole, k = real(0.5 * PI), real(10.0 * LN2), real(1023.0), real(OVERSHOOT)
    wave, least, limit, tiny = real(2.0 * PI / PERIOD), real(1.0 / LIMIT), real(LIMIT), real(1.0e-12)
    first, second, third, after_one, after_two, after_three = (real(v / 2.75) for v in (1.0, 2.0, 2.5, 1.5, 2.25, 2.625))
    g, high_one, high_two, high_three = real(7.5625), real(0.75), real(0.9375), real(0.984375)

    def smoothstep_easing(s: Any):
        return s * s * (three - two * s), six * s * (one - s)

    def smootherstep_easing(s: Any):
        r = s * (one - s)
        return s * s * s * (s * (six * s - fifteen) + ten), thirty * r * r

    def quadratic_easing(s: Any):
        return s * s, two * s

    def cubic_easing(s: Any):
        return s * s * s, three * s * s

    def quartic_easing(s: Any):
        return s * s * s * s, four * s * s * s

    def quintic_easing(s: Any):
        return s * s * s * s * s, five * s * s * s * s

    def sine_easing(s: Any):
        return one - m.cos(quarter_turn * s), quarter_turn * m.sin(quarter_turn * s)

    def exponential_easing(s: Any):
        e = m.exp(rise_rate * s)
        return (e - one) / whole, rise_rate * e / whole

    def circular_easing(s: Any):
        root = m.sqrt(m.where(s < one, one - s * s, zero))
        return one - root, s / m.where(root * limit > one, root, least)

    def back_easing(s: Any):
        return s * s * ((k + one) * s - k), s * (three * (k + one) * s - two * k)

    def elastic_easing(s: Any):
        e = m.exp(rise_rate * s)
        a = wave * (s - one)
        return (e - one) / whole * m.cos(a), (rise_rate * e * m.cos(a) - wave * (e - one) * m.sin(a)) / whole

    def bounce_easing(s: Any):
        """A ball seen backwards: flights of 1 : 2 : 4, then half of one of 8, heights as the squares of times."""
        t = one - s
        mid = m.where(t < first, zero, m.where(t < second, after_one, m.where(t < third, after_two, after_three)))
        up = m.where(t < first, zero, m.where(t < second, high_one, m.where(t < third, high_two, high_three)))
        return one - (g * (t - mid) * (t - mid) + up), two * g * (t - mid)

    def bezier_fraction(s: Any, x1: Any, x2: Any):
        low = zero * s
        high = low + one
        u = s
        ax = one - three * x2 + three * x1
        bx = three * x2 - six * x1
        cx = three * x1
        slope = zero * s
        for _k in range(STEPS):
            off = ((ax * u + bx) * u + cx) * u - s
            slope = (three * ax * u + two * bx) * u + cx
            high = m.where(off > zero, u, high)
            low = m.where(off > zero, low, u)
            by = off / m.where(slope > tiny, slope, tiny + zero * slope)
            middle = half * (low + high)
            u = m.where(u - by >= low, m.where(u - by <= high, u - by, middle), middle)
        slope = (three * ax * u + two * bx) * u + cx
        return u, one / m.where(slope * limit > one, slope, least + zero * slope)

    return SimpleNamespace(smoothstep=smoothstep_easing, smootherstep=smootherstep_easing, quad=quadratic_easing,
                           cubic=cubic_easing, quart=quartic_easing, quint=quintic_easing,
                           sine=sine_easing, expo=exponential_easing, circ=circular_easing, back=back_easing,
                           elastic=elastic_easing, bounce=bounce_easing, parameter=bezier_fraction)


def turned_round(of, real):
    """The `easing_out_form` form (s) -> (e, de/ds) of an `in` form."""
    one = real(1.0)

    def easing_out_form(s: Any):
        e, r = of(one - s)
        return one - e, r

    return easing_out_form


def in_out_halves(of, m, real):
    """The `in-out` form of an `in` form."""
    half, one, two = real(0.5), real(1.0), real(2.0)

    def easing_in_out_form(s: Any):
        first = s < half
        e, r = of(m.where(first, two * s, two - two * s))
        return m.where(first, half * e, one - half * e), r

    return easing_in_out_form
