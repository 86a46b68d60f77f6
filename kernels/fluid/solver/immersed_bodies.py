"""Rigid bodies in a fluid through a frame: from the state into the steps of the fluid, and the fluid's impulses back.

    take    centre, orientation and momenta of the state where a frame begins
    swim    a step begins: the pose that the grid sees, c + h v; then p += h push, L += h torque
    pushed  impulses of the pressure: p += I, L += r x I
    goes    the step ends: c += h v,  q turns by h omega
    give    the mean force of a frame, sum of I / frame: what moves the bodies in the end, contacts and all, has it beside their
            weight

Vectors are the world's, places count from the low corner of the domain.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.math.real import types
from wsim.kernels.rigid import motion


@cache
def immersed_structs(real) -> SimpleNamespace:
    t = types(real)

    @wp.struct
    class Afloat:
        row: wp.array(dtype=int)               # of the bodies of the state, (bodies,)
        base: wp.array(dtype=t.vec3)           # place that their x counts from [m]
        reach: wp.array(dtype=real)            # radius about the centre that holds all their shapes [m]
        center: wp.array(dtype=t.vec3)         # [m]
        turn: wp.array(dtype=t.quat)           # of the principal axes (x, y, z, w)
        at: wp.array(dtype=t.vec3)             # centre and turn as the grid sees them in a step
        seen: wp.array(dtype=t.quat)
        p: wp.array(dtype=t.vec3)              # momentum [kg m/s]
        L: wp.array(dtype=t.vec3)              # angular momentum about the centre [kg m^2/s]
        v: wp.array(dtype=t.vec3)              # [m/s]
        spin: wp.array(dtype=t.vec3)           # [rad/s]
        given_p: wp.array(dtype=t.vec3)        # impulses of the fluid since the frame began
        given_L: wp.array(dtype=t.vec3)

    return SimpleNamespace(Afloat=Afloat)


@cache
def rotation_step_function(real):
    """Function (q, way) -> q after a turn by the rotation vector way [rad], of the world."""
    t = types(real)

    @wp.func
    def rotate_by_vector(q: t.quat, way: t.vec3):
        angle = wp.length(way)
        found = q
        if angle > real(0.0):
            found = wp.normalize(wp.quat_from_axis_angle(way / angle, angle) * q)
        return found

    return rotate_by_vector


@cache
def immersed_read_kernel(real, module):
    """Kernel over bodies; most_out: the greatest speed of their points [m/s], as of other things before."""
    t, S, (Bodies, Moving) = types(real), immersed_structs(real), motion.body_structs(real)

    def read_immersed_bodies(b: Bodies, now: Moving, s: S.Afloat, out: S.Afloat, most_out: wp.array(dtype=real)):
        k = wp.tid()
        i = s.row[k]
        q = wp.normalize(now.q[i])
        out.center[k] = s.base[k] + now.x[i] + now.e[i]
        out.turn[k] = q
        out.p[k] = now.p[i]
        out.L[k] = now.L[i]
        out.given_p[k] = t.vec3()
        out.given_L[k] = t.vec3()
        spin = motion.angular_velocity_of(q, now.L[i], b.inverse[i])
        wp.atomic_max(most_out, 0, b.w[i] * wp.length(now.p[i]) + s.reach[k] * wp.length(spin))

    return wp.kernel(read_immersed_bodies, name=f"afloat_take_{types(real).name}", module=module, enable_backward=False)


@cache
def immersed_step_kernel(real, module):
    """Kernel over bodies. part: of the step that passes; moves: whether the grid sees them elsewhere."""
    S, (Bodies, _), turned = immersed_structs(real), motion.body_structs(real), rotation_step_function(real)

    def step_immersed_bodies(b: Bodies, clock: wp.array(dtype=real), part: real, moves: int, s: S.Afloat, out: S.Afloat):
        k = wp.tid()
        i = s.row[k]
        h = part * clock[0]
        p = s.p[k]
        L = s.L[k]
        seen = s.seen[k]
        if moves != 0:
            seen = turned(s.turn[k], h * motion.angular_velocity_of(s.turn[k], L, b.inverse[i]))
            out.at[k] = s.center[k] + (h * b.w[i]) * p
            out.seen[k] = seen
        p = motion.kick_momentum(p, b.push[i], b.drag[i], h)
        L = motion.kick_momentum(L, b.torque[i], b.spin_drag[i], h)
        out.p[k] = p
        out.L[k] = L
        out.v[k] = b.w[i] * p
        out.spin[k] = motion.angular_velocity_of(seen, L, b.inverse[i])

    return wp.kernel(step_immersed_bodies, name=f"afloat_swim_{types(real).name}", module=module, enable_backward=False)


@cache
def immersed_shape_kernel(real, module):
    """Kernel over shapes: those of bodies go where the grid sees them. place, turn: in the bodies' principal axes."""
    t, S, M = types(real), immersed_structs(real), moved.fluid_shape_structs(real)

    def move_immersed_shapes(place: wp.array(dtype=t.vec3), turn: wp.array(dtype=t.quat), s: S.Afloat, shapes: M.Shapes,
                             out: M.Shapes):
        k = wp.tid()
        b = shapes.of.owner[k]
        if b >= 0:
            out.of.pose[0, k] = t.transform(s.at[b] + wp.quat_rotate(s.seen[b], place[k]), s.seen[b] * turn[k])

    return wp.kernel(move_immersed_shapes, name=f"afloat_carry_{types(real).name}", module=module, enable_backward=False)


@cache
def body_sum_function(real):
    """Function (parts, k, bodies) -> sum of the parts of body k, in their order."""
    t = types(real)

    @wp.func
    def sum_body_parts(part: wp.array(dtype=wp.vec3d), k: int, bodies: int):
        n = part.shape[0] // bodies
        sum = wp.vec3d()
        for m in range(k * n, (k + 1) * n):
            sum += part[m]
        return t.vec3(real(sum[0]), real(sum[1]), real(sum[2]))

    return sum_body_parts


@cache
def fluid_impulse_kernel(real, module):
    """Kernel over bodies. scale: of the sums `force` and `torque` (parts,), to impulses."""
    S, (Bodies, _), whole = immersed_structs(real), motion.body_structs(real), body_sum_function(real)

    def apply_fluid_impulse(b: Bodies, scale: real, force: wp.array(dtype=wp.vec3d), torque: wp.array(dtype=wp.vec3d),
                            s: S.Afloat, out: S.Afloat):
        k = wp.tid()
        i = s.row[k]
        impulse = scale * whole(force, k, s.row.shape[0])
        twist = scale * whole(torque, k, s.row.shape[0])
        p = s.p[k] + impulse
        L = s.L[k] + twist
        out.p[k] = p
        out.L[k] = L
        out.v[k] = b.w[i] * p
        out.spin[k] = motion.angular_velocity_of(s.seen[k], L, b.inverse[i])
        out.given_p[k] = s.given_p[k] + impulse
        out.given_L[k] = s.given_L[k] + twist

    return wp.kernel(apply_fluid_impulse, name=f"afloat_pushed_{types(real).name}", module=module, enable_backward=False)


@cache
def immersed_move_kernel(real, module):
    """Kernel over bodies. part: of the step that passes."""
    S, turned = immersed_structs(real), rotation_step_function(real)

    def move_immersed_bodies(clock: wp.array(dtype=real), part: real, s: S.Afloat, out: S.Afloat):
        k = wp.tid()
        h = part * clock[0]
        out.center[k] = s.center[k] + h * s.v[k]
        out.turn[k] = turned(s.turn[k], h * s.spin[k])

    return wp.kernel(move_immersed_bodies, name=f"afloat_goes_{types(real).name}", module=module, enable_backward=False)


@cache
def fluid_force_kernel(real, module):
    """Kernel over bodies: the mean force and torque of the frame on top of what is there."""
    t, S = types(real), immersed_structs(real)

    def write_fluid_force(clock: wp.array(dtype=real), s: S.Afloat, push_out: wp.array(dtype=t.vec3),
                          torque_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        i = s.row[k]
        push_out[i] = push_out[i] + s.given_p[k] / clock[3]
        torque_out[i] = torque_out[i] + s.given_L[k] / clock[3]

    return wp.kernel(write_fluid_force, name=f"afloat_give_{types(real).name}", module=module, enable_backward=False)
