"""Grains that stand on others: which contacts carry, so that a hundred layers need no hundred iterations.

    up  against gravity, unit vector      G  gravity [m/s^2]      W  load [N], what the grains above press upon a grain
    n   unit normal from grain j to i     L  impulse times g [kg m] of a contact, see grains.py

Iterations pass a load on by one layer each, and lose most of it on the way: with 16 of them a frame a hundred layers
fall through each other. Macklin, Mueller, Chentanez, Kim 2014, section 5.1, make lower grains heavier, m* = m exp(-k height).
This is their limit for large k, as in the shock propagation of Guendelman, Bridson, Fedkiw 2003, section 7:

    j holds i    where j has felt at least HELD of gravity in the substep before, and n.up > STEEP
    i alone answers such a contact, with its own mass, after the contacts that both answer, one contact behind the other

so that what holds is as good as ground, and a grain comes to rest on it within an iteration. A column then rests in as many
iterations as it has layers, whatever its height. Two rules keep motions from growing on their way up, where a wedge
of two grains makes more of what they do: of a push by what holds, the part PUSHED counts; and where a substep begins,
contacts that carry give together what weight needs, not what a blow needed in the substep before.

Grains so carry their own weight alone. What lies on them is passed on as a load, a layer in a substep, in the parts in which
their own weight rests on others; the lowest give it to what they stand on:

    W_j = -sum_(i on j) L_ij / h^2 (1 - W_i.up / (m_i G)),      d_i += w_i h^2 W_i where i rests on no grain

What rests on a grain knows of its motion at once, and the grain knows of what rests on it a substep later. Such a loop has a
gain of W / (m G), and what is more than about one swings from substep to substep without end, as fluids of heavy added mass do
(Causin, Gerbeau, Nobile 2005). So grains that rest on no other take a change of load by the part EASED in a substep.

A heap whose grains feel their own weight alone does not rest: friction deep in it resists by too little, and loads come late.
So a grain that has landed comes to feel the part s of what stands on it, and the load is what is left,

    j takes -s L_ij       W_j = -sum_(i on j) L_ij / h^2 (1 + W_i.up / F_i - s)       F_i = m_i G + what i feels from above

with s of both grains, the lower of the two. Any s is a state of rest of Coulomb's law, of other weights, so that s may grow
while forces follow: 1 / (1 - s), the layers that a grain feels, grows by GROWN and by the factor GROWTH in a substep. With
s = 1 both sides answer, and nothing is late. A blow (BLOW) and a fall take s back, so that what lands is carried.

Where what carries a grain gives more than its weight, as in a blow, it counts as weight alone. Grains that fall, cloth and
bodies, and scenes without gravity have contacts that both sides answer: momentum is kept there to rounding, and in stacks by
the loads, a substep late for each layer.
"""

# ruff: noqa: UP018
# int(0) makes a variable of what would be a constant.

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_constants
from wsim.kernels.position_based.grains import grain_structs
from wsim.kernels.position_based.neighbours import neighbour_structs

STEEP = 0.55           # n.up from which a contact carries; at 0.4 a squeezed pile throws grains half as fast again
HELD = 0.5             # of gravity
MORE = 2.0             # times that a contact may begin with what it has borne: 1 lets layers sink while they land
SETTLED = 8.0          # substeps that a grain has rested on no other before it gives its load to what it stands on,
#                        of its weight as often as substeps have passed: what rests for a moment is not thrown
EASED = 0.05           # of a change of its load, that a grain on no other takes in a substep: see above
BLOW = 3.0             # times gravity that a grain feels, from which on it is hit, or hits
HIT = 0.05             # of s, that a blow takes in a substep; all at once throws what has borne it
GROWN, GROWTH = 0.01, 1.006     # layers, and a factor: faster than iterations pass on loads, columns fall in
WHOLE = 0.999          # s that counts as 1
DEEPEST = 1e4          # times its weight, that a grain passes on at most


@cache
def support_func(real):
    """Function (n.up, what i felt, what j felt) -> 1 where j holds i, -1 where i holds j, else 0. Felt: below 0 of what is no
    grain."""
    @wp.func
    def support_of_pair(rise: real, felt_i: real, felt_j: real):
        held = int(0)
        if felt_i >= real(0.0) and felt_j >= real(0.0):
            if rise > real(STEEP) and felt_j > real(HELD):
                held = 1
            if rise < -real(STEEP) and felt_i > real(HELD):
                held = -1
        return held

    return support_of_pair


@cache
def answer_func(real):
    """Function (n.up, felt and share of i and of j) -> support, and the parts of a contact's impulse that i and j feel."""
    t, support = types(real), support_func(real)

    @wp.func
    def parts_of_answer(rise: real, own: t.vec2, other: t.vec2):
        held = support(rise, own[0], other[0])
        share = wp.min(own[1], other[1])
        mine = real(1.0)
        others = real(1.0)
        if held == 1:
            others = share
        if held == -1:
            mine = share
        return held, mine, others

    return parts_of_answer


@cache
def stack_state_func(real):
    """Function (rows, points, before, p, w) -> (up and gravity, felt, held) of particle p of inverse mass w, as GrainTable
    has them."""
    t, N, S, Constants = types(real), neighbour_structs(real), grain_structs(real), point_constants(real)

    @wp.func
    def stack_state(rows: N.ParticleTable, points: Constants, before: S.GrainSupport, p: int, w: real):
        gravity = points.gravity[points.object[rows.point[p]]]
        size = wp.length(gravity)
        up = t.vec3()
        bears = real(0.0)
        felt = -real(1.0)
        if size > real(0.0):
            up = -gravity / size
            bears = wp.clamp(-wp.dot(up, before.load[p]) * w / size, real(0.0), real(DEEPEST))
            if rows.group[p] < 0:
                felt = wp.max(before.felt[p], real(0.0))
        due = wp.max(before.due[p], real(1.0))
        return t.vec4(up[0], up[1], up[2], size), felt, t.vec4(before.part[p], bears, before.ground[p], due)

    return stack_state


@cache
def share_growth_func(real):
    """Function (share, felt, ground, most) -> the share of the next substep."""
    @wp.func
    def share_after(share: real, felt: real, ground: real, most: real):
        if felt <= real(HELD) or felt > real(BLOW) or (ground > real(0.0) and ground < real(SETTLED)):
            share -= real(HIT)
        else:
            layers = real(1.0) / (real(1.0) - wp.min(share, real(WHOLE)))
            share = real(1.0) - real(1.0) / (real(GROWTH) * layers + real(GROWN))
            if share > real(WHOLE):
                share = real(1.0)
        return wp.clamp(share, real(0.0), most)

    return share_after


@cache
def support_sum_func(shares: bool, real):
    """Function (g, q, after, v, most, k, p, h) -> what a grain has felt in a substep of h [s], over gravity; the part
    of what it bears that grains carried; and the load upon it [N]: written for the next substep."""
    t, S, share_after = types(real), grain_structs(real), share_growth_func(real)

    @wp.func
    def keep_grain_support(g: S.GrainTable, q: S.GrainContacts, after: S.GrainSupport, v: t.vec3, most: real,
                           k: int, p: int, h: real):
        up = t.vec3(g.up[k][0], g.up[k][1], g.up[k][2])
        fall = g.up[k][3] * h * h
        carried = real(0.0)
        taken = real(0.0)
        load = t.vec3()
        ground = wp.min(g.held[k][2] + real(1.0), real(DEEPEST))
        for s in range(q.count[k]):
            slot = s * q.size + k
            if q.support[slot] == 1:
                ground = real(0.0)
                carried += g.inverse[k] * wp.dot(up, q.L[slot])
            elif q.support[slot] == -1:
                other = q.other[slot]
                L = q.L[slot]
                due = g.held[other][3]
                share = real(0.0)
                if wp.static(shares):
                    share = q.share[slot]
                weight = due * fall / g.inverse[other]                 # of the other, times h^2: a blow passes on no more
                size = wp.length(L)
                borne = wp.min(size / wp.max(g.held[other][0], real(1.0)), weight)
                if borne > real(0.0):
                    rest = (real(1.0) + g.held[other][1] / due) * borne - share * size
                    load += (wp.max(rest, real(0.0)) / (h * h * size)) * L
                taken -= share * g.inverse[k] * wp.dot(up, L)
        felt = real(0.0)
        part = real(0.0)
        due = real(1.0)
        if fall > real(0.0):
            felt = (wp.dot(up, v) * h - g.rise[k]) / fall
            due = wp.clamp(real(1.0) + taken / fall, real(1.0), real(DEEPEST))
            part = carried / (due * fall)
        if felt <= real(HELD):
            ground = real(0.0)
        if ground > real(1.0):
            load = after.load[p] + real(EASED) * (load - after.load[p])
        after.felt[p] = felt
        after.part[p] = part
        after.load[p] = load
        after.ground[p] = ground
        if wp.static(shares):
            after.due[p] = due
            after.share[p] = share_after(g.felt[k][1], felt, ground, most)

    return keep_grain_support
