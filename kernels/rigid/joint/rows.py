"""Wants of each row of a joint in a sweep: locks, limits and drives.

    held      g(x + h v) = goal                      coordinates of the places that the velocities v lead to, not linearised
    limited   the same at low or high, where v would lead beyond it; its impulse keeps one sign
    driven    the laws of drives.py, by an impulse no larger than what the drive may give
    relaxed   g' = 0 of what is held, at the new places; the rest of what drives give

A step whose held rows have g(x + h v) = goal, and which then takes the speed along them away, is SHAKE and RATTLE (Ryckaert,
Ciccotti, Berendsen 1977; Andersen 1983): of order 2, and no energy is lost. goal is 0, or what is left of an error that is
taken back at PULL or SPIN.

Which of them act together is found by pivots (pivots.py). The first guess is what acts already, and limits that v leads beyond.
"""

import warp as wp

from wsim.kernels.rigid.joint.elimination import Linked, block_product, mat66d
from wsim.kernels.rigid.joint.tables import (
    BOTTOM,
    DRIVEN,
    FAR,
    HELD,
    HIGHEST,
    LIMITED,
    LOCKED,
    LOWEST,
    NONE,
    TOP,
)

PULL, SPIN = wp.constant(wp.float64(4.0)), wp.constant(wp.float64(10.0))     # [m/s], [rad/s] at which a joint closes, at most


@wp.func
def own_joint_block(j: int, J: Linked):
    """A_jj: what a joint moves by itself."""
    A = mat66d()
    a = J.t.a[j]
    b = J.t.b[j]
    if a >= 0:
        A = A + block_product(j, j, J.r_a[j], J.r_a[j], J.t.w[a], J.S[a], J)
    if b >= 0:
        A = A + block_product(j, j, J.r_b[j], J.r_b[j], J.t.w[b], J.S[b], J)
    return A


@wp.func
def unreduced_joint_error(error: wp.float64, r: int, h: wp.float64):
    """What of an error stays behind a substep."""
    most = h * PULL
    if r > 2:
        most = h * SPIN
    return error - wp.clamp(error, -most, most)


@wp.func
def set_limit_rates(j: int, r: int, h: wp.float64, then: wp.float64, J: Linked):
    """under and over: rates by which a row goes beyond its ends; then: its coordinate at the end of the substep."""
    low = J.t.low[j, r]
    high = J.t.high[j, r]
    now = J.now[j, r]
    J.under[j, r] = (then - low - wp.min(unreduced_joint_error(now - low, r, h), wp.float64(0.0))) / h
    J.over[j, r] = (then - high - wp.max(unreduced_joint_error(now - high, r, h), wp.float64(0.0))) / h


@wp.func(inline=False)
def row_want_and_piece(j: int, r: int, h: wp.float64, then: wp.float64, J: Linked):
    """Sets what row r asks for in a sweep, but for its drive; what acts, by a first guess. then: its coordinate at the end of
    the substep."""
    kind = J.t.kind[j, r]
    hold = J.hold[j, r]
    J.under[j, r] = FAR
    J.over[j, r] = -FAR
    if J.broken[j] != 0:
        return NONE
    if kind == LOCKED:
        low = J.t.low[j, r]
        J.under[j, r] = (then - low - unreduced_joint_error(J.now[j, r] - low, r, h)) / h
        return HELD
    push = J.push[j, r]
    driven = J.t.drive[j, r] > NONE
    if kind == LIMITED:
        set_limit_rates(j, r, h, then, J)
        if hold > wp.float64(0.0) or (not driven and hold == wp.float64(0.0) and J.under[j, r] < wp.float64(0.0)):
            return LOWEST
        if hold < wp.float64(0.0) or (not driven and J.over[j, r] > wp.float64(0.0)):
            return HIGHEST
    if driven:
        if push >= J.give[j, r] and J.much[j, r] >= wp.float64(0.0):
            return TOP
        if push <= -J.give[j, r] and J.much[j, r] <= wp.float64(0.0):
            return BOTTOM
        return DRIVEN
    return NONE


@wp.func(inline=False)
def relaxed_row_piece(j: int, r: int, driving: int, rate: wp.float64, J: Linked):
    """As `row_want_and_piece`, behind the places. driving: 1 where drives act."""
    kind = J.t.kind[j, r]
    hold = J.hold[j, r]
    zero = wp.float64(0.0)
    J.under[j, r] = FAR
    J.over[j, r] = -FAR
    if J.broken[j] != 0:
        return NONE
    if kind == LOCKED:
        J.under[j, r] = rate
        return HELD
    if kind == LIMITED:
        if hold > zero or hold == zero and J.now[j, r] <= J.t.low[j, r]:
            J.under[j, r] = rate
        if hold < zero or hold == zero and J.now[j, r] >= J.t.high[j, r]:
            J.over[j, r] = rate
        if hold > zero or J.under[j, r] < zero:
            return LOWEST
        if hold < zero or J.over[j, r] > zero:
            return HIGHEST
    if driving == 1 and J.t.drive[j, r] > NONE:
        return DRIVEN
    return NONE
