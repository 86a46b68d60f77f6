"""Curves of numbers on the device, in float64: the formulas of wsim/scene/curve (pieces, easing, what is outside), from one
source.

    value(t) = cubic(u(s)) + periods growth, or the end + beyond slope         s, periods, beyond: kernels/animation/outside.py

Pieces come from the host. A kernel has the easings that its curves use and no others: `channel_functions(codes)` makes its
functions for a set of codes (wsim/scene/curve/easing.py).
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.animation import cubic, easing, outside

real = wp.float64
STRAIGHT, HOLD, BEZIER = 0, 1, 2                      # codes; others are numbers of easings by name
cubic_value = wp.func(cubic.cubic_piece_value, name="cubic_value")
cubic_rate = wp.func(cubic.cubic_piece_rate, name="cubic_rate")
inside = wp.func(outside.extrapolation_formulas(wp, real).inside, name="inside_keys")


@wp.struct
class ChannelTable:
    first: wp.array(dtype=int)                # keys of channel c: first[c] .. first[c + 1], (channels + 1,)
    time: wp.array(dtype=real)                # [s], increasing, (keys,)
    code: wp.array(dtype=int)                 # of the piece behind each key, (keys,)
    x: wp.array(dtype=wp.vec2d)               # of its handles [1], (keys,)
    part: wp.array(dtype=wp.vec4d)            # a, b, c, d of its cubic, (keys,)
    mode: wp.array(dtype=wp.vec2i)            # before and after the keys: kernels/animation/outside.py, (channels,)
    end: wp.array(dtype=wp.vec2d)             # values held there, (channels,)
    slope: wp.array(dtype=wp.vec2d)           # of going on there [unit/s]
    growth: wp.array(dtype=wp.vec2d)          # of a period there


@wp.func
def locate_in_channel(c: ChannelTable, channel: int, t: real):
    """(key before, fraction [1] of the way to the next, periods to add, direction, side or -1, [s] beyond the end)."""
    low = c.first[channel]
    last = c.first[channel + 1] - 1
    side = int(-1)
    mode = int(0)
    if t < c.time[low]:
        side = 0
        mode = c.mode[channel][0]
    elif t >= c.time[last]:
        side = 1
        mode = c.mode[channel][1]
    at, n, way = inside(t, c.time[low], c.time[last], mode)
    high = last
    first = low
    while low < high:                         # the first key later than `at`, or not earlier where it runs back
        middle = (low + high) // 2
        if c.time[middle] < at or (c.time[middle] == at and way > real(0.0)):
            low = middle + 1
        else:
            high = middle
    k = wp.max(low - 1, first)
    s = real(0.0)
    if k < c.first[channel + 1] - 1:
        s = (at - c.time[k]) / (c.time[k + 1] - c.time[k])
    if mode >= wp.static(outside.REPEAT):
        side = -1
    return k, s, n, way, side, t - at


@cache
def channel_functions(codes: tuple[int, ...], names: tuple[str, ...]) -> SimpleNamespace:
    """`channel_value` (c, channel, t) for pieces with these codes, and `channel_value_and_rate` -> (value, its rate a second):
    at a key the one behind it. names: of the easings whose codes are behind BEZIER."""
    own = f"{'_'.join(map(str, codes))}"
    formulas = easing.easing_formulas(wp, real)
    found = wp.func(_plain_easing, name=f"eased_{own}")
    if BEZIER in codes:
        found = _bezier_easing_func(found, wp.func(formulas.parameter, name="bezier_parameter"), own)
    for code, name in zip([code for code in codes if code > BEZIER], names, strict=True):
        found = _named_easing_func(found, _easing_of_name(formulas, name), code, own)

    def channel_value(c: ChannelTable, channel: int, t: real):
        k, s, n, _way, side, beyond = locate_in_channel(c, channel, t)
        p = c.part[k]
        x = c.x[k]
        u, _du = found(c.code[k], x[0], x[1], s)
        return extrapolated_value(c, channel, cubic_value(p[0], p[1], p[2], p[3], u), n, side, beyond)

    def channel_value_and_rate(c: ChannelTable, channel: int, t: real):
        k, s, n, way, side, beyond = locate_in_channel(c, channel, t)
        p = c.part[k]
        x = c.x[k]
        u, du = found(c.code[k], x[0], x[1], s)
        speed = real(0.0)
        if side >= 0:
            speed = c.slope[channel][side]
        elif k < c.first[channel + 1] - 1:
            speed = cubic_rate(p[1], p[2], p[3], u) * (du / (c.time[k + 1] - c.time[k])) * way
        return extrapolated_value(c, channel, cubic_value(p[0], p[1], p[2], p[3], u), n, side, beyond), speed

    return SimpleNamespace(value=wp.func(channel_value, name=f"channel_value_{own}"),
                           rate=wp.func(channel_value_and_rate, name=f"channel_rate_{own}"))


@wp.func
def extrapolated_value(c: ChannelTable, channel: int, within: real, n: real, side: int, beyond: real):
    """The value within the keys, or what is outside of them."""
    found = within
    if side >= 0:
        found = c.end[channel][side] + c.slope[channel][side] * beyond
    if n > real(0.0):
        found += n * c.growth[channel][1]
    elif n < real(0.0):
        found += n * c.growth[channel][0]
    return found


def _plain_easing(code: int, x1: real, x2: real, s: real):
    u = s
    du = real(1.0)
    if code == HOLD:
        u = real(0.0)
        du = real(0.0)
    return u, du


def _bezier_easing_func(before, parameter, own: str):
    def bezier_eased_fraction(code: int, x1: real, x2: real, s: real):
        u, du = before(code, x1, x2, s)
        if code == BEZIER:
            u, du = parameter(s, x1, x2)
        return u, du

    return wp.func(bezier_eased_fraction, name=f"eased_handles_{own}")


def _named_easing_func(before, formula, number: int, own: str):
    def named_eased_fraction(code: int, x1: real, x2: real, s: real):
        u, du = before(code, x1, x2, s)
        if code == number:
            u, du = formula(s)
        return u, du

    return wp.func(named_eased_fraction, name=f"eased_{number}_of_{own}")


def _easing_of_name(formulas, name: str):
    """The easing of a name, as a function of the device."""
    family, _, form = name.partition("-")
    base = wp.func(getattr(formulas, family), name=f"ease_{family}")
    if form == "out":
        return wp.func(easing.turned_round(base, real), name=f"ease_{family}_out")
    return wp.func(easing.in_out_halves(base, wp, real), name=f"ease_{family}_in_out") if form == "in-out" else base
