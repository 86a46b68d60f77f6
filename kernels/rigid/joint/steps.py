"""Substeps of an island of joints: functions for one thread, and the kernel of islands that meet nothing.

    placed   bodies' places and inertia, rows of joints; begun: impulses to 0, laws of drives
    solve    a sweep: where velocities lead to, what rows ask for, impulses that fit all of them (pivots.py)
    relax    velocities along what is held or driven, at the new places; joints that broke

Bodies that joints alone move are placed by their momentum less half of the kick of the forces, as free ones are; the rest of it
comes behind: leapfrog. Islands of which a body is in contact are placed by all of it, as contacts expect.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.joint.actuation.row_laws import driven_rows_work
from wsim.kernels.rigid.joint.coordinates import joint_coordinates, unwind_twist_angle
from wsim.kernels.rigid.joint.drives import ask_drive, ask_drive_last, prepare_drives, renew_masses
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.frames import ends_of, measure_turn, set_joint_rows
from wsim.kernels.rigid.joint.pivots import solve_joint_pivots
from wsim.kernels.rigid.joint.rows import relaxed_row_piece, row_want_and_piece
from wsim.kernels.rigid.joint.tables import NONE
from wsim.kernels.rigid.motion import body_structs, double_quat, double_vec3, free_rotor_step, kick_momentum, rounded_quaternion

FAST = wp.constant(wp.float64(0.25))     # [rad] of a turn in a substep: RATTLE has no solution for a joint that turns much more
RELAX = wp.constant(4)                   # sweeps over the velocities of a loop, as A is eased (elimination.py)
CONTACT, JOINT = wp.constant(1), wp.constant(2)       # what touched a body in a substep


@wp.func
def rounded_like(v: wp.vec3d, like: Any):
    """v in the type of `like`."""
    return type(like)(type(like[0])(v[0]), type(like[0])(v[1]), type(like[0])(v[2]))


@wp.func
def joint_has_contact(j: int, J: Linked):
    """1 where a contact has touched the island of a joint in this substep (`then` notes it of all its bodies)."""
    return wp.where(J.touched[wp.max(J.t.a[j], J.t.b[j])] == CONTACT, 1, 0)


@wp.func
def asked_row(j: int, r: int, contact: int, h: wp.float64, then: wp.float64, rate: wp.float64, J: Linked):
    """Wants of row r in a sweep. then: its coordinate at the end of the substep; rate: of the velocities now."""
    if J.t.drive[j, r] > NONE:
        ask_drive(j, r, contact, h, (then - J.now[j, r]) / h, rate, J)
    J.next[j, r] = row_want_and_piece(j, r, h, then, J)


@wp.func
def relaxed_row(j: int, r: int, driving: int, h: wp.float64, rate: wp.float64, J: Linked):
    """Wants of row r behind the places."""
    if driving == 1 and J.t.drive[j, r] > NONE:
        ask_drive_last(j, r, h, rate, J)
    J.next[j, r] = relaxed_row_piece(j, r, driving, rate, J)


@wp.func
def note_broken_joint(j: int, h: wp.float64, J: Linked):
    """Notes a joint whose reaction was over what it bears."""
    f = wp.vec3d()
    t = wp.vec3d()
    three = int(3)
    for r in range(three):
        f[r] = J.hold[j, r] + J.push[j, r]
        t[r] = J.hold[j, 3 + r] + J.push[j, 3 + r]
    f = wp.transpose(J.axis[j]) * f
    t = wp.transpose(J.turn[j]) * t
    if wp.length(f) > h * J.t.breaking[j][0] or wp.length(t) > h * J.t.breaking[j][1]:
        J.broken[j] = 1


@cache
def joint_step_functions(real):
    """Functions of an island g: placed, begun, solve, relax; of a body i: kicks, place."""
    Bodies, Moving = body_structs(real)

    @wp.func
    def place_island_bodies(g: int, b: Bodies, now: Moving, J: Linked):
        for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
            i = J.t.body[m]
            q = double_quat(now.q[i], now.o[i])
            R = rotation_to_matrix(q)
            J.X[i] = double_vec3(now.x[i]) + double_vec3(now.e[i])
            J.Q[i] = q
            J.S[i] = R * wp.diag(double_vec3(b.inverse[i])) * wp.transpose(R)

    @wp.func
    def place_joint_island(g: int, k: int, b: Bodies, now: Moving, J: Linked):
        place_island_bodies(g, b, now, J)
        for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
            set_joint_rows(j, k, J)

    @wp.func(inline=False)
    def predict_island_poses(g: int, h: wp.float64, b: Bodies, now: Moving, J: Linked):
        """X and Q where the velocities lead to, as `place_jointed_body` will have it. Where one body rests in contact, all of
        them do."""
        rests = int(0)
        for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
            if J.touched[J.t.body[m]] == CONTACT:
                rests = 1
        for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
            i = J.t.body[m]
            p = double_vec3(now.p[i])
            L = double_vec3(now.L[i])
            if rests == 1:
                J.touched[i] = CONTACT
            else:
                p = p + J.dp[i]
                L = L + J.dL[i]
            J.X[i] = double_vec3(now.x[i]) + double_vec3(now.e[i]) + h * J.t.w[i] * p
            J.Q[i] = free_rotor_step(double_quat(now.q[i], now.o[i]), L, double_vec3(b.inverse[i]), h)

    @wp.func(inline=False)
    def rate_of(j: int, k: int, placing: wp.float64, now: Moving, J: Linked):
        """Velocity at the joint and angular velocity, of b against a; placing 1: of the momenta that bodies are placed by."""
        row = k * J.t.moving
        a = J.t.a[j]
        b = J.t.b[j]
        u = wp.vec3d()
        omega = wp.vec3d()
        if b >= 0:
            more = placing
            if J.touched[b] == CONTACT:
                more = wp.float64(0.0)
            o = J.S[b] * (double_vec3(now.L[b]) + more * J.dL[b])
            u = J.t.w[b] * (double_vec3(now.p[b]) + more * J.dp[b]) + wp.cross(o, J.r_b[j])
            omega = o
        else:
            omega = J.t.anchor_o[row, j]
            u = J.t.anchor_v[row, j] + wp.cross(omega, J.r_b[j])
        if a >= 0:
            more = placing
            if J.touched[a] == CONTACT:
                more = wp.float64(0.0)
            o = J.S[a] * (double_vec3(now.L[a]) + more * J.dL[a])
            u = u - J.t.w[a] * (double_vec3(now.p[a]) + more * J.dp[a]) - wp.cross(o, J.r_a[j])
            omega = omega - o
        else:
            u = u - J.t.anchor_v[row, j] - wp.cross(J.t.anchor_o[row, j], J.r_a[j])
            omega = omega - J.t.anchor_o[row, j]
        return u, omega

    @wp.func(inline=False)
    def apply_joint_impulses(g: int, driving: int, now: Moving, J: Linked):
        """Impulses that fit all rows, on the bodies of an island."""
        solve_joint_pivots(g, driving, J)
        for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
            i = J.t.body[m]
            now.p[i] = rounded_like(double_vec3(now.p[i]) + J.P[i], now.p[i])
            now.L[i] = rounded_like(double_vec3(now.L[i]) + J.T[i], now.L[i])
            if J.touched[i] == 0:
                J.touched[i] = JOINT

    @wp.func
    def begin_joint_island(g: int, k: int, h: wp.float64, J: Linked):
        six = int(6)
        for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
            for r in range(six):
                J.hold[j, r] = wp.float64(0.0)
                J.push[j, r] = wp.float64(0.0)
                J.active[j, r] = -1
            prepare_drives(j, k, h, J)

    @wp.func(inline=False)
    def nonlinear_step_share(j: int, h: wp.float64, now: Moving, J: Linked):
        """Part of what is not linear in a step that is believed: 1 below FAST, 0 above twice that."""
        spin = wp.float64(0.0)
        if J.t.a[j] >= 0:
            spin = wp.length(J.S[J.t.a[j]] * double_vec3(now.L[J.t.a[j]]))
        if J.t.b[j] >= 0:
            spin = wp.max(spin, wp.length(J.S[J.t.b[j]] * double_vec3(now.L[J.t.b[j]])))
        return wp.clamp(wp.float64(2.0) - h * spin / FAST, wp.float64(0.0), wp.float64(1.0))

    @wp.func(inline=False)
    def ask_joint_rows(j: int, k: int, h: wp.float64, now: Moving, J: Linked):
        """Wants of the rows of a joint, and a first guess of which act."""
        e = ends_of(j, k + 1, J)
        at = joint_coordinates(e, J.t.form[j], J.t.cone[j])
        u, omega = rate_of(j, k, wp.float64(0.0), now, J)
        lead, whirl = rate_of(j, k, wp.float64(1.0), now, J)
        contact = joint_has_contact(j, J)
        part = nonlinear_step_share(j, h, now, J)
        if J.t.closed[j] == 1 and J.active[j, 0] < 0:
            measure_turn(j, e, at, part, J)
        u = J.axis[j] * u
        omega = J.turn[j] * omega
        lead = J.axis[j] * lead
        whirl = J.turn[j] * whirl
        three = int(3)
        for r in range(three):
            line = J.now[j, r] + h * lead[r]
            asked_row(j, r, contact, h, line + part * (at.shift[r] - line), u[r], J)
            line = J.now[j, 3 + r] + h * whirl[r]
            then_at = at.turned[r]
            if r == 0:
                then_at = unwind_twist_angle(then_at, J.quarters[j])
            asked_row(j, 3 + r, contact, h, line + part * (then_at - line), omega[r], J)

    @wp.func
    def solve_joint_island(g: int, k: int, h: wp.float64, b: Bodies, now: Moving, J: Linked):
        predict_island_poses(g, h, b, now, J)
        for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
            ask_joint_rows(j, k, h, now, J)
        apply_joint_impulses(g, 1, now, J)

    @wp.func(inline=False)
    def relax_joint_island(g: int, k: int, h: wp.float64, now: Moving, J: Linked):
        three = int(3)
        times = int(1)
        driving = 1 - joint_has_contact(J.t.first_joint[g], J)
        if J.t.closed[J.t.first_joint[g]] == 1:
            times = RELAX
        if driving == 1:
            for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
                renew_masses(j, J)
        for sweep in range(times):
            for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
                u, omega = rate_of(j, k, wp.float64(0.0), now, J)
                u = J.axis[j] * u
                omega = J.turn[j] * omega
                for r in range(three):
                    relaxed_row(j, r, driving, h, u[r], J)
                    relaxed_row(j, 3 + r, driving, h, omega[r], J)
                    if sweep == 0:
                        J.active[j, r] = -1
                        J.active[j, 3 + r] = -1
            apply_joint_impulses(g, driving, now, J)
        for j in range(J.t.first_joint[g], J.t.first_joint[g + 1]):
            note_broken_joint(j, h, J)
            u, omega = rate_of(j, k, wp.float64(0.0), now, J)
            J.given[j] += driven_rows_work(j, k, h, J.axis[j] * u, J.turn[j] * omega, J)

    @wp.func
    def kick_jointed_body(i: int, h: real, b: Bodies, now: Moving, J: Linked):
        """Forces of a substep."""
        half = real(0.5) * h
        J.p[i] = double_vec3(now.p[i])
        J.L[i] = double_vec3(now.L[i])
        p = kick_momentum(now.p[i], b.push[i], b.drag[i], h)
        L = kick_momentum(now.L[i], b.torque[i], b.spin_drag[i], h)
        J.dp[i] = double_vec3(kick_momentum(now.p[i], b.push[i], b.drag[i], half)) - double_vec3(p)
        J.dL[i] = double_vec3(kick_momentum(now.L[i], b.torque[i], b.spin_drag[i], half)) - double_vec3(L)
        now.p[i] = p
        now.L[i] = L
        J.touched[i] = 0

    @wp.func(inline=False)
    def place_jointed_body(i: int, h: real, b: Bodies, now: Moving, J: Linked):
        """Where a body is behind the substep."""
        p = double_vec3(now.p[i])
        L = double_vec3(now.L[i])
        if J.touched[i] != CONTACT:
            p = p + J.dp[i]
            L = L + J.dL[i]
        d = wp.float64(h)
        X = double_vec3(now.x[i]) + double_vec3(now.e[i]) + d * wp.float64(b.w[i]) * p
        q = free_rotor_step(double_quat(now.q[i], now.o[i]), L, double_vec3(b.inverse[i]), d)
        now.x[i] = rounded_like(X, now.x[i])
        now.e[i] = rounded_like(X - double_vec3(now.x[i]), now.x[i])
        now.q[i] = rounded_quaternion(q, now.q[i])
        now.o[i] = rounded_quaternion(q - double_quat(now.q[i], wp.quatd()), now.q[i])

    return SimpleNamespace(placed=place_joint_island, begun=begin_joint_island, solve=solve_joint_island, rate_of=rate_of,
                           relax=relax_joint_island, kicks=kick_jointed_body, place=place_jointed_body,
                           given=apply_joint_impulses)


def joint_substep_kernel(real, module):
    """Kernel of substeps steps[0] .. steps[1] of h [s], of steps[2] sweeps each, of islands of joints alone: a thread each.
    asleep: 1 for bodies of islands that stay, or None."""
    Bodies, Moving = body_structs(real)
    f = joint_step_functions(real)
    placed, begun, solve, relax, kicks, place = f.placed, f.begun, f.solve, f.relax, f.kicks, f.place

    def rigid_joints(steps: wp.vec3i, h: real, b: Bodies, J: Linked, asleep: wp.array(dtype=int), now: Moving):
        g = wp.tid()
        if asleep:
            if asleep[J.t.body[J.t.first_body[g]]] == 1:
                return
        d = wp.float64(h)
        placed(g, steps[0], b, now, J)
        linked = J.t.first_joint[g + 1] > J.t.first_joint[g]
        for k in range(steps[0], steps[1]):
            for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
                kicks(J.t.body[m], h, b, now, J)
            if linked:
                begun(g, k, d, J)
                for _sweep in range(steps[2]):
                    solve(g, k, d, b, now, J)
            for m in range(J.t.first_body[g], J.t.first_body[g + 1]):
                place(J.t.body[m], h, b, now, J)
            if linked:
                placed(g, k + 1, b, now, J)
                relax(g, k, d, now, J)

    return wp.kernel(rigid_joints, name="rigid_joints", module=module, enable_backward=False)
