"""Contacts of balls that turn with colliders: those of kernels/contact/project.py with the law of law.py. Pushes are
in metres, as there: A = 1 + a, B = C = a. Points that do not turn are projected as everywhere.

A ball touches a collider at x - R n, and turns about what turns with it: a plate under it that turns about n takes it along.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.colliders import first_body_slot
from wsim.kernels.contact.project import SUNK, TOUCHED, contact_tables, point_projection_func, read_type, slot_type
from wsim.kernels.math.real import substep_number, types
from wsim.kernels.position_based.rolling.law import roll_type, rolling_law_func


@cache
def roll_wall_kernel(real, module):
    """Kernel over points, behind a search: how far the colliders of contacts turn in the substep, and no torques. Reads k."""
    t, Roll, Slots, Read, (Rows, _) = types(real), roll_type(real), slot_type(real), read_type(real), contact_tables(real)

    def begin_rolling_contacts(c: Rows, s: Slots, at: Read, roll: Roll):
        i = wp.tid()
        k = substep_number(at.k, at.now)
        if roll.own[i][0] > real(0.0):
            for slot in range(s.count[i]):
                j = slot * s.points + i
                turn = wp.transform_get_rotation(c.of.step[k, s.row[j]])
                axis = t.vec3(turn[0], turn[1], turn[2])
                size = wp.length(axis)
                theta = real(2.0) * axis
                if size > real(1.0e-3):
                    theta *= wp.atan2(size, turn[3]) / size
                roll.wall[j] = roll.own[i][2] * theta
                roll.q[j] = t.vec3()
                roll.swing[j] = t.vec3()

    return wp.kernel(begin_rolling_contacts, name=f"roll_walls_{t.name}", module=module, enable_backward=False)


@cache
def rolling_point_func(real):
    """Function (c, points, s, roll, i, g, at: rows d and a, push) -> d of point i after one iteration of its contacts, in
    order; writes pushes, torques, its turn and its mark."""
    t, Roll, Slots, (Rows, Points) = types(real), roll_type(real), slot_type(real), contact_tables(real)
    plain, law = point_projection_func(real), rolling_law_func(real)

    @wp.func
    def project_rolling_point(c: Rows, points: Points, s: Slots, roll: Roll, i: int, g: real,
                              at: wp.types.matrix((2, 3), real), push: wp.array(dtype=t.vec3)):
        ball = roll.own[i]
        kappa = ball[0]
        d = at[0]
        phi = roll.phi[i]
        touched = int(0)
        many = s.count[i]
        first = first_body_slot(c, s, i)
        for turn in range(many):
            j = ((first + turn) % many) * s.points + i
            n = s.n[j]
            lam = wp.dot(push[j], n)
            T = push[j] - lam * n
            q = roll.q[j]
            pressed = wp.max(lam - (s.b[j] + wp.dot(n, d)), real(0.0))
            d += (pressed - lam) * n
            away = (d - at[1]) - g * s.u[j]
            s0 = away - wp.dot(n, away) * n + wp.cross(n, phi - kappa * q) - (real(1.0) + kappa) * T
            psi0 = phi - roll.wall[j] - roll.swing[j] + kappa * (wp.cross(n, T) - q)
            rub = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
            mu = t.vec3(rub[0], rub[1], ball[1])
            new = law(n, pressed, s0, psi0, t.vec3(real(1.0) + kappa, kappa, kappa), mu)
            d += new[0] - T
            phi += kappa * ((new[1] - q) - wp.cross(n, new[0] - T))
            if pressed > real(0.0):
                touched = TOUCHED
            push[j] = pressed * n + new[0]
            roll.q[j] = new[1]
        roll.phi[i] = phi
        s.mark[i] = (s.mark[i] & SUNK) | touched
        return d

    @wp.func
    def project_ball_or_point(c: Rows, points: Points, s: Slots, roll: Roll, i: int, g: real,
                              at: wp.types.matrix((2, 3), real), push: wp.array(dtype=t.vec3)):
        if roll.own[i][0] > real(0.0):
            return project_rolling_point(c, points, s, roll, i, g, at, push)
        return plain(c, points, s, i, g, at, push, push)

    return project_ball_or_point


@cache
def rolling_projection_kernel(real, module):
    """Kernel over points: one iteration of all contacts of a point, as `contact_projection_kernel`."""
    t, Roll, Slots, (Rows, Points) = types(real), roll_type(real), slot_type(real), contact_tables(real)
    Read, one = read_type(real), rolling_point_func(real)

    def project_rolling_contacts(c: Rows, points: Points, s: Slots, at: Read, g: real, roll: Roll,
                                 d_out: wp.array(dtype=t.vec3), push_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if s.count[i] > 0:
            d_out[i] = one(c, points, s, roll, i, g, wp.matrix_from_rows(at.d[i], at.a[i]), push_out)

    return wp.kernel(project_rolling_contacts, name=f"roll_contact_{t.name}", module=module, enable_backward=False)
