"""Contacts in a Newton step (kernels/solver/newton.py): planes that bear are an active set, points that stick have no direction
left.

A contact that bears takes its direction out of the system: P = S (A_ii)^-1 S, S = I - n n^T (Baraff, Witkin 1998, section 5.1);
one that sticks (kernels/solver/contact/friction.py) all of them, S = 0; one that slides adds its drag. The step begins with the
way to the planes, and back to where a point sticks, `start`, so that it solves for what is free

    A z = f - A start,   y = start + z          with S f = f, z = S z

and the forces that it leaves, r = f - A y, say what bears in the next step: of those that bore the ones with
lam = -n.r / own > 0, and what y would carry into a collider (a primal-dual active set: Hintermueller, Ito, Kunisch 2002).
y ends outside of all colliders, so a line search along it (kernels/solver/line_search.py), of Phi with friction, keeps points
out. The push of a contact is P = lam n + T [m] (kernels/contact/project.py; impulse m P / g).
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.contact import project
from wsim.kernels.math.real import types
from wsim.kernels.solver import newton, pcg
from wsim.kernels.solver.contact.friction import friction_formulas
from wsim.kernels.solver.newton import inverse_of

NEAR = 0.01            # part of the search's skin: a gap under it touches, as kernels/contact/search.py has it
PASSES = 3             # over the planes of a point in several contacts, which are not at right angles


@cache
def active_set_structs(real) -> SimpleNamespace:
    """Where: a substep as it stands. Held: what a Newton step solves, see `active_set_filter_kernel`."""
    t = types(real)

    @wp.struct
    class ActiveSetState:
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        g: t.scalar

    @wp.struct
    class HeldContacts:
        f: wp.array(dtype=t.vec3)            # forces that contacts leave [N], (points,)
        own: wp.array(dtype=t.scalar)        # with drag [N/m]
        start: wp.array(dtype=t.vec3)        # way to the planes that bear, and back to where one sticks [m]
        push: wp.array(dtype=t.vec3)         # of the slots; n.P > 0: it bears

    return SimpleNamespace(Where=ActiveSetState, Held=HeldContacts)


@cache
def active_set_filter_kernel(real, module):
    """Kernel over points, after `assemble`: forces f without contacts to what a step solves, P filtered. fresh: 1 where forces
    at d tell what bears, 0 where the step before has told."""
    t, A, Slots, one, own_ = (types(real), newton.newton_structs(real).Matrix, project.slot_type(real), friction_formulas(real),
                              active_set_structs(real))
    (Rows, Points), slip, friction = project.contact_tables(real), one.slip, one.friction

    @wp.func
    def friction_of_slot(c: Rows, points: Points, s: Slots, at: own_.Where, which: wp.vec2i, left: t.vec3, H: t.mat33,
                         pressed: t.vec2):
        """Slip, friction, its drag, whether contact which[1] of point which[0] sticks; ties have none. pressed: own, lam."""
        i = which[0]
        j = which[1]
        n = s.n[j]
        way = slip(n, at.d[i], at.a[i] + at.g * s.u[j])
        T = t.vec3()
        more = real(0.0)
        sticks = bool(False)
        if not project.is_tied_slot(s, j):
            mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
            T, more, sticks = friction(n, way, left - wp.dot(left, n) * n, H, pressed[0], pressed[1], mu)
        return way, T, more, sticks

    @wp.kernel(module=module, enable_backward=False)
    def filter_active_contacts(c: Rows, points: Points, s: Slots, at: own_.Where, fresh: int, f: wp.array(dtype=t.vec3),
                               A_out: A, held_out: own_.Held):
        i = wp.tid()
        own = A_out.own[i]
        left = f[i]
        drag = real(0.0)
        start = t.vec3()
        if s.count[i] > 0 and own > real(0.0):
            P = A_out.P[i]
            H = wp.inverse(P)
            S = wp.identity(n=3, dtype=real)
            pulled = t.vec3()
            sticks = bool(False)
            for slot in range(s.count[i]):
                j = slot * s.points + i
                n = s.n[j]
                gap = s.b[j] + wp.dot(n, at.d[i])
                pressed = -wp.dot(left, n) / own
                lam = wp.dot(held_out.push[j], n)
                if fresh != 0:
                    lam = wp.where(gap <= real(NEAR) * c.skin, pressed, real(0.0))
                push = t.vec3()
                tied = project.is_tied_slot(s, j)
                lam = wp.where(tied, pressed, lam)
                if (lam > real(0.0) or tied) and not sticks:
                    left += (pressed * own) * n
                    Sn = S * n
                    S -= inverse_or_zero(wp.dot(n, Sn)) * wp.outer(Sn, Sn)
                    start -= (gap + wp.dot(n, start)) * n
                    way, T, more, sticks = friction_of_slot(c, points, s, at, wp.vec2i(i, j), left, H, t.vec2(own, lam))
                    push = lam * n + T
                    drag += more
                    pulled += more * way
                    if sticks:
                        left = t.vec3()
                        S = t.mat33()
                        start -= way
                held_out.push[j] = push
            if drag > real(0.0):
                P = inverse_of(H + drag * wp.identity(n=3, dtype=real), own)
            left = S * (left - pulled)
            A_out.P[i] = S * P * S
        held_out.f[i] = left
        held_out.own[i] = own + drag
        held_out.start[i] = start

    return filter_active_contacts


@cache
def active_set_residual_kernel(real, module, springs: bool, elements: bool):
    """Kernel over points: f + more - less - A z."""
    t, s = types(real), newton.newton_structs(real)
    product, vec3 = pcg.pcg_point_functions(real, springs, elements).product, wp.array(dtype=t.vec3)

    def newton_contact_residual(rows: s.Rows, A: s.Matrix, z: vec3, f: vec3, more: vec3, less: vec3, r_out: vec3):
        i = wp.tid()
        r_out[i] = f[i] + (more[i] - less[i]) - product(i, rows, A, z)

    name = "_".join(["remain", *["springs"] * springs, *["elements"] * elements, t.name])
    return wp.kernel(newton_contact_residual, name=name, module=module, enable_backward=False)


@cache
def step_clip_kernel(real, module):
    """Kernel over points: the part of y after which d + y is in no collider, on the planes of what bears and without slip where
    it sticks. solved: 1 after a Newton step, which says what bears in the next: r are the forces it has left there."""
    t, Slots, own_ = types(real), project.slot_type(real), active_set_structs(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def step_outside_colliders(s: Slots, push: vec3, i: int, solved: int, start: t.vec3):
        moved = start
        count = s.count[i]
        for turn in range(wp.where(count > 1, wp.static(PASSES), 1)):  # noqa: B007
            for slot in range(count):
                j = slot * s.points + i
                n = s.n[j]
                gap = s.b[j] + wp.dot(n, moved)
                if gap < real(0.0) or project.is_tied_slot(s, j) or (solved != 0 and wp.dot(push[j], n) > real(0.0)):
                    moved -= gap * n
        return moved

    @wp.func
    def active_contact_push(P: t.vec3, n: t.vec3, gap: real, R: t.vec3, own: real, sticks: bool):
        """The push of a contact that bore, or of one that is hit."""
        lam = wp.dot(P, n)
        push = t.vec3()
        if lam > real(0.0):
            pressed = -wp.dot(R, n) / own
            if pressed > real(0.0):
                push = P + (pressed - lam) * n
                if sticks:
                    push = -R / own
        elif gap < real(0.0):
            push = -gap * n
        return push

    @wp.kernel(module=module, enable_backward=False)
    def clip_newton_step(s: Slots, at: own_.Where, solved: int, A: newton.newton_structs(real).Matrix, held: own_.Held, r: vec3,
                         y: vec3, y_out: vec3):
        i = wp.tid()
        if s.count[i] == 0:
            return
        d = at.d[i]
        way = y[i]
        if solved != 0:
            way += held.start[i]
        moved = step_outside_colliders(s, held.push, i, solved, d + way)
        if solved != 0:
            R = r[i] + (held.own[i] - A.own[i]) * way
            sticks = wp.trace(A.P[i]) == real(0.0)
            touched = int(0)
            for slot in range(s.count[i]):
                j = slot * s.points + i
                n = s.n[j]
                push = active_contact_push(held.push[j], n, s.b[j] + wp.dot(n, d + way), R, A.own[i], sticks)
                tied = project.is_tied_slot(s, j)
                if tied:
                    push = (-wp.dot(R, n) / A.own[i]) * n
                if wp.dot(push, n) > real(0.0) or tied:
                    touched = wp.static(project.TOUCHED)
                    R += A.own[i] * push
                held.push[j] = push
            s.mark[i] = (s.mark[i] & wp.static(project.SUNK)) | touched
        y_out[i] = moved - d

    return clip_newton_step
