"""Pairs of grains that may touch in a substep, and the forces that last from one substep to the next. See grains.py.

Overlaps that are there as a substep begins move places alone, not velocities (pre-stabilization, Macklin et al. 2014, section
4.4): those of a grain together, over one more than there are, a substep. A pair is looked at in the iterations where its gap,
or that which free motion would leave, is small. Contacts stand in the order of the grains' numbers, whatever the lists are,
so that a run that goes on from a file has the same bits.
"""

# ruff: noqa: UP018       int(0) makes a variable of what would be a constant

from functools import cache

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_constants
from wsim.kernels.position_based.grains import grain_structs, pair_impulse_func, pair_normal_func
from wsim.kernels.position_based.neighbours import neighbour_structs
from wsim.kernels.position_based.stacks import MORE, SETTLED, answer_func, stack_state_func, support_sum_func

SLOP = 1e-3            # of R_i + R_j: overlap that is left alone, so that contacts last
NEAR = 0.05            # of R_i + R_j: gap up to which a pair may touch in the iterations of a substep
RELAXED = 1.0          # over one more than a grain's overlaps: part of their sum that a substep takes away
DEEP = 0.1             # of R_i + R_j: overlap beyond which contacts part pairs too, and give them the velocity of that,
PARTED = 0.1           # by this part of the rest in a substep,
QUICK = 0.01           # and by this part of R_i + R_j at most
FINE = 2.0**32         # parts of a radius in which overlaps are summed
SHIFTED = RELAXED / FINE                # of such a sum, over one more than a grain has overlaps
TOLD = 2e-3            # of R_i + R_j: overlap that is told
FAR = 4.0              # of a radius: way in a substep from which grains may pass through others
FASTEST = 0.2          # of the least radius: way of an overlap's correction in a substep


@cache
def gather_kernel(real, module):
    """Kernel over places: what is known of the particles, in the order of cells. g.fast: how many go farther in this substep
    than FAR times their radius, so that they may pass through others unseen."""
    t, N, S, Constants = types(real), neighbour_structs(real), grain_structs(real), point_constants(real)
    stack = stack_state_func(real)

    def gather_grains(rows: N.ParticleTable, c: N.CellTable, g: S.GrainTable, points: Constants, before: S.GrainSupport,
                      x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3)):
        k = wp.tid()
        p = c.order[k]
        i = rows.point[p]
        w = g.w[i]
        u = d[i] - a[i]
        up, felt, held = stack(rows, points, before, p, w)
        g.point[k] = i
        g.inverse[k] = w
        g.y[k] = x[i] + rows.shift[p]
        g.u[k] = u
        g.rub[k] = g.friction[p]
        g.up[k] = up
        g.felt[k] = t.vec2(felt, before.share[p])
        g.held[k] = held
        g.rise[k] = up[0] * u[0] + up[1] * u[1] + up[2] * u[2]
        if wp.length(d[i]) > real(FAR) * rows.reach[p]:
            wp.atomic_add(g.fast, 0, 1)

    return kernel_over_cores(gather_grains, f"grains_gather_{t.name}", module)


@cache
def overlap_kernel(rigid: bool, real, module):
    """Kernel over places: `back`, and the greatest overlap into `deepest`. most: of `back` [m]."""
    t, N, S, normal = types(real), neighbour_structs(real), grain_structs(real), pair_normal_func(real)
    answers = answer_func(real)

    def measure_overlaps(c: N.CellTable, lists: N.PairLists, g: S.GrainTable, most: real):
        k = wp.tid()
        w = g.inverse[k]
        y = g.y[k]
        felt = g.felt[k]
        own = c.reach[k]
        up = t.vec3(g.up[k][0], g.up[k][1], g.up[k][2])
        whole = wp.vec3l()                          # sums of integers do not depend on the order of lists
        number = real(0.0)
        deepest = real(0.0)
        for s in range(lists.count[k]):
            other = lists.other[s * lists.size + k]
            R = own + c.reach[other]
            way = y - g.y[other]
            if wp.length_sq(way) < R * R:
                n, D = normal(way, c.order[k], c.order[other])
                over = R - D
                deepest = wp.max(deepest, over / R)
                over -= real(SLOP) * R
                held, mine, others = answers(wp.dot(up, n), felt, g.felt[other])
                both = mine * w + others * g.inverse[other]
                if over > real(0.0) and both > real(0.0) and mine > real(0.0):
                    part = (real(FINE) * over * mine * w / (both * real(own))) * n
                    whole += wp.vec3l(wp.int64(part[0]), wp.int64(part[1]), wp.int64(part[2]))
                    number += real(1.0)
        back = t.vec3()
        if number > real(0.0):
            back = t.vec3(real(whole[0]), real(whole[1]), real(whole[2]))
            back *= own * real(SHIFTED) / (real(1.0) + number)
            size = wp.length(back)
            if size > most:
                back *= most / size
        if wp.static(rigid):
            if g.piece[c.order[k]] >= 0:             # the others of its body would bring it back, and so throw the body
                back = t.vec3()
        g.back[k] = back
        if deepest > real(TOLD):
            wp.atomic_max(g.deepest, 0, int(real(1.0e6) * deepest))

    return kernel_over_cores(measure_overlaps, f"grains_overlap{'_rigid' * rigid}_{t.name}", module)


@cache
def stabilize_kernel(real, module):
    """Kernel over places: places without the overlaps that go."""
    t, S = types(real), grain_structs(real)

    def move_apart(g: S.GrainTable, x_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        back = g.back[k]
        if wp.length_sq(back) > real(0.0):
            i = g.point[k]
            x_out[i] = x_out[i] + back
            g.y[k] = g.y[k] + back

    return kernel_over_cores(move_apart, f"grains_apart_{t.name}", module)


@cache
def pair_listing_func(real):
    """Function (c, lists, g, q, k) -> contacts of place k: pairs of its list that may touch in this substep, written in the
    order of their numbers."""
    N, S = neighbour_structs(real), grain_structs(real)

    @wp.func
    def list_grain_contacts(c: N.CellTable, lists: N.PairLists, g: S.GrainTable, q: S.GrainContacts, k: int):
        y = g.y[k]
        u = g.u[k]
        own = c.reach[k]
        m = int(0)
        for s in range(lists.count[k]):
            other = lists.other[s * lists.size + k]
            R = real(1.0 + NEAR) * (own + c.reach[other])
            way = y - g.y[other]
            square = wp.length_sq(way)
            near = square < R * R
            if not near:
                closing = wp.dot(way, u - g.u[other])
                if closing < real(0.0):
                    D = wp.sqrt(square)
                    near = D + closing / D < R
            if near:
                if m < q.room:
                    o = c.order[other]
                    at = int(m)
                    while at > 0 and q.id[(at - 1) * q.size + k] > o:
                        q.id[at * q.size + k] = q.id[(at - 1) * q.size + k]
                        q.other[at * q.size + k] = q.other[(at - 1) * q.size + k]
                        at -= 1
                    q.id[at * q.size + k] = o
                    q.other[at * q.size + k] = other
                m += 1
        if m > q.room:
            wp.atomic_max(q.wanted, 0, m)
        m = wp.min(m, q.room)
        q.count[k] = m
        return m

    return list_grain_contacts


@cache
def force_before_func(real):
    """Function (before, q, p, o, first) -> (entry, force on p by o [N]) of the substep before, from entry `first` on; or 0."""
    t, S = types(real), grain_structs(real)

    @wp.func
    def force_before(before: S.GrainForces, q: S.GrainContacts, p: int, o: int, first: int):
        e = int(first)
        f = t.vec3()
        while e < q.room and before.id[e * q.size + p] >= 0 and before.id[e * q.size + p] < o:
            e += 1
        if e < q.room and before.id[e * q.size + p] == o:
            f = before.f[e * q.size + p]
        return e, f

    return force_before


@cache
def parting_func(rigid: bool, real):
    """Function (g, p, o, gap, R) -> what a contact parts in a substep [m], below 0: beyond DEEP, of a rigid cluster, whose
    points are not moved alone, beyond SLOP."""
    S = grain_structs(real)

    @wp.func
    def part_deep_pair(g: S.GrainTable, p: int, o: int, gap: real, R: real):
        left = real(DEEP)
        if wp.static(rigid):
            if g.piece[p] >= 0 or g.piece[o] >= 0:
                left = real(SLOP)
        return wp.max(real(PARTED) * wp.min(gap + left * R, real(0.0)), -real(QUICK) * R)

    return part_deep_pair


@cache
def contact_kernel(shares: bool, rigid: bool, real, module):
    """Kernel over places: contacts, their normals and gaps, and the impulses that the forces of the substep before give in this
    one; h [s]."""
    t, N, S, normal = types(real), neighbour_structs(real), grain_structs(real), pair_normal_func(real)
    answers, solve, parting = answer_func(real), pair_impulse_func(real), parting_func(rigid, real)
    listing, force_before = pair_listing_func(real), force_before_func(real)

    def start_grain_contacts(c: N.CellTable, lists: N.PairLists, g: S.GrainTable, q: S.GrainContacts, before: S.GrainForces,
                             support_before: S.GrainSupport, h: real, d_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        p = c.order[k]
        y = g.y[k]
        u = g.u[k]
        rub = g.rub[k]
        ground = g.held[k][2]
        up = t.vec3(g.up[k][0], g.up[k][1], g.up[k][2])
        given = t.vec3()
        pressed = real(1.0)
        carried = bool(False)
        old = int(0)
        for s in range(listing(c, lists, g, q, k)):
            slot = s * q.size + k
            other = q.other[slot]
            n, D = normal(y - g.y[other], p, q.id[slot])
            held, mine, others = answers(wp.dot(up, n), g.felt[k], g.felt[other])
            old, f = force_before(before, q, p, q.id[slot], old)
            L = (h * h) * f
            share = wp.min(mine, others)
            if held != 0:
                upper = wp.where(held == 1, g.held[k][0], g.held[other][0])
                L *= share + (real(1.0) - share) / wp.max(upper, real(1.0 / MORE))
            mu = real(0.5) * (rub + g.rub[other])
            L = solve(n, real(0.0), L, t.vec3(), real(1.0), mu)          # cut to the cone of friction: nothing has moved
            R = c.reach[k] + c.reach[other]
            gap = D - R
            b = wp.max(gap, real(0.0))
            b += share * parting(g, p, q.id[slot], gap, R)
            q.n[slot] = n
            q.b[slot] = b
            q.L[slot] = L
            q.support[slot] = held
            carried = carried or held == 1
            if wp.static(shares):
                q.share[slot] = share
            given += mine * L
            if wp.length_sq(L) > real(0.0) or b + wp.dot(n, u - g.u[other]) < real(0.0):
                pressed += real(1.0)
        if not carried and ground >= real(SETTLED):
            rested = wp.min(ground / wp.max(g.held[k][1], real(1.0)), real(1.0))
            given += (rested * h * h) * support_before.load[p]
        d_out[g.point[k]] = d_out[g.point[k]] + g.inverse[k] * given
        g.split[k] = pressed * g.inverse[k]

    return kernel_over_cores(start_grain_contacts, f"grains_contact{'_shares' * shares}{'_rigid' * rigid}_{t.name}", module)


@cache
def force_kernel(deep: bool, shares: bool, real, module):
    """Kernel over places: what contacts have borne in a substep of h [s], as forces, by the numbers of grains; deep: and what
    stacks need of it (stacks.py)."""
    t, N, S = types(real), neighbour_structs(real), grain_structs(real)
    sum_support = support_sum_func(shares, real)

    def keep_grain_forces(c: N.CellTable, g: S.GrainTable, q: S.GrainContacts, after: S.GrainForces,
                          support_after: S.GrainSupport, v: wp.array(dtype=t.vec3), h: real, most: real):
        k = wp.tid()
        p = c.order[k]
        m = int(0)
        for s in range(q.count[k]):
            slot = s * q.size + k
            L = q.L[slot]
            alone = q.support[slot] == -1
            if wp.static(shares):
                alone = alone and q.share[slot] == real(0.0)
            if alone:                                        # what it holds has answered alone, and knows
                other = q.other[slot]
                L = t.vec3()
                e = int(0)
                while e < q.count[other] and q.id[e * q.size + other] < p:
                    e += 1
                if e < q.count[other] and q.id[e * q.size + other] == p:
                    L = -q.L[e * q.size + other]
                q.L[slot] = L
            if wp.length_sq(L) > real(0.0):
                after.id[m * q.size + p] = q.id[slot]
                after.f[m * q.size + p] = L / (h * h)
                m += 1
        if m < q.room:
            after.id[m * q.size + p] = -1
        if wp.static(deep):
            sum_support(g, q, support_after, v[g.point[k]], most, k, p, h)

    return kernel_over_cores(keep_grain_forces, f"grains_force{'_deep' * deep}{'_shares' * shares}_{t.name}", module)
