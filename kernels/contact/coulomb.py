"""What contacts bear at the solution of an implicit substep. See kernels/solver/contact/active_set.py and
kernels/contact/project.py.

    F = f - own (d - b)    all forces on a point but those of contacts [N]        own = m / g^2        f  of elements and pins
    w = a + g u            where the surface carries it     s = (I - n n^T) (d - w)     how far it has slid [m], t = s / |s|

Contacts take from F in turn, left_0 = F, and where the solution is the point's own directions S are balanced:

    lam = -n.left / own,  left' = left + own (lam n + T)        T = -mu_d lam t of one that slides
    S left = 0,   n.d + b = 0 of every one that bears           S: what is normal to their n
    d = w - (b + n.w) n                                         where one sticks, which takes all that is left; S = 0

With one contact this is Coulomb's law; a point in several gives the first what it can take. It bears where lam exceeds the
gap. What sticks stays so while |T| <= mu_s lam, T = -left / own, and what slides until dynamic friction stops it
(kernels/contact/project.py lets static friction do so, and has no solution where that does not hold what dynamic friction lets
slide a little). Of a solution pushes are kept: what sticks has an |s| below |T + mu_d lam t|, both but rounding where they are
met.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.contact.project import SUNK, TOUCHED, contact_tables, slot_type
from wsim.kernels.math.real import types


@cache
def coulomb_structs(real) -> SimpleNamespace:
    """State: a substep and its forces. Frame: what is free of each point. Left: what is not balanced. Grads: gradients, added
    to. Pushed: pushes at a solution."""
    t = types(real)

    @wp.struct
    class CoulombState:
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        b: wp.array(dtype=t.vec3)
        f: wp.array(dtype=t.vec3)            # of elements and pins [N]
        rate: t.scalar                       # 1 / g

    @wp.struct
    class FreeDirections:
        S: wp.array(dtype=t.mat33)
        W: wp.array(dtype=t.mat33)           # E^T S
        K: wp.array(dtype=t.mat33)           # S K [N/m]
        bears: wp.array(dtype=int)           # of each slot: 0, SLIDES, or STICKS, which only the last that bears may

    @wp.struct
    class CoulombResidual:
        r: wp.array(dtype=t.vec3)            # S left [N]
        miss: wp.array(dtype=t.vec3)         # that, and own times how far contacts are from where they hold
        scale: wp.array(dtype=t.vec3)        # own (d - a), which miss is small beside

    @wp.struct
    class CoulombGradients:
        d: wp.array(dtype=t.vec3)            # y
        n: wp.array(dtype=t.vec3)            # of the slots
        b: wp.array(dtype=t.scalar)
        u: wp.array(dtype=t.vec3)
        friction: wp.array(dtype=t.vec2)     # as kernels/contact/project_adjoint.py has it
        a: wp.array(dtype=t.vec3)

    @wp.struct
    class CoulombPushes:
        bears: wp.array(dtype=int)           # of each slot, as in Frame
        push: wp.array(dtype=t.vec3)         # [m]
        by_push: wp.array(dtype=t.vec3)      # gradient
        by_w: wp.array(dtype=t.scalar)       # added to, (points,)

    return SimpleNamespace(State=CoulombState, Frame=FreeDirections, Left=CoulombResidual, Grads=CoulombGradients,
                           Pushed=CoulombPushes)


SLIDES, STICKS, SOLVED = 1, 2, 3


@cache
def coulomb_formulas(real) -> SimpleNamespace:
    """Functions of one contact."""
    t = types(real)
    vec3 = t.vec3

    @wp.func
    def slip_and_inverse_speed(n: vec3, d: vec3, w: vec3):
        """s, and 1 / |s| or 0."""
        way = d - w
        s = way - wp.dot(way, n) * n
        return s, inverse_or_zero(wp.length(s))

    @wp.func
    def contact_state_and_push(n: vec3, d: vec3, w: vec3, left: vec3, own: real, mu: t.vec2, P: vec3, before: int):
        """(state, t, 1 / |s|, s, push) of one that bears. P: its push before."""
        way, rate = slip_and_inverse_speed(n, d, w)
        lam = -wp.dot(left, n) / own
        still = -(real(1.0) / own) * left - lam * n
        state = wp.static(SLIDES)
        tangent = rate * way
        if before == wp.static(SOLVED):
            pressed = wp.dot(P, n)
            if wp.length(way) <= wp.length(P - pressed * (n - mu[1] * tangent)) and mu[0] > real(0.0):
                state = wp.static(STICKS)
        elif before == wp.static(STICKS):
            tangent = -inverse_or_zero(wp.length(still)) * still
            rate = real(0.0)
            if wp.length(still) <= mu[0] * lam:
                state = wp.static(STICKS)
        push = lam * (n - mu[1] * tangent)
        if state == wp.static(STICKS):
            push = lam * n + still
        return state, tangent, rate, way, push

    @wp.func
    def contact_presses(lam: real, gap: real, pushed: real, before: int):
        return pushed > real(0.0) if before == wp.static(SOLVED) else lam > gap and lam > real(0.0)

    @wp.func
    def projector_across_both(n: vec3, tangent: vec3):
        """What is across both."""
        return wp.identity(n=3, dtype=real) - wp.outer(n, n) - wp.outer(tangent, tangent)

    @wp.func
    def remove_normal_direction(S: t.mat33, n: vec3):
        """S without n."""
        Sn = S * n
        return S - inverse_or_zero(wp.dot(n, Sn)) * wp.outer(Sn, Sn)

    return SimpleNamespace(slid=slip_and_inverse_speed, law=contact_state_and_push, presses=contact_presses,
                           across=projector_across_both, filtered=remove_normal_direction)


@cache
def contact_step_update_kernel(real, module):
    """Kernel over points, after a Newton step: what pushes is met, what sticks stops, and so does what has turned back or what
    dynamic friction stops. Friction of what slides is for the next step: where it slides is where Newton's step has put it.
    Writes d, and push and bears of `out`."""
    t, slid, at = types(real), coulomb_formulas(real).slid, coulomb_structs(real)
    (Rows, Points), Slots, vec3 = contact_tables(real), slot_type(real), wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def update_contacts_after_step(c: Rows, points: Points, s: Slots, a: vec3, g: real, first: int, d_out: vec3,
                                   out: at.Pushed):
        i = wp.tid()
        count = s.count[i]
        if count == 0:
            return
        d = d_out[i]
        touched = int(0)
        for slot in range(count):
            j = slot * s.points + i
            n = s.n[j]
            P = out.push[j]
            lam = wp.dot(P, n)
            T = P - lam * n
            pressed = wp.max(lam - (s.b[j] + wp.dot(n, d)), real(0.0))
            d += (pressed - lam) * n
            state = int(0)
            stop = t.vec3()
            if pressed > real(0.0):
                mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
                way, rate = slid(n, d, a[i] + g * s.u[j])
                turned = wp.dot(way, T) > real(0.0) or wp.length(T - way) <= mu[1 - first] * pressed
                if (out.bears[j] != wp.static(STICKS) and not turned) or mu[0] == real(0.0):
                    stop = -(mu[1] * pressed * rate) * way
                    state = wp.static(SLIDES)
                else:
                    stop = T - way
                    d -= way
                    state = wp.static(STICKS)
                touched = wp.static(TOUCHED)
            out.push[j] = pressed * n + stop
            out.bears[j] = state
        d_out[i] = d
        s.mark[i] = (s.mark[i] & wp.static(SUNK)) | touched

    return update_contacts_after_step


@cache
def contact_frame_kernel(real, module):
    """Kernel over points: the frame at d and what is left to balance there. found: 1 at a solution, where pushes say what bears
    and sticks; else that is as `contact_step_update_kernel` and the step before left it."""
    t, at, one = types(real), coulomb_structs(real), coulomb_formulas(real)
    law, presses, across, filtered, (Rows, Points) = one.law, one.presses, one.across, one.filtered, contact_tables(real)
    Slots, vec3 = slot_type(real), wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def build_contact_frame(c: Rows, points: Points, s: Slots, o: at.State, found: int, out: at.Frame, rest: at.Left,
                            push_out: vec3):
        i = wp.tid()
        left = t.vec3()
        over = t.vec3()
        S = t.mat33()
        K = t.mat33()
        E = wp.identity(n=3, dtype=real)
        own = o.rate * o.rate * inverse_or_zero(points.w[i])
        if own > real(0.0):
            left = o.f[i] - own * (o.d[i] - o.b[i])
            S = E
            for slot in range(s.count[i]):
                j = slot * s.points + i
                n = s.n[j]
                lam = -wp.dot(left, n) / own
                gap = s.b[j] + wp.dot(n, o.d[i])
                P = push_out[j]
                push = t.vec3()
                state = int(0)
                before = wp.where(found != 0, wp.static(SOLVED), out.bears[j])
                if presses(lam, gap, wp.dot(P, n), before):
                    over += (own * gap) * n
                    mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
                    state, tangent, rate, way, push = law(n, o.d[i], o.a[i] + s.u[j] / o.rate, left, own, mu, P, before)
                    S = filtered(S, n)
                    if state == wp.static(STICKS):
                        over += own * way
                        S = t.mat33()
                        left = t.vec3()
                    else:
                        D = wp.identity(n=3, dtype=real) - wp.outer(n - mu[1] * tangent, n)
                        K = D * K - (mu[1] * own * lam * rate) * across(n, tangent)
                        E = D * E
                        left = D * left
                else:
                    over += (own * wp.min(gap, real(0.0))) * n
                push_out[j] = push
                out.bears[j] = state
        out.S[i] = S
        out.W[i] = wp.transpose(S * E)
        out.K[i] = S * K
        rest.r[i] = S * left
        rest.miss[i] = rest.r[i] + over
        rest.scale[i] = own * (o.d[i] - o.a[i])

    return build_contact_frame


@cache
def preconditioner_filter_kernel(real, module):
    """Kernel over points: the preconditioner's block, filtered."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def filter_preconditioner_block(S: wp.array(dtype=t.mat33), P_out: wp.array(dtype=t.mat33)):
        i = wp.tid()
        F = S[i]
        P = P_out[i]
        P_out[i] = F * P * F

    return filter_preconditioner_block
