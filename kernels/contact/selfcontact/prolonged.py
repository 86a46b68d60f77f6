"""Velocities behind contacts of pairs where a step goes on from its middle to its end (implicit midpoint), by impulses that
change no place.

Contacts push at the end of a substep h, where d~ and v~ are without them, and v~ + (d - d~) / h is right of a blow: what is
left of the way is left of the velocity. Of a force that lasts the same push takes back the way h^2 f / 2, and with it half of
the velocity h f. Relative velocities of pairs that push tell one from the other: they are made those of relative motions (as
BDF2's, kernels/contact/selfcontact/velocity_solve.py), by impulses Q [kg m/s]. P [m kg] is what a pair pushes with, n its
normal:

    u = sum_k b_k (v_k - (d_k - e_k) / h)       sticks: u = 0, by any Q       slides: n . u = 0, by Q along p = P / n . P

where n . (P / h + Q) >= 0. Q = 0 at first; where a pair pushed alike in the substep before, P / h, which is the solution at
rest. What goes to and fro with every step stands still in its middle, where drag would act on it: friction of what sticks ends
it here. Sweeps as kernels/contact/selfcontact/velocity_solve.py has them, as many for all: those that lead ahead gain energy
where pairs slide, whose rows are not symmetric.

Q has no moment where the substep ends (kernels/contact/selfcontact/moment_correction.py). P has none where it begins, and
counts about

    y = x + d~ - h v~,      as  (x + d) x (v~ + w P / h) - (x + d~) x v~ = y x w P / h  of one point,  d = d~ + w P

which is x but for what forces have changed in h / 2. So a couple gives back sum_k y_k x P_k.

Pushes that Newton steps have solved for (kernels/selfcontact/newton) act all through the step, as other forces do: v~
has 2 P / h of them, which is right at rest, and they count about the middle, y - x = d~ - e by the same sum.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.moment_correction import couple_funcs
from wsim.kernels.contact.selfcontact.velocity_solve import aim_type
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import ALIKE
from wsim.kernels.motion.points import point_states

SLIDES = 0.999         # of the friction that lets a pair slide, from which on it does


@cache
def slip_type(real):
    """Struct of what pairs that push need besides (kernels/contact/selfcontact/velocity_solve.py, `aim_type`), (capacity,)."""
    t = types(real)

    @wp.struct
    class PairSlips:
        p: wp.array(dtype=t.vec3)                 # P / n . P
        turn: wp.array(dtype=t.vec3)              # moment of P [m^2 kg]
        Q: wp.array(dtype=t.vec3)                 # [kg m/s]
        sticks: wp.array(dtype=int)

    return PairSlips


@cache
def arms_of(real):
    """Functions: whether all points of a pair are free, since what cannot move takes moments; (r, D, J^-1) of a pair where the
    substep ends."""
    t = types(real)
    Surfaces, State = pairs.surface_type(real), point_states(real)
    points = wp.types.matrix((4, 3), real)
    place, _ = pairs.pair_geometry_funcs(real)
    _, lever, _ = couple_funcs(real)

    @wp.func
    def all_points_free(s: Surfaces, ids: wp.vec4i):
        return s.w[ids[0]] * s.w[ids[1]] * s.w[ids[2]] * s.w[ids[3]] > real(0.0)

    @wp.func
    def end_moment_arms(s: Surfaces, at: State, ids: wp.vec4i, b: t.vec4):
        r, D, middle = points(), t.vec3(), t.vec3()
        for k in range(4):
            r[k] = place(s, at.x, at.d, ids[k], ids[0])
            D += b[k] * r[k]
            middle += real(0.25) * r[k]
        for k in range(4):
            r[k] = r[k] - middle
        K = t.mat33()
        if all_points_free(s, ids):
            K = lever(r)
        return r, D, K

    return all_points_free, end_moment_arms


@cache
def pushing_pair_kernel(real, module):
    """Kernel: the pairs that push. ahead: d~ [m]; at.v: v~ [m/s];"""
    t = types(real)
    Surfaces, State, Pairs = pairs.surface_type(real), point_states(real), pairs.pair_type(real)
    Aims, Slips, (arms, lever, _), (free, _) = aim_type(real), slip_type(real), couple_funcs(real), arms_of(real)

    @wp.func
    def mean_slip_friction(s: Surfaces, ids: wp.vec4i, b: t.vec4):
        mu = t.vec2()
        for k in range(4):
            mu += real(0.5) * wp.abs(b[k]) * s.friction[ids[k]]
        return mu

    @wp.func
    def moment_of_push(s: Surfaces, at: State, ahead: wp.array(dtype=t.vec3), ids: wp.vec4i, b: t.vec4, push: t.vec3, h: real,
                       twice: real):
        """sum_k y_k x P_k: of y - x, and of x where friction has no couple. h 0, twice 2: of a push that was solved for."""
        M = t.vec3()
        if free(s, ids):
            r, D = arms(s, at, ids, b)
            moment = wp.cross(D, push)
            back = t.vec3()
            if mean_slip_friction(s, ids, b)[0] > real(0.0):
                back = lever(r) * moment
            else:
                M = twice * moment
            for k in range(4):
                y = (ahead[ids[k]] - at.e[ids[k]]) - h * at.v[ids[k]]
                M += wp.cross(y, b[k] * push - wp.cross(back, r[k]))
        return M

    @wp.kernel(module=module, enable_backward=False)
    def gather_pushes(s: Surfaces, at: State, near_at: wp.array(dtype=Pairs), ahead: wp.array(dtype=t.vec3), h: real,
                      threads: int, to_at: wp.array(dtype=Aims), slip_at: wp.array(dtype=Slips)):
        near = near_at[0]
        to = to_at[0]
        slip = slip_at[0]
        j = wp.tid()
        if j == 0:
            to.count[0] = near.rows[0]
        while j < near.rows[0]:
            i = near.row[j]
            ids = near.ids[i]
            b = near.b[i]
            push = near.push[i]
            within = t.vec3()
            if near.force.shape[0] > 0:
                within = near.force[j]
            behind = push - within
            lam = wp.dot(push, near.n[i])
            to.ids[j] = ids
            to.b[j] = b
            to.keep[j] = near.keep[i]
            to.n[j] = near.n[i]
            to.q[j] = real(0.0)
            to.least[j] = -(lam + wp.dot(within, near.n[i])) / h
            to.most[j] = real(0.0)
            if lam > real(0.0):
                mu = mean_slip_friction(s, ids, b)[1]
                slip.p[j] = push / lam
                slip.turn[j] = (moment_of_push(s, at, ahead, ids, b, behind, h, real(1.0))
                                + moment_of_push(s, at, ahead, ids, b, within, real(0.0), real(2.0)))
                to.most[j] = real(1.0e30)
                slip.sticks[j] = wp.where(wp.length(push - lam * near.n[i]) < real(SLIDES) * mu * lam, 1, 0)
                slip.Q[j] = t.vec3()
                if wp.length(push - near.past[i]) < real(ALIKE) * lam:
                    slip.Q[j] = behind / h
            j += threads

    return gather_pushes


@cache
def impulse_share_func(real):
    """Function: what an impulse Q of a pair gives to its k-th point, times its mass."""
    t = types(real)
    points = wp.types.matrix((4, 3), real)

    @wp.func
    def impulse_share_of_point(Q: t.vec3, back: t.vec3, r: points, b: t.vec4, k: int):
        return b[k] * Q - wp.cross(back, r[k])

    return impulse_share_of_point


@cache
def wanted_velocity_kernel(real, module):
    """Kernel: relative velocities along n that are wanted, first impulses, and the couples that give back moments, to the sums
    of points [m/s] and to their shares, so that they are taken."""
    Surfaces, State, Aims, Slips, Sums = (pairs.surface_type(real), point_states(real), aim_type(real), slip_type(real),
                                          pairs.sum_type(real))
    fixed, share, (_, ends) = pairs.fixed_point_sum(real), impulse_share_func(real), arms_of(real)

    @wp.kernel(module=module, enable_backward=False)
    def aim_pushes(s: Surfaces, at: State, h: real, threads: int, aim_at: wp.array(dtype=Aims),
                   slip_at: wp.array(dtype=Slips), to: Sums):
        aim = aim_at[0]
        slip = slip_at[0]
        j = wp.tid()
        while j < aim.count[0]:
            if aim.most[j] > real(0.0):
                ids = aim.ids[j]
                b = aim.b[j]
                Q = slip.Q[j]
                r, D, K = ends(s, at, ids, b)
                back = K * (wp.cross(D, Q) + slip.turn[j] / h)
                motion = real(0.0)
                for k in range(4):
                    motion += b[k] * wp.dot(aim.n[j], at.d[ids[k]] - at.e[ids[k]])
                    wp.atomic_add(to.share, ids[k], 1)
                    fixed(to, ids[k], s.w[ids[k]] * share(Q, back, r, b, k))
                aim.aim[j] = motion / h
                aim.q[j] = wp.dot(aim.n[j], Q)
            j += threads

    return aim_pushes


@cache
def push_weight_kernel(real, module):
    """Kernel: adds the weights of pairs to the shares of points, as each sweep needs them."""
    Aims, Sums = aim_type(real), pairs.sum_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def spread_pushes(aim_at: wp.array(dtype=Aims), threads: int, to: Sums):
        aim = aim_at[0]
        j = wp.tid()
        while j < aim.count[0]:
            if aim.most[j] > real(0.0):
                for k in range(4):
                    share = int(wp.ceil(wp.abs(aim.b[j][k]) * real(pairs.SHARES)))
                    wp.atomic_add(to.share, aim.ids[j][k], wp.max(share, 1))          # couples move all four
            j += threads

    return spread_pushes


@cache
def push_sweep_kernel(real, module):
    """Kernel: one sweep over velocities at.v [m/s]."""
    t = types(real)
    Surfaces, State, Aims, Slips, Sums = (pairs.surface_type(real), point_states(real), aim_type(real), slip_type(real),
                                          pairs.sum_type(real))
    fixed, share, (_, ends), (_, _, turn) = (pairs.fixed_point_sum(real), impulse_share_func(real), arms_of(real),
                                             couple_funcs(real))
    points = wp.types.matrix((4, 3), real)

    @wp.func
    def impulse_after_sweep(aim: Aims, slip: Slips, j: int, r: t.vec3):
        """The impulse behind a sweep, by the velocity r that is lacking times the mass."""
        n = aim.n[j]
        lack = wp.dot(r, n)
        q = wp.max(aim.q[j] - real(pairs.OVER) * lack, aim.least[j])
        if slip.sticks[j] == 0:
            return q * slip.p[j]
        T = slip.Q[j] - (r - lack * n)
        return T + (q - wp.dot(T, n)) * n

    @wp.kernel(module=module, enable_backward=False)
    def strike_pushes(s: Surfaces, at: State, h: real, aim_at: wp.array(dtype=Aims), slip_at: wp.array(dtype=Slips),
                      threads: int, to: Sums):
        aim = aim_at[0]
        slip = slip_at[0]
        j = wp.tid()
        while j < aim.count[0]:
            if aim.most[j] > real(0.0):
                ids = aim.ids[j]
                b = aim.b[j]
                W = real(0.0)
                lack, u = t.vec3(), points()
                for k in range(4):
                    q = ids[k]
                    W += wp.abs(b[k]) * s.w[q] * real(to.share[q]) / real(pairs.SHARES)
                    u[k] = at.v[q] - (at.d[q] - at.e[q]) / h
                    lack += b[k] * u[k]
                if W > real(0.0):
                    r, D, K = ends(s, at, ids, b)
                    lack -= wp.cross(turn(K, r, u), D)
                    before = slip.Q[j]
                    Q = impulse_after_sweep(aim, slip, j, lack / W)
                    slip.Q[j] = Q
                    aim.q[j] = wp.dot(aim.n[j], Q)
                    back = K * wp.cross(D, Q - before)
                    for k in range(4):
                        fixed(to, ids[k], s.w[ids[k]] * share(Q - before, back, r, b, k))
            j += threads

    return strike_pushes
