"""Inverse kinematics by Levenberg and Marquardt's method, an arm a thread.

    (A + lambda D) dq = g,    A = J^T J, g = J^T e,    D = diag(A), with a floor

A step that makes E smaller is taken, and lambda falls; else lambda grows. Where a limit is reached and g points beyond it, the
coordinate rests (projected Newton method, Bertsekas 1982). A goal that is reached is reached quadratically: lambda goes to
FLOOR. After LATE steps A has the second derivatives of places too, without which steps towards a goal out of reach are too long
(Erleben, Andrews 2019); a pivot that is not positive becomes d.

Arms that come to rest elsewhere, in a local minimum, begin again from places of an R sequence (Roberts 2018) within their
limits, all of these at once; the first that leads to the goal counts, else the best. Where the goal is reached and a pose of
rest is given, steps

    (A + FLOOR d) dq = g + FLOOR d (rest - q),    d the largest entry of diag(A)

move towards it in the null space of J, shorter ones once the distance grows, and Newton steps set right what is left.

(Marquardt 1963; Nakamura, Hanafusa 1986.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import conjugate_rotation, multiply_rotations, rotation_logarithm
from wsim.kernels.rigid.joint.inverse.placing import arm_ball_quaternion, step_arm, weigh_arm_goals
from wsim.kernels.rigid.joint.inverse.tables import ArmGoals, ArmStarts, ArmTable, ArmWork

FIRST = wp.constant(wp.float64(1e-3))      # lambda at first
FLOOR = wp.constant(wp.float64(1e-9))      # and at least: a pivot of J^T J of a redundant arm is 0
CEILING = wp.constant(wp.float64(1e6))     # over which no step helps: a minimum
LONGEST = wp.constant(wp.float64(1.0))     # [rad] that a step turns a joint, at most
NEARER = wp.constant(wp.float64(0.3))      # and towards rest
LATE = wp.constant(12)                     # steps without second derivatives
SMALL = wp.constant(wp.float64(1e-3))      # part of the largest entry of D that is its least
ALIKE = wp.constant(wp.float64(1.0))       # and towards rest: all entries are alike


@wp.struct
class ArmSettings:
    """Numbers of a solve."""

    tolerance: wp.vec2d                    # [m], [rad] at which a goal is reached
    most: int                              # steps from one start, tried ones counted
    starts: int                            # places to begin from
    rests: int                             # steps towards the pose of rest; 0: there is none
    reach: wp.float64                      # [m] a slide without limits is moved by, at most, for another start


@wp.func
def rests_at_limit(t: ArmTable, W: ArmWork, i: int, b: wp.float64, arm: int):
    """True if dof i stays: it does not move, or b points beyond its limit."""
    c = t.coordinate[i]
    still = t.moves[i] == 0
    if c >= 0:
        if (b > wp.float64(0.0) and W.q[c, arm] >= t.high[c]) or (b < wp.float64(0.0) and W.q[c, arm] <= t.low[c]):
            still = True
    return still


@standalone_function
@wp.func
def factor_arm_row(W: ArmWork, i: int, d: wp.float64, most: wp.float64, arm: int):
    """Row i of the Cholesky factor, whose diagonal entry was d, and of the forward substitution in `step`."""
    row = i * (i + 1) / 2
    b = W.step[i, arm]
    for j in range(i):
        s = wp.float64(0.0)
        at = j * (j + 1) / 2
        if W.L[at + j, arm] > wp.float64(0.0):                           # else it rests
            s = W.A[row + j, arm]
            for k in range(j):
                s -= W.L[row + k, arm] * W.L[at + k, arm]
            s = s / W.L[at + j, arm]
        W.L[row + j, arm] = s
        d -= s * s
        b -= s * W.step[j, arm]
    d = wp.sqrt(wp.where(d > wp.float64(0.0), d, most))
    W.L[row + i, arm] = d
    W.step[i, arm] = b / d


@standalone_function
@wp.func
def solve_arm_step(t: ArmTable, W: ArmWork, lam: wp.float64, least: wp.float64, longest: wp.float64, arm: int):
    """Sets `step`; what it is on entry is added to g. least: part of the largest entry of D that every one has. Returns how far
    it turns a joint [rad] before it is cut to `longest`."""
    n = t.axis.shape[0]
    most = wp.float64(1e-12)
    for i in range(n):
        most = wp.max(most, W.A[i * (i + 3) / 2, arm])
    for i in range(n):
        row = i * (i + 1) / 2
        b = W.g[i, arm] + W.step[i, arm]
        if rests_at_limit(t, W, i, b, arm):
            for j in range(i):
                W.L[row + j, arm] = wp.float64(0.0)
            W.L[row + i, arm] = wp.float64(-1.0)
            W.step[i, arm] = wp.float64(0.0)
        else:
            W.step[i, arm] = b
            d = W.A[row + i, arm]
            factor_arm_row(W, i, d + lam * wp.max(d, least * most), most, arm)
    far = wp.float64(0.0)
    for back in range(n):
        i = n - 1 - back
        x = W.step[i, arm]
        if W.L[i * (i + 3) / 2, arm] > wp.float64(0.0):
            for j in range(i + 1, n):
                x -= W.L[j * (j + 1) / 2 + i, arm] * W.step[j, arm]
            x = x / W.L[i * (i + 3) / 2, arm]
        W.step[i, arm] = x
        if t.turns[i] == 1:
            far = wp.max(far, wp.abs(x))
    if far > longest:
        for i in range(n):
            W.step[i, arm] = W.step[i, arm] * (longest / far)
    return far


@wp.func
def take_arm_trial(t: ArmTable, W: ArmWork, arm: int):
    """What was tried is accepted."""
    n = t.axis.shape[0]
    for i in range(W.q.shape[0]):
        W.q[i, arm] = W.trial[i, arm]
    for i in range(n * (n + 1) / 2):
        W.A[i, arm] = W.A_trial[i, arm]
    for i in range(n):
        W.g[i, arm] = W.g_trial[i, arm]


@wp.func
def goal_reached(found: wp.vec3d, p: ArmSettings):
    return found[1] <= p.tolerance[0] and found[2] <= p.tolerance[1]


@standalone_function
@wp.func
def descend_arm(t: ArmTable, G: ArmGoals, W: ArmWork, p: ArmSettings, arm: int):
    """Levenberg and Marquardt from q on. Returns (E, |e_p|, |e_r|, steps)."""
    n = t.axis.shape[0]
    found = weigh_arm_goals(t, G, W, W.q, W.A, W.g, 0, arm)
    lam = FIRST
    count = int(0)
    while count < p.most and lam < CEILING and not goal_reached(found, p):
        for i in range(n):
            W.step[i, arm] = wp.float64(0.0)
        far = solve_arm_step(t, W, lam, SMALL, LONGEST, arm)
        step_arm(t, W, arm)
        tried = weigh_arm_goals(t, G, W, W.trial, W.A_trial, W.g_trial, wp.where(count >= LATE, 1, 0), arm)
        if tried[0] < found[0]:
            if found[0] - tried[0] < wp.float64(1e-12) * found[0]:
                lam = CEILING                                            # a minimum that is not 0
            found = tried
            take_arm_trial(t, W, arm)
            lam = wp.max(wp.float64(0.1) * lam, FLOOR) + wp.where(lam >= CEILING, CEILING, wp.float64(0.0))
        else:
            lam = wp.where(far < wp.float64(1e-13), CEILING, wp.max(wp.float64(8.0) * lam, FIRST))
        count += 1
    return wp.vec4d(found[0], found[1], found[2], wp.float64(count))


@standalone_function
@wp.func
def rest_arm(t: ArmTable, G: ArmGoals, W: ArmWork, p: ArmSettings, rest: wp.array2d(dtype=wp.float64), arm: int):
    """Moves a solution towards the pose of rest, and sets right what is left."""
    n = t.axis.shape[0]
    share = wp.float64(1.0)
    before = wp.float64(wp.inf)
    for _round in range(p.rests):
        most = wp.float64(0.0)
        for i in range(n):
            most = wp.max(most, W.A[i * (i + 3) / 2, arm])
        for link in range(t.parent.shape[0]):
            d = t.first_dof[link]
            c = t.first_coordinate[link]
            for k in range(d, t.first_dof[link + 1]):
                if t.coordinate[k] >= 0:
                    W.step[k, arm] = rest[t.coordinate[k], W.arm[arm]] - W.q[t.coordinate[k], arm]
            if t.ball[link] == 1:
                c += t.slides[link]
                d += t.slides[link]
                u = rotation_logarithm(multiply_rotations(conjugate_rotation(arm_ball_quaternion(W.q, c, arm)),
                                                          arm_ball_quaternion(rest, c, W.arm[arm])))
                for k in range(3):
                    W.step[d + k, arm] = u[k]
        far = wp.float64(0.0)
        for i in range(n):
            far += W.step[i, arm] * W.step[i, arm]
        if far > before:                                                  # it went too far: J changes along the way
            share = wp.float64(0.5) * share
        before = far
        for i in range(n):
            W.step[i, arm] = share * FLOOR * wp.max(most, wp.float64(1e-12)) * W.step[i, arm]
        solve_arm_step(t, W, FLOOR, ALIKE, NEARER, arm)
        step_arm(t, W, arm)
        weigh_arm_goals(t, G, W, W.trial, W.A_trial, W.g_trial, 0, arm)
        take_arm_trial(t, W, arm)
    return descend_arm(t, G, W, p, arm)


@wp.func
def copy_arm(a: wp.array2d(dtype=wp.float64), k: int, out: wp.array2d(dtype=wp.float64), to: int):
    """Column k of a becomes column `to` of out."""
    for i in range(a.shape[0]):
        out[i, to] = a[i, k]


@standalone_function
@wp.func
def begin_arm_anew(t: ArmTable, W: ArmWork, p: ArmSettings, B: ArmStarts, number: int, arm: int):
    """q: place `number` of the R sequence within limits; about the first start where there are none. 0: the first start."""
    who = W.arm[arm]
    copy_arm(B.start, who, W.q, arm)
    for k in range(t.axis.shape[0]):
        u = wp.float64(0.5) + wp.float64(number) * B.ratio[k]
        u = u - wp.floor(u)
        c = t.coordinate[k]
        W.step[k, arm] = wp.float64(0.0)
        if t.moves[k] == 1 and number > 0:
            half = wp.where(t.turns[k] == 1, wp.float64(wp.pi), p.reach)
            if c >= 0:
                low = wp.max(t.low[c], B.start[c, who] - half)
                high = wp.min(t.high[c], B.start[c, who] + half)
                W.q[c, arm] = low + u * (high - low)
            else:
                W.step[k, arm] = (wp.float64(2.0) * u - wp.float64(1.0)) * half
    step_arm(t, W, arm)
    copy_arm(W.trial, arm, W.q, arm)


@wp.kernel(enable_backward=False, module="wsim_arms")
def first_start_kernel(t: ArmTable, G: ArmGoals, W: ArmWork, p: ArmSettings, B: ArmStarts):
    """Over arms: the solution from the first start, and whether it failed."""
    arm = wp.tid()
    W.arm[arm] = arm
    begin_arm_anew(t, W, p, B, 0, arm)
    found = descend_arm(t, G, W, p, arm)
    B.found[arm] = found
    B.failed[arm] = wp.where(goal_reached(wp.vec3d(found[0], found[1], found[2]), p), 0, 1)
    copy_arm(W.q, arm, B.best, arm)


@wp.kernel(enable_backward=False, module="wsim_arms")
def failed_arm_kernel(B: ArmStarts):
    """Over arms: lists those that failed."""
    arm = wp.tid()
    if B.failed[arm] == 1:
        B.who[B.rank[arm] - 1] = arm


@wp.kernel(enable_backward=False, module="wsim_arms")
def other_start_kernel(t: ArmTable, G: ArmGoals, W: ArmWork, p: ArmSettings, B: ArmStarts):
    """Over as many threads as there are arms: all other starts of those that failed."""
    thread = wp.tid()
    others = p.starts - 1
    pair = wp.tid()
    while pair < others * B.rank[B.rank.shape[0] - 1]:
        arm = B.who[pair / others]
        number = pair % others
        W.arm[thread] = arm
        begin_arm_anew(t, W, p, B, number + 1, thread)
        place = arm * others + number
        B.tries[place] = descend_arm(t, G, W, p, thread)
        copy_arm(W.q, thread, B.tried, place)
        pair += B.rank.shape[0]


@wp.kernel(enable_backward=False, module="wsim_arms")
def best_start_kernel(t: ArmTable, G: ArmGoals, W: ArmWork, p: ArmSettings, B: ArmStarts, rest: wp.array2d(dtype=wp.float64)):
    """Over arms: the first start that leads to the goal, else the one that leaves least; then towards rest."""
    arm = wp.tid()
    W.arm[arm] = arm
    best = B.found[arm]
    steps = best[3]
    reached = B.failed[arm] == 0
    if not reached:
        for number in range(p.starts - 1):
            place = arm * (p.starts - 1) + number
            now = B.tries[place]
            steps += now[3]
            if now[0] < best[0] and not reached:
                best = now
                reached = goal_reached(wp.vec3d(now[0], now[1], now[2]), p)
                copy_arm(B.tried, place, B.best, arm)
    if reached and p.rests > 0:
        copy_arm(B.best, arm, W.q, arm)
        weigh_arm_goals(t, G, W, W.q, W.A, W.g, 0, arm)
        now = rest_arm(t, G, W, p, rest, arm)
        steps += now[3]
        if goal_reached(wp.vec3d(now[0], now[1], now[2]), p):             # else what was found before stays
            best = now
            copy_arm(W.q, arm, B.best, arm)
    B.found[arm] = wp.vec4d(best[0], best[1], best[2], steps)
