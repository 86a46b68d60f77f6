"""Contacts of points with few convex colliders within frames of one launch: the threads of a point try a collider each.

    found       `against` of kernels/contact/search.py; planes that stand after one by which the point is carried out of an
                overlap are moved by as much, n.carried, which is exact for flat faces
    projected   kernels/contact/project.py, contacts in the order of colliders, in registers
    corrected   as kernels/motion/fused/contact.py does

A collider is left alone as long as its gap, where a point was when it last looked, is more than what the point has moved
since in the collider's frame: `far` [m] is what is left of it, less rounding. So most points look at nothing, and those that do
at one. All threads of a point know where it goes; slots are written in the last substep, for reports.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact import collide
from wsim.kernels.contact.collider.colliders import collider_frame_funcs
from wsim.kernels.contact.project import SUNK, TOUCHED, contact_tables, slot_type, softness_func
from wsim.kernels.contact.project import plane_projection_func as pressing
from wsim.kernels.contact.search import SUNK_FROM
from wsim.kernels.math.real import types
from wsim.kernels.motion.fused.contact import written_frames
from wsim.kernels.motion.fused.lanes import warp_lane_functions
from wsim.kernels.motion.fused.own import thread_points

SLACK = wp.constant(1.0e-6)        # of coordinates in a collider's frame that a substep's rounding is less than


@cache
def collider_looks(real):
    """Struct of what a thread knows of the collider that it tries."""
    t = types(real)

    @wp.struct
    class ColliderLook:
        row: int                 # -1: it has none
        kind: int
        size: t.vec3
        keep: real               # distance that is kept free [m]
        far: real                # gap that there is at least [m]
        mu: t.vec2
        n: t.vec3                # of its contact, as kernels/contact/project.py has them
        b: real
        u: t.vec3
        P: t.vec3

    return ColliderLook


@cache
def look_function(real):
    """Function (c, points, own) -> what a thread of a point tries."""
    Own, Look, (Rows, Points) = thread_points(real), collider_looks(real), contact_tables(real)

    @wp.func
    def look_at_collider(c: Rows, points: Points, own: wp.ref[Own]):
        look = Look()
        look.row = -1
        i = own.point
        if i >= 0 and points.w[wp.max(i, 0)] > real(0.0):
            o = points.object[i]
            row = c.first[o] + own.lane
            if row < c.first[o + 1]:
                look.row = row
                look.kind = c.of.kind[row]
                look.size = c.of.size[row]
                look.keep = points.reach[i] + c.of.thick[row] - c.width
                look.mu = real(0.5) * (points.friction[i] + c.of.friction[row])
                look.far = real(-1.0e30)
        return look

    return look_at_collider


@cache
def collider_try_function(kinds: tuple[str, ...], real):
    """Function (c, look, k, x, d) -> (C, s0), gaps to the contact plane and where the substep starts, of a point that moves by
    d from x; n and u are in `look`. Where there is no contact C is 1e30."""
    t, Look, Rows = types(real), collider_looks(real), contact_tables(real)[0]
    touch, (inside, outside) = collide.convex_touch_func(kinds, real), collider_frame_funcs(real)

    @wp.func
    def try_collider(c: Rows, look: wp.ref[Look], k: int, x: t.vec3, d: t.vec3):
        gap = real(1.0e30)
        start = real(0.0)
        row = look.row
        if row >= 0:
            T0 = c.of.pose[k, row]
            T1 = c.of.pose[k + 1, row]
            q0, q1 = inside(T0, T1, x, d)
            length = wp.length(q1 - q0)
            margin = length + c.skin + c.stride[k, row]
            if not look.far > margin + length:
                C, m, p, s0 = touch(look.kind, look.size, q0, q1, look.keep, margin, c.width)
                look.far = s0
                if C < margin:
                    n, way = outside(T0, T1, c.of.step[k, row], m, p, t.vec3())
                    gap = C
                    start = s0
                    look.n = n
                    look.u = way / c.h
            look.far = look.far - length - real(SLACK) * (wp.abs(q0[0]) + wp.abs(q0[1]) + wp.abs(q0[2]))
        return gap, start

    return try_collider


@cache
def lane_contact_function(kinds: tuple[str, ...], real, lanes: int):
    """Function (c, s, out, own, look, before, at: substep and whether it is the last): contacts of a point that has moved from
    the displacement `before`. All threads of a block call it."""
    t, Own, Look, Written, Slots, Rows = (types(real), thread_points(real), collider_looks(real), written_frames(real),
                                          slot_type(real), contact_tables(real)[0])
    attempt, meet, soften = collider_try_function(kinds, real), pressing(real), softness_func(real)
    group, lowest, least, anywhere, of_lane = warp_lane_functions(lanes, real)

    @wp.func
    def carry_out_of_overlaps(c: Rows, look: wp.ref[Look], own: wp.ref[Own], mask: int, d: t.vec3, C: real, s0: real):
        """How far the point is carried out of overlaps, and whether of one that counts; fills b."""
        carried = t.vec3()
        sunk = int(0)
        left = int(mask)
        while anywhere(left) != 0:
            r = lowest(left)
            over = wp.max(-(s0 + wp.dot(look.n, carried)), real(0.0))
            out = wp.min(over, c.recovery * c.h)
            if own.lane == r:
                look.b = C + over - out - wp.dot(look.n, d)
                if over > real(SUNK_FROM) * c.skin:
                    sunk = SUNK
            shift = of_lane(out * look.n, wp.max(r, 0))
            if r >= 0:
                carried = carried + shift
            left = left & (left - 1)
        return carried, sunk

    @wp.func
    def project_lane_contacts(c: Rows, look: wp.ref[Look], own: wp.ref[Own], mask: int, iterations: int, d: t.vec3, a: t.vec3):
        """d after the contacts of the mask, in order; and TOUCHED of a thread whose contact presses."""
        d1 = t.vec3(d)
        touched = int(0)
        soft = soften(c, c.h)
        look.P = t.vec3()
        for _m in range(iterations):
            left = int(mask)
            while anywhere(left) != 0:
                r = lowest(left)
                moved, P, pressed = meet(look.n, look.b, a, c.h * look.u, look.P, d1, look.mu, soft)
                if own.lane == r:
                    look.P = P
                    if pressed > real(0.0):
                        touched = TOUCHED
                moved = of_lane(moved, wp.max(r, 0))
                if r >= 0:
                    d1 = moved
                left = left & (left - 1)
        return d1, touched

    @wp.func
    def report_lane_contacts(s: Slots, out: Written, own: wp.ref[Own], look: wp.ref[Look], mask: int, mark: int):
        """Writes the slots of the last substep."""
        i = own.point
        if own.lane == 0 and i >= 0:
            s.count[i] = wp.bit_count(mask)
            s.mark[i] = mark
        if (mask >> own.lane) & 1 != 0:
            j = wp.bit_count(mask & ((1 << own.lane) - 1)) * s.points + i
            s.row[j] = look.row
            s.n[j] = look.n
            s.b[j] = look.b
            s.u[j] = look.u
            out.push[j] = look.P

    @wp.func
    def act_by_lanes(c: Rows, s: Slots, out: Written, own: wp.ref[Own], look: wp.ref[Look], before: t.vec3, at: wp.vec2i):
        x = own.x + before
        start = x - own.x                                       # displacement of the rounded place
        e = before - start
        d = own.d - start
        C, s0 = attempt(c, look, at[0], x, d)
        mask = group(wp.where(C < real(1.0e30), 1, 0))
        own.before = own.change
        own.change = t.vec3()
        own.normal = t.vec3()
        sunk = int(0)
        touched = int(0)
        if anywhere(mask) != 0:
            carried, sunk = carry_out_of_overlaps(c, look, own, mask, d, C, s0)
            if wp.bit_count(mask) > s.capacity and own.lane == 0:
                wp.atomic_max(s.wanted, 0, wp.bit_count(mask))   # the frame is repeated, with more room
            mask = least(mask, s.capacity)
            d1, touched = project_lane_contacts(c, look, own, mask, out.iterations, d + carried, e + carried)
            change = ((d1 - (e + carried)) - (d - e)) / c.h
            if wp.dot(change, change) > real(0.0) or wp.dot(carried, carried) > real(0.0):
                moved = start + d1
                own.s = own.s + (d1 - (moved - start))
                own.d = moved
                own.change = change
                own.v = own.v + change
                own.q = own.q + change
                look.far = look.far - wp.length(d1 - d)
        if at[1] != 0:
            mark = wp.where(group(sunk) != 0, SUNK, 0) | wp.where(group(touched) != 0, TOUCHED, 0)
            report_lane_contacts(s, out, own, look, mask, mark)

    return act_by_lanes
