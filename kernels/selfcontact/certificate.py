"""Proof that a pair does not pass through itself in a substep, and the projection of pairs that lack one.

Points of a pair go linearly from p_i to q_i. With r = p_i - p_j at the start, R = q_i - q_j at the end, n0 the normal of the
start and n1 that of the end, the plane with the normal (1 - t) n0 + t n1 separates the two sides for all t where

    n0 . r > 0,   n0 . R + n1 . r > 0,   n1 . R > 0           for every i of the first side and j of the second

(Bernstein coefficients of a quadratic in t). Then no point meets a triangle and no edge another, and no triangles intersect that
did not. Only differences of motions enter: a pair that flies, however fast, costs nothing. With n1 = n0 the middle one follows.
The end keeps a gap s, by which rounding in a file cannot close it, and c, a bound of the rounding of all that is computed here:

    c = 8 u (|r| + |m_i| + |m_j| + |shift_i - shift_j|),   sums of absolute coordinates, m the motions, u = 2^-24 (2^-53)

Projection: rows n0 . R >= s + (gap - s) / 10 between single points i and j of pairs that are not certified, as
kernels/selfcontact/rows.py, by the same sums: momentum is kept.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.selfcontact import closest, pairs


@cache
def ends(real):
    """Function: motion of point k, less that of o, and c of the pair of both, see above."""
    t = types(real)
    Surfaces = pairs.surfaces(real)

    @wp.func
    def one(a: t.vec3):
        return wp.abs(a[0]) + wp.abs(a[1]) + wp.abs(a[2])

    @wp.func
    def rounding(s: Surfaces, d: wp.array(dtype=t.vec3), e: wp.array(dtype=t.vec3), k: int, o: int, r: t.vec3):
        both = one(d[k] - e[k]) + one(d[o] - e[o]) + one(e[k]) + one(e[o])
        return real(8.0) * s.ulp * (one(r) + both + one(s.shift[k] - s.shift[o]))

    return rounding


@cache
def certify(real, module):
    """Kernel: `bad` of every pair, and how many are not certified in words[BAD]. A pair that began nearer than s is let be (2):
    nothing of it can be proven, and what holds it is its contact."""
    t = types(real)
    vec3 = t.vec3
    Surfaces, Pairs, State = pairs.surfaces(real), pairs.lists(real), states(real)
    place, _ = pairs.reading(real)
    rounding, weights, least, normal = ends(real), closest.weights(real), closest.gap(real), closest.normal(real)

    @wp.kernel(module=module, enable_backward=False)
    def certify_pairs(s: Surfaces, at: State, near: Pairs, words: wp.array(dtype=int)):
        i = wp.tid()
        if i >= wp.min(near.count[0], near.capacity):
            return
        ids = near.ids[i]
        kind = near.kind[i]
        o = ids[0]
        p0, q0 = vec3(), vec3()
        p1 = place(s, at.x, at.e, ids[1], o)
        p2 = place(s, at.x, at.e, ids[2], o)
        p3 = place(s, at.x, at.e, ids[3], o)
        move = at.d[o] - at.e[o]
        q1 = p1 + ((at.d[ids[1]] - at.e[ids[1]]) - move)
        q2 = p2 + ((at.d[ids[2]] - at.e[ids[2]]) - move)
        q3 = p3 + ((at.d[ids[3]] - at.e[ids[3]]) - move)
        c = rounding(s, at.d, at.e, ids[1], o, p1)
        c = wp.max(c, rounding(s, at.d, at.e, ids[2], o, p2))
        c = wp.max(c, rounding(s, at.d, at.e, ids[3], o, p3))
        need = near.least[i] + real(2.0) * c
        n = near.n[i]
        if near.gap[i] < near.least[i] - real(2.0) * c:
            near.bad[i] = 2
            wp.atomic_add(words, pairs.CLOSER, 1)
            return
        if near.gap[i] > real(2.0) * c and least(kind, n, q0, q1, q2, q3) >= need:
            near.bad[i] = 0
            return
        b = weights(kind, q0, q1, q2, q3)
        m, end = normal(kind, b, q0, q1, q2, q3)
        good = near.gap[i] > real(2.0) * c and end >= need
        # the coefficient in the middle: n . R + m . r, of every i and j
        a0, a1, a2, a3 = real(0.0), wp.dot(n, q1) + wp.dot(m, p1), wp.dot(n, q2) + wp.dot(m, p2), wp.dot(n, q3) + wp.dot(m, p3)
        middle = wp.min(a0 - a2, a0 - a3)
        if kind == closest.POINT:
            middle = wp.min(middle, a0 - a1)
        else:
            middle = wp.min(middle, wp.min(a1 - a2, a1 - a3))
        if good and middle >= real(4.0) * c:
            near.bad[i] = 0
            return
        near.bad[i] = 1
        wp.atomic_add(words, pairs.BAD, 1)

    return certify_pairs


@cache
def goal(real):
    """Function: what is lacking of a row of points k (first side) and j, < 0 where something is."""
    t = types(real)
    Surfaces, Pairs, State = pairs.surfaces(real), pairs.lists(real), states(real)
    place, _ = pairs.reading(real)

    @wp.func
    def lack(s: Surfaces, at: State, near: Pairs, i: int, k: int, j: int):
        s0 = near.least[i]
        spare = wp.max(near.gap[i] - s0, real(0.0))
        r = place(s, at.x, at.e, k, j) + ((at.d[k] - at.e[k]) - (at.d[j] - at.e[j]))
        return wp.dot(near.n[i], r) - (s0 + real(0.1) * spare)

    return lack


@cache
def share(real, module):
    """Kernel: counts the rows that points have of pairs that are not certified."""
    Surfaces, Pairs, State, Sums = pairs.surfaces(real), pairs.lists(real), states(real), pairs.sums(real)
    lack = goal(real)

    @wp.kernel(module=module, enable_backward=False)
    def share_rows(s: Surfaces, at: State, near: Pairs, to: Sums):
        i = wp.tid()
        if i >= wp.min(near.count[0], near.capacity) or near.bad[i] != 1:
            return
        ids = near.ids[i]
        split = 1 + near.kind[i]
        for k in range(split):
            for j in range(split, 4):
                if lack(s, at, near, i, ids[k], ids[j]) < real(0.0):
                    wp.atomic_add(to.share, ids[k], pairs.SHARES)
                    wp.atomic_add(to.share, ids[j], pairs.SHARES)

    return share_rows


@cache
def project(real, module):
    """Kernel: pushes pairs that are not certified, point by point."""
    Surfaces, Pairs, State, Sums = pairs.surfaces(real), pairs.lists(real), states(real), pairs.sums(real)
    lack, fixed = goal(real), pairs.fixed(real)

    @wp.kernel(module=module, enable_backward=False)
    def project_rows(s: Surfaces, at: State, near: Pairs, to: Sums):
        i = wp.tid()
        if i >= wp.min(near.count[0], near.capacity) or near.bad[i] != 1:
            return
        ids = near.ids[i]
        split = 1 + near.kind[i]
        for k in range(split):
            for j in range(split, 4):
                a = ids[k]
                b = ids[j]
                C = lack(s, at, near, i, a, b)
                W = (s.w[a] * real(to.share[a]) + s.w[b] * real(to.share[b])) / real(pairs.SHARES)
                if C < real(0.0) and W > real(0.0):
                    push = (-C / W) * near.n[i]
                    fixed(to, a, s.w[a] * push)
                    fixed(to, b, -s.w[b] * push)

    return project_rows


@cache
def proceed(module):
    """Kernel: a pass over all pairs is over. Projections go on while pairs lack a proof and rounds are left; then cuts do, while
    pairs lack one or points are out of their tubes. kind: 0 behind the first pass, 1 a projection, 2 a cut; most: cuts."""
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
            words[pairs.SWEPT] = turn
            if bad > 0 and turn < words[pairs.ROUNDS]:
                going = 1
                left = 0
            else:
                turn = 0
        else:
            words[pairs.TURNED] = turn
            if turn >= most:
                left = 0
        words[pairs.GOING] = going
        words[pairs.LEFT] = left
        words[pairs.ROUND] = turn
        words[pairs.BAD] = 0
        words[pairs.OUT] = 0
        words[pairs.CLOSER] = 0

    return proceed_rounds
