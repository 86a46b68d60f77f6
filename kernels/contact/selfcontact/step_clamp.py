"""The last resort for pairs that projections leave without a proof: their points are cut towards the rigid motion R.

With m_i the motion of a point beside R, n the normal of the start and s the gap that stays, points that are cut keep

    m_i <- t_i m_i,   t_i = min over the pairs of i of  KEPT (gap - s') / |n . m_i|  where m_i closes the gap, else 1

s' what a proof leaves (kernels/contact/selfcontact/bounds.py), so that two that are cut keep a tenth of their gap, and one that
flies with the others loses nothing. A point that was cut may now be in the way of one that was not: what is not certified then
is cut, too, round by round; in round ALL everything is; in round HELD, which rounding alone can lead to, every point of a pair
that lacks a proof goes by R alone, in round RIGID all do, which keeps their momentum, and in the last all points stay, which
needs no proof. Points that pins move are held back like others; the pin takes them on in the next substep. Where colliders
take part, R is what they do (kernels/contact/selfcontact/obstacles.py), and all goes along with it in the last round, too:
colliders that close a gap from two sides leave pairs without a proof then, which are counted.

Motions are only ever made shorter (monotone), by minima, which need no order.

Energy that cuts take is counted as sum m (|d|^2 - |d'|^2) of displacements, beside sum m |d|^2 of all points, so that their
ratio over h is the part of the kinetic energy that is lost a second; in whole numbers of UNIT, as
kernels/contact/selfcontact/pairs.py.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.bounds import proof_margin_func
from wsim.kernels.contact.selfcontact.motion_bounds import ENERGY, frame_type, rigid_carry_func
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states

KEPT = 0.45
ALL, HELD, RIGID, STILL = 8, 9, 10, 11   # rounds from which on: all are cut; pairs without a proof go by R; all do; all stay
ROUNDS = 12
# words that a frame leaves behind: pairs that there was no room for; substeps that were projected, of rounds; cut; most percent
# of its motion that a point lost; substeps in which all were cut; in which some were held; pairs that began too near, at most;
# searches; points that were cut; 1: pairs are listed, 2: some may push; pairs with colliders that are left without a proof,
# over all substeps; the place of a point of one, and 1; the bits of two float32, sums of m |d|^2 [kg m^2] of substeps, and of
# what was cut of it; substeps running in which a point lost more than LOSS of its motion, at most and at the end; of the
# colliders of pairs that are left without a proof the last, its number and 1, and the first, MOST less its number; percent of a
# mean edge by which surfaces that met came nearer in a substep, at most, where it was more than one; pairs of a list, at most;
# 1: surfaces came near each other in a frame with all stages, on the whole ways of their points
WANTED, PROJECTED, TURNS, CUT, LOST, WHOLE, STAYED, CLOSE, SEARCHES, POINTS, BUSY, PINCHED, WHERE = range(13)
MOVED, TAKEN, RUN, RUNNING, LATTER, FORMER, FAST, LISTED, NEARBY = range(13, 22)
SAID, MOST = 22, 1 << 30
LOSS = 0.05            # of its motion that a point may lose in a substep
UNIT = 2.0 ** 56       # per kg m^2


@cache
def cut_claim_kernel(real, module):
    """Kernel: points of pairs without a proof are cut from here on."""
    Pairs, Sums = pairs.pair_type(real), pairs.sum_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def claim_points(words: wp.array(dtype=int), threads: int, near_at: wp.array(dtype=Pairs), to: Sums):
        near = near_at[0]
        i = wp.tid()
        while i < wp.min(near.count[0], near.capacity):
            if near.bad[i] == 1:
                ids = near.ids[i]
                for k in range(4):
                    to.cut[ids[k]] = words[pairs.EPOCH]
            i += threads

    return claim_points


@cache
def cut_factor_kernel(real, module):
    """Kernel: t of the points that are cut."""
    Surfaces, Pairs, State, Sums, Frames = (pairs.surface_type(real), pairs.pair_type(real), point_states(real),
                                            pairs.sum_type(real), frame_type(real))
    carry, spare = rigid_carry_func(real), proof_margin_func(real)

    @wp.func
    def shorten_pair(s: Surfaces, at: State, f: Frames, words: wp.array(dtype=int), near: Pairs, i: int, to: Sums):
        n = near.n[i]
        ids = near.ids[i]
        room = real(KEPT) * wp.max(near.gap[i] - near.least[i] - spare(s, at, ids), real(0.0))
        for k in range(4):
            q = ids[k]
            if to.cut[q] == words[pairs.EPOCH] or words[pairs.ROUND] >= ALL:
                beside = (at.d[q] - at.e[q]) - carry(f, (at.x[q] + s.shift[q]) + at.e[q])
                nearer = wp.dot(n, beside)
                if k <= near.kind[i]:
                    nearer = -nearer
                if nearer > room:
                    wp.atomic_min(to.factor, q, room / nearer)

    @wp.kernel(module=module, enable_backward=False)
    def shorten_motion(s: Surfaces, at: State, f: Frames, words: wp.array(dtype=int), threads: int,
                       near_at: wp.array(dtype=Pairs), to: Sums):
        near = near_at[0]
        i = wp.tid()
        while i < wp.min(near.count[0], near.capacity):
            if near.bad[i] != 2:
                shorten_pair(s, at, f, words, near, i, to)
            i += threads

    return shorten_motion


@cache
def motion_cut_kernel(real, module):
    """Kernel: shortens motions. lost: words of the frame."""
    t = types(real)
    Surfaces, State, Frames, Sums = pairs.surface_type(real), point_states(real), frame_type(real), pairs.sum_type(real)
    carry = rigid_carry_func(real)

    @wp.func
    def record_energy_loss(w: real, before: t.vec3, after: t.vec3, to: Sums):
        if w > real(0.0):
            taken = (wp.dot(before, before) - wp.dot(after, after)) / w
            wp.atomic_add(to.taken, 0, wp.int64(real(UNIT) * taken))

    @wp.kernel(module=module, enable_backward=False)
    def cut_motion(s: Surfaces, at: State, f: Frames, words: wp.array(dtype=int), to: Sums, d_out: wp.array(dtype=t.vec3),
                   said: wp.array(dtype=int)):
        i = s.point[wp.tid()]
        turn = words[pairs.ROUND]
        factor = to.factor[i]
        to.factor[i] = real(1.0)
        if turn >= RIGID or (turn == HELD and to.cut[i] == words[pairs.EPOCH]):
            stay = carry(f, (at.x[i] + s.shift[i]) + at.e[i])
            if turn == STILL and not f.rigid[3][0] > real(0.0):
                stay = t.vec3()
            record_energy_loss(s.w[i], at.d[i] - at.e[i], stay, to)
            d_out[i] = at.e[i] + stay
            wp.atomic_max(said, LOST, 100)
            words[pairs.WORST] = 1
        elif factor < real(1.0):
            rigid = carry(f, (at.x[i] + s.shift[i]) + at.e[i])
            beside = (at.d[i] - at.e[i]) - rigid
            way = at.d[i] - at.e[i]
            whole = wp.length(way)
            record_energy_loss(s.w[i], way, rigid + factor * beside, to)
            d_out[i] = at.e[i] + (rigid + factor * beside)
            if whole > real(0.0):
                lost = (real(1.0) - factor) * wp.length(beside) / whole
                wp.atomic_max(said, LOST, wp.min(int(real(100.0) * lost), 100))
                if lost > real(LOSS):
                    words[pairs.WORST] = 1
            wp.atomic_add(said, POINTS, 1)

    return cut_motion


@cache
def frame_report_kernel(real, module):
    """Kernel: what a substep needed, to the words of the frame, and the words of the next one. moments: sums of the motion
    (kernels/contact/selfcontact/motion_bounds.py)."""
    Sums = pairs.sum_type(real)

    @wp.func
    def add_to_word(said: wp.array(dtype=int), k: int, value: float):
        said[k] = wp.cast(wp.cast(said[k], wp.float32) + value, int)

    @wp.kernel(module=module, enable_backward=False)
    def tell_frame(moments: wp.array2d(dtype=real), to: Sums, words: wp.array(dtype=int), said: wp.array(dtype=int)):
        add_to_word(said, MOVED, float(moments[0, ENERGY]))
        add_to_word(said, TAKEN, float(wp.float64(to.taken[0]) / wp.float64(UNIT)))
        to.taken[0] = wp.int64(0)
        words[pairs.RUN] = wp.where(words[pairs.WORST] > 0, words[pairs.RUN] + 1, 0)
        words[pairs.WORST] = 0
        said[RUN] = wp.max(said[RUN], words[pairs.RUN])
        said[RUNNING] = words[pairs.RUN]
        said[WANTED] = wp.max(said[WANTED], words[pairs.LACKED])
        said[LISTED] = wp.max(said[LISTED], words[pairs.LISTED])
        words[pairs.LISTED] = 0
        rounds = words[pairs.SWEPT]
        if rounds > 0:
            said[PROJECTED] = said[PROJECTED] + 1
            said[TURNS] = said[TURNS] + rounds
        turn = words[pairs.TURNED]
        if turn > 0:
            said[CUT] = said[CUT] + 1
        if turn > ALL:
            said[WHOLE] = said[WHOLE] + 1
        if turn > HELD:
            said[STAYED] = said[STAYED] + 1
        said[CLOSE] = wp.max(said[CLOSE], words[pairs.CLOSE])
        words[pairs.CLOSE] = 0
        said[FAST] = wp.max(said[FAST], words[pairs.FAST])
        words[pairs.FAST] = 0
        words[pairs.SWEPT] = 0
        words[pairs.TURNED] = 0
        said[BUSY] = wp.where(words[pairs.BEHIND] > words[pairs.EPOCH], 2, wp.max(words[pairs.NEAR], words[pairs.PROOF]))
        words[pairs.CALM] = wp.where(said[BUSY] < 2, 1, 0)
        said[SEARCHES] = said[SEARCHES] + words[pairs.MADE]
        words[pairs.MADE] = 0
        words[pairs.EPOCH] = words[pairs.EPOCH] + 1
        words[pairs.AGE] = words[pairs.AGE] + 1

    return tell_frame
