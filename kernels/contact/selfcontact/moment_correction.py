"""Friction of a pair without a moment.

The closest points of a pair are D = sum_k b_k r_k apart, r_k its four points from their middle. A push P along D has no moment;
friction across it has one, D x P, that turns what slides. A couple on the same points takes it back, and what a pair looks at
is the slip beside their common turn, which is the transpose of it (so that friction still only takes energy):

    J = sum_k (|r_k|^2 - r_k r_k^T)      P_k = b_k P - (J^-1 (D x P)) x r_k
    slip = sum_k b_k d_k - (J^-1 sum_k r_k x d_k) x D

Sums of P_k and of r_k x P_k are zero. It is the least change of the four pushes that does so, and it is small: some D / L of P,
where the points are L apart; of two edges one above the other friction across them has no other way, and vanishes.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states

THIN = 1e-6            # of the third of a trace cubed, that a determinant is at least; less: four points in a line


@cache
def couple_funcs(real):
    """Functions, r and d being matrices of four rows:

    arms   (s, at, ids, b) -> r, D: points of a pair from their middle, where the substep begins; way between the closest
    lever  r -> J^-1, 0 of points in a line
    turn   (J^-1, r, d) -> J^-1 sum_k r_k x d_k
    """
    t = types(real)
    Surfaces, State = pairs.surface_type(real), point_states(real)
    points = wp.types.matrix((4, 3), real)
    place, _ = pairs.pair_geometry_funcs(real)

    @wp.func
    def pair_moment_arms(s: Surfaces, at: State, ids: wp.vec4i, b: t.vec4):
        r, D, middle = points(), t.vec3(), t.vec3()
        for k in range(4):
            r[k] = place(s, at.x, at.e, ids[k], ids[0])
            D += b[k] * r[k]
            middle += real(0.25) * r[k]
        for k in range(4):
            r[k] = r[k] - middle
        return r, D

    @wp.func
    def inverse_pair_inertia(r: points):
        x, y, z = t.vec3(), t.vec3(), t.vec3()             # rows of J
        for k in range(4):
            p = r[k]
            size = wp.dot(p, p)
            x += t.vec3(size - p[0] * p[0], -p[0] * p[1], -p[0] * p[2])
            y += t.vec3(-p[1] * p[0], size - p[1] * p[1], -p[1] * p[2])
            z += t.vec3(-p[2] * p[0], -p[2] * p[1], size - p[2] * p[2])
        mean = (x[0] + y[1] + z[2]) / real(3.0)
        cofactor = wp.cross(y, z)
        determinant = wp.dot(x, cofactor)
        if determinant <= real(THIN) * mean * mean * mean:
            return t.mat33()
        return wp.matrix_from_rows(cofactor, wp.cross(z, x), wp.cross(x, y)) / determinant     # J is symmetric

    @wp.func
    def common_turn(K: t.mat33, r: points, d: points):
        L = t.vec3()
        for k in range(4):
            L += wp.cross(r[k], d[k])
        return K * L

    return pair_moment_arms, inverse_pair_inertia, common_turn


@cache
def held_type(real):
    """(Held, hold): struct of one pair, and function (s, at, climb, turn, j, near, to) -> it, of row j. With q_k = d_k - d_0,
    of the last three points, since weights and arms have the sum 0:

        C = gap + n . sum_k b_k q_k           slip = sum_k b_k q_k - anchor - (K (sum_k r_k x q_k - moment)) x D
    """
    t = types(real)
    Surfaces, Pairs, State, Sums = pairs.surface_type(real), pairs.pair_type(real), point_states(real), pairs.sum_type(real)
    arms, lever, _ = couple_funcs(real)
    points = wp.types.matrix((4, 3), real)

    @wp.struct
    class HeldPair:
        ids: wp.vec4i
        b: t.vec4
        w: t.vec4                                 # inverse masses [1/kg]
        n: t.vec3
        gap: t.scalar                             # [m]
        keep: t.scalar                            # [m]
        W: t.scalar
        mu: t.vec2
        anchor: t.vec3                            # [m]
        r: points                                 # arms [m]; 0 as D and K are where there is no couple
        D: t.vec3                                 # way between the closest points [m]
        K: t.mat33
        moment: t.vec3                            # of anchors [m^2]
        push: t.vec3                              # P [m kg]
        prior: t.vec3

    @wp.func
    def effective_mass_part(turn: bool, b: real, q: int, s: Surfaces, to: Sums):
        """A point's part of W."""
        if turn:
            return b * b * s.w[q]
        return wp.abs(b) * s.w[q] * real(to.share[q]) / real(pairs.SHARES)

    @wp.func
    def gather_held_pair(s: Surfaces, at: State, climb: real, turn: bool, j: int, near: Pairs, to: Sums):
        h = HeldPair()
        h.ids = near.four[j]
        h.b = near.swept[4 * j + pairs.B]
        there = near.swept[4 * j + pairs.NORMAL]
        pushed = near.swept[4 * j + pairs.PUSH]
        prior = near.swept[4 * j + pairs.PRIOR]
        h.n = t.vec3(there[0], there[1], there[2])
        h.push = t.vec3(pushed[0], pushed[1], pushed[2])
        h.prior = t.vec3(prior[0], prior[1], prior[2])
        h.keep = pushed[3]
        o = h.ids[0]
        started, W, mu, rubs = t.vec3(), real(0.0), t.vec2(), real(1.0)
        rolls = bool(False)
        for k in range(4):
            q = h.ids[k]
            started += h.b[k] * (at.e[q] - at.e[o])
            h.anchor += h.b[k] * (at.a[q] - at.a[o])
            h.w[k] = s.w[q]
            W += effective_mass_part(turn, h.b[k], q, s, to)
            mu += real(0.5) * wp.abs(h.b[k]) * s.friction[q]
            rubs *= s.w[q]
            if s.rolls:
                rolls = rolls or s.rolls[q] > 0
        h.W = W
        if rolls:
            mu = t.vec2()
        h.mu = mu
        h.gap = there[3] - wp.min(h.keep, there[3] + climb) - wp.dot(h.n, started)
        if mu[0] * rubs > real(0.0):                      # what cannot move takes moments
            r, D = arms(s, at, h.ids, h.b)
            h.r = r
            h.D = D
            h.K = lever(r)
            for k in range(1, 4):
                h.moment += wp.cross(r[k], at.a[h.ids[k]] - at.a[o])
        return h

    return HeldPair, gather_held_pair
