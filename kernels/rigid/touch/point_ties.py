"""Points that are tied to rigid bodies, both ways: three planes a point, along the axes, that pull as well as they push.

    C_k = e_k . (x + d - a(q)) = 0,  k = 1, 2, 3       a: place on the body, where its momentum leads it in the substep
    lam_k' = lam_k - C_k                               (kernels/contact/project.py), of any sign, without friction

They are slots of the contacts that points have with bodies (points.py), so that the star of a body (body_point_solve.py),
Newton's active set and the exchange of momentum know them: `ContactSlots.tie` is k of such a slot, 0 of a contact. A tied point
has no other contacts.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact import project
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import rotate_vector, unit_quaternion
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.motion import double_quat, double_vec3, free_rotor_step
from wsim.kernels.rigid.touch.points import touch_structs


@wp.struct
class TiedPoints:
    """By tied point: its place in the arrays, its body, a row of that in the table of colliders, and where the body holds it,
    from the centre of mass, in the principal axes [m]."""

    point: wp.array(dtype=int)
    body: wp.array(dtype=int)
    row: wp.array(dtype=int)
    place: wp.array(dtype=wp.vec3d)


@cache
def point_tie_kernel(real, module):
    """Kernel over tied points, behind a search: their slots. h [s]."""
    t, (Shapes, _, Points), Slots, Rig = types(real), touch_structs(real), project.slot_type(real), rig_type(real)

    def write_point_ties(ties: TiedPoints, shapes: Shapes, rig: Rig, p: Points, h: wp.float64, s: Slots,
                         push_out: wp.array(dtype=t.vec3)):
        m = wp.tid()
        i = ties.point[m]
        body = ties.body[m]
        q0 = unit_quaternion(double_quat(rig.now.q[body], rig.now.o[body]))
        q1 = free_rotor_step(q0, double_vec3(rig.now.L[body]), double_vec3(rig.b.inverse[body]), h)
        x0 = (shapes.begin[body] - shapes.object[p.object[i]]) + double_vec3(rig.now.x[body]) + double_vec3(rig.now.e[body])
        a0 = x0 + rotate_vector(q0, ties.place[m])
        a1 = x0 + (h * wp.float64(rig.b.w[body])) * double_vec3(rig.now.p[body]) + rotate_vector(q1, ties.place[m])
        gap = double_vec3(p.x[i]) - a1
        u = (a1 - a0) / h
        for k in range(wp.static(3)):
            j = k * s.points + i
            n = t.vec3()
            n[k] = real(1.0)
            s.row[j] = ties.row[m]
            s.n[j] = n
            s.b[j] = real(gap[k])
            s.u[j] = t.vec3(real(u[0]), real(u[1]), real(u[2]))
            s.tie[j] = k + 1
            push_out[j] = t.vec3()
        s.count[i] = 3

    return wp.kernel(write_point_ties, name=f"point_ties_{t.name}", module=module, enable_backward=False)
