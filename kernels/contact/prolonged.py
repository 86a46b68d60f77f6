"""Contacts between points and colliders where a step h is solved for at a part c of it and goes on to its end (the implicit
midpoint: c = 1/2). Symbols as in kernels/contact/project.py; D, A, P are d, a, P at the end, n and b those of a contact there.

A contact asks for C = b + n . D >= 0 where the step ends. The way there is one line, D - e = (d - e) / c, so that

    c C = b' + n . d,   b' = c (b + n . e) - n . e,   c P for P,   (d - a) / (c h) = (D - A) / h:  the same slip

and whoever solves for d has contacts as backward Euler has. Their forces last all through the step: the velocity gets
J = P / (c h) [m/s] of them. What they do along the way is J . (D - A) / h, by planes that stand still no work but what friction
takes, as long as C >= 0 where the step began. So nothing is gained; but nothing is lost either: a point that meets a plane goes
on as its mirror image would, by up to all of its speed. Velocities at the end have Coulomb's law of their own (Moreau 1988,
Unilateral contact and dry friction in finite freedom dynamics, section 4), for contacts that push, from J on:

    J_n' = max(J_n - n . (v - w), 0)          T* = T - (v - w)_t,   |T'| <= mu J_n'

which is a projection of v in the norm of the masses: it takes kinetic energy, and leaves what lasts as it is. w is the velocity
of the surface at the end. u is its mean over the step, and of a contact that lasts w = u + (u - u_before) / 2, without which
the force on what rides on a surface that accelerates would be twice as much. Of order 1 where contacts begin, or slide along
what bends (a sphere: test_midpoint.py).
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.project import contact_tables, plane_projection_func, read_type, slot_type
from wsim.kernels.math.marks import writes_all
from wsim.kernels.math.real import types

PASSES = 8             # over the contacts of a point that has several: planes at 60 degrees to each other are met to 1e-5


@cache
def end_displacement_kernel(real, module, part: float = 0.5):
    """Kernel over points: displacements where the step ends, of those at that part of it."""
    t, more = types(real), real((1.0 - part) / part)

    @wp.kernel(module=module, enable_backward=False)
    def reach_ends(e: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), end_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        end_out[i] = d[i] + more * (d[i] - e[i])

    return reach_ends


@cache
def prolonged_contact_kernel(real, module, part: float = 0.5):
    """Kernel over points, behind the search for contacts at the end: contacts as they are for what is solved for. A point that
    was carried out of an overlap, a = e + way, goes that part of the way. Reads e, d, a.

    now, was   u of the contact that a point had alone, and its row + 1; 0: it had none"""
    t, Slots, Read, c = types(real), slot_type(real), read_type(real), real(part)

    @writes_all
    @wp.kernel(module=module, enable_backward=False)
    def begin_contacts(s: Slots, at: Read, now: wp.array(dtype=t.vec4), d_out: wp.array(dtype=t.vec3),
                       a_out: wp.array(dtype=t.vec3), was_out: wp.array(dtype=t.vec4), now_out: wp.array(dtype=t.vec4)):
        i = wp.tid()
        e = at.e[i]
        way = at.a[i] - e
        if wp.dot(way, way) > real(0.0):
            d_out[i] = at.d[i] + c * way
            a_out[i] = e + c * way
        was_out[i] = now[i]
        now_out[i] = t.vec4()
        for slot in range(s.count[i]):
            j = slot * s.points + i
            start = wp.dot(s.n[j], e)
            s.b[j] = c * (s.b[j] + start) - start

    return begin_contacts


@cache
def prolonged_end_kernel(real, module, part: float = 0.5):
    """Kernel over points: d, a, v, contacts and pushes where the step ends. Reads v, e, d, a, push. carried: 1 where a pinned
    point has the velocity that it went by, as surfaces that touch have it. rest_out: what pushes give beyond P / h [m/s]."""
    t, Slots, Read = types(real), slot_type(real), read_type(real)
    once, more = real(1.0 / part), real((1.0 - part) / part)
    vectors = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def end_contacts(s: Slots, w: wp.array(dtype=real), at: Read, g: real, carried: int, out: Read, rest_out: vectors):
        i = wp.tid()
        d = at.d[i]
        e = at.e[i]
        a = at.a[i]
        v = (d - a) / g
        if carried == 0 or w[i] > real(0.0):
            v = once * v - more * at.v[i]
        out.d[i] = d + more * (d - e)
        out.a[i] = a + more * (a - e)
        out.v[i] = v
        for slot in range(s.count[i]):
            j = slot * s.points + i
            start = wp.dot(s.n[j], e)
            s.b[j] = once * (s.b[j] + start) - start
            P = once * at.push[j]
            out.push[j] = P
            rest_out[j] = (real(part) * more / g) * P

    return end_contacts


@cache
def prolonged_velocity_kernel(real, module):
    """Kernel over points: velocities behind contacts that push. Reads v, push. rest: J - P / h of each slot: it stays, so that
    others may push between two launches; was, now: see `prolonged_contact_kernel`."""
    t, Slots, Read, meet = types(real), slot_type(real), read_type(real), plane_projection_func(real)
    Rows, Points = contact_tables(real)
    vectors = wp.array(dtype=t.vec3)

    @wp.func
    def surface_velocity_at_end(s: Slots, j: int, before: t.vec4):
        """Velocity of the surface at the end."""
        u = s.u[j]
        if before[3] == real(s.row[j] + 1):
            u += real(0.5) * (u - t.vec3(before[0], before[1], before[2]))
        return u

    @wp.kernel(module=module, enable_backward=False)
    def even_contacts(c: Rows, points: Points, s: Slots, at: Read, was: wp.array(dtype=t.vec4),
                      v_out: vectors, rest_out: vectors, now_out: wp.array(dtype=t.vec4)):
        i = wp.tid()
        bear = int(0)  # noqa: UP018
        last = int(0)  # noqa: UP018
        for slot in range(s.count[i]):
            j = slot * s.points + i
            if wp.dot(at.push[j], s.n[j]) > real(0.0):
                bear += 1
                last = j
        if bear > 0:
            v = at.v[i]
            before = t.vec4()
            if bear == 1:
                before = was[i]
                u = s.u[last]
                now_out[i] = t.vec4(u[0], u[1], u[2], real(s.row[last] + 1))
            for turn in range(wp.where(bear > 1, wp.static(PASSES), 1)):  # noqa: B007
                for slot in range(s.count[i]):
                    j = slot * s.points + i
                    n = s.n[j]
                    P = at.push[j]
                    if wp.dot(P, n) > real(0.0):
                        w = surface_velocity_at_end(s, j, before)
                        mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
                        v, J, _ = meet(n, -wp.dot(n, w), t.vec3(), w, rest_out[j] + P / c.h, v, mu, t.vec3())
                        rest_out[j] = J - P / c.h
            v_out[i] = v

    return even_contacts
