"""Bodies in a Newton step of points (kernels/solver/contact/active_set.py): where planes will be when the step is done.

A step of Newton's method holds points at planes that go with a body as it has been foreseen, and says how they push, P. A
star (kernels/rigid/touch/body_point_solve.py) then foresees it anew, of points that give way as A_ii lets them alone: the block
of a point is stiffer than all of them together are to what moves them together, so what is foreseen goes towards the solution
from one side, and does not swing however light the body is. Force F = own P is lam' = own P / own' in a metric own' = n.A_ii n:

    base' = lam' - k n.U0  where lam > 0, else -gap - k n.U0,     slip' = g U0 - T',     f' = h own'

with U0 what the body was foreseen to give the place. A substep begins with the impulses of the one before
(`previous_impulse_kernel`), and ends with a star of points as they are without forces, by which momentum is exchanged: what a
body gets is what points got of it, however far all this has come.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact import project
from wsim.kernels.math.real import types
from wsim.kernels.rigid.motion import double_vec3
from wsim.kernels.rigid.touch.body_point_solve import star_structs as stars
from wsim.kernels.rigid.touch.exchange import PULL
from wsim.kernels.rigid.touch.points import touch_structs


@cache
def newton_star_kernel(real, module):
    """Kernel over the room for contacts: rows of a star, behind a Newton step. P: inverse blocks A_ii before contacts."""
    t, Points, Rows, Slots = types(real), touch_structs(real)[2], stars(real)[0], project.slot_type(real)
    vectors = wp.array(dtype=wp.vec3d)

    def touch_lean(c: project.contact_tables(real)[0], of: wp.array(dtype=int), s: Slots, p: Points, P: wp.array(dtype=t.mat33),
                   V: vectors, rows_out: Rows):
        m = wp.tid()
        bodies = V.shape[0] // 2
        if m >= rows_out.first[bodies]:
            return
        j = rows_out.slot[m]
        i = j % s.points
        body = of[s.row[j]]
        n = rows_out.n[m]
        U = V[body] + wp.cross(V[bodies + body], double_vec3(rows_out.r[m]))
        U0 = t.vec3(real(U[0]), real(U[1]), real(U[2]))
        own = real(1.0) / (p.w[i] * p.g * p.g)
        stiff = wp.max(wp.dot(n, wp.inverse(P[i]) * n), own)
        push = p.push[j]
        lam = wp.dot(push, n)
        base = -wp.max(s.b[j] + wp.dot(n, p.d[i]), real(0.0))
        tied = project.is_tied_slot(s, j)
        if lam > real(0.0) or tied:
            base = (own / stiff) * lam
        mu = real(0.5) * (p.friction[i] + c.of.friction[s.row[j]])
        rows_out.base[m] = base - p.h * wp.dot(n, U0)
        rows_out.least[m] = real(0.0)
        rows_out.slip[m] = p.g * U0 - (own / stiff) * (push - lam * n)
        rows_out.mu[m] = mu[1]
        if tied:
            rows_out.least[m] = real(-wp.static(PULL))
            rows_out.mu[m] = real(0.0)
        rows_out.f[m] = p.h * stiff

    return wp.kernel(touch_lean, name=f"touch_lean_{t.name}", module=module, enable_backward=False)


@cache
def previous_impulse_kernel(real, module):
    """Kernel over bodies: V of the impulses J, T that points had in the substep before, of bodies that have contacts."""
    t, Rows, Hubs, vectors = types(real), *stars(real), wp.array(dtype=types(real).vec3)

    def touch_recall(rows: Rows, hubs: Hubs, J: vectors, T: vectors, V_out: wp.array(dtype=wp.vec3d)):
        i = wp.tid()
        bodies = hubs.w.shape[0]
        v = wp.vec3d()
        o = wp.vec3d()
        if rows.first[i + 1] > rows.first[i]:
            R = wp.mat33d(hubs.turn[i])
            v = -wp.float64(hubs.w[i]) * double_vec3(J[i])
            o = -(R * wp.cw_mul(double_vec3(hubs.inverse[i]), wp.transpose(R) * double_vec3(T[i])))
        V_out[i] = v
        V_out[bodies + i] = o

    return wp.kernel(touch_recall, name=f"touch_recall_{t.name}", module=module, enable_backward=False)


@cache
def foresight_error_kernel(real, module):
    """Kernel over bodies, behind a substep: how far V is from what was foreseen, a part of what points have changed of it, both
    by the momentum and the spin's that it is; a part of `slow` [m/s] counts as none. status: becomes 1 beyond `most`."""
    t, Found, Hubs, vectors = types(real), touch_structs(real)[1], stars(real)[1], wp.array(dtype=wp.vec3d)

    @wp.func
    def speed_norm_of_body(w: wp.float64, R: wp.mat33d, inverse: wp.vec3d, v: wp.vec3d, o: wp.vec3d):
        own = wp.transpose(R) * o
        return wp.sqrt(wp.dot(v, v) + w * wp.dot(wp.cw_div(own, inverse), own))

    def touch_miss(hubs: Hubs, found: Found, V: vectors, foreseen: vectors, slow: real, most: real,
                   left_out: wp.array(dtype=real), status_out: wp.array(dtype=int)):
        i = wp.tid()
        bodies = hubs.w.shape[0]
        w = wp.float64(hubs.w[i])
        R = wp.mat33d(hubs.turn[i])
        inverse = double_vec3(hubs.inverse[i])
        off = speed_norm_of_body(w, R, inverse, V[i] - foreseen[i], V[bodies + i] - foreseen[bodies + i])
        spun = R * wp.cw_mul(inverse, wp.transpose(R) * found.total[bodies + i])
        given = speed_norm_of_body(w, R, inverse, w * found.total[i], spun)
        left_out[i] = real(off / (given + wp.float64(slow)))
        if left_out[i] > most:
            status_out[0] = 1

    return wp.kernel(touch_miss, name=f"touch_miss_{t.name}", module=module, enable_backward=False)


@cache
def owed_push_kernel(real, module):
    """Kernel over points, behind the last Newton step: pushes become what points that bodies push have got: the opposite of
    what forces f [N] leave there."""
    t, Slots, vectors = types(real), project.slot_type(real), wp.array(dtype=types(real).vec3)

    def touch_owe(of: wp.array(dtype=int), s: Slots, p: touch_structs(real)[2], f: vectors, push_out: vectors):
        i = wp.tid()
        given = t.vec3()
        most = real(0.0)
        own = int(-1)
        tied = s.count[i] > 0 and project.is_tied_slot(s, i)
        for slot in range(s.count[i]):
            j = slot * s.points + i
            given += p.push[j]
            lam = wp.dot(p.push[j], s.n[j])
            if lam > most and of[s.row[j]] >= 0:
                most = lam
                own = j
        if tied:
            for k in range(s.count[i]):
                j = k * s.points + i
                push_out[j] = (-(p.w[i] * p.g * p.g) * wp.dot(f[i], s.n[j])) * s.n[j]
        elif own >= 0:
            P = p.push[own] - given - (p.w[i] * p.g * p.g) * f[i]
            if wp.dot(P, s.n[own]) > real(0.0):
                push_out[own] = P

    return wp.kernel(touch_owe, name=f"touch_owe_{t.name}", module=module, enable_backward=False)


@cache
def unpushed_way_kernel(real, module):
    """Kernel over points: ways without which points would not have been pushed, for the balance of momentum
    (kernels/solver/rigid_translation.py). own [N/m]: with soft pins."""
    t, Slots, vectors = types(real), project.slot_type(real), wp.array(dtype=types(real).vec3)

    def touch_given(s: Slots, p: touch_structs(real)[2], own: wp.array(dtype=real), y_out: vectors):
        i = wp.tid()
        P = t.vec3()
        for slot in range(s.count[i]):
            P += p.push[slot * s.points + i]
        y_out[i] = t.vec3()
        if p.w[i] > real(0.0):
            y_out[i] = (real(-1.0) / (p.w[i] * p.g * p.g * own[i])) * P

    return wp.kernel(touch_given, name=f"touch_given_{t.name}", module=module, enable_backward=False)


@cache
def kept_impulse_kernel(real, module):
    """Kernel over bodies: impulses of this substep for the next."""
    t, Found = types(real), touch_structs(real)[1]
    vectors = wp.array(dtype=t.vec3)

    def touch_keep(found: Found, J_out: vectors, T_out: vectors):
        i = wp.tid()
        J = found.total[i]
        T = found.total[J_out.shape[0] + i]
        J_out[i] = t.vec3(real(J[0]), real(J[1]), real(J[2]))
        T_out[i] = t.vec3(real(T[0]), real(T[1]), real(T[2]))

    return wp.kernel(touch_keep, name=f"touch_keep_{t.name}", module=module, enable_backward=False)
