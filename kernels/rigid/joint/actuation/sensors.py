"""Readings of rigid bodies and joints where a frame has ended: joint coordinates, links, contact forces, inertial units.

An inertial measurement unit at a place r from the centre of mass reads, along its own axes S, the mean over the frame of

    f = S^T (a + alpha x r + omega x (omega x r) - g),   omega                   (specific force: g up where it rests)

a and alpha are changes of velocities over the frame; S, r and omega those in its middle, so that f has order 2 there.
"""

import warp as wp

from wsim.kernels.math.rotation import multiply_rotations, rotate_vector, unit_quaternion
from wsim.kernels.rigid.contact import first_manifold_func, rig_type
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.steps import joint_step_functions
from wsim.kernels.rigid.motion import angular_velocity_of, body_structs, double_quat, double_vec3

HALF = wp.constant(wp.float64(0.5))


def joint_reading_kernels(real, module):
    """(place, read): kernels over islands, which put joints where bodies are after k substeps, and over readings: rows
    (joint, row), coordinates [m], [rad] and their rates."""
    (Bodies, Moving), f = body_structs(real), joint_step_functions(real)
    placed, rate_of = f.placed, f.rate_of

    def place_read_joints(k: int, b: Bodies, now: Moving, J: Linked):
        placed(wp.tid(), k, b, now, J)

    def read_joint_rows(k: int, rows: wp.array(dtype=wp.vec2i), now: Moving, J: Linked, position: wp.array(dtype=wp.float64),
                        velocity: wp.array(dtype=wp.float64)):
        e = wp.tid()
        j = rows[e][0]
        r = rows[e][1]
        u, omega = rate_of(j, k, wp.float64(0.0), now, J)
        u = J.axis[j] * u
        if r > 2:
            u = J.turn[j] * omega
        position[e] = J.now[j, r]
        velocity[e] = u[r % 3]

    return [wp.kernel(each, name=each.__name__, module=module, enable_backward=False)
            for each in (place_read_joints, read_joint_rows)]


def link_reading_kernel(real, module):
    """Kernel over bodies: place [m] and quaternion (x, y, z, w) of the frame, velocity [m/s] of its origin and angular velocity
    [rad/s], world. origin, center, axes: where centres of mass began; in the frame; of the principal axes."""
    Bodies, Moving = body_structs(real)
    vec3 = wp.array(dtype=wp.vec3d)

    def read_links(b: Bodies, now: Moving, origin: vec3, center: vec3, axes: wp.array(dtype=wp.quatd), place: vec3,
                   turn: wp.array(dtype=wp.quatd)):
        i = wp.tid()
        Q = multiply_rotations(unit_quaternion(double_quat(now.q[i], now.o[i])), wp.quat_inverse(axes[i]))
        turn[i] = Q
        place[i] = origin[i] + double_vec3(now.x[i]) + double_vec3(now.e[i]) - rotate_vector(Q, center[i])

    def read_link_rates(b: Bodies, now: Moving, center: vec3, turn: wp.array(dtype=wp.quatd), velocity: vec3, spin: vec3):
        i = wp.tid()
        q = unit_quaternion(double_quat(now.q[i], now.o[i]))
        omega = angular_velocity_of(q, double_vec3(now.L[i]), double_vec3(b.inverse[i]))
        spin[i] = omega
        velocity[i] = wp.float64(b.w[i]) * double_vec3(now.p[i]) - wp.cross(omega, rotate_vector(turn[i], center[i]))

    return [wp.kernel(each, name=each.__name__, module=module, enable_backward=False) for each in (read_links, read_link_rates)]


def contact_force_kernel(real, module):
    """Kernel over bodies: sum of the contact forces on each in the last substep of h [s], world [N], in the list's order."""
    Rig, first_manifold = rig_type(real), first_manifold_func(real)

    def sum_contact_forces(h: real, worlds: int, rig: Rig, force: wp.array(dtype=wp.vec3d)):
        i = wp.tid()
        w = i // (rig.b.w.shape[0] // worlds)
        found = wp.vec3d()
        for m in range(first_manifold(w, rig), first_manifold(w + 1, rig)):
            sign = wp.float64(0.0)
            if rig.s.frame[rig.c.a[m]] == i:
                sign = wp.float64(1.0)
            elif rig.s.frame[rig.c.b[m]] == i:
                sign = wp.float64(-1.0)
            for e in range(rig.c.count[m]):
                found += sign * double_vec3(rig.c.push[4 * m + e] * rig.c.n[m] + rig.c.rub[4 * m + e])
        force[i] = found / wp.float64(h)

    return wp.kernel(sum_contact_forces, name="sum_contact_forces", module=module, enable_backward=False)


def inertial_unit_kernel(real, module):
    """Kernel over worlds: readings of a unit at `at` [m] from the centre of mass, turned by `turn`, both in principal axes, of
    body first + world * each. before: where the frame began, dt [s] ago."""
    Bodies, Moving = body_structs(real)
    vec3 = wp.array(dtype=wp.vec3d)

    @wp.struct
    class Unit:
        first: int
        each: int
        dt: wp.float64
        at: wp.vec3d
        turn: wp.quatd
        gravity: vec3                                   # of worlds

    def read_inertial_unit(unit: Unit, b: Bodies, before: Moving, now: Moving, force: vec3, spin: vec3):
        w = wp.tid()
        i = unit.first + w * unit.each
        inverse = double_vec3(b.inverse[i])
        q0 = unit_quaternion(double_quat(before.q[i], before.o[i]))
        q1 = unit_quaternion(double_quat(now.q[i], now.o[i]))
        if wp.dot(q0, q1) < wp.float64(0.0):
            q0 = -q0
        q = unit_quaternion(q0 + q1)
        spin0 = angular_velocity_of(q0, double_vec3(before.L[i]), inverse)
        spin1 = angular_velocity_of(q1, double_vec3(now.L[i]), inverse)
        omega = HALF * (spin0 + spin1)
        r = rotate_vector(q, unit.at)
        a = (wp.float64(b.w[i]) / unit.dt) * (double_vec3(now.p[i]) - double_vec3(before.p[i]))
        a += wp.cross((spin1 - spin0) / unit.dt, r) + wp.cross(omega, wp.cross(omega, r)) - unit.gravity[w]
        back = wp.quat_inverse(multiply_rotations(q, unit.turn))
        force[w] = rotate_vector(back, a)
        spin[w] = rotate_vector(back, omega)

    return Unit, wp.kernel(read_inertial_unit, name="read_inertial_unit", module=module, enable_backward=False)
