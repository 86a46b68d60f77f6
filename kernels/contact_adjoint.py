"""Adjoints of the search for contacts (kernels/search.py) and of their projection (kernels/contact.py), point by point.

Lists are frozen: which contacts a point has, and in which order, is found anew by the same search of the same arrays. Where a
list, a branch of friction or the side of a shape would change, the motion has a kink, and there is no derivative.

Of a projection, with D and Q the gradients by d and P after it, those by all that it has read are those of s = D.d' + Q.P',
which Warp differentiates. Of the search, with the iterates tau_k of kernels/collide.py at q = q0 + tau dq, H the Hessian of
phi (dn = H dq), and gradients gC, gn, gp, g by C, n, p and tau:

    C = phi - r + (1 - tau) n.dq,  p = q - phi n:
        by q    gC n + gp - (gp.n) n + H ((1 - tau) gC dq + gn - phi gp)       by dq    gC (1 - tau) n       by tau  -gC n.dq
    tau' = tau + (phi - r) / f,  f = -n.dq:
        by q    g (n / f + (phi - r) / f^2 H dq)                               by dq    g (phi - r) / f^2 n  by tau  g
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.collide import NEWTON_LIMIT, touch_convex
from wsim.kernels.contact import meeting, slots, tables
from wsim.kernels.distance import distance
from wsim.kernels.real import types
from wsim.kernels.search import frames


@cache
def grads(real):
    """Struct of gradients. d_out, push_out, a_out: by what was written; the others are added to; of contacts in the order of
    the slots."""
    t = types(real)

    @wp.struct
    class Grads:
        d_out: wp.array(dtype=t.vec3)
        a_out: wp.array(dtype=t.vec3)
        push_out: wp.array(dtype=t.vec3)
        x: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        push: wp.array(dtype=t.vec3)
        n: wp.array(dtype=t.vec3)
        b: wp.array(dtype=t.scalar)
        u: wp.array(dtype=t.vec3)
        friction: wp.array(dtype=t.vec2)         # of the points' own, (points,)

    return Grads


@cache
def read(real):
    """Struct of the arrays that a launch has read."""
    t = types(real)

    @wp.struct
    class Read:
        x: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        push: wp.array(dtype=t.vec3)

    return Read


@cache
def products(kinds: tuple[str, ...], real):
    """Functions that Warp differentiates: s of a contact, and v.n of a shape at q, whose gradient is H v."""
    t, meet, formula = types(real), meeting(real), distance(kinds)
    vec3 = t.vec3

    @wp.func
    def pushed(n: vec3, gap: t.vec2, w: vec3, P: vec3, d: vec3, mu: t.vec2, D: vec3, Q: vec3):
        moved, push, pressed = meet(n, gap[0], w, vec3(), P, d, mu, gap[1])
        return wp.dot(D, moved) + wp.dot(Q, push)

    @wp.func
    def bent(kind: int, size: vec3, q: vec3, v: vec3):
        phi, n = formula(kind, size, q)
        return wp.dot(v, n)

    return pushed, bent


@cache
def need(kinds: tuple[str, ...], real, module) -> None:
    """A kernel that never runs: see kernels/xpbd_product.py."""
    t, (pushed, bent) = types(real), products(kinds, real)
    vec3 = t.vec3

    def called(kind: int, b: real, out: wp.array(dtype=real)):
        o = vec3()
        out[0] = pushed(o, t.vec2(b, b), o, o, o, t.vec2(), o, o) + bent(kind, o, o, o)

    wp.kernel(called, name=f"need_contact_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=True)


@cache
def project_adjoint(kinds: tuple[str, ...], real, module):
    """Kernel over points: the adjoint of an iteration; takes the gradients by what it has written away. Arguments: rows,
    points, slots, what was read (d, a, push), gradients, g."""
    t, (pushed, _), meet = types(real), products(kinds, real), meeting(real)
    (Rows, Points), Slots, Read, Grads = tables(real), slots(real), read(real), grads(real)

    @wp.func
    def friction(c: Rows, points: Points, s: Slots, i: int, j: int):
        return real(0.5) * (points.friction[i] + c.friction[s.row[j]])

    def back(c: Rows, points: Points, s: Slots, at: Read, o: Grads, g: real):
        i = wp.tid()
        count = s.count[i]
        if count == 0:
            return
        a = at.a[i]
        D = o.d_out[i]
        by_a = t.vec3()
        by_mu = t.vec2()
        for back in range(count):
            last = count - 1 - back
            d = at.d[i]
            for slot in range(last):
                j = slot * s.points + i
                d, P, _pressed = meet(s.n[j], s.b[j], a, g * s.u[j], at.push[j], d, friction(c, points, s, i, j), c.width)
            j = last * s.points + i
            gn, gb, gw, gP, gd, gmu, _D, _Q = wp.grad(pushed)(
                s.n[j], t.vec2(s.b[j], c.width), a + g * s.u[j], at.push[j], d, friction(c, points, s, i, j), D, o.push_out[j])
            o.n[j] = o.n[j] + gn
            o.b[j] = o.b[j] + gb[0]
            o.u[j] = o.u[j] + g * gw
            o.push[j] = o.push[j] + gP
            o.push_out[j] = t.vec3()
            by_a += gw
            by_mu += real(0.5) * gmu
            D = gd
        o.d_out[i] = t.vec3()
        o.d[i] = o.d[i] + D
        o.a[i] = o.a[i] + by_a
        o.friction[i] = o.friction[i] + by_mu

    need(kinds, real, module)
    return wp.kernel(back, name=f"adjoint_contact_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=False)


@cache
def touch_adjoint(kinds: tuple[str, ...], real):
    """Function: gradients by q0 and q1 from those by C, n, p and s0 of `collide.touch_convex`."""
    t, formula, (_, bent) = types(real), distance(kinds), products(kinds, real)
    vec3, path = t.vec3, wp.types.vector(NEWTON_LIMIT + 1, real)

    @wp.func
    def iterates(kind: int, size: vec3, q0: vec3, dq: vec3, r: real, margin: real):
        """tau_0 .. tau_k, and k; -1 - k where the last is the end of the path."""
        taus = path()
        length = wp.length(dq)
        k = int(0)
        ended = int(0)
        while k < NEWTON_LIMIT:
            phi, n = formula(kind, size, q0 + taus[k] * dq)
            s = phi - r
            if ended != 0 or s <= real(1.0e-4) * length or s > margin + length:
                break
            fall = -wp.dot(n, dq)
            if fall * (real(1.0) - taus[k]) > s:
                taus[k + 1] = taus[k] + s / fall
            else:
                taus[k + 1] = real(1.0)
                ended = 1
            k += 1
        if ended != 0:
            k = -1 - k
        return taus, k

    @wp.func
    def touch_adjoint(kind: int, size: vec3, ends: wp.types.matrix((2, 3), real), r: real, margin: real, by: t.vec2, gn: vec3,
                      gp: vec3):
        q0 = ends[0]
        dq = ends[1] - q0
        gC = by[0]
        taus, k = iterates(kind, size, q0, dq, r, margin)
        ended = k < 0
        if ended:
            k = -1 - k
        tau = taus[k]
        q = q0 + tau * dq
        phi, n = formula(kind, size, q)
        rest = real(1.0) - tau
        _kind, _size, Hv, _v = wp.grad(bent)(kind, size, q, (rest * gC) * dq + gn - phi * gp)      # only here: a function that
        gq = gC * n + gp - wp.dot(gp, n) * n + Hv                              # calls one with wp.grad would come before it
        g0 = gq
        gd = tau * gq + (rest * gC) * n
        g = wp.dot(gq, dq) - gC * wp.dot(n, dq)
        if not ended:
            for back in range(k):
                tau = taus[k - 1 - back]
                q = q0 + tau * dq
                phi, n = formula(kind, size, q)
                over = real(1.0) / -wp.dot(n, dq)
                share = (phi - r) * over * over
                _kind, _size, Hv, _v = wp.grad(bent)(kind, size, q, dq)
                gq = (g * over) * n + (g * share) * Hv
                g0 += gq
                gd += tau * gq + (g * share) * n
                g += wp.dot(gq, dq)
        phi, n = formula(kind, size, q0)
        return wp.matrix_from_rows(g0 - gd + by[1] * n, gd)

    return touch_adjoint


@cache
def search_adjoint(kinds: tuple[str, ...], real, module):
    """Kernel over points: the adjoint of the search of substep k; gradients by d and a that it has moved are left where they
    are, for the copies before it. Arguments: rows, points, slots, what was read (x, d), gradients, k."""
    t, touch, back = types(real), touch_convex(kinds, real), touch_adjoint(kinds, real)
    (Rows, Points), Slots, Read, Grads = tables(real), slots(real), read(real), grads(real)
    inside, outside = frames(real)
    vec3 = t.vec3

    @wp.func
    def met(c: Rows, points: Points, i: int, row: int, k: int, x: vec3, d: vec3):
        """Of a contact: ends of the path, normal, (distance kept, margin, overlap, part of it that is left)."""
        T0 = c.pose[k, row]
        T1 = c.pose[k + 1, row]
        q0, q1 = inside(T0, T1, x, d)
        margin = wp.length(q1 - q0) + c.skin + c.stride[k, row]
        r = points.reach[i] + c.gap[row]
        C, m, p, s0 = touch(c.kind[row], c.size[row], q0, q1, r, margin)
        n, way = outside(T0, T1, c.step[k, row], m, p, vec3())
        return wp.matrix_from_rows(q0, q1), n, t.vec4(r, margin, -s0, wp.min(wp.max(-s0, real(0.0)), c.recovery * c.h))

    @wp.func
    def turned_back(step: t.transform, T0: t.transform, f: vec3):
        """R0^T (R - 1)^T f of the turn of a step."""
        q = wp.transform_get_rotation(step)
        v = vec3(q[0], q[1], q[2])
        across = wp.cross(f, v)
        y = real(2.0) * (q[3] * across + wp.cross(across, v))
        return wp.quat_rotate_inv(wp.transform_get_rotation(T0), y)

    def search(c: Rows, points: Points, s: Slots, at: Read, o: Grads, k: int):
        i = wp.tid()
        x = at.x[i]
        d = at.d[i]
        K = o.d_out[i] + o.a_out[i]
        by_x = vec3()
        by_d = vec3()
        count = s.count[i]
        for later in range(count):
            last = count - 1 - later
            carried = vec3()
            for slot in range(last):
                ends, n, how = met(c, points, i, s.row[slot * s.points + i], k, x + carried, d)
                carried += how[3] * n
            j = last * s.points + i
            row = s.row[j]
            T0 = c.pose[k, row]
            ends, n, how = met(c, points, i, row, k, x + carried, d)
            gb = o.b[j]
            g_out = wp.dot(K, n) - gb
            gn = wp.quat_rotate_inv(wp.transform_get_rotation(c.pose[k + 1, row]), o.n[j] + how[3] * K - gb * (d + carried))
            g_over = gb
            if how[2] < c.recovery * c.h:
                g_over += g_out
            gs0 = real(0.0)
            if how[2] > real(0.0):
                gs0 = -g_over
            gp = turned_back(c.step[k, row], T0, o.u[j] / c.h)
            ends = back(c.kind[row], c.size[row], ends, how[0], how[1], t.vec2(gb, gs0), gn, gp)
            g0 = wp.quat_rotate(wp.transform_get_rotation(T0), ends[0])
            g1 = wp.quat_rotate(wp.transform_get_rotation(c.pose[k + 1, row]), ends[1])
            by_x += g0 + g1
            by_d += g1 - gb * n
            K += g0 + g1 - gb * n
        o.x[i] = o.x[i] + by_x
        o.d[i] = o.d[i] + by_d

    need(kinds, real, module)
    return wp.kernel(search, name=f"adjoint_search_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=False)
