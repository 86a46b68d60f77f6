"""Bodies as colliders of points, and what both give each other in a substep. The solve:
kernels/rigid/touch/body_point_solve.py.

    place     rows of the table of colliders (kernels/contact/project.py) go where the bodies are, and would go by momenta alone
    sort      slots of contacts (kernels/contact/search.py) in the order of bodies; within a body in that of slots
    found     once a search has ended: arms where the substep begins, and the planes as they were found. A point that goes by h
              v' gains x x J of angular momentum, with x of that begin; with arms of its end h (v' - V') x J would be lost
    gather    what a star reads of points, before each of its solves; `rise`, of velocities
    tell      the planes go with the body; kernels/contact/project.py then pushes the points as the star has foreseen
    take      the body gets the opposite of what its points have got, summed in a fixed order: momentum is kept to rounding

An impulse is J = P / (w c), with c of the integrator (2h/3 by BDF2, h/4 by the implicit midpoint, else h), which moves a
point's velocity by w J whatever integrates it. What a contact leaves is not always the velocity that the step has made of it:
restitution, and BDF2, which throws back half of the speed it meets a wall with. So velocities behind a substep are solved for
once more (`rise` in kernels/rigid/touch/rebound.py): along the normals of contacts that push, that of the way over h, or of a
rebound,

    n.v' = max(min(n.V / h, 0), -restitution n.v_before)          V: relative way; the latter where n.v_before < -slow

by impulses that change no place, and a memory is told of both (`remember`).
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.contact import project
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import conjugate_rotation, multiply_rotations, rotate_vector, unit_quaternion
from wsim.kernels.position_based.rolling.law import roll_type
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.motion import double_quat, double_vec3, free_rotor_step
from wsim.kernels.rigid.touch.body_point_solve import star_structs as stars


@cache
def touch_structs(real):
    """(Shapes, Found, Points)."""
    t, Roll = types(real), roll_type(real)

    @wp.struct
    class BodyShapeRows:
        """Rows of the table that bodies have, (rows,)."""
        row: wp.array(dtype=int)
        body: wp.array(dtype=int)
        place: wp.array(dtype=wp.transformd)      # in the frame of the centre of mass and the principal axes
        ball: wp.array(dtype=wp.vec4d)            # centre in the shape's own frame, radius with the gap [m]
        origin: wp.array(dtype=wp.vec3d)          # of the row's object [m]
        begin: wp.array(dtype=wp.vec3d)           # of bodies: where x is counted from [m], (bodies,)
        of: wp.array(dtype=int)                   # body of each row of the whole table, -1: a collider
        restitution: wp.array(dtype=real)         # of each row of the whole table
        object: wp.array(dtype=wp.vec3d)          # origin of each object [m]

    @wp.struct
    class FoundContacts:
        """Of contacts, sorted as the rows of a star are, where nothing else is said."""
        b: wp.array(dtype=real)
        u: wp.array(dtype=t.vec3)
        before: wp.array(dtype=real)              # velocity along n when the contact was found [m/s]
        q: wp.array(dtype=real)                   # of slots: impulse along n that changes no place [N s]
        ahead: wp.array(dtype=wp.vec3d)           # of bodies: velocity and spin that contacts were found with, (2 bodies,)
        total: wp.array(dtype=wp.vec3d)           # impulse that points have got of a body, and its moment, (2 bodies,)
        still: wp.array(dtype=wp.vec3d)           # the same of impulses that change no place
        roll: Roll                                # balls that turn, where some do
        rolled: wp.array(dtype=wp.vec3d)          # torque of rolling that balls have got of a body, (bodies,)

    @wp.struct
    class TouchingPoints:
        w: wp.array(dtype=real)
        object: wp.array(dtype=int)
        friction: wp.array(dtype=t.vec2)
        x: wp.array(dtype=t.vec3)
        v: wp.array(dtype=t.vec3)
        e: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        push: wp.array(dtype=t.vec3)              # of slots
        h: real
        g: real
        c: real                                   # [s]
        slow: real                                # [m/s]

    return BodyShapeRows, FoundContacts, TouchingPoints


@cache
def body_place_kernel(real, module):
    """Kernel over rows of bodies: pose at substep k, what it will be by momenta, the way there, and the ball about it.
    arrived: 1 where bodies stand at the end of substep k: pose[k + 1] alone."""
    t, Shapes, Rig, vec3d = types(real), touch_structs(real)[0], rig_type(real), wp.vec3d

    @wp.func
    def rounded_transform(p: vec3d, q: wp.quatd):
        return t.transform(t.vec3(real(p[0]), real(p[1]), real(p[2])), t.quat(real(q[0]), real(q[1]), real(q[2]), real(q[3])))

    def pose_body_colliders(shapes: Shapes, rig: Rig, k: int, arrived: int, h: wp.float64,
                            pose_out: wp.array2d(dtype=t.transform),
                            step_out: wp.array2d(dtype=t.transform), ball_out: wp.array2d(dtype=t.vec4)):
        j = wp.tid()
        i = shapes.body[j]
        row = shapes.row[j]
        q0 = unit_quaternion(double_quat(rig.now.q[i], rig.now.o[i]))
        at = shapes.place[j]
        own = wp.transform_get_translation(at)
        turn = wp.transform_get_rotation(at)
        x0 = (shapes.begin[i] - shapes.origin[j]) + double_vec3(rig.now.x[i]) + double_vec3(rig.now.e[i])
        p0 = x0 + rotate_vector(q0, own)
        if arrived != 0:
            pose_out[k + 1, row] = rounded_transform(p0, multiply_rotations(q0, turn))
            return
        q1 = free_rotor_step(q0, double_vec3(rig.now.L[i]), double_vec3(rig.b.inverse[i]), h)
        p1 = x0 + (h * wp.float64(rig.b.w[i])) * double_vec3(rig.now.p[i]) + rotate_vector(q1, own)
        a0 = multiply_rotations(q0, turn)
        a1 = multiply_rotations(q1, turn)
        pose_out[k, row] = rounded_transform(p0, a0)
        pose_out[k + 1, row] = rounded_transform(p1, a1)
        step_out[k, row] = rounded_transform(p1 - p0, multiply_rotations(a1, conjugate_rotation(a0)))
        ball = shapes.ball[j]
        center = vec3d(ball[0], ball[1], ball[2])
        c0 = p0 + rotate_vector(a0, center)
        c1 = p1 + rotate_vector(a1, center)
        c = wp.float64(0.5) * (c0 + c1)
        radius = ball[3] + wp.float64(1.5) * wp.length(c1 - c0)
        ball_out[k, row] = t.vec4(real(c[0]), real(c[1]), real(c[2]), real(radius))

    return wp.kernel(pose_body_colliders, name=f"place_bodies_{t.name}", module=module, enable_backward=False)


@cache
def contact_key_kernel(real, module):
    """Kernel over slots: the body of each, or the number of bodies."""
    Slots = project.slot_type(real)

    def touch_keys(s: Slots, of: wp.array(dtype=int), bodies: int, key_out: wp.array(dtype=int), slot_out: wp.array(dtype=int)):
        j = wp.tid()
        body = bodies
        if j // s.points < s.count[j % s.points]:
            if of[s.row[j]] >= 0:
                body = of[s.row[j]]
        key_out[j] = body
        slot_out[j] = j

    return wp.kernel(touch_keys, name=f"touch_keys_{types(real).name}", module=module, enable_backward=False)


@cache
def touch_begin_funcs(real, rolling: bool = False):
    """(ahead, found): functions of body i: velocity and spin that contacts are found with, and nothing is given yet; of contact
    m: its arm, and the plane as it was found. rolling: arms of balls that turn lead to where they touch."""
    t, (Shapes, Found, Points), Rows = types(real), touch_structs(real), stars(real)[0]
    Slots, Rig = project.slot_type(real), rig_type(real)

    @wp.func
    def predict_body_velocity(rig: Rig, i: int, out: Found):
        n = rig.b.w.shape[0]
        out.ahead[i] = wp.float64(rig.b.w[i]) * double_vec3(rig.now.p[i])
        out.ahead[n + i] = wp.mat33d(rig.work.spread[i]) * double_vec3(rig.now.L[i])
        out.total[i] = wp.vec3d()
        out.total[n + i] = wp.vec3d()
        if wp.static(rolling):
            out.rolled[i] = wp.vec3d()
        out.still[i] = wp.vec3d()
        out.still[n + i] = wp.vec3d()

    @wp.func
    def record_found_contact(shapes: Shapes, rig: Rig, s: Slots, p: Points, m: int, rows_out: Rows, out: Found):
        j = rows_out.slot[m]
        i = j % s.points
        body = shapes.of[s.row[j]]
        n = s.n[j]
        center = shapes.begin[body] - shapes.object[p.object[i]] + double_vec3(rig.now.x[body])
        r = (double_vec3(p.x[i]) - center) + (double_vec3(p.e[i]) - double_vec3(rig.now.e[body]))
        if wp.static(rolling):
            if out.roll.own[i][0] > real(0.0):
                r -= double_vec3(out.roll.own[i][2] * n)
        rows_out.n[m] = n
        rows_out.r[m] = t.vec3(real(r[0]), real(r[1]), real(r[2]))
        out.b[m] = s.b[j]
        out.u[m] = s.u[j]
        out.before[m] = wp.dot(n, p.v[i] - s.u[j])

    return predict_body_velocity, record_found_contact


@cache
def touch_begin_kernel(real, module, rolling: bool = False):
    """Kernel over bodies, see `touch_begin_funcs`."""
    Found, Rig, own = touch_structs(real)[1], rig_type(real), touch_begin_funcs(real, rolling)[0]

    def touch_begin(rig: Rig, out: Found):
        own(rig, wp.tid(), out)

    return wp.kernel(touch_begin, name=f"touch_begin_{types(real).name}", module=module, enable_backward=False)


@cache
def found_contact_kernel(real, module, rolling: bool = False):
    """Kernel over the room for contacts, see `touch_begin_funcs`."""
    (Shapes, Found, Points), Rows, own = touch_structs(real), stars(real)[0], touch_begin_funcs(real, rolling)[1]
    Slots, Rig = project.slot_type(real), rig_type(real)

    def touch_found(shapes: Shapes, rig: Rig, s: Slots, p: Points, rows_out: Rows, out: Found):
        m = wp.tid()
        if m < rows_out.first[rig.b.w.shape[0]]:
            own(shapes, rig, s, p, m, rows_out, out)

    return wp.kernel(touch_found, name=f"touch_found_{types(real).name}", module=module, enable_backward=False)


@cache
def group_bound_kernel(module):
    """Kernel over groups + 1: where each begins among the sorted numbers."""

    def find_group_bounds(keys: wp.array(dtype=int), room: int, first_out: wp.array(dtype=int)):
        group = wp.tid()
        low = int(0)
        high = room
        while low < high:
            middle = (low + high) // 2
            if keys[middle] < group:
                low = middle + 1
            else:
                high = middle
        first_out[group] = low

    return wp.kernel(find_group_bounds, name="bounds_of_groups", module=module, enable_backward=False)
