"""Wants of each row of a joint in a sweep: locks, limits and drives.

    held      g(x + h v) = goal                      coordinates of the places that the velocities v lead to, not linearised
    limited   the same at low or high, where v would lead beyond it; its impulse keeps one sign
    driven    F = k (target - g - h g') + c (speed - g'), h F = P:   Gamma = 1 / (h (h k + c)),
              g' + bias + Gamma P = 0,  bias = (k (g - target) - c speed) / (h k + c);   |P| <= h most
    relaxed   g' = 0 of what is held, at the new places

A step whose held rows have g(x + h v) = goal, and which then takes the speed along them away, is SHAKE and RATTLE (Ryckaert,
Ciccotti, Berendsen 1977; Andersen 1983): of order 2, and no energy is lost. goal is 0, or what is left of an error that is
taken back at PULL or SPIN. A drive is backward Euler: stable for all k and c. That of an acceleration has k and c per effective
mass, which is what the row moves while the locked rows of its joint stay (Schur complement of A_jj).

Which of them act together is found by pivots (pivots.py). The first guess is what acts already, and limits that v leads beyond.
"""

import warp as wp

from wsim.kernels.rigid.joint.elimination import Linked, mat66d, product
from wsim.kernels.rigid.joint.tables import (
    ACCELERATION,
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
def both(j: int, J: Linked):
    """A_jj: what a joint moves by itself."""
    A = mat66d()
    a = J.t.a[j]
    b = J.t.b[j]
    if a >= 0:
        A = A + product(j, j, J.r_a[j], J.r_a[j], J.t.w[a], J.S[a], J)
    if b >= 0:
        A = A + product(j, j, J.r_b[j], J.r_b[j], J.t.w[b], J.S[b], J)
    return A


@wp.func
def effective(j: int, given: mat66d, J: Linked):
    """Schur complement of the locked rows: its diagonal is what each other row moves with them."""
    six = int(6)
    A = given
    for m in range(six):
        if J.t.kind[j, m] == LOCKED and A[m, m] > wp.float64(1.0e-12) * given[m, m]:
            for r in range(six):
                if r != m:
                    part = A[r, m] / A[m, m]
                    for c in range(six):
                        A[r, c] = A[r, c] - part * A[m, c]
    return A


@wp.func(inline=False)
def drive(j: int, s: int, h: wp.float64, J: Linked):
    """Gamma and bias of the driven rows of a joint, as it is, for substep s."""
    six = int(6)
    asked = int(0)
    for r in range(six):
        asked = wp.max(asked, J.t.drive[j, r])
    if asked > NONE:
        A = mat66d()
        if asked == ACCELERATION:
            A = effective(j, both(j, J), J)
        for r in range(six):
            if J.t.drive[j, r] > NONE:
                mass = wp.float64(1.0)
                if J.t.drive[j, r] == ACCELERATION:
                    mass = wp.float64(1.0) / wp.max(A[r, r], wp.float64(1.0e-300))
                k = mass * J.t.stiffness[j, r]
                c = mass * J.t.damping[j, r]
                stiff = h * k + c
                J.soft[j, r] = wp.float64(1.0) / (h * stiff)
                target = J.t.target[j, r]
                speed = J.t.speed[j, r]
                if J.t.aiming == 1:
                    target = J.t.aim[s, j, r]
                    speed = J.t.pace[s, j, r]
                J.bias[j, r] = (k * (J.now[j, r] - target) - c * speed) / stiff


@wp.func
def left(error: wp.float64, r: int, h: wp.float64):
    """What of an error stays behind a substep."""
    most = h * PULL
    if r > 2:
        most = h * SPIN
    return error - wp.clamp(error, -most, most)


@wp.func
def ranged(j: int, r: int, h: wp.float64, then: wp.float64, J: Linked):
    """under and over: rates by which a row goes beyond its ends; then: its coordinate at the end of the substep."""
    low = J.t.low[j, r]
    high = J.t.high[j, r]
    now = J.now[j, r]
    J.under[j, r] = (then - low - wp.min(left(now - low, r, h), wp.float64(0.0))) / h
    J.over[j, r] = (then - high - wp.max(left(now - high, r, h), wp.float64(0.0))) / h


@wp.func(inline=False)
def wanted(j: int, r: int, h: wp.float64, then: wp.float64, rate: wp.float64, J: Linked):
    """Sets what row r asks for in a sweep; what acts, by a first guess. then: its coordinate at the end of the substep."""
    kind = J.t.kind[j, r]
    hold = J.hold[j, r]
    J.under[j, r] = FAR
    J.over[j, r] = -FAR
    if J.broken[j] != 0:
        return NONE
    if kind == LOCKED:
        low = J.t.low[j, r]
        J.under[j, r] = (then - low - left(J.now[j, r] - low, r, h)) / h
        return HELD
    push = J.push[j, r]
    driven = J.t.drive[j, r] > NONE
    if driven:
        J.much[j, r] = -(rate + J.bias[j, r] + J.soft[j, r] * push)
    if kind == LIMITED:
        ranged(j, r, h, then, J)
        if hold > wp.float64(0.0) or (not driven and hold == wp.float64(0.0) and J.under[j, r] < wp.float64(0.0)):
            return LOWEST
        if hold < wp.float64(0.0) or (not driven and J.over[j, r] > wp.float64(0.0)):
            return HIGHEST
    if driven:
        if push >= h * J.t.most[j, r] and J.much[j, r] >= wp.float64(0.0):
            return TOP
        if push <= -h * J.t.most[j, r] and J.much[j, r] <= wp.float64(0.0):
            return BOTTOM
        return DRIVEN
    return NONE


@wp.func(inline=False)
def relaxed(j: int, r: int, rate: wp.float64, J: Linked):
    """As `wanted`, behind the places."""
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
    return NONE
