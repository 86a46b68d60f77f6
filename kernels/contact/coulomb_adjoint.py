"""Adjoint of an implicit substep among contacts: kernels/contact/coulomb.py, kernels/solver/newton_adjoint.py.

    left = E F,   dE F = K dd,   W = E^T,   q in the range of S,   y  the gradient by d

    S ((dr/dd)^T W q - K^T q) = S y        (r = -F, kernels/solver/newton_adjoint.py; of one contact W = S + mu n t^T)

is solved, and z = y - (dr/dd)^T W q + K^T q is then what holds the point: z = sum nu_j n_j, by b_j -nu_j, by n_j -nu_j d; where
one sticks z is the gradient by d = w - (b + n.w) n. Those by n, w, mu in E follow contact by contact, by Warp, and that by the
n in S is -beta_j q, left = sum beta_j n_j.

What is projected behind the solution (kernels/contact/project.py) reads the pushes P_j there: own P_j is what left_j loses to
contact j. With Q_j the gradients by them, H_j = G_j+1 + Q_j / own and G = 0 behind the last,

    H.left_j+1 of left_j, by n, d, w, mu     G_j = (dleft_j+1/dleft_j)^T H - Q_j / own        by own  -Q_j.P_j / own

and G_0 is a gradient by F: it joins W q, and the right side is S (y - (dr/dd)^T G_0).
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.contact.coulomb import SLIDES, STICKS, coulomb_formulas, coulomb_structs
from wsim.kernels.contact.project import contact_tables, slot_type
from wsim.kernels.math.real import types


@cache
def sliding_reaction_func(real):
    """Function: Q.left' of a contact that slides."""
    t = types(real)
    vec3 = t.vec3

    @wp.func
    def sliding_reaction_product(left: vec3, n: vec3, d: vec3, w: vec3, mu: real, Q: vec3):
        way = d - w
        s = way - wp.dot(way, n) * n
        c = n
        if mu > real(0.0):
            c = n - (mu / wp.length(s)) * s
        return wp.dot(Q, left - wp.dot(n, left) * c)

    return sliding_reaction_product


@cache
def compile_coulomb_gradient(real, module) -> None:
    """A kernel that never runs: see kernels/solver/xpbd_vjp.py."""
    t, taken = types(real), sliding_reaction_func(real)

    def call_coulomb_gradient(mu: real, out: wp.array(dtype=real)):
        o = t.vec3()
        out[0] = taken(o, o, o, o, mu, o)

    wp.kernel(call_coulomb_gradient, name=f"need_holding_{t.name}", module=module, enable_backward=True)


@cache
def reaction_transpose_kernel(real, module):
    """Kernel over points: W p."""
    t = types(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def apply_reaction_transpose(W: wp.array(dtype=t.mat33), p: vec3, q_out: vec3):
        i = wp.tid()
        q_out[i] = W[i] * p[i]

    return apply_reaction_transpose


@wp.func
def free_adjoint_residual(S: Any, W: Any, K: Any, v: Any, p: Any):
    """S (v - K^T p)."""
    return S * (v - wp.transpose(K) * p)


@wp.func
def reaction_cotangent(S: Any, W: Any, K: Any, v: Any, p: Any):
    """W^T v - K p."""
    return wp.transpose(W) * v - K * p


@cache
def contact_frame_product_kernel(formula, real, module):
    """Kernel over points: `free_adjoint_residual` or `reaction_cotangent` in the frame of each."""
    t, at = types(real), coulomb_structs(real)
    vec3 = wp.array(dtype=t.vec3)

    def multiply_in_contact_frame(o: at.Frame, v: vec3, p: vec3, q_out: vec3):
        i = wp.tid()
        q_out[i] = formula(o.S[i], o.W[i], o.K[i], v[i], p[i])

    return wp.kernel(multiply_in_contact_frame, name=f"{formula.key}_{t.name}", module=module, enable_backward=False)


@cache
def free_remainder_kernel(real, module):
    """Kernel over points: S (y - v)."""
    t = types(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def project_free_remainder(S: wp.array(dtype=t.mat33), y: vec3, v: vec3, r_out: vec3):
        i = wp.tid()
        r_out[i] = S[i] * (y[i] - v[i])

    return project_free_remainder


@cache
def reaction_sum_kernel(real, module):
    """Kernel over points: W p + G."""
    t = types(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def add_reaction_to_gradient(W: wp.array(dtype=t.mat33), p: vec3, G: vec3, q_out: vec3):
        i = wp.tid()
        q_out[i] = W[i] * p[i] + G[i]

    return add_reaction_to_gradient


@cache
def push_adjoint_kernel(real, module):
    """Kernel over points: G_0 and, added to, the gradients by d, contacts, their friction, a and w. push: at the solution;
    by_push: Q."""
    t, at, taken = types(real), coulomb_structs(real), sliding_reaction_func(real)
    (Rows, Points), Slots, vec3 = contact_tables(real), slot_type(real), wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def accumulate_push_adjoint(c: Rows, points: Points, s: Slots, o: at.State, of: at.Pushed, by: at.Grads, G_out: vec3):
        i = wp.tid()
        G = t.vec3()
        count = s.count[i]
        if count > 0 and points.w[i] > real(0.0):
            share = points.w[i] / (o.rate * o.rate)
            by_d = t.vec3()
            by_a = t.vec3()
            by_w = real(0.0)
            for back in range(count):
                slot = count - 1 - back
                j = slot * s.points + i
                Q = share * of.by_push[j]
                if of.bears[j] != 0:
                    by_w += wp.dot(of.by_push[j], of.push[j]) / points.w[i]
                if of.bears[j] == wp.static(STICKS):
                    G = -Q
                elif of.bears[j] == wp.static(SLIDES):
                    left = o.f[i] - (o.d[i] - o.b[i]) / share
                    for before in range(slot):
                        left += of.push[before * s.points + i] / share
                    mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
                    Gb, gn, gd, gw, gmu, _H = wp.grad(taken)(left, s.n[j], o.d[i], o.a[i] + s.u[j] / o.rate, mu[1], G + Q)
                    G = Gb - Q
                    by.n[j] = by.n[j] + gn
                    by.u[j] = by.u[j] + gw / o.rate
                    place = (s.row[j] - c.first[points.object[i]]) * s.points + i
                    by.friction[place] = by.friction[place] + t.vec2(real(0.0), gmu)
                    by_d += gd
                    by_a += gw
            by.d[i] = by.d[i] + by_d
            by.a[i] = by.a[i] + by_a
            of.by_w[i] = of.by_w[i] + by_w
        G_out[i] = G

    compile_coulomb_gradient(real, module)
    return accumulate_push_adjoint


@cache
def left_by_contacts_func(real):
    """Function: what the contacts of point i before slot `last` leave: of F, and of its own directions, S."""
    at, one = coulomb_structs(real), coulomb_formulas(real)
    slid, filtered, (Rows, Points), Slots = one.slid, one.filtered, contact_tables(real), slot_type(real)

    @wp.func
    def force_left_by_contacts(c: Rows, points: Points, s: Slots, o: at.State, bears: wp.array(dtype=int), i: int, last: int):
        left = o.f[i] - (o.rate * o.rate / points.w[i]) * (o.d[i] - o.b[i])
        S = wp.identity(n=3, dtype=real)
        for slot in range(last):
            j = slot * s.points + i
            if bears[j] != 0:
                n = s.n[j]
                way, rate = slid(n, o.d[i], o.a[i] + s.u[j] / o.rate)
                mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
                left -= wp.dot(n, left) * (n - (mu[1] * rate) * way)
                S = filtered(S, n)
        return left, S

    return force_left_by_contacts


@cache
def held_contact_adjoint_kernel(real, module):
    """Kernel over points: adds gradients by contacts, their friction and a. v: y - (dr/dd)^T W q; q as above."""
    t, at, taken, before = types(real), coulomb_structs(real), sliding_reaction_func(real), left_by_contacts_func(real)
    (Rows, Points), Slots, vec3 = contact_tables(real), slot_type(real), wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def accumulate_held_adjoint(c: Rows, points: Points, s: Slots, o: at.State, fixed: at.Frame, v: vec3, q: vec3,
                                by: at.Grads):
        i = wp.tid()
        count = s.count[i]
        if count == 0:
            return
        z = (by.d[i] - v[i]) + wp.transpose(fixed.K[i]) * q[i]
        Q = q[i]
        end, _S = before(c, points, s, o, fixed.bears, i, count)
        by_a = t.vec3()
        for back in range(count):
            slot = count - 1 - back
            j = slot * s.points + i
            n = s.n[j]
            w = o.a[i] + s.u[j] / o.rate
            gn = t.vec3()
            gw = t.vec3()
            gb = real(0.0)
            if fixed.bears[j] == wp.static(STICKS):
                gb = -wp.dot(n, z)
                gn = gb * w - (s.b[j] + wp.dot(n, w)) * z
                gw = z + gb * n
                z = t.vec3()
            elif fixed.bears[j] == wp.static(SLIDES):
                left, S = before(c, points, s, o, fixed.bears, i, slot)
                mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
                Sn = S * n
                size = inverse_or_zero(wp.dot(n, Sn))
                nu = size * wp.dot(Sn, z)
                beta = size * wp.dot(Sn, end)
                z -= nu * n
                end -= beta * n
                Qb, gn, _d, gw, gmu, _Q = wp.grad(taken)(left, n, o.d[i], w, mu[1], Q)
                Q = Qb
                gb = -nu
                gn -= nu * o.d[i] + beta * q[i]
                place = (s.row[j] - c.first[points.object[i]]) * s.points + i
                by.friction[place] = by.friction[place] + t.vec2(real(0.0), gmu)
            by.n[j] = by.n[j] + gn
            by.b[j] = by.b[j] + gb
            by.u[j] = by.u[j] + gw / o.rate
            by_a += gw
        by.a[i] = by.a[i] + by_a

    compile_coulomb_gradient(real, module)
    return accumulate_held_adjoint
