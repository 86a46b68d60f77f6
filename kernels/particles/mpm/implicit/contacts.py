"""Colliders at corners of cells in implicit steps: which of them may hold a corner in a step, and what they do to its velocity.

    w = v - u;  press = max(-w . n - gap / h, 0);  v += press n;  then Coulomb friction of the size mu press on the rest of w

The law is that of explicit steps (walls.py). A corner that has a gap to a collider may go as far as the gap in a step, so that
what falls comes to rest on the surface, and not within it.
"""

# ruff: noqa: UP018
# int(-1) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.contact.mesh import SHEET
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.faces import face_functions
from wsim.kernels.particles.mpm.implicit.granular_tables import CONTACTS, granular_tables

REACH = wp.constant(2.0)           # cells from a collider in which a corner may touch it within a step
FAR = wp.constant(5.0)             # cells from all colliders, beyond which a particle of the cell meets none in a step
ON = wp.constant(0.01)             # cells: corners so near are within
HALF = wp.constant(0.5)            # of an open mesh, which has no inside
OUTSIDE = wp.constant(3.0)         # times the mean way from a corner to particles of its eight cells: 1.5 cells off a plane


@cache
def contact_functions(kinds: tuple[str, ...], real) -> SimpleNamespace:
    """find_contacts(colliders, place, mean way to matter [cells], time, dx, row, contacts) -> their number, -1: none is near.
    A solid is asked from where the matter is, as in faces.py.
    hold_corner(contacts, row, count, v, h) -> v, and the part of a push along each axis that the corner is free to follow."""
    t, Colliders, Contacts = types(real), collider_type(real), granular_tables(real).CornerContacts
    ask, faces = collider_queries(kinds or ("sphere",), real), face_functions(kinds, real)

    @wp.func
    def farthest_contact(contacts: Contacts, row: int, count: int, gap: real):
        """Where a contact with that gap is kept: behind the others, else in place of the farthest; -1 if that is nearer."""
        place = int(count)
        if count == wp.static(CONTACTS):
            place = int(-1)
            most = real(gap)
            for k in range(count):
                if contacts.gap[k, row] > most:
                    most = contacts.gap[k, row]
                    place = k
        return place

    @wp.func
    def find_contacts(c: Colliders, y: t.vec3, side: t.vec3, time: real, dx: real, row: int, contacts: Contacts):
        count = int(-1)
        for k in range(c.kind.shape[0]):
            phi, n, p = ask.closest(c, k, y, time)
            if phi < real(FAR) * dx:
                count = wp.max(count, 0)
                surface = real(ON) * dx
                if c.kind[k] == SHEET:
                    surface = real(HALF) * dx
                elif phi < real(REACH) * dx:
                    a = y + (real(OUTSIDE) * dx) * side
                    far, m, q = ask.closest(c, k, a, time)
                    if far > real(0.0):                        # the face that matter touches
                        m, q = faces.pass_seam(c, k, a, m, q, time, dx)
                        n = m
                        phi = wp.dot(y - q, m)
                if phi < real(REACH) * dx:
                    gap = wp.max(phi - surface, real(0.0))
                    place = farthest_contact(contacts, row, count, gap)
                    if place >= 0:
                        u = ask.rate(c, k, y, time)
                        rub = c.friction[k]
                        contacts.n[place, row] = t.vec4(n[0], n[1], n[2], rub[0])
                        contacts.u[place, row] = t.vec4(u[0], u[1], u[2], rub[1])
                        contacts.gap[place, row] = gap
                        count = wp.min(count + 1, wp.static(CONTACTS))
        return count

    @wp.func
    def hold_corner(contacts: Contacts, row: int, count: int, v: t.vec3, h: real):
        held = v
        free = t.vec3(real(1.0))
        for k in range(count):
            at = contacts.n[k, row]
            moves = contacts.u[k, row]
            n = t.vec3(at[0], at[1], at[2])
            u = t.vec3(moves[0], moves[1], moves[2])
            w = held - u
            into = wp.dot(w, n)
            press = -into - contacts.gap[k, row] / h
            if press > real(0.0):
                w -= into * n
                speed = wp.length(w)
                part = real(0.0)
                if speed > at[3] * press:
                    part = wp.max(real(1.0) - moves[3] * press / speed, real(0.0))
                if part > real(0.0):
                    free -= wp.cw_mul(free, wp.cw_mul(n, n))
                else:
                    free = t.vec3()
                held = u + part * w + (into + press) * n
        return held, free

    return SimpleNamespace(find_contacts=find_contacts, hold_corner=hold_corner)
