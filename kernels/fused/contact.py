"""Contacts of a point with colliders within frames of one launch (kernels/fused/march.py): what kernels/contact has, launch by
launch, between the prediction of a substep and its end.

    found       kernels/contact/search.py, at the place where the substep began, rounded as x is between launches
    projected   kernels/contact/project.py, once
    thrown      kernels/contact/restitution.py, where colliders throw back
    corrected   what they changed is a change of velocity, too: `correct` of kernels/motion/explicit.py

The slots keep the contacts of the last substep, as launches do. One thread of a point is in here, the others wait.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.project import SUNK, projecting, slots, tables
from wsim.kernels.contact.restitution import bounces, formula
from wsim.kernels.contact.search import finding
from wsim.kernels.fused.own import owned
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import ALIKE


@cache
def written(real):
    """Struct of what contacts and motion write, in place."""
    vec3 = types(real).vec3

    @wp.struct
    class Written:
        x: wp.array(dtype=vec3)              # positions [m], and e, v, r, as kernels/motion/explicit.py has them, (points,)
        e: wp.array(dtype=vec3)
        v: wp.array(dtype=vec3)
        r: wp.array(dtype=vec3)
        half: wp.array(dtype=vec3)           # velocity half a step before the end [m/s], (points,)
        halved: int                          # 1: the frame begins with half a kick of v; 0: it goes on from `half`
        push: wp.array(dtype=vec3)           # of contacts, (slots,)

    return Written


@cache
def throwing(real):
    """Function (c, s, i, push, own, at: d and a, move: D, e) -> d and a in rows: the fastest impact of point i throws it back;
    its normal is kept. D: displacement as it was predicted."""
    t, Own, two = types(real), owned(real), wp.types.matrix((2, 3), real)
    Bounces, Slots, (struck, thrown) = bounces(real), slots(real), formula(real)

    @wp.func
    def throwing(c: Bounces, s: Slots, push: wp.array(dtype=t.vec3), own: wp.ref[Own], at: two, D: t.vec3):
        i = own.point
        own.normal = t.vec3()
        A = (c.bend / (c.h * c.h)) * (c.h * own.v - D)
        V0 = own.v - c.h * A
        slot = struck(c, s, push, i, V0)
        d = at[0]
        a = at[1]
        if slot >= 0:
            j = slot * s.points + i
            n = s.n[j]
            p, q = thrown(c, s, i, j, a, V0, A, own.v + ((d - a) - D) / c.h)
            if p > real(0.0):
                d += p * n
                a += (p - c.h * q) * n
                push[j] = push[j] + (c.h * q) * n
                own.normal = n
        return wp.matrix_from_rows(d, a)

    return throwing


@cache
def meeting(kinds: tuple[str, ...], real, listed: bool, throws: bool):
    """Function (c, points, s, b, push, own, before, k): contacts of a point in substep k, which has moved it from the
    displacement `before`. listed: meshes have lists of candidates; throws: colliders may."""
    t, Own = types(real), owned(real)
    (Rows, Points), Slots, Bounces = tables(real), slots(real), bounces(real)
    find, one, throw = finding(kinds, real, False, listed), projecting(real), throwing(real)

    @wp.func
    def meeting(c: Rows, points: Points, s: Slots, b: Bounces, push: wp.array(dtype=t.vec3), own: wp.ref[Own],
                before: t.vec3, k: int):
        i = own.point
        x = own.x + before
        start = x - own.x                                       # displacement of the rounded place
        e = before - start
        d = own.d - start
        deep = s.mark[i] & SUNK
        if k == 0:
            deep = deep | c.deep[0]
        carried = find(c, points, s, wp.vec3i(i, k, deep), x, d, push)
        own.before = own.change
        own.change = t.vec3()
        own.normal = t.vec3()
        if s.count[i] > 0:
            at = wp.matrix_from_rows(d + carried, e + carried)
            at[0] = one(c, points, s, i, c.h, at, push, push)
            if wp.static(throws):
                at = throw(b, s, push, own, at, d - e)
            own.change = ((at[0] - at[1]) - (d - e)) / c.h
            moved = start + at[0]
            own.s = own.s + (at[0] - (moved - start))
            own.d = moved
            own.v = own.v + own.change
            own.q = own.q + own.change

    return meeting


@cache
def settled(real):
    """Function (own, v) -> v: leapfrog's last half kick from own.v to v leaves out what contacts would take back: `settle` of
    kernels/motion/explicit.py, of an impact that is over nothing (`spare` of kernels/contact/restitution.py)."""
    t, Own = types(real), owned(real)

    @wp.func
    def settled(own: wp.ref[Own], v: t.vec3):
        change = own.change - wp.dot(own.normal, own.change) * own.normal
        size = wp.length(change)
        if size > real(0.0):
            n = change / size
            back = wp.max(-wp.dot(v - own.v, n), real(0.0))
            part = wp.min(back, real(0.5) * size)
            if wp.length(change - own.before) < real(ALIKE) * size:
                part = real(0.5) * size
            return v + part * n
        return v

    return settled
