"""Grains that turn, with each other: the iterations of grains.py with the law of law.py.

    phi  turn of a grain in the substep times its radius [m]     a = 5/2 w     x = r / R,  1/r = 1/R_i + 1/R_j
    f = |y_i - y_j| / (R_i + R_j)  where a substep begins   s = (u_i - u_j)_t + f n x (phi_i + phi_j)  slide where both touch
    psi = x_i phi_i - x_j phi_j                                  turn of i about j, times r
    phi_i += a_i (x_i dq - f n x dT),   phi_j -= a_j (x_j dq + f n x dT)

A of the law has f^2 (a_i + a_j), B has f. So T and its two turns keep the angular momentum m x X v + 2/5 m R^2 omega of both,
and q does by itself: a gap that closes within the substep is shared by the arms f R. Grains are split
in as many parts as they have contacts (grains.py), with their inertia. What is carried (stacks.py) answers such a contact
alone, and what carries more than LOCKED of its own weight does not turn: it passes loads straight down without a torque, and
the foot of a pile would roll from under it. Torques of contacts last from one substep to the next, as their forces do.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.position_based.grains import PUSHED, grain_structs
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.rolling.law import SPHERE, roll_type, rolling_law_func

LOCKED = 0.3           # of its weight: a grain that carries more of others does not turn; at 1 heaps creep at 1e-3 m/s
FREE = 0.1             # from which it turns again; one bound for both has it turn in each other substep


@cache
def rolling_type(real):
    """Struct of grains that turn: by place k, by contact as GrainContacts, and what lasts, as GrainForces."""
    t = types(real)

    @wp.struct
    class RollingGrains:
        phi: wp.array(dtype=t.vec3)        # before an iteration, by k [m]
        own: wp.array(dtype=t.vec3)        # a over w; mu_r; radius [m], by k
        q: wp.array(dtype=t.vec3)          # torque over r on the grain, times g, by contact [kg m]
        arm: wp.array(dtype=t.scalar)      # f, by contact
        torque: wp.array(dtype=t.vec3)     # over r, by entry of what contacts have borne [N]

    return RollingGrains


@cache
def roll_mean_func(real):
    """Function (own_i, own_j) -> mu_r of a pair: the mean, or that of the one that turns; 0 of none."""
    t = types(real)

    @wp.func
    def mean_rolling_friction(own: t.vec3, other: t.vec3):
        if own[1] < real(0.0):
            return wp.max(other[1], real(0.0))
        if other[1] < real(0.0):
            return own[1]
        return real(0.5) * (own[1] + other[1])

    return mean_rolling_friction


@cache
def roll_motion_kernel(real, module):
    """Kernel over places: u and phi in the order of cells, before an iteration."""
    t, N, S, Pairs, Roll = types(real), neighbour_structs(real), grain_structs(real), rolling_type(real), roll_type(real)

    def gather_rolling(rows: N.ParticleTable, c: N.CellTable, g: S.GrainTable, r: Pairs, roll: Roll,
                       d: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3)):
        k = wp.tid()
        p = c.order[k]
        i = rows.point[p]
        g.u[k] = d[i] - a[i]
        r.phi[k] = roll.phi[i]
        own = roll.own[i]
        r.own[k] = t.vec3(own[0], own[1], rows.reach[p])

    return wp.kernel(gather_rolling, name=f"roll_motion_{t.name}", module=module, enable_backward=False)


@cache
def roll_pair_func(real):
    """Function (n, away, (phi_i, phi_j), own_i, own_j, (w_i, w_j, f), (b, mu_s, mu_d), (L, q)) -> (L', q') of one contact,
    split as w_i and w_j say; away: u_i - u_j."""
    t = types(real)
    law, mean, mat23 = rolling_law_func(real), roll_mean_func(real), wp.types.matrix((2, 3), real)

    @wp.func
    def solve_rolling_pair(n: t.vec3, away: t.vec3, phi: mat23, own: t.vec3, there: t.vec3, w: t.vec3, law_of: t.vec3,
                           before: mat23):
        R = own[2] + there[2]
        a_i = own[0] * w[0]
        a_j = there[0] * w[1]
        x_i = there[2] / R
        x_j = own[2] / R
        f = w[2]
        K = t.vec3(w[0] + w[1] + f * f * (a_i + a_j), f * (a_i * x_i - a_j * x_j), a_i * x_i * x_i + a_j * x_j * x_j)
        lam = wp.dot(before[0], n)
        T = before[0] - lam * n
        close = wp.dot(n, away)
        pressed = wp.max(lam - (law_of[0] + close) / (w[0] + w[1]), real(0.0))
        s0 = away - close * n + wp.cross(n, f * (phi[0] + phi[1]) - K[1] * before[1]) - K[0] * T
        psi0 = x_i * phi[0] - x_j * phi[1] + K[1] * wp.cross(n, T) - K[2] * before[1]
        new = law(n, pressed, s0, psi0, K, t.vec3(law_of[1], law_of[2], mean(own, there)))
        return wp.matrix_from_rows(pressed * n + new[0], new[1])

    return solve_rolling_pair


@cache
def roll_solve_kernel(real, module):
    """Kernel over places: one iteration of all contacts of a grain, as `grain_solve_kernel`."""
    t, N, S, Pairs, Roll = types(real), neighbour_structs(real), grain_structs(real), rolling_type(real), roll_type(real)
    solve = roll_pair_func(real)

    def solve_rolling_contacts(rows: N.ParticleTable, c: N.CellTable, g: S.GrainTable, q: S.GrainContacts,
                               r: Pairs, roll: Roll, d_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        m = q.count[k]
        if m == 0:
            return
        i = rows.point[c.order[k]]
        w = g.w[i]
        own = r.own[k]
        own_phi = r.phi[k]
        own_rub = g.rub[k]
        u = g.u[k]
        split = g.split[k]
        given = t.vec3()
        turned = t.vec3()
        for s in range(m):
            slot = s * q.size + k
            o = q.other[slot]
            held = q.support[slot]
            n = q.n[slot]
            L = q.L[slot]
            away = u - g.u[o]
            if held < 0 or (held == 0 and wp.length_sq(L) == real(0.0) and q.b[slot] + wp.dot(n, away) >= real(0.0)):
                continue                                     # it does not press, and did not: most of those near
            f = r.arm[slot]
            phi = own_phi + t.vec3()
            each = t.vec3(split, g.split[o], f)
            if held == 1:
                each = t.vec3(w, real(0.0), f)
                away += w * given + (real(1.0 - PUSHED) * wp.max(wp.dot(n, g.u[o]), real(0.0))) * n
                phi += (own[0] * w) * turned
            if each[0] + each[1] > real(0.0):
                old = wp.matrix_from_rows(L, r.q[slot])
                rub = real(0.5) * (own_rub + g.rub[o])
                new = solve(n, away, wp.matrix_from_rows(phi, r.phi[o]), own, r.own[o], each,
                            t.vec3(q.b[slot], rub[0], rub[1]), old)
                q.L[slot] = new[0]
                r.q[slot] = new[1]
                given += new[0] - old[0]
                turned += (r.own[o][2] / (own[2] + r.own[o][2])) * (new[1] - old[1]) - f * wp.cross(n, new[0] - old[0])
        d_out[i] = d_out[i] + w * given
        if own[0] > real(0.0):
            roll.phi[i] = roll.phi[i] + (own[0] * w) * turned

    return wp.kernel(solve_rolling_contacts, name=f"roll_solve_{t.name}", module=module, enable_backward=False)


@cache
def roll_warm_kernel(real, module):
    """Kernel over places, behind `contact_kernel`: torques of the substep before, and what impulses and they turn; h [s]."""
    t, N, S, Pairs, Roll = types(real), neighbour_structs(real), grain_structs(real), rolling_type(real), roll_type(real)
    mean = roll_mean_func(real)

    def start_rolling_contacts(rows: N.ParticleTable, c: N.CellTable, g: S.GrainTable, q: S.GrainContacts,
                               before: S.GrainForces, r: Pairs, roll: Roll, h: real):
        k = wp.tid()
        p = c.order[k]
        i = rows.point[p]
        own = roll.own[i]
        most = real(LOCKED)
        if wp.length_sq(roll.phi[i]) == real(0.0):           # it did not turn, and does so only where it carries less
            most = real(FREE)
        own[0] = real(0.0)
        if own[2] > real(0.0) and g.held[k][1] <= most:
            own[0] = real(SPHERE)
        roll.own[i] = own
        if own[0] == real(0.0):
            roll.phi[i] = t.vec3()
        turned = t.vec3()
        old = int(0)
        for s in range(q.count[k]):
            slot = s * q.size + k
            n = q.n[slot]
            lam = wp.dot(q.L[slot], n)
            o = q.id[slot]
            j = rows.point[o]
            torque = t.vec3()
            while old < q.room and before.id[old * q.size + p] >= 0 and before.id[old * q.size + p] < o:
                old += 1
            if old < q.room and before.id[old * q.size + p] == o and q.support[slot] >= 0:
                torque = (h * h) * r.torque[old * q.size + p]
                bound = mean(own, roll.own[j]) * wp.max(lam, real(0.0))
                size = wp.length(torque)
                if size > bound:
                    torque *= bound / size
            r.q[slot] = torque
            R = rows.reach[p] + rows.reach[o]
            f = wp.dot(n, g.y[k] - g.y[q.other[slot]]) / R
            r.arm[slot] = f
            if q.support[slot] >= 0:
                turned += (rows.reach[o] / R) * torque - f * wp.cross(n, q.L[slot])
        if own[0] > real(0.0):
            roll.phi[i] = roll.phi[i] + (own[0] * g.w[i]) * turned

    return wp.kernel(start_rolling_contacts, name=f"roll_warm_{t.name}", module=module, enable_backward=False)


@cache
def roll_force_kernel(real, module):
    """Kernel over places, behind `force_kernel` and in its order: torques that contacts have borne in a substep of h [s]."""
    t, N, S, Pairs = types(real), neighbour_structs(real), grain_structs(real), rolling_type(real)

    def keep_rolling_torques(c: N.CellTable, q: S.GrainContacts, r: Pairs, h: real):
        k = wp.tid()
        p = c.order[k]
        m = int(0)
        for s in range(q.count[k]):
            if wp.length_sq(q.L[s * q.size + k]) > real(0.0):
                r.torque[m * q.size + p] = r.q[s * q.size + k] / (h * h)
                m += 1

    return wp.kernel(keep_rolling_torques, name=f"roll_force_{t.name}", module=module, enable_backward=False)
