"""The law of a driven row in a substep: its drive and its actuators (actuators.py) as one spring, damper and force.

    F = k (T - g) + c (s - g') + effort,   |F| <= most

Laws that are linear add up. One that is at its limit where the substep begins pulls with that limit. A row with one law alone
and a symmetric limit is held to it wherever in the substep.
"""

import warp as wp

from wsim.kernels.rigid.joint.actuation.actuators import row_actuation, row_actuator_force
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tables import ACCELERATION, NONE


@wp.struct
class RowLaw:
    """k, c; T at the start and the end, s in the mean and at the end; the force beside them, in the mean and at the end."""
    k: wp.float64
    c: wp.float64
    before: wp.float64
    target: wp.float64
    speed: wp.float64
    last: wp.float64
    effort: wp.float64
    effort_last: wp.float64
    most: wp.float64


@wp.func(inline=False)
def row_drive_law(j: int, r: int, s: int, m: wp.float64, J: Linked):
    """Law of the drive alone; m: effective mass."""
    law = RowLaw()
    law.k = J.t.stiffness[j, r]
    law.c = J.t.damping[j, r]
    law.most = J.t.most[j, r]
    if J.t.drive[j, r] == ACCELERATION:
        law.k = m * law.k
        law.c = m * law.c
    law.before = J.t.target[j, r]
    law.target = law.before
    law.speed = J.t.speed[j, r]
    law.last = law.speed
    if J.t.aiming == 1:
        law.before = J.t.aim[s, j, r]
        law.target = J.t.aim[s + 1, j, r]
        law.last = J.t.pace[s + 1, j, r]
        law.speed = wp.float64(0.5) * (J.t.pace[s, j, r] + law.last)
    return law


@wp.func(inline=False)
def actuated_row_law(j: int, r: int, s: int, rate: wp.float64, given: RowLaw, J: Linked):
    """The law of a drive with the actuators of its row; rate: of g where the substep begins."""
    now = J.now[j, r]
    alone = wp.where(given.k + given.c > wp.float64(0.0), 0, 1)
    more = row_actuation(j, r, s, now, rate, alone, J.t.actuators)
    law = RowLaw()
    law.k = more.k
    law.c = more.c
    law.most = more.most
    spring = given.k * (given.before - now) + given.c * (given.speed - rate)
    if wp.abs(spring) <= given.most:
        law.k += given.k
        law.c += given.c
        more.before += given.k * given.before + given.c * given.speed
        more.last += given.k * given.target + given.c * given.last
    else:
        more.before += wp.clamp(spring, -given.most, given.most)
        more.last += wp.clamp(spring, -given.most, given.most)
    if law.k > wp.float64(0.0):
        law.before = more.before / law.k
        law.target = more.last / law.k
    else:
        law.before = now
        law.target = now
        law.effort = wp.float64(0.5) * (more.before + more.last)
        law.effort_last = more.last
    return law


@wp.func
def driven_row_law(j: int, r: int, s: int, h: wp.float64, rate: wp.float64, m: wp.float64, J: Linked):
    """Law of row r of joint j in substep s of h [s]; m: effective mass. Notes half of the work of actuators, by their force
    now."""
    law = row_drive_law(j, r, s, m, J)
    if J.t.actuated == 1:
        if J.t.actuators.first[j, r] < J.t.actuators.first[j, r + 1]:
            force = row_actuator_force(j, r, s, wp.float64(0.0), J.now[j, r], rate, J.t.actuators)
            J.given[j] = J.given[j] + wp.float64(0.5) * h * rate * force
            law = actuated_row_law(j, r, s, rate, law, J)
    return law


@wp.func(inline=False)
def driven_rows_work(j: int, s: int, h: wp.float64, u: wp.vec3d, omega: wp.vec3d, J: Linked):
    """Work [J] in substep s of drives that ask for a speed, what is not the spring's, times that speed; and of actuators, half
    of it by their force at its end. u, omega: rates of the rows then."""
    work = wp.float64(0.0)
    six = int(6)
    for r in range(six):
        if J.t.drive[j, r] > NONE:
            most = J.t.most[j, r]
            acted = bool(False)
            if J.t.actuated == 1:
                acted = J.t.actuators.first[j, r] < J.t.actuators.first[j, r + 1]
            if acted:
                rate = omega[wp.max(r - 3, 0)]
                if r < 3:
                    rate = u[r]
                force = row_actuator_force(j, r, s, wp.float64(1.0), J.now[j, r], rate, J.t.actuators)
                work += wp.float64(0.5) * h * rate * force
            elif J.t.speed[j, r] != wp.float64(0.0):
                spring = wp.clamp(J.t.stiffness[j, r] * (J.t.target[j, r] - J.now[j, r]), -most, most)
                work += (J.push[j, r] - h * spring) * J.t.speed[j, r]
    return work
