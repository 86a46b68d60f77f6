"""Drives of joints: springs and dampers F = k (T - g) + c (s - g') on a coordinate g, of order 2 in the substep.

A substep gives two impulses, as all rows do (rows.py): P before the places, which move by it, and what is left of the whole
impulse W behind them. Both are linear in what they lead to, so that they join the system of the locks:

    P = h/2 (k (T - g) + c s) - a u + b g'             u = (g(x') - g) / h, the mean rate; h/2 of the limit `most`
    W =  h  (k (T - g) + c s) - a' g'(x') + b' g' - d u

Coefficients for a joint that is alone in its island: the flow of one coordinate, m g'' = F + constant, is known,

    g(x') = g + Psi g' + Phi f,   g'(x') = chi g' + Psi f,     f the acceleration at g, at rest

With f out of them, P and W are exact: a = m (h^2 / 2 Phi - 1), b = m (h Psi / 2 Phi - 1), a' = m (h / Psi - 1),
b' = m (h chi / Psi - 1), d = 0. m is the effective mass: what the row moves while the locked rows of its joint stay. Where
other driven rows of the joint move it too, m is less by what they share: that is stable (diagonal dominance), and of order 2.
The flow is summed as a series for a part of h and doubled: that holds for any damping.

Coefficients for all others do not know m:

    a = (1/6 + 1/3 K / (K + C)) K + C/3,  b = -C/6,  a' = K/2 + C/4,  b' = -C/4,  d = C/2;   K = k h^2,  C = c h

These are of order 2 too, stable for every mass, and end at the target in a step where K or C is large (L-stable). Steps of h
do not show an oscillation of more than 2 / h [rad/s]: the exact coefficients give way to these between 1 / h and 2 / h.

Targets go evenly from where they were at the start of the substep to where they are at its end: T, g and rates are meant from
there. Islands that contacts have touched are placed by whole kicks of the forces, of order 1; drives there are backward Euler,
P = h (k (T - g - h g') + c (s - g')). A drive of an acceleration has k and c per effective mass; what is left of W behind the
places, per that there.
"""

import warp as wp

from wsim.kernels.rigid.joint.actuation.row_laws import driven_row_law
from wsim.kernels.rigid.joint.elimination import Linked, mat66d
from wsim.kernels.rigid.joint.rows import own_joint_block
from wsim.kernels.rigid.joint.tables import ACCELERATION, LOCKED, NONE

TERMS = wp.constant(18)                       # of the series, for arguments up to HALF: 1e-16 is left out
HALF = wp.constant(wp.float64(0.5))
LEAST = wp.constant(wp.float64(1.0e-30))      # [kg] or [kg m^2] of a drive without stiffness and damping


@wp.struct
class DriveCoefficients:
    """Coefficients a, b, a', b', d of a drive [kg], [kg m^2]."""
    a: wp.float64
    b: wp.float64
    a_last: wp.float64
    b_last: wp.float64
    d: wp.float64


@wp.func(inline=False)
def oscillator_flow_parts(q: wp.float64, z: wp.float64):
    """(1 - 2 Phi / h^2, 1 - Psi / h, chi) of q = h^2 k / m, z = h c / m."""
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    t = one
    doubled = int(0)
    while wp.max(wp.sqrt(q), z) * t > HALF:
        t = t * HALF
        doubled += 1
    before = wp.float64(0.0)
    c = one
    power = one                                # t^n / n!
    phi = wp.float64(0.0)
    psi = wp.float64(0.0)
    chi = one
    for n in range(2, int(TERMS)):
        after = -z * c - q * before
        before = c
        c = after
        chi += c * power * t
        power = power * t / wp.float64(n)
        psi -= c * power
        phi -= two * c * power / wp.float64(n + 1)
    if doubled > 0:
        P = t * (one - psi)
        F = HALF * t * t * (one - phi)
        for _k in range(doubled):
            still = one - q * F
            F_next = two * F - q * F * F + P * P
            chi_next = chi * chi - q * P * P
            P = P * (still + chi)
            F = F_next
            chi = chi_next
        phi = one - two * F
        psi = one - P
    return phi, psi, chi


@wp.func(inline=False)
def drive_coefficients(K: wp.float64, C: wp.float64, m: wp.float64):
    """The law of K = k h^2, C = c h and an effective mass m [kg], [kg m^2]; m < 0: it is not known."""
    one = wp.float64(1.0)
    found = DriveCoefficients()
    found.a = (one + wp.float64(2.0) * K / wp.max(K + C, LEAST)) * K / wp.float64(6.0) + C / wp.float64(3.0)
    found.b = -C / wp.float64(6.0)
    found.a_last = wp.float64(0.5) * K + wp.float64(0.25) * C
    found.b_last = -wp.float64(0.25) * C
    found.d = wp.float64(0.5) * C
    if m > wp.float64(0.0):
        q = K / m
        part = wp.clamp(wp.float64(2.0) - wp.sqrt(q), wp.float64(0.0), one)
        if part > wp.float64(0.0):
            phi, psi, chi = oscillator_flow_parts(q, C / m)
            found.a += part * (m * phi / (one - phi) - found.a)
            found.b += part * (m * (phi - psi) / (one - phi) - found.b)
            found.a_last += part * (m * psi / (one - psi) - found.a_last)
            found.b_last += part * (m * (chi - one + psi) / (one - psi) - found.b_last)
            found.d -= part * found.d
    return found


@wp.func(inline=False)
def locked_schur_complement(j: int, given: mat66d, J: Linked):
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
def start_rate(j: int, k: int, J: Linked):
    """Velocity at the joint and angular velocity, of b against a, before the forces of substep k."""
    row = k * J.t.moving
    a = J.t.a[j]
    b = J.t.b[j]
    spin_a = J.t.anchor_o[row, j]
    spin_b = spin_a
    v_a = J.t.anchor_v[row, j]
    v_b = v_a
    if a >= 0:
        spin_a = J.S[a] * J.L[a]
        v_a = J.t.w[a] * J.p[a]
    if b >= 0:
        spin_b = J.S[b] * J.L[b]
        v_b = J.t.w[b] * J.p[b]
    return v_b + wp.cross(spin_b, J.r_b[j]) - v_a - wp.cross(spin_a, J.r_a[j]), spin_b - spin_a


@wp.func
def asked_most(j: int, J: Linked):
    """ACCELERATION where a row of a joint has such a drive, else FORCE or NONE."""
    six = int(6)
    found = int(0)
    for r in range(six):
        found = wp.max(found, J.t.drive[j, r])
    return found


@wp.func
def row_effective_mass(A: mat66d, r: int):
    return wp.float64(1.0) / wp.max(A[r, r], wp.float64(1.0e-300))


@wp.func(inline=False)
def free_mass(j: int, A: mat66d, r: int, J: Linked):
    """Effective mass of row r for the law of a drive, less what other driven rows share; -1 where other joints do."""
    six = int(6)
    found = wp.float64(-1.0)
    if J.t.alone[j] == 1:
        size = A[r, r]
        for s in range(six):
            if s != r and J.t.drive[j, s] > NONE:
                size += wp.abs(A[r, s]) * wp.sqrt(A[r, r] / wp.max(A[s, s], wp.float64(1.0e-300)))
        found = wp.float64(1.0) / wp.max(size, wp.float64(1.0e-300))
    return found


@wp.func(inline=False)
def prepare_drives(j: int, s: int, h: wp.float64, J: Linked):
    """Sets `early`, `late` and `beside` of the driven rows of a joint for substep s."""
    three = int(3)
    kind = asked_most(j, J)
    if kind > NONE:
        A = mat66d()
        if kind == ACCELERATION or J.t.alone[j] == 1:
            A = locked_schur_complement(j, own_joint_block(j, J), J)
        u, omega = start_rate(j, s, J)
        u = J.axis[j] * u
        omega = J.turn[j] * omega
        for r in range(three):
            if J.t.drive[j, r] > NONE:
                prepare_row(j, r, s, h, u[r], row_effective_mass(A, r), free_mass(j, A, r, J), J)
            if J.t.drive[j, 3 + r] > NONE:
                prepare_row(j, 3 + r, s, h, omega[r], row_effective_mass(A, 3 + r), free_mass(j, A, 3 + r, J), J)


@wp.func(inline=False)
def renew_masses(j: int, J: Linked):
    """Gives what is left of the impulses of drives of accelerations the effective mass behind the places."""
    six = int(6)
    if asked_most(j, J) == ACCELERATION:
        A = locked_schur_complement(j, own_joint_block(j, J), J)
        for r in range(six):
            if J.t.drive[j, r] == ACCELERATION:
                law = J.late[j, r]
                more = row_effective_mass(A, r) / law[3]
                left = more * law[1] + (wp.float64(1.0) - more) * J.push[j, r]
                J.late[j, r] = wp.vec4d(law[0] / more, left, more * law[2], law[3])


@wp.func(inline=False)
def prepare_row(j: int, r: int, s: int, h: wp.float64, rate: wp.float64, m: wp.float64, free: wp.float64, J: Linked):
    """One row of `prepare_drives`, of a rate, an effective mass, and that of `free_mass`."""
    row = driven_row_law(j, r, s, h, rate, m, J)
    J.limit[j, r] = row.most
    law = drive_coefficients(h * h * row.k, h * row.c, free)
    now = J.now[j, r]
    way = (row.target - row.before) / h
    pull = h * (row.k * (row.before - now) + row.c * (row.speed - way) + row.effort)
    a = wp.max(law.a, LEAST)
    J.early[j, r] = wp.vec2d(wp.float64(1.0) / a, -(HALF * pull + law.b * (rate - way)) / a - way)
    late = pull + law.a_last * way + law.b_last * (rate - way) + law.d * (way + now / h)
    J.late[j, r] = wp.vec4d(wp.float64(1.0) / wp.max(law.a_last, LEAST), late, law.d / h, m)
    stiff = wp.max(h * row.k + row.c, LEAST)
    beside = row.k * (now - row.target) - row.c * row.last - row.effort_last
    J.beside[j, r] = wp.vec2d(wp.float64(1.0) / (h * stiff), beside / stiff)


@wp.func
def ask_drive(j: int, r: int, contact: int, h: wp.float64, lead: wp.float64, rate: wp.float64, J: Linked):
    """Sets soft, much and give of a drive before the places. lead: mean rate to where velocities lead; contact 1: `beside`."""
    law = J.early[j, r]
    give = HALF * h * J.limit[j, r]
    moves = lead
    if contact == 1:
        law = J.beside[j, r]
        give = h * J.limit[j, r]
        moves = rate
    if J.soft[j, r] != law[0]:
        J.active[j, r] = -1                    # what the factor is of has changed
    J.soft[j, r] = law[0]
    J.much[j, r] = -(moves + law[1] + law[0] * J.push[j, r])
    J.give[j, r] = give


@wp.func
def ask_drive_last(j: int, r: int, h: wp.float64, rate: wp.float64, J: Linked):
    """The same behind the places."""
    law = J.late[j, r]
    J.soft[j, r] = law[0]
    J.much[j, r] = (law[1] - law[2] * J.now[j, r] - J.push[j, r]) * law[0] - rate
    J.give[j, r] = h * J.limit[j, r]
