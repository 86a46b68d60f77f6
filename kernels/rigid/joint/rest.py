"""Sleep of islands of joints that meet nothing: a thread each, before the substeps of a frame.

The rule is that of kernels/rigid/graph/sleep.py, with the islands known from the start: an island sleeps once all its bodies
have been slow for CALM seconds, unless one of its joints stirs. Bodies that no joint has stay as they are.
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.graph.sleep import CALM
from wsim.kernels.rigid.joint.tables import joint_table_structs as tables
from wsim.kernels.rigid.motion import body_structs


def joint_sleep_kernel(real, module):
    """Kernel over islands, before a frame of `time` [s]. Slow is what is no faster than `speed` [m/s].
    stir: of joints (joints,): 1 where its island may not sleep. calm [s] and asleep: of bodies."""
    t, (Bodies, Moving), (Joints, _) = types(real), body_structs(real), tables()

    @wp.func
    def mean_square_speed(i: int, b: Bodies, now: Moving):
        """Twice the kinetic energy over the mass [m^2/s^2]."""
        v = b.w[i] * now.p[i]
        L = wp.quat_rotate_inv(now.q[i], now.L[i])
        return wp.dot(v, v) + b.w[i] * wp.dot(L, wp.cw_mul(b.inverse[i], L))

    def rigid_joints_rest(time: real, speed: real, b: Bodies, J: Joints, stir: wp.array(dtype=int), now: Moving,
                          calm: wp.array(dtype=real), asleep: wp.array(dtype=int)):
        g = wp.tid()
        if J.first_joint[g + 1] == J.first_joint[g]:
            return
        sleeps = int(1)
        for j in range(J.first_joint[g], J.first_joint[g + 1]):
            if stir[j] == 1:
                sleeps = 0
        for m in range(J.first_body[g], J.first_body[g + 1]):
            i = J.body[m]
            slow = real(0.0)
            if mean_square_speed(i, b, now) <= speed * speed:
                slow = wp.min(calm[i] + time, real(CALM))
            calm[i] = slow
            if slow < real(CALM):
                sleeps = 0
        for m in range(J.first_body[g], J.first_body[g + 1]):
            i = J.body[m]
            asleep[i] = sleeps
            if sleeps == 1:
                now.p[i] = t.vec3()
                now.L[i] = t.vec3()

    return wp.kernel(rigid_joints_rest, name="rigid_joints_rest", module=module, enable_backward=False)
