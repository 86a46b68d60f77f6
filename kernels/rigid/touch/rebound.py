"""Velocities behind a substep of points that push bodies, by impulses that change no place: kernels/rigid/touch/points.py."""

from functools import cache

import warp as wp

from wsim.kernels.contact import project
from wsim.kernels.math.real import types
from wsim.kernels.rigid.touch.body_point_solve import star_structs as stars
from wsim.kernels.rigid.touch.exchange import PULL
from wsim.kernels.rigid.touch.points import touch_structs


@cache
def star_velocity_kernel(real, module):
    """Kernel over the room for contacts: rows of a star of velocities. memory: 1 where the integrator has one."""
    t, (Shapes, Found, Points), Rows, Slots = types(real), touch_structs(real), stars(real)[0], project.slot_type(real)

    def touch_rise(shapes: Shapes, s: Slots, p: Points, found: Found, memory: int, bodies: int, rows_out: Rows):
        m = wp.tid()
        if m >= rows_out.first[bodies]:
            return
        j = rows_out.slot[m]
        i = j % s.points
        n = rows_out.n[m]
        lam = wp.dot(p.push[j], n)
        v = (p.d[i] - p.a[i]) / p.g
        wants = wp.dot(n, v - s.u[j])
        if memory != 0:
            wants = wp.min(wp.dot(n, (p.d[i] - p.e[i]) / p.h - s.u[j]), real(0.0))
        rebound = shapes.restitution[s.row[j]]
        if found.before[m] < -p.slow:
            wants = wp.max(wants, -rebound * found.before[m])
        f = real(0.0)
        tied = project.is_tied_slot(s, j)
        if lam > real(0.0) or tied:
            f = real(1.0) / p.w[i]
        rows_out.f[m] = f
        rows_out.mu[m] = real(0.0)
        rows_out.least[m] = -lam / p.c
        if tied:
            wants = wp.where(memory != 0, wp.dot(n, (p.d[i] - p.e[i]) / p.h - s.u[j]), wp.dot(n, v - s.u[j]))
            rows_out.least[m] = real(-wp.static(PULL))
        rows_out.base[m] = wants - wp.dot(n, v - found.u[m])

    return wp.kernel(touch_rise, name=f"touch_rise_{t.name}", module=module, enable_backward=False)


@cache
def bounce_impulse_kernel(real, module):
    """Kernel over the room for contacts: impulses q along n, where bodies go by V on top."""
    Found, Rows = touch_structs(real)[1], stars(real)[0]

    def touch_thrown(rows: Rows, V: wp.array(dtype=wp.vec3d), of: wp.array(dtype=int), s: project.slot_type(real), out: Found):
        m = wp.tid()
        bodies = V.shape[0] // 2
        if m >= rows.first[bodies]:
            return
        body = of[s.row[rows.slot[m]]]
        U = V[body] + wp.cross(V[bodies + body], wp.vec3d(rows.r[m]))
        lam = wp.max(wp.float64(rows.base[m]) + wp.dot(wp.vec3d(rows.n[m]), U), wp.float64(rows.least[m]))
        out.q[rows.slot[m]] = rows.f[m] * real(lam)

    return wp.kernel(touch_thrown, name=f"touch_thrown_{types(real).name}", module=module, enable_backward=False)


@cache
def impulse_memory_kernel(real, module):
    """Kernel over points: anchors by what changes no place; a memory is told of that and of what does."""
    t, (_, Found, Points), Slots = types(real), touch_structs(real), project.slot_type(real)
    vectors = wp.array(dtype=t.vec3)

    def touch_remember(of: wp.array(dtype=int), s: Slots, p: Points, found: Found, memory: int, a_out: vectors, v_out: vectors,
                       e_out: vectors):
        i = wp.tid()
        P = t.vec3()
        q = t.vec3()
        for slot in range(s.count[i]):
            j = slot * s.points + i
            if of[s.row[j]] >= 0:
                P += p.push[j] / p.c
                q += (p.w[i] * found.q[j]) * s.n[j]
        a_out[i] = p.a[i] - p.g * q
        if memory != 0:
            v_out[i] = p.v[i] + (P + q)
            e_out[i] = p.e[i] - ((p.h - p.c) * P + p.h * q)

    return wp.kernel(touch_remember, name=f"touch_remember_{t.name}", module=module, enable_backward=False)


@cache
def overlap_carry_kernel(real, module):
    """Kernel over points, behind a search: the way out of a body is no motion, e goes along with it, and a memory keeps what it
    has; before: anchors without it."""
    t, Slots = types(real), project.slot_type(real)
    vectors = wp.array(dtype=t.vec3)

    def touch_carry(of: wp.array(dtype=int), s: Slots, a: vectors, before: vectors, e: vectors, e_out: vectors,
                    struck_out: wp.array(dtype=real)):
        i = wp.tid()
        for slot in range(s.count[i]):
            if of[s.row[slot * s.points + i]] >= 0:
                e_out[i] = e[i] + (a[i] - before[i])
                struck_out[i] = real(0.0)
                return

    return wp.kernel(touch_carry, name=f"touch_carry_{t.name}", module=module, enable_backward=False)


@cache
def other_push_kernel(real, module):
    """Kernel over slots: pushes of colliders that are no bodies."""
    t, Slots = types(real), project.slot_type(real)

    def touch_others(of: wp.array(dtype=int), s: Slots, push: wp.array(dtype=t.vec3), push_out: wp.array(dtype=t.vec3)):
        j = wp.tid()
        given = t.vec3()
        if j // s.points < s.count[j % s.points]:
            if of[s.row[j]] < 0:
                given = push[j]
        push_out[j] = given

    return wp.kernel(touch_others, name=f"touch_others_{t.name}", module=module, enable_backward=False)
