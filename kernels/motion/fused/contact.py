"""What acts on a point between the prediction of a substep and its end, within frames of one launch
(kernels/motion/fused/march.py), in the order of launches:

    found       contacts, kernels/contact/search.py, at the place where the substep began, rounded as x is between launches
    held        soft pins and tethers, hold.py; strain limits, limits.py; contacts, kernels/contact/project.py: each iteration
    thrown      kernels/contact/restitution.py, where colliders throw back
    corrected   what they changed is a change of velocity, too: `correct` of kernels/motion/explicit.py

The slots keep the contacts of the last substep, as launches do. One thread of a point is in here, the others wait; but where
meshes have lists of candidates all search (kernels/motion/fused/contact_faces.py), and all threads of a block sweep over its
limits.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.project import SUNK, contact_tables, point_projection_func, slot_type
from wsim.kernels.contact.restitution import bounce_type, restitution_law
from wsim.kernels.contact.search import point_contact_search_func
from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import ALIKE
from wsim.kernels.motion.fused.contact_faces import lane_finding_function as sharing
from wsim.kernels.motion.fused.hold import pin_projection, point_holdings, tether_pulling
from wsim.kernels.motion.fused.limits import limit_sweep_functions
from wsim.kernels.motion.fused.own import thread_points


@dataclass(frozen=True)
class Acts:
    """Things that act. kinds: of colliders; listed: meshes have lists of candidates; throws: some colliders throw back; lanes:
    threads of a point, where each tries one (kernels/motion/fused/contact_lanes.py); shared: threads that share a list's faces;
    limits: the `wsim.physics.motion.fused.domain_decomposition.BlockPlan` of sheets that have strain limits; damped: they have
    damping."""

    kinds: tuple[str, ...] = ()
    listed: bool = False
    throws: bool = False
    pinned: bool = False
    tethered: bool = False
    lanes: int = 0
    shared: int = 0
    limits: Any = None
    damped: bool = False

    @property
    def together(self) -> bool:
        """True if all threads of a block act."""
        return self.shared > 0 or self.limits is not None


@cache
def written_frames(real):
    """Struct of what a frame is told and what it writes, in place."""
    vec3, Bounces = types(real).vec3, bounce_type(real)

    @wp.struct
    class Written:
        x: wp.array(dtype=vec3)              # positions [m], and e, v, r, as kernels/motion/explicit.py has them, (points,)
        e: wp.array(dtype=vec3)
        v: wp.array(dtype=vec3)
        r: wp.array(dtype=vec3)
        half: wp.array(dtype=vec3)           # velocity half a step before the end [m/s], (points,)
        push: wp.array(dtype=vec3)           # of contacts, (slots,)
        bounces: Bounces
        halved: int                          # 1: the frame begins with half a kick of v; 0: it goes on from `half`
        iterations: int

    return Written


@cache
def bounce_throwing(real):
    """Function (c, s, push, own, at: d and a, D) -> d and a in rows: the fastest impact of a point throws it back, and its
    normal is kept. D: displacement as it was predicted."""
    t, Own, two = types(real), thread_points(real), wp.types.matrix((2, 3), real)
    Bounces, Slots, (struck, thrown) = bounce_type(real), slot_type(real), restitution_law(real)

    @wp.func
    def throw_back_point(c: Bounces, s: Slots, push: wp.array(dtype=t.vec3), own: wp.ref[Own], at: two, D: t.vec3):
        i = own.point
        A = (c.bend / (c.h * c.h)) * (c.h * own.q - D)
        V0 = own.q - c.h * A
        slot = struck(c, s, push, i, V0)
        d = at[0]
        a = at[1]
        if slot >= 0:
            j = slot * s.points + i
            n = s.n[j]
            p, q = thrown(c, s, i, j, a, V0, A, own.q + ((d - a) - D) / c.h)
            if p > real(0.0):
                d += p * n
                a += (p - c.h * q) * n
                push[j] = push[j] + (c.h * q) * n
                own.normal = n
        return wp.matrix_from_rows(d, a)

    return throw_back_point


@cache
def contact_action_function(acts: Acts, real):
    """Function (c, points, s, hold, out, own, before, k): what acts on a point in substep k, which has moved it from the
    displacement `before`. Where `Acts.together` all threads of a block call it."""
    t, Own, Held, Written = types(real), thread_points(real), point_holdings(real), written_frames(real)
    (Rows, Points), Slots, met = contact_tables(real), slot_type(real), bool(acts.kinds)
    find, answer = point_contact_search_func(acts.kinds, real, False, acts.listed), contact_response_function(acts, real)
    share = sharing(acts.kinds, real, acts.shared) if acts.shared else None

    @wp.func
    def act_on_point(c: Rows, points: Points, s: Slots, hold: Held, out: Written, own: wp.ref[Own], before: t.vec3, k: int):
        moved = t.vec3()
        first = bool(True)
        if wp.static(acts.together):
            first = own.point >= 0 and own.lane == 0
        if wp.static(acts.shared > 0):
            moved = share(c, points, s, own, before, k, out.push)
        elif wp.static(met):
            if first:
                i = own.point
                deep = s.mark[i] & SUNK
                if k == 0:
                    deep = deep | c.deep[0]
                x = own.x + before
                moved = find(c, points, s, wp.vec3i(i, k, deep), x, own.d - (x - own.x), out.push)
        if first or wp.static(acts.limits is not None):
            answer(c, points, s, hold, out, own, wp.matrix_from_rows(before, moved), k)

    return act_on_point


@cache
def contact_response_function(acts: Acts, real):
    """Function (c, points, s, hold, out, own, way: rows `before` and by how much contacts carry the point out of overlaps, k):
    what acts on a point whose contacts are found. With `limits` all threads of a block call it."""
    t, Own, Held, Written, two = (types(real), thread_points(real), point_holdings(real), written_frames(real),
                                  wp.types.matrix((2, 3), real))
    (Rows, Points), Slots, met = contact_tables(real), slot_type(real), bool(acts.kinds)
    one, throw, pin, tether = point_projection_func(real), bounce_throwing(real), pin_projection(real), tether_pulling(real)
    sweep = limit_sweep_functions(real, acts.limits, acts.damped)[1] if acts.limits else None

    @wp.func
    def respond_to_contacts(c: Rows, points: Points, s: Slots, hold: Held, out: Written, own: wp.ref[Own], way: two, k: int):
        i = own.point
        first = bool(True)
        if wp.static(acts.limits is not None):
            first = i >= 0 and own.lane == 0
        x = own.x + way[0]
        start = x - own.x                                       # displacement of the rounded place
        e = way[0] - start
        d = own.d - start
        at = wp.matrix_from_rows(d + way[1], e + way[1])
        own.before = own.change
        own.normal = t.vec3()
        for m in range(out.iterations):
            if first:
                if wp.static(acts.pinned):
                    at[0] = pin(hold, wp.vec3i(i, k, m), own.w, x, at)
                if wp.static(acts.tethered):
                    at[0] = tether(hold, i, k, x, at[0])
            if wp.static(acts.limits is not None):
                at[0] = sweep(hold.limits, own, at[0], k, k * out.iterations + m)
            if wp.static(met):
                if first:
                    if s.count[i] > 0:
                        at[0] = one(c, points, s, i, hold.h, at, out.push, out.push)
        if first:
            if wp.static(met and acts.throws):
                at = throw(out.bounces, s, out.push, own, at, d - e)
            change = ((at[0] - at[1]) - (d - e)) / hold.h
            own.change = change
            if wp.dot(change, change) > real(0.0) or wp.dot(at[1] - e, at[1] - e) > real(0.0):
                moved = start + at[0]
                own.s = own.s + (at[0] - (moved - start))
                own.d = moved
                own.v = own.v + change
                own.q = own.q + change

    return respond_to_contacts


@cache
def settling_function(real):
    """Function (own, v) -> v: leapfrog's last half kick from own.v to v leaves out what contacts would take back: `settle` of
    kernels/motion/explicit.py, of an impact that is over nothing (`spare` of kernels/contact/restitution.py)."""
    t, Own = types(real), thread_points(real)

    @wp.func
    def settled_velocity(own: wp.ref[Own], v: t.vec3):
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

    return settled_velocity
