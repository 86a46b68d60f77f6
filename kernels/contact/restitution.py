"""Impacts of points on colliders that throw back, with their time solved inside the substep, after the last projection.

    h    substep [s]                                  n, b, u, push   of a contact, see kernels/contact/project.py
    V0   velocity at the start of the substep [m/s]   A    acceleration [m/s^2], constant through it
    e    restitution: v+ = -e v- along n              s    time of the impact after the start, r = h - s what is left [s]

Against the plane of the contact, which moves by u, a point is at the height gap + w s + B s^2 / 2, with

    gap = b + n.a + h n.u  at the start,    w = n.(V0 - u),    B = n.A

    S = sqrt(w^2 - 2 B gap)       the speed at which it meets the plane
    s = 2 gap / (S - w)           the first root, without cancellation: w < 0
    height e S r + B r^2 / 2      and velocity n.u + e S + B r along n at the end of the substep

which stand in for what the projection has made of d.n (height 0) and of the velocity. A point that only gravity moves is so
where its parabolas take it, to rounding: d' = d + p n, and of a new anchor a' = a + (p - g q) n follows that its velocity
changes by q n. What the projection did across n (friction), and other contacts, stays. Of several impacts of a point the
fastest counts.

Explicit integrators (`explicit_restitution_kernel`): V0 and A are of the displacement D and the velocity V1 that they have
predicted, V1 = V0 + A h and D = V0 h + A h^2 / 2, which leapfrog, midpoint and rk4 are for constant forces (bend = 2; explicit
Euler, D = V0 h: 1); springs act on the point as they did at the start of the substep. Implicit ones and symplectic Euler
(`implicit_restitution_kernel`): V0 is the velocity before, A gravity and drag of the air; what constraints do within the
substep counts after the impact only. The flight between impacts is the integrator's, of first or, with BDF2, second order; so
are sensitivities.

Slow impacts stay as the projection leaves them, inelastic: e S <= 2 h max(-B, 0), a flight of at most 4 substeps. Else
infinitely many would follow one another (Zeno). So do points that begin in an overlap, and those that constraints carry to
the collider though they would not get there by themselves.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.project import SUNK, read_type, slot_type
from wsim.kernels.math.real import has_adjoint, types
from wsim.kernels.motion.points import point_constants

FLIGHT = 2.0           # substeps of pressing acceleration that a rebound must be faster than. 1 would do for leapfrog, in
                       # whose steps a resting point meets its plane at h B / 2; backward Euler's does at h B


@cache
def bounce_type(real):
    """Struct: reads only."""

    @wp.struct
    class BounceConstants:
        restitution: wp.array2d(dtype=real)      # of each row of the table of colliders, (rows, 1); with gradients of each row
                                                 # of an object for each point, (rows of an object, points)
        h: real                                  # substep [s]
        g: real                                  # the velocity is (d - a) / g, or changes with it (explicit: h)
        source: int                              # copy of the pair (explicit)
        bend: real                               # A = bend (V1 h - D) / h^2 (explicit)

    return BounceConstants


@wp.func
def time_of_impact_on_plane(gap: Any, w: Any, B: Any):
    """(s, S): time until gap + w s + B s^2 / 2 = 0 and the speed there; w < 0 <= gap. S is 0 where the plane is not met."""
    two = type(gap)(2.0)
    square = w * w - two * B * gap
    S = type(gap)(0.0)
    if square > type(gap)(0.0):
        S = wp.sqrt(square)
    return two * gap / (S - w), S


@cache
def restitution_law(real):
    """(struck, thrown): which contact of a point throws it back, and how."""
    t = types(real)
    Bounces, Slots, vec3 = bounce_type(real), slot_type(real), t.vec3

    @wp.func
    def contact_restitution(c: Bounces, row: int, i: int):
        return c.restitution[row % c.restitution.shape[0], i % c.restitution.shape[1]]

    @wp.func
    def fastest_approach_slot(c: Bounces, s: Slots, push: wp.array(dtype=vec3), i: int, V0: vec3):
        """Slot of the contact that pushes and throws back which the point approaches fastest, or -1."""
        found = int(-1)
        most = real(0.0)
        if (s.mark[i] & SUNK) == 0:
            for slot in range(s.count[i]):
                j = slot * s.points + i
                if wp.dot(push[j], s.n[j]) > real(0.0) and contact_restitution(c, s.row[j], i) > real(0.0):
                    speed = wp.dot(s.n[j], s.u[j] - V0)
                    if speed > most:
                        most = speed
                        found = slot
        return found

    @wp.func
    def restitution_change(c: Bounces, s: Slots, i: int, j: int, start: vec3, V0: vec3, A: vec3, V: vec3):
        """(p, q): what the displacement and the velocity V, after the projection, change by along n; 0 where it is slow."""
        n = s.n[j]
        u = s.u[j]
        e = contact_restitution(c, s.row[j], i)
        w = wp.dot(n, V0 - u)
        B = wp.dot(n, A)
        gap = wp.max(s.b[j] + wp.dot(n, start + c.h * u), real(0.0))
        p = real(0.0)
        q = real(0.0)
        if w < real(0.0):
            time, S = time_of_impact_on_plane(gap, w, B)
            r = c.h - time
            if r > real(0.0) and e * S > real(FLIGHT) * c.h * wp.max(-B, real(0.0)):
                p = e * S * r + real(0.5) * B * r * r
                q = e * S + B * r - wp.dot(n, V - u)
        return p, q

    return fastest_approach_slot, restitution_change


@cache
def explicit_restitution_kernel(real, module):
    """Kernel over points, for explicit integrators: pair holds what they have predicted, displacements (copy `source`) and
    velocities (2 + source); e is what both started from. Reads e, d, a, push. normal_out: n of the impact, or 0."""
    t, Read = types(real), read_type(real)
    Bounces, Slots, (struck, thrown), vectors = (bounce_type(real), slot_type(real), restitution_law(real),
                                                 wp.array(dtype=t.vec3))

    def apply_explicit_restitution(c: Bounces, s: Slots, at: Read, pair: vectors,
                                   d_out: vectors, a_out: vectors, push_out: vectors, normal_out: vectors):
        i = wp.tid()
        d0 = at.d[i]
        a0 = at.a[i]
        D = pair[c.source * s.points + i] - at.e[i]
        V1 = pair[(2 + c.source) * s.points + i]
        A = (c.bend / (c.h * c.h)) * (c.h * V1 - D)
        V0 = V1 - c.h * A
        slot = struck(c, s, at.push, i, V0)
        normal = t.vec3()
        if slot >= 0:
            j = slot * s.points + i
            n = s.n[j]
            P = at.push[j]
            V = V1 + ((d0 - a0) - D) / c.h
            p, q = thrown(c, s, i, j, a0, V0, A, V)
            if p > real(0.0):
                d_out[i] = d0 + p * n
                a_out[i] = a0 + (p - c.h * q) * n
                push_out[j] = P + (c.h * q) * n
                normal = n
        normal_out[i] = normal

    return wp.kernel(apply_explicit_restitution, name=f"bounce_free_{t.name}", module=module,
                     enable_backward=has_adjoint(module))


@cache
def implicit_restitution_kernel(real, module):
    """Kernel over points, for implicit integrators: v is the velocity before, e the displacement that the substep started from.
    Reads v, e, d, a, push. thrown_out (may be None): whether it was."""
    t, Read = types(real), read_type(real)
    Bounces, Slots, (struck, thrown), vectors = (bounce_type(real), slot_type(real), restitution_law(real),
                                                 wp.array(dtype=t.vec3))
    Constants = point_constants(real)

    def apply_implicit_restitution(c: Bounces, constants: Constants, s: Slots, at: Read,
                                   d_out: vectors, a_out: vectors, push_out: vectors, thrown_out: wp.array(dtype=real)):
        i = wp.tid()
        d0 = at.d[i]
        a0 = at.a[i]
        V0 = at.v[i]
        slot = struck(c, s, at.push, i, V0)
        thrown_now = real(0.0)
        if slot >= 0:
            j = slot * s.points + i
            n = s.n[j]
            P = at.push[j]
            o = constants.object[i]
            A = constants.gravity[o] - constants.decay[o] * V0
            p, q = thrown(c, s, i, j, at.e[i], V0, A, (d0 - a0) / c.g)
            if p > real(0.0):
                d_out[i] = d0 + p * n
                a_out[i] = a0 + (p - c.g * q) * n
                push_out[j] = P + (c.g * q) * n
                thrown_now = real(1.0)
        if thrown_out:
            thrown_out[i] = thrown_now

    return wp.kernel(apply_implicit_restitution, name=f"bounce_held_{t.name}", module=module,
                     enable_backward=has_adjoint(module))


@cache
def prolonged_restitution_kernel(real, module):
    """Kernel over points, where a step has gone on from its middle to its end (kernels/contact/prolonged.py): v is the velocity
    before, V the one there. Reads v, d, a, push, V. Of a contact that throws nothing is left to give: push_out, rest_out."""
    t, Read = types(real), read_type(real)
    Bounces, Slots, (struck, thrown), vectors = (bounce_type(real), slot_type(real), restitution_law(real),
                                                 wp.array(dtype=t.vec3))
    Constants = point_constants(real)

    def apply_prolonged_restitution(c: Bounces, constants: Constants, s: Slots, at: Read,
                                    d_out: vectors, V_out: vectors, push_out: vectors, rest_out: vectors):
        i = wp.tid()
        V0 = at.v[i]
        slot = struck(c, s, at.push, i, V0)
        if slot >= 0:
            j = slot * s.points + i
            n = s.n[j]
            o = constants.object[i]
            A = constants.gravity[o] - constants.decay[o] * V0
            p, q = thrown(c, s, i, j, at.a[i], V0, A, V_out[i])
            if p > real(0.0):
                d_out[i] = at.d[i] + p * n
                V_out[i] = V_out[i] + q * n
                push_out[j] = t.vec3()
                rest_out[j] = t.vec3()

    return wp.kernel(apply_prolonged_restitution, name=f"bounce_beyond_{t.name}", module=module, enable_backward=False)


@cache
def impact_kick_kernel(real, module):
    """Kernel over points: leapfrog's last half kick (`settle`, kernels/motion/explicit.py) leaves out what contacts would take
    back; of an impact that is over it takes nothing back. change: what others changed the velocity by [m/s]."""
    vectors = wp.array(dtype=types(real).vec3)

    def remove_impact_kick(change: vectors, normal: vectors, change_out: vectors):
        i = wp.tid()
        n = normal[i]
        c = change[i]
        change_out[i] = c - wp.dot(n, c) * n

    return wp.kernel(remove_impact_kick, name=f"spare_{types(real).name}", module=module, enable_backward=has_adjoint(module))


@cache
def history_after_impact_kernel(real, module):
    """Kernel over points, after the substep of a multistep integrator: one that was thrown has flown as it does now, with
    u = v - h A the velocity before and s = h v - h^2 A / 2 the step before."""
    t = types(real)
    Constants, vectors = point_constants(real), wp.array(dtype=t.vec3)

    def renew_impact_history(constants: Constants, thrown: wp.array(dtype=real), v: vectors, h: real, s_out: vectors,
                             u_out: vectors):
        i = wp.tid()
        if thrown[i] != real(0.0):
            o = constants.object[i]
            change = h * (constants.gravity[o] - constants.decay[o] * v[i])
            s_out[i] = h * (v[i] - real(0.5) * change)
            u_out[i] = v[i] - change

    return wp.kernel(renew_impact_history, name=f"renew_{t.name}", module=module, enable_backward=has_adjoint(module))


@cache
def impact_anchor_kernel(real, module):
    """Kernel over points: one that was thrown has the anchor that it was thrown by."""
    vectors = wp.array(dtype=types(real).vec3)

    @wp.kernel(module=module, enable_backward=False)
    def stand_by(thrown: wp.array(dtype=real), a: vectors, a_out: vectors):
        i = wp.tid()
        if thrown[i] != real(0.0):
            a_out[i] = a[i]

    return stand_by
