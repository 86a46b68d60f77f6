"""Balls that turn on cloth, clusters and ropes: friction of pairs (kernels/contact/selfcontact/rows.py) by the law of law.py.

    N   normal towards the ball         R  its radius           r_k  points of a triangle from their middle     u = d - a
    D   way from the surface to where the ball touches it, |D| is half of the thickness        J = sum (|r_k|^2 - r_k r_k^T)

    s   = (sum_k b_k u_k - theta x D) across N + N x phi          theta = J^-1 sum_k r_k x u_k      common turn of the points
    psi = phi - R theta
    d_k += w_k (b_k dT - (J^-1 (D x dT + R dq)) x r_k)            phi += a (dq - N x dT)

The pushes of a pair have neither a sum nor a moment, but for R dq - R N x dT of the ball: both momenta are kept. (Friction of
pairs without balls has D from middle to middle: moment_correction.py. A strand has two points, and the ball is the third. Where
a point cannot move, it takes moments: J^-1 = 0.)

Pushes along n are those of rows.py, of the sweeps before; those leave such pairs without friction (`rolls`). All pairs move at
once, with masses split by weight as there: A = sum |b_k| w_k B_k + a B, B = a B_ball, and C has a bound of what the couple
turns the points by.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.moment_correction import couple_funcs
from wsim.kernels.contact.selfcontact.rows import whole_point_weight
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.kernels.position_based.rolling.law import roll_type, rolling_law_func


@cache
def rolling_row_type(real):
    """Struct of rows in which a ball turns, (capacity,). Kernels read it from an array of one, as the list of pairs."""
    t = types(real)

    @wp.struct
    class RollingRows:
        T: wp.array(dtype=t.vec3)          # friction on the ball [kg m]
        q: wp.array(dtype=t.vec3)          # torque on it over R [kg m]

    return RollingRows


@cache
def rolling_ball_func(real):
    """Function (ids, b, roll) -> (corner of the pair that is a ball which may turn, -1: none; the sum of its weights, 1 or -1).
    """
    t, Roll = types(real), roll_type(real)

    @wp.func
    def rolling_ball(ids: wp.vec4i, b: t.vec4, roll: Roll):
        found = int(-1)
        side = real(0.0)
        for k in range(4):
            if ids[k] < roll.own.shape[0]:
                if roll.own[ids[k]][2] > real(0.0):
                    found = k
                    side += b[k]
        return found, side

    return rolling_ball


@cache
def rolling_row_open_kernel(real, module):
    """Kernel: no friction yet, where a substep begins."""
    t, Pairs, Rows = types(real), pairs.pair_type(real), rolling_row_type(real)

    def open_rolling_rows(near_at: wp.array(dtype=Pairs), rows_at: wp.array(dtype=Rows), threads: int):
        rows = rows_at[0]
        j = wp.tid()
        while j < near_at[0].rows[0]:
            rows.T[j] = t.vec3()
            rows.q[j] = t.vec3()
            j += threads

    return wp.kernel(open_rolling_rows, name=f"roll_rows_{t.name}", module=module, enable_backward=False)


@cache
def rolling_row_weight_kernel(real, module):
    """Kernel: weights of the pairs that push a ball, by point."""
    t, Pairs, Rows, Roll = types(real), pairs.pair_type(real), rolling_row_type(real), roll_type(real)
    ball_of, Sums = rolling_ball_func(real), pairs.sum_type(real)

    def add_rolling_weights(near_at: wp.array(dtype=Pairs), rows_at: wp.array(dtype=Rows), roll: Roll, threads: int, to: Sums):
        near = near_at[0]
        rows = rows_at[0]
        j = wp.tid()
        while j < near.rows[0]:
            ids = near.four[j]
            b = near.swept[4 * j + pairs.B]
            ball, _side = ball_of(ids, b, roll)
            push = near.swept[4 * j + pairs.PUSH]
            pushes = push[0] != real(0.0) or push[1] != real(0.0) or push[2] != real(0.0)
            if ball >= 0 and (pushes or wp.length_sq(rows.T[j]) > real(0.0)):
                for c in range(4):
                    wp.atomic_add(to.share, ids[c], whole_point_weight(b[c]))
            j += threads

    return wp.kernel(add_rolling_weights, name=f"roll_weights_{t.name}", module=module, enable_backward=False)


@cache
def rolling_pair_type(real):
    """(RollingPair, gather): struct of one pair, and function (s, at, near, roll, j, ball, side, to) -> it, of row j."""
    t, Surfaces, State, Pairs = types(real), pairs.surface_type(real), point_states(real), pairs.pair_type(real)
    Roll, Sums, (arms, lever, _) = roll_type(real), pairs.sum_type(real), couple_funcs(real)
    points = wp.types.matrix((4, 3), real)

    @wp.struct
    class RollingPair:
        N: t.vec3
        D: t.vec3
        r: points
        K: t.mat33                         # J^-1
        masses: t.vec3                     # A, B, C [1/kg]
        lam: t.scalar                      # [kg m]
        mu: t.vec3
        away: t.vec3                       # sum_k b_k u_k - theta x D, of the ball from the surface [m]
        theta: t.vec3

    @wp.func
    def sum_pair_motion(at: State, ids: wp.vec4i, b: t.vec4, p: RollingPair):
        way = t.vec3()
        turning = t.vec3()
        for k in range(4):
            u = at.d[ids[k]] - at.a[ids[k]]
            way += b[k] * u
            turning += wp.cross(p.r[k], u)
        return way, p.K * turning

    @wp.func
    def arms_beside_ball(r: points, ball: int):
        """Those of a triangle from its own middle; 0 of the ball."""
        middle = t.vec3()
        for k in range(4):
            if k != ball:
                middle += r[k] / real(3.0)
        for k in range(4):
            r[k] = r[k] - middle
        r[ball] = t.vec3()
        return r

    @wp.func
    def gather_rolling_pair(s: Surfaces, at: State, near: Pairs, roll: Roll, j: int, ball: int, side: real, to: Sums):
        p = RollingPair()
        ids = near.four[j]
        b = near.swept[4 * j + pairs.B]
        there = near.swept[4 * j + pairs.NORMAL]
        push = near.swept[4 * j + pairs.PUSH]
        n = t.vec3(there[0], there[1], there[2])
        own = roll.own[ids[ball]]
        p.N = side * n
        p.lam = wp.max(wp.dot(n, t.vec3(push[0], push[1], push[2])), real(0.0))
        r, D = arms(s, at, ids, b)
        if ids[0] != ids[1] and ids[2] != ids[3]:
            r = arms_beside_ball(r, ball)
        p.r = r
        W = real(0.0)
        fixed = bool(False)
        spread = t.mat33()
        mu = t.vec2()
        for k in range(4):
            w = s.w[ids[k]] * real(to.share[ids[k]]) / real(pairs.SHARES)
            W += wp.abs(b[k]) * w
            spread += w * (wp.length_sq(r[k]) * wp.identity(n=3, dtype=real) - wp.outer(r[k], r[k]))
            mu += real(0.5) * wp.abs(b[k]) * s.friction[ids[k]]
            fixed = fixed or s.w[ids[k]] == real(0.0)
        p.D = side * D - own[2] * p.N
        if not fixed:
            p.K = lever(r)
        spin = own[0] * s.w[ids[ball]] * real(to.share[ids[ball]]) / real(pairs.SHARES)
        turned = p.K * spread * p.K
        p.masses = t.vec3(W + spin, spin, real(0.0))
        if spin > real(0.0):
            p.masses[2] = spin + own[2] * own[2] * wp.trace(turned)
        p.mu = t.vec3(mu[0], mu[1], own[1])
        way, theta = sum_pair_motion(at, ids, b, p)
        p.theta = theta
        p.away = side * way - wp.cross(theta, p.D)
        return p

    return RollingPair, gather_rolling_pair


@cache
def rolling_row_sweep_kernel(real, module):
    """Kernel: friction and torques of all pairs that push a ball, once; into sums of ways (`to`) and of turns."""
    t, Surfaces, State, Pairs = types(real), pairs.surface_type(real), point_states(real), pairs.pair_type(real)
    Rows, Roll, Sums = rolling_row_type(real), roll_type(real), pairs.sum_type(real)
    ball_of, fixed, law = rolling_ball_func(real), pairs.fixed_point_sum(real), rolling_law_func(real)
    Pair, gather = rolling_pair_type(real)

    @wp.func
    def solve_rolling_row(p: Pair, phi: t.vec3, R: real, T: t.vec3, q: t.vec3):
        A = p.masses[0]
        B = p.masses[1]
        s0 = p.away - wp.dot(p.N, p.away) * p.N + wp.cross(p.N, phi - B * q) - A * T
        psi0 = phi - R * p.theta + B * wp.cross(p.N, T) - p.masses[2] * q
        return law(p.N, p.lam, s0, psi0, p.masses, p.mu)

    @wp.func
    def add_turn(turns: wp.array(dtype=wp.int64), i: int, phi: t.vec3):
        for c in range(3):
            wp.atomic_add(turns, 3 * i + c, wp.int64(real(pairs.SCALE) * phi[c]))

    def rub_rolling_rows(s: Surfaces, at: State, near_at: wp.array(dtype=Pairs), rows_at: wp.array(dtype=Rows), roll: Roll,
                         threads: int, turns: wp.array(dtype=wp.int64), to: Sums):
        near = near_at[0]
        rows = rows_at[0]
        j = wp.tid()
        while j < near.rows[0]:
            ids = near.four[j]
            b = near.swept[4 * j + pairs.B]
            ball, side = ball_of(ids, b, roll)
            if ball >= 0:
                i = ids[ball]
                T = rows.T[j]
                q = rows.q[j]
                p = gather(s, at, near, roll, j, ball, side, to)
                if p.masses[0] > real(0.0) and (p.lam > real(0.0) or wp.length_sq(T) > real(0.0)):
                    new = solve_rolling_row(p, roll.phi[i], roll.own[i][2], T, q)
                    dT = new[0] - T
                    dq = new[1] - q
                    rows.T[j] = new[0]
                    rows.q[j] = new[1]
                    back = p.K * (wp.cross(p.D, dT) + roll.own[i][2] * dq)
                    for k in range(4):
                        fixed(to, ids[k], s.w[ids[k]] * ((side * b[k]) * dT - wp.cross(back, p.r[k])))
                    add_turn(turns, i, (roll.own[i][0] * s.w[i]) * (dq - wp.cross(p.N, dT)))
            j += threads

    return wp.kernel(rub_rolling_rows, name=f"roll_rub_{t.name}", module=module, enable_backward=False)


@cache
def rolling_turn_kernel(real, module):
    """Kernel over balls: they turn as pairs have summed up; sums are zero again."""
    t, Roll = types(real), roll_type(real)

    def add_rolling_turns(ball: wp.array(dtype=int), turns: wp.array(dtype=wp.int64), roll: Roll):
        i = ball[wp.tid()]
        scale = real(1.0 / pairs.SCALE)
        phi = t.vec3(real(turns[3 * i]), real(turns[3 * i + 1]), real(turns[3 * i + 2]))
        for c in range(3):
            turns[3 * i + c] = wp.int64(0)
        if roll.own[i][0] > real(0.0):
            roll.phi[i] = roll.phi[i] + scale * phi

    return wp.kernel(add_rolling_turns, name=f"roll_turns_{t.name}", module=module, enable_backward=False)
