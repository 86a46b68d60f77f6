"""What bodies and points give each other in a round of a star (kernels/rigid/touch/body_point_solve.py): functions of a contact
m or of a body, and kernels of them. kernels/rigid/touch/points.py has the order, kernels/rigid/touch/rounds.py all of it in one
launch.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact import project
from wsim.kernels.math.real import types
from wsim.kernels.math.team import team_sum_func
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.motion import double_vec3
from wsim.kernels.rigid.touch.body_point_solve import star_structs as stars
from wsim.kernels.rigid.touch.points import touch_structs

PULL = 1e30            # [m] that a tie pulls by, at most
SLID = 0.999           # of the bound of friction at which a contact counts as one that slides: it then has the dynamic bound
SIX, sum_six = wp.types.vector(6, wp.float64), team_sum_func(6)


@wp.func
def rotate_moments(R: wp.mat33d, inverse: wp.vec3d, omega: wp.vec3d):
    """I omega of the principal axes R."""
    return R * wp.cw_div(wp.transpose(R) * omega, inverse)


@wp.func
def sum_team(J: wp.vec3d, T: wp.vec3d, warps: int, team: int):
    """Both, summed over the threads of a team."""
    both = sum_six(SIX(J[0], J[1], J[2], T[0], T[1], T[2]), warps, team)
    return wp.vec3d(both[0], both[1], both[2]), wp.vec3d(both[3], both[4], both[5])


@cache
def star_energy_funcs(real):
    """(energy, weight): functions of body i: twice the kinetic energy [J] of momenta p and L; of what its weight gives
    in h [s]."""
    Rig = rig_type(real)

    @wp.func
    def doubled_kinetic_energy(rig: Rig, i: int, p: wp.vec3d, L: wp.vec3d):
        return wp.float64(rig.b.w[i]) * wp.dot(p, p) + wp.dot(L, wp.mat33d(rig.work.spread[i]) * L)

    @wp.func
    def weight_energy_scale(rig: Rig, i: int, h: real):
        g = rig.work.g[i * rig.work.g.shape[0] // rig.b.w.shape[0]]
        return wp.float64(g * h) * wp.float64(g * h) / wp.float64(rig.b.w[i])

    return doubled_kinetic_energy, weight_energy_scale


@cache
def star_contact_funcs(real, rolling: bool = False):
    """(gather, tell): functions of contact m. gather: its row of a star; tell: its plane and the speed of its surface, where
    the body goes by V, (v, o). rolling: balls turn (kernels/position_based/rolling/law.py)."""
    t, (_, Found, Points), Rows, Slots = types(real), touch_structs(real), stars(real)[0], project.slot_type(real)
    Table = project.contact_tables(real)[0]

    @wp.func
    def gather_star_row(c: Table, s: Slots, p: Points, found: Found, m: int, rows_out: Rows):
        j = rows_out.slot[m]
        i = j % s.points
        n = rows_out.n[m]
        P = p.push[j]
        d0 = p.d[i] - P
        lam = wp.dot(P, n)
        mu = real(0.5) * (p.friction[i] + c.of.friction[s.row[j]])
        bound = mu[0]
        if lam > real(0.0) and wp.length(P - lam * n) >= real(SLID) * mu[1] * lam:
            bound = mu[1]
        rows_out.base[m] = -(found.b[m] + wp.dot(n, d0))
        rows_out.least[m] = real(0.0)
        rows_out.slip[m] = (d0 - p.a[i]) - p.g * found.u[m]
        rows_out.mu[m] = bound
        if wp.static(rolling):
            own = found.roll.own[i]
            rows_out.ball[m] = own
            if own[0] > real(0.0):
                phi = found.roll.phi[i] + own[0] * (wp.cross(n, P) - found.roll.q[j])
                rows_out.slip[m] = rows_out.slip[m] + wp.cross(n, phi)
                rows_out.psi[m] = phi - found.roll.wall[j]
        if project.is_tied_slot(s, j):
            rows_out.least[m] = real(-wp.static(PULL))
            rows_out.mu[m] = real(0.0)
        rows_out.f[m] = real(1.0) / (p.w[i] * p.c)

    @wp.func
    def update_contact_plane(rows: Rows, found: Found, m: int, v: wp.vec3d, o: wp.vec3d, h: real, s_out: Slots):
        j = rows.slot[m]
        U = v + wp.cross(o, double_vec3(rows.r[m]))
        n = rows.n[m]
        s_out.u[j] = t.vec3(real(wp.float64(found.u[m][0]) + U[0]), real(wp.float64(found.u[m][1]) + U[1]),
                            real(wp.float64(found.u[m][2]) + U[2]))
        s_out.b[j] = real(wp.float64(found.b[m]) - wp.float64(h) * wp.dot(double_vec3(n), U))
        if wp.static(rolling):
            swing = wp.float64(h * rows.ball[m][2]) * o
            found.roll.swing[j] = t.vec3(real(swing[0]), real(swing[1]), real(swing[2]))

    return gather_star_row, update_contact_plane


@cache
def star_body_funcs(real, rolling: bool = False):
    """(hub, take): functions of body i. hub: momentum without what points have given, less that which V = 0 is counted from;
    given: 1, or 0 for impulses that come on top. take: its momenta, less what points have got beyond `total`; at: see
    `star.solving`; still: 1 for impulses that change no place."""
    t, Found, Rows, Rig, Hubs = types(real), touch_structs(real)[1], stars(real)[0], rig_type(real), stars(real)[1]

    @wp.func
    def set_star_hub(rig: Rig, found: Found, given: wp.float64, i: int, out: Hubs):
        n = rig.b.w.shape[0]
        R = wp.mat33d(rig.work.turn[i])
        at = rotate_moments(R, double_vec3(rig.b.inverse[i]), found.ahead[n + i])
        moment = found.total[n + i]
        if wp.static(rolling):
            moment += found.rolled[i]
        out.q[i] = double_vec3(rig.now.p[i]) + given * found.total[i] - found.ahead[i] / wp.float64(rig.b.w[i])
        out.q[n + i] = double_vec3(rig.now.L[i]) + given * moment - at

    @wp.func
    def ball_torque(found: Found, j: int):
        """Torque of rolling on the ball of slot j, over its mass and times g [m^2]."""
        own = found.roll.own[j % found.roll.own.shape[0]]
        torque = wp.vec3d()
        if own[0] > real(0.0):
            torque = double_vec3(own[2] * found.roll.q[j])
        return torque

    @wp.func
    def subtract_point_impulses(rows: Rows, push: wp.array(dtype=t.vec3), found: Found, still: int, i: int, at: wp.vec4i,
                                rig: Rig):
        bodies = rig.b.w.shape[0]
        J = wp.vec3d()
        T = wp.vec3d()
        turned = wp.vec3d()
        m = rows.first[i] + at[0]
        while m < rows.first[i + 1]:
            P = wp.float64(rows.f[m]) * double_vec3(push[rows.slot[m]])
            if still != 0:
                P = wp.float64(found.q[rows.slot[m]]) * double_vec3(rows.n[m])
            J += P
            T += wp.cross(double_vec3(rows.r[m]), P)
            if wp.static(rolling):
                turned += wp.float64(rows.f[m]) * ball_torque(found, rows.slot[m])
            m += at[1]
        J, T = sum_team(J, T, at[2], at[3])
        if wp.static(rolling):
            if still == 0:
                turned, _none = sum_team(turned, wp.vec3d(), at[2], at[3])
        if at[0] == 0 and rows.first[i + 1] > rows.first[i]:
            p = double_vec3(rig.now.p[i]) - J
            L = double_vec3(rig.now.L[i]) - T
            if still != 0:
                found.still[i] = J
                found.still[bodies + i] = T
            else:
                p += found.total[i]
                L += found.total[bodies + i]
                if wp.static(rolling):
                    L += found.rolled[i] - turned
                    found.rolled[i] = turned
                found.total[i] = J
                found.total[bodies + i] = T
                if wp.dot(J, J) > wp.float64(0.0):
                    rig.work.touched[i] = 1
            rig.now.p[i] = t.vec3(real(p[0]), real(p[1]), real(p[2]))
            rig.now.L[i] = t.vec3(real(L[0]), real(L[1]), real(L[2]))

    return set_star_hub, subtract_point_impulses


@cache
def star_row_kernel(real, module, rolling: bool = False):
    """Kernel over the room for contacts: their rows of a star."""
    (_, Found, Points), Rows, Slots, own = (touch_structs(real), stars(real)[0], project.slot_type(real),
                                            star_contact_funcs(real, rolling)[0])
    Table = project.contact_tables(real)[0]

    def touch_gather(c: Table, s: Slots, p: Points, found: Found, bodies: int, rows_out: Rows):
        m = wp.tid()
        if m < rows_out.first[bodies]:
            own(c, s, p, found, m, rows_out)

    return wp.kernel(touch_gather, name=f"touch_gather_{types(real).name}", module=module, enable_backward=False)


@cache
def star_hub_kernel(real, module, rolling: bool = False):
    """Kernel over bodies, see `star_body_funcs`."""
    Found, Rig, Hubs, own = touch_structs(real)[1], rig_type(real), stars(real)[1], star_body_funcs(real, rolling)[0]

    def touch_hubs(rig: Rig, found: Found, given: wp.float64, out: Hubs):
        own(rig, found, given, wp.tid(), out)

    return wp.kernel(touch_hubs, name=f"touch_hubs_{types(real).name}", module=module, enable_backward=False)


@cache
def contact_plane_kernel(real, module, rolling: bool = False):
    """Kernel over the room for contacts: planes and speeds of surfaces, as bodies go by V."""
    Found, Rows, Slots, own = (touch_structs(real)[1], stars(real)[0], project.slot_type(real),
                               star_contact_funcs(real, rolling)[1])

    def touch_tell(rows: Rows, found: Found, V: wp.array(dtype=wp.vec3d), of: wp.array(dtype=int), h: real, s_out: Slots):
        m = wp.tid()
        bodies = V.shape[0] // 2
        if m < rows.first[bodies]:
            body = of[s_out.row[rows.slot[m]]]
            own(rows, found, m, V[body], V[bodies + body], h, s_out)

    return wp.kernel(touch_tell, name=f"touch_tell_{types(real).name}", module=module, enable_backward=False)


@cache
def point_impulse_kernel(real, module, rolling: bool = False):
    """Kernel over bodies times lanes, see `star_body_funcs`."""
    t, Found, Rows, Rig, own = (types(real), touch_structs(real)[1], stars(real)[0], rig_type(real),
                                star_body_funcs(real, rolling)[1])

    def touch_take(rows: Rows, push: wp.array(dtype=t.vec3), found: Found, still: int, lanes: int, rig: Rig):
        tid = wp.tid()
        own(rows, push, found, still, tid // lanes, wp.vec4i(tid % lanes, lanes, (lanes + 31) // 32, 0), rig)

    return wp.kernel(touch_take, name=f"touch_take_{t.name}", module=module, enable_backward=False)
