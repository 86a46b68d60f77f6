"""Proof that a pair does not pass through itself in a substep, and the projection of pairs that lack one.

Points of a pair go linearly from p_i to q_i. With r = p_i - p_j at the start, R = q_i - q_j at the end, n0 the normal of the
start and n1 that of the end, the plane with the normal (1 - t) n0 + t n1 separates the two sides for all t where

    n0 . r > 0,   n0 . R + n1 . r > 0,   n1 . R > 0           for every i of the first side and j of the second

(Bernstein coefficients of a quadratic in t). Then no point meets a triangle and no edge another, and no triangles intersect
that did not. Only differences of motions enter: a pair that flies, however fast, costs nothing. With n1 = n0 the middle one
follows. The end keeps a gap s, by which rounding in a file cannot close it, and c, a bound of the rounding of what is computed
(kernels/contact/selfcontact/bounds.py).

Projection: rows n0 . R >= s + max((gap - s) / 10, 4 c) between single points i and j of pairs that are not certified, as
kernels/contact/selfcontact/rows.py, by the same sums: momentum is kept. What ends there is certified, though gaps shrink to a
tenth in substep after substep of a jam. A pair that began nearer than an end can be proven is let be where all goes by the
rigid motion R of kernels/contact/selfcontact/step_clamp.py, and counted with those that began too near.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import closest, pairs
from wsim.kernels.contact.selfcontact.bounds import pair_rounding_bounds, proof_margin_func
from wsim.kernels.contact.selfcontact.motion_bounds import LONG, TURNS
from wsim.kernels.contact.selfcontact.step_clamp import RIGID
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states

LISTS = 16             # of a substep, from which on points that projections lead out of their tubes are cut


@cache
def push_reach_func(real):
    """Function: how much further apart than they keep pairs are that may push [m]: a tube's radius; less of it where
    they are pressed in turn, whose lists are narrower."""
    Surfaces = pairs.surface_type(real)

    @wp.func
    def tube_push_reach(s: Surfaces, words: wp.array(dtype=int)):
        if words[pairs.NARROW] > 1:
            return real(TURNS) * s.beta
        return s.beta

    return tube_push_reach


@cache
def near_pair_listing_func(real):
    """Function: lists pair i among those that may come as near as they keep, by where its points are and where they are
    predicted, and `push_reach_func`; words[FAST], by how much nearer that is. ends -1, -3: none, as the substep is solved."""
    t = types(real)
    Surfaces, Pairs, State = pairs.surface_type(real), pairs.pair_type(real), point_states(real)
    margin = push_reach_func(real)

    @wp.func
    def list_near_pair(s: Surfaces, at: State, ends: int, i: int, near: Pairs, words: wp.array(dtype=int)):
        if ends == -1 or ends == -3:
            return
        ids = near.ids[i]
        b = near.b[i]
        n = near.n[i]
        away = near.away[i]
        keep = near.keep[i]
        end = away
        for k in range(4):
            end += b[k] * wp.dot(n, at.d[ids[k]] - at.e[ids[k]])
        if wp.min(away, end) < keep + margin(s, words):
            j = wp.atomic_add(near.rows, 0, 1)
            if j == 0:
                words[pairs.BEHIND] = words[pairs.EPOCH] + 1
            near.row[j] = i
            near.four[j] = ids
            near.swept[4 * j + pairs.B] = b
            near.swept[4 * j + pairs.NORMAL] = t.vec4(n[0], n[1], n[2], away)
            near.swept[4 * j + pairs.PUSH] = t.vec4(real(0.0), real(0.0), real(0.0), keep)
            near.swept[4 * j + pairs.PRIOR] = t.vec4()
        fast = real(100.0 * LONG) * (away - end) / s.longest
        if end < keep and fast > real(100.0):
            wp.atomic_max(words, pairs.FAST, int(wp.min(fast, real(1.0e9))))

    return list_near_pair


@cache
def pair_start_func(real):
    """Function: pair i where a substep begins, with no push; True where it does not meet, by its last normal, along which it is
    `away` apart and `end` where it is predicted [m]."""
    Surfaces, Pairs, State = pairs.surface_type(real), pairs.pair_type(real), point_states(real)
    vec3, written, margin = types(real).vec3, pair_rounding_bounds(real)[0], push_reach_func(real)

    @wp.func
    def pair_stays_apart(s: Surfaces, at: State, i: int, away: real, end: real, near: Pairs, words: wp.array(dtype=int)):
        near.least[i] = written(s, at, near.kind[i], near.ids[i])
        near.past[i] = near.push[i]
        near.push[i] = vec3()
        far = wp.min(away, end) > near.keep[i] + margin(s, words)
        if far:
            near.away[i] = away
            near.gap[i] = away
        return far

    return pair_stays_apart


@cache
def pair_inspection_kernel(real, module):
    """Kernel: ends 0: normal, weights and gaps of all pairs where the substep begins, and no push, rows, and words[FAST] by
    what is predicted; -1: without rows and that word, as the substep is solved: rows say what pushed in it. A pair that its
    last normal holds further apart than it keeps, and a tube's radius, where it begins and where it is predicted, does not
    meet: it keeps this normal, and its gap by it, and has no weights. -2, -3: as 0 and -1, but all pairs have theirs. 1, and 2
    behind cuts without colliders: `bad` of every pair where it ends, and how many lack a proof in words[BAD]. A pair that began
    nearer than s, or than any end that was proven leaves it, is let be (2): nothing of it can be proven, and what holds it is
    its contact. One kernel, since closest points and normals are most of what is compiled."""
    vec3 = types(real).vec3
    Surfaces, Pairs, State = pairs.surface_type(real), pairs.pair_type(real), point_states(real)
    place, _ = pairs.pair_geometry_funcs(real)
    _, rounding, still, between = pair_rounding_bounds(real)
    apart, meet = pair_start_func(real), near_pair_listing_func(real)
    weights, least, normal = closest.closest_weights(real), closest.pair_gap_func(real), closest.pair_normal_func(real)

    @wp.func
    def inspect_pair_gap(s: Surfaces, at: State, ends: int, i: int, near: Pairs, words: wp.array(dtype=int)):
        ids = near.ids[i]
        kind = near.kind[i]
        o = ids[0]
        zero = vec3()
        p1 = place(s, at.x, at.e, ids[1], o)
        p2 = place(s, at.x, at.e, ids[2], o)
        p3 = place(s, at.x, at.e, ids[3], o)
        n = near.n[i]
        need, c = real(0.0), real(0.0)
        move = at.d[o] - at.e[o]
        q1 = p1 + ((at.d[ids[1]] - at.e[ids[1]]) - move)
        q2 = p2 + ((at.d[ids[2]] - at.e[ids[2]]) - move)
        q3 = p3 + ((at.d[ids[3]] - at.e[ids[3]]) - move)
        if ends > 0:
            c = real(2.0) * rounding(s, at, ids, p1, p2, p3)
            need = near.least[i] + c
            near.bad[i] = 0
            if near.gap[i] < wp.max(still(s, ids, p1, p2, p3), near.least[i] - c):
                near.bad[i] = 2
                wp.atomic_add(words, pairs.CLOSER, 1)
                return
            if least(kind, n, zero, q1, q2, q3) >= need:
                return
        else:
            if apart(s, at, i, least(kind, n, zero, p1, p2, p3), least(kind, n, zero, q1, q2, q3), near, words) and ends > -2:
                return
            q1, q2, q3 = p1, p2, p3
        b = weights(kind, zero, q1, q2, q3)
        m, gap = normal(kind, b, zero, q1, q2, q3)
        if ends <= 0:
            near.n[i] = m
            near.b[i] = b
            near.away[i] = wp.dot(m, b[1] * q1 + b[2] * q2 + b[3] * q3)
            near.gap[i] = gap
            meet(s, at, ends, i, near, words)
            return
        a1, a2, a3 = wp.dot(n, q1) + wp.dot(m, p1), wp.dot(n, q2) + wp.dot(m, p2), wp.dot(n, q3) + wp.dot(m, p3)
        if not (gap >= need and between(kind, a1, a2, a3) >= real(2.0) * c):
            rigid = ends == 2 and words[pairs.ROUND] >= RIGID and near.gap[i] < need and gap >= near.gap[i] - c
            near.bad[i] = wp.where(rigid, 2, 1)
            wp.atomic_add(words, wp.where(rigid, pairs.CLOSER, pairs.BAD), 1)

    @wp.kernel(module=module, enable_backward=False)
    def inspect_pairs(s: Surfaces, at: State, ends: int, threads: int, near_at: wp.array(dtype=Pairs),
                      words: wp.array(dtype=int)):
        near = near_at[0]
        i = wp.tid()
        while i < wp.min(near.count[0], near.capacity):
            inspect_pair_gap(s, at, ends, i, near, words)
            i += threads

    return inspect_pairs


@cache
def proof_deficit_func(real):
    """Function: what is lacking of a row of points k (first side) and j, < 0 where something is."""
    Surfaces, Pairs, State = pairs.surface_type(real), pairs.pair_type(real), point_states(real)
    place, _ = pairs.pair_geometry_funcs(real)
    room = proof_margin_func(real)

    @wp.func
    def separation_deficit(s: Surfaces, at: State, near: Pairs, i: int, k: int, j: int):
        s0 = near.least[i]
        spare = wp.max(real(0.1) * (near.gap[i] - s0), room(s, at, near.ids[i]))
        r = place(s, at.x, at.e, k, j) + ((at.d[k] - at.e[k]) - (at.d[j] - at.e[j]))
        return wp.dot(near.n[i], r) - (s0 + spare)

    return separation_deficit


@cache
def uncertified_share_kernel(real, module):
    """Kernel: counts the rows that points have of pairs that are not certified."""
    Surfaces, Pairs, State, Sums = pairs.surface_type(real), pairs.pair_type(real), point_states(real), pairs.sum_type(real)
    lack = proof_deficit_func(real)

    @wp.kernel(module=module, enable_backward=False)
    def share_rows(s: Surfaces, at: State, threads: int, near_at: wp.array(dtype=Pairs), to: Sums):
        near = near_at[0]
        i = wp.tid()
        while i < wp.min(near.count[0], near.capacity):
            if near.bad[i] == 1:
                ids = near.ids[i]
                split = 1 + near.kind[i]
                for k in range(split):
                    for j in range(split, 4):
                        if lack(s, at, near, i, ids[k], ids[j]) < real(0.0):
                            wp.atomic_add(to.share, ids[k], pairs.SHARES)
                            wp.atomic_add(to.share, ids[j], pairs.SHARES)
            i += threads

    return share_rows


@cache
def pair_projection_kernel(real, module):
    """Kernel: pushes pairs that are not certified, point by point."""
    Surfaces, Pairs, State, Sums = pairs.surface_type(real), pairs.pair_type(real), point_states(real), pairs.sum_type(real)
    lack, fixed = proof_deficit_func(real), pairs.fixed_point_sum(real)

    @wp.func
    def push_apart(s: Surfaces, at: State, near: Pairs, i: int, to: Sums):
        ids = near.ids[i]
        split = 1 + near.kind[i]
        for k in range(split):
            for j in range(split, 4):
                a = ids[k]
                b = ids[j]
                C = lack(s, at, near, i, a, b)
                W = (s.w[a] * real(to.share[a]) + s.w[b] * real(to.share[b])) / real(pairs.SHARES)
                if C < real(0.0) and W > real(0.0):
                    push = (-real(pairs.OVER) * C / W) * near.n[i]
                    fixed(to, a, s.w[a] * push)
                    fixed(to, b, -s.w[b] * push)

    @wp.kernel(module=module, enable_backward=False)
    def project_rows(s: Surfaces, at: State, threads: int, near_at: wp.array(dtype=Pairs), to: Sums):
        near = near_at[0]
        i = wp.tid()
        while i < wp.min(near.count[0], near.capacity):
            if near.bad[i] == 1:
                push_apart(s, at, near, i, to)
            i += threads

    return project_rows


@cache
def proof_round_kernel(module):
    """Kernel: a pass over all pairs is over. Projections go on while pairs lack a proof and rounds are left; then cuts do,
    while pairs lack one or points are out of their tubes. kind: 0 behind the first pass, 1 a projection, 2 a cut; most: cuts.
    A first pass counts for nothing where points are out of their tubes: a list of where they are comes first. words[UNPROVEN]:
    there is more to do behind it."""
    @wp.kernel(module=module, enable_backward=False)
    def proceed_rounds(words: wp.array(dtype=int), kind: int, most: int):
        bad = words[pairs.BAD]
        left = int(0)
        if bad > 0 or words[pairs.OUT] > 0:
            left = 1
        turn = words[pairs.ROUND] + 1
        if kind == 0:
            turn = 0
            words[pairs.CLOSE] = words[pairs.CLOSER]
        going = int(0)
        if kind < 2:
            words[pairs.SWEPT] = wp.max(words[pairs.SWEPT], turn)
            strayed = int(0)
            if kind == 0 and words[pairs.OUT] > 0:
                strayed = 1
            elif bad > 0 and turn < words[pairs.ROUNDS]:
                going = 1
            elif words[pairs.OUT] > 0 and words[pairs.MADE] < LISTS:
                strayed = 1
            if going == 0:
                turn = 0
            left = wp.where(going + strayed > 0, 0, left)
            words[pairs.STRAYED] = strayed
            words[pairs.UNPROVEN] = going + strayed + left
        else:
            words[pairs.TURNED] = turn
            words[pairs.CLOSE] = wp.max(words[pairs.CLOSE], words[pairs.CLOSER])
            if turn >= most:
                words[pairs.PINCH] = wp.min(bad, 1)
                left = 0
        words[pairs.GOING] = going
        words[pairs.LEFT] = left
        words[pairs.ROUND] = turn
        words[pairs.BAD] = 0
        words[pairs.OUT] = 0
        words[pairs.CLOSER] = 0

    return proceed_rounds
