"""Impulses of all rows of an island of joints that act at once: locks, limits and drives of bounded force.

With z what a sweep adds to a row's impulse h + p (limit or lock, drive), and g' + A z the rates behind it, each row has a graph
that falls, of which its `active` names the piece (tables.py):

    LOWEST   A z = -under,  h >= 0           HIGHEST   A z = -over,  h <= 0          HELD   A z = -under
    DRIVEN   A z + Gamma z = much            TOP, BOTTOM   p = give, -give           NONE   h = 0
    where none of the first two:  under + A z >= 0 >= over + A z

A drive at a limit gives what it gives at that rate, p = clamp(p_0 + (much - A z) / Gamma). All rows whose piece is wrong for
the solution take their next one (block pivots: Portugal, Judice, Vicente 1994, A comparison of block pivoting and
interior-point algorithms for linear least squares problems with nonnegative variables, section 3); where that has not made
less of them wrong for TRIES times, the last of them alone (Murty 1974, which ends for every A that is symmetric and definite).
The first guess is what acted in the sweep before: a sweep in which nothing changes is one solve.
"""

import warp as wp

from wsim.kernels.rigid.joint.elimination import Linked, row_has_equation, solve_joint_system
from wsim.kernels.rigid.joint.frames import factor_joint_island
from wsim.kernels.rigid.joint.tables import BOTTOM, DRIVEN, FAR, HELD, HIGHEST, LOWEST, NONE, TOP

PIVOTS, TRIES = wp.constant(60), wp.constant(3)
ROUND = wp.constant(wp.float64(1.0e-9))      # part of what is compared that is rounding, no sign


@wp.func
def row_is_driven(j: int, r: int, driving: int, J: Linked):
    return driving == 1 and J.t.drive[j, r] > NONE and J.broken[j] == 0


@wp.func
def drive_impulse_and_piece(j: int, r: int, J: Linked):
    """(impulse of a drive where a row's rate is, the piece that it is on)."""
    most = J.give[j, r]
    p = J.push[j, r] + (J.much[j, r] - J.change[j, r]) / J.soft[j, r]
    piece = DRIVEN
    slack = wp.float64(1.0)
    if J.active[j, r] == DRIVEN:
        slack = wp.float64(1.0) + ROUND
    if p >= slack * most:
        piece = TOP
    if p <= -slack * most:
        piece = BOTTOM
    return wp.clamp(p, -most, most), piece


@wp.func(inline=False)
def fitting_row_piece(j: int, r: int, driving: int, J: Linked):
    """The piece of a row that fits the solution."""
    acts = J.active[j, r]
    z = J.rhs[j, r]
    before = J.hold[j, r]
    p = wp.float64(0.0)
    loose = NONE
    if row_is_driven(j, r, driving, J):
        before = before + J.push[j, r]
        p, loose = drive_impulse_and_piece(j, r, J)
    ends = before + z - p
    small = ROUND * (wp.abs(before) + wp.abs(z) + wp.abs(p))
    rate = J.change[j, r] + J.ease[j, r] * z
    still = ROUND * wp.abs(rate)
    found = acts
    if acts == LOWEST:
        if ends < -small:
            found = loose
    elif acts == HIGHEST:
        if ends > small:
            found = loose
    elif acts != HELD:
        found = loose
        if J.under[j, r] + rate < -still - ROUND * wp.abs(J.under[j, r]):
            found = LOWEST
        elif J.over[j, r] + rate > still + ROUND * wp.abs(J.over[j, r]):
            found = HIGHEST
    return found


@wp.func
def known_row_impulse(j: int, r: int, J: Linked):
    """Impulse of a row without an equation: all that its drive has, or nothing."""
    z = wp.float64(0.0)
    if J.active[j, r] == NONE:
        z = -J.hold[j, r]
    elif J.active[j, r] == TOP:
        z = J.give[j, r] - J.push[j, r] - J.hold[j, r]
    elif J.active[j, r] == BOTTOM:
        z = -J.give[j, r] - J.push[j, r] - J.hold[j, r]
    return z


@wp.func(inline=False)
def island_body_impulses(g: int, J: Linked):
    """P and T: impulses on the bodies of an island of those in rhs."""
    for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
        J.P[J.t.body[m]] = wp.vec3d()
        J.T[J.t.body[m]] = wp.vec3d()
    for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
        P = wp.transpose(J.axis[j]) * wp.vec3d(J.rhs[j, 0], J.rhs[j, 1], J.rhs[j, 2])
        T = wp.transpose(J.turn[j]) * wp.vec3d(J.rhs[j, 3], J.rhs[j, 4], J.rhs[j, 5])
        a = J.t.a[j]
        b = J.t.b[j]
        if a >= 0:
            J.P[a] = J.P[a] - P
            J.T[a] = J.T[a] - wp.cross(J.r_a[j], P) - T
        if b >= 0:
            J.P[b] = J.P[b] + P
            J.T[b] = J.T[b] + wp.cross(J.r_b[j], P) + T


@wp.func(inline=False)
def rate_change_of_rows(g: int, J: Linked):
    """change: A times rhs, by way of the bodies."""
    island_body_impulses(g, J)
    three = int(3)
    for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
        u = wp.vec3d()
        omega = wp.vec3d()
        a = J.t.a[j]
        b = J.t.b[j]
        if b >= 0:
            o = J.S[b] * J.T[b]
            u = J.t.w[b] * J.P[b] + wp.cross(o, J.r_b[j])
            omega = o
        if a >= 0:
            o = J.S[a] * J.T[a]
            u = u - J.t.w[a] * J.P[a] - wp.cross(o, J.r_a[j])
            omega = omega - o
        u = J.axis[j] * u
        omega = J.turn[j] * omega
        for r in range(three):
            J.change[j, r] = u[r]
            J.change[j, 3 + r] = omega[r]


@wp.func(inline=False)
def set_row_equations(g: int, J: Linked):
    """Right sides of what acts; rhs of other rows is what they add."""
    six = int(6)
    some = int(0)
    for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
        for r in range(six):
            z = known_row_impulse(j, r, J)
            J.rhs[j, r] = z
            if z != wp.float64(0.0):
                some = 1
    if some == 1:
        rate_change_of_rows(g, J)
    for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
        for r in range(six):
            if row_has_equation(j, r, J):
                asks = -J.under[j, r]
                if J.active[j, r] == HIGHEST:
                    asks = -J.over[j, r]
                if J.active[j, r] == DRIVEN:
                    asks = J.much[j, r] - J.soft[j, r] * J.hold[j, r]
                if some == 1:
                    asks = asks - J.change[j, r]
                J.rhs[j, r] = asks


@wp.func(inline=False)
def judge_row_pieces(g: int, driving: int, J: Linked):
    """`next` of all rows; how many were wrong."""
    six = int(6)
    open = int(0)
    for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
        for r in range(six):
            if J.active[j, r] != HELD and (J.under[j, r] < FAR or J.over[j, r] > -FAR or row_is_driven(j, r, driving, J)):
                open = 1
    wrong = int(0)
    if open == 1:
        rate_change_of_rows(g, J)
        for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
            for r in range(six):
                J.next[j, r] = fitting_row_piece(j, r, driving, J)
                if J.next[j, r] != J.active[j, r]:
                    wrong += 1
    return wrong


@wp.func
def one_alone(g: int, J: Linked):
    """All rows but the last that is wrong stay on their piece."""
    found = int(0)
    n = J.t.first_joint[g + 1] - J.t.first_joint[g]
    for back in range(6 * n):
        k = 6 * n - 1 - back
        j = J.t.first_joint[g] + k // 6
        if J.next[j, k % 6] != J.active[j, k % 6]:
            if found == 1:
                J.next[j, k % 6] = J.active[j, k % 6]
            found = 1


@wp.func(inline=False)
def admissible_row_impulse(j: int, r: int, driving: int, J: Linked):
    """Impulse of row r that a solution adds, within what it may give; the sums are noted."""
    acts = J.active[j, r]
    hold = J.hold[j, r]
    push = J.push[j, r]
    z = J.rhs[j, r]
    most = J.give[j, r]
    if acts == HELD:
        J.hold[j, r] = hold + z
    elif acts == NONE:
        J.hold[j, r] = wp.float64(0.0)
    elif acts >= LOWEST and acts <= HIGHEST:
        given = push
        if row_is_driven(j, r, driving, J):
            given, _piece = drive_impulse_and_piece(j, r, J)
        J.push[j, r] = given
        after = hold + z - (given - push)
        if acts == LOWEST:
            J.hold[j, r] = wp.max(after, wp.float64(0.0))
        else:
            J.hold[j, r] = wp.min(after, wp.float64(0.0))
    else:
        J.hold[j, r] = wp.float64(0.0)
        J.push[j, r] = wp.clamp(push + (hold + z), -most, most)
    return (J.hold[j, r] - hold) + (J.push[j, r] - push)


@wp.func(inline=False)
def solve_joint_pivots(g: int, driving: int, J: Linked):
    """Impulses of an island that fit all of its rows: P and T of bodies. next: the first guess; driving: 1 where drives act."""
    six = int(6)
    best = int(1 << 30)
    tries = int(TRIES)
    first = J.t.first_joint[g]
    last = J.t.first_joint[g + 1]
    for _pivot in range(int(PIVOTS)):
        other = int(0)
        for j in range(first, last):
            for r in range(six):
                if J.active[j, r] != J.next[j, r]:
                    J.active[j, r] = J.next[j, r]
                    other = 1
        if other == 1:
            factor_joint_island(first, last, J)
        set_row_equations(g, J)
        solve_joint_system(first, last, J)
        wrong = judge_row_pieces(g, driving, J)
        if wrong == 0:
            break
        tries -= 1
        if wrong < best:
            best = wrong
            tries = int(TRIES)
        if tries < 0:
            one_alone(g, J)
    for j in range(first, last):
        for r in range(six):
            J.rhs[j, r] = admissible_row_impulse(j, r, driving, J)
    island_body_impulses(g, J)
