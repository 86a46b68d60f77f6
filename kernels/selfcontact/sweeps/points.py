"""Points in sweeps over contact rows of surfaces: where pairs have moved them, and what their contacts with colliders then say.
Symbols of contacts: kernels/contact/project.py."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.project import SUNK, TOUCHED, meeting, slots, softness, tables
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.selfcontact import pairs
from wsim.kernels.selfcontact.couple import holding


@cache
def orders(real):
    """(How, Touched): structs of what a call asks for, and of contacts with colliders."""
    t, (Held, _) = types(real), holding(real)
    Rows, Points = tables(real)
    Slots = slots(real)

    @wp.struct
    class How:
        climb: t.scalar                           # as `rows.lean` has it [m]; calm likewise
        calm: t.scalar
        g: t.scalar                               # effective step of contacts [s]
        count: int                                # sweeps
        anew: int                                 # behind which it is asked anew what takes part
        leads: int                                # 1: they lead ahead
        spared: int                               # number of the sweep that is left out where pairs are taken in turn
        free: int                                 # points that have contacts
        threads: int                              # of all blocks
        words: wp.array(dtype=int)                # (WORDS,), 0 before the launch
        moved: wp.array(dtype=int)                # points that pairs move, in no order
        held: wp.array(dtype=Held)                # pairs that take part, as many as are not read anew in each sweep; on a GPU
        pool: wp.array(dtype=int)                 # those beyond the first of a thread (`memory.pooling`), and of points
        slot: wp.array(dtype=int)                 # their number in `moved`
        alone: int                                # pairs that one block takes alone, at most

    @wp.struct
    class Touched:
        rows: Rows
        points: Points
        slots: Slots
        push: wp.array(dtype=t.vec3)              # P of each slot

    return How, Touched


@cache
def touching(real):
    """(Kept, keep, touch): struct of a point and its first contact; function (at, how, c, i) -> it, of point i; and
    (how, c, p, d, writes) -> (p, d), d of the point behind one iteration of its contacts. writes: the push of the first is
    written, and the point's mark; those of others always are."""
    t, (_, Touched) = types(real), orders(real)
    How, meet, soften = orders(real)[0], meeting(real), softness(real)
    State = states(real)

    @wp.struct
    class Kept:
        point: int
        count: int                                # of its contacts
        d: t.vec3
        a: t.vec3
        n: t.vec3
        b: t.scalar
        gu: t.vec3
        mu: t.vec2
        P: t.vec3

    @wp.func
    def contact(c: Touched, how: How, p: Kept, slot: int):
        """Contact of a slot."""
        j = slot * c.slots.points + p.point
        p.n = c.slots.n[j]
        p.b = c.slots.b[j]
        p.gu = how.g * c.slots.u[j]
        p.mu = real(0.5) * (c.points.friction[p.point] + c.rows.of.friction[c.slots.row[j]])
        p.P = c.push[j]
        return p

    @wp.func
    def keep(at: State, how: How, c: Touched, i: int, touches: bool):
        p = Kept()
        p.point = i
        p.d = at.d[i]
        if touches:
            p.a = at.a[i]
            if i < how.free:
                p.count = c.slots.count[i]
            if p.count > 0:
                p = contact(c, how, p, 0)
        return p

    @wp.func
    def touch(how: How, c: Touched, p: Kept, d: t.vec3, writes: bool):
        soft = soften(c.rows, how.g)
        d, P, pressed = meet(p.n, p.b, p.a, p.gu, p.P, d, p.mu, soft)
        p.P = P
        most = pressed
        for slot in range(1, p.count):
            o = contact(c, how, p, slot)
            d, P, pressed = meet(o.n, o.b, p.a, o.gu, o.P, d, o.mu, soft)
            c.push[slot * c.slots.points + p.point] = P
            most = wp.max(most, pressed)
        if writes:
            c.push[p.point] = p.P
            c.slots.mark[p.point] = (c.slots.mark[p.point] & SUNK) | wp.where(most > real(0.0), TOUCHED, 0)
        return p, d

    return Kept, keep, touch


@cache
def turning(real):
    """Struct of a thread's share until it is asked anew what takes part."""
    vec3 = types(real).vec3

    @wp.struct
    class Turn:
        own: int                                  # its number among those that share, and of these
        each: int
        active: int                               # pairs that take part, points that they move
        moved: int
        done: int                                 # 1: the last sweep before it is asked
        alone: int                                # 1: one block takes all (`memory`), whose points these have by their number:
        d: wp.array(dtype=vec3)                   # displacements [m]
        sum: wp.array(dtype=wp.int64)             # their sums

    return Turn


@cache
def moving(real, touches: bool, many: bool):
    """Function (at, how, now, kept, c, to) -> kept: points behind a sweep of the pairs; kept: the first of this thread, where
    there are `many`."""
    (How, Touched), Turn, add, (Kept, keep, touch) = orders(real), turning(real), pairs.adding(real), touching(real)
    State, Sums = states(real), pairs.sums(real)

    @wp.func
    def move_points(at: State, how: How, now: Turn, kept: Kept, c: Touched, to: Sums):
        sums = Sums()
        sums.move = now.sum
        j = now.own
        while j < now.moved:
            p = kept
            first = wp.static(many) and j < now.each
            i = how.moved[j]
            slot = i
            if not first:
                p = keep(at, how, c, i, bool(touches))
            if now.alone > 0:
                slot = j
                p.d = now.d[j]
            d = add(p.d, 0, slot, sums)
            if wp.static(touches):
                if p.count > 0:
                    p, d = touch(how, c, p, d, now.done > 0 or not first)
            now.d[slot] = d
            p.d = d
            if now.done > 0:
                to.share[i] = 0
                if now.alone > 0:
                    at.d[i] = d
            if first:
                kept = p
            j += now.each
        return kept

    return move_points
