"""The time of an impact within a substep: a body goes on from there, as if it had come with the speed that it leaves with.

    u' = u + (1 + e) U,   U = sqrt(u^2 + 2 a gap)       closing speed at the impact, which is 2 gap / (U - u) = t from now
    x <- x - t dv,   q <- exp(-t domega) q              dv, domega: what the impulse changes

x + h v' is then where a body is that flew on with v until t and with v' from t on. So neither the height of a bounce nor when
it comes knows the step, and both have the derivatives that a closed form has: without t, what is left of a substep behind an
impact would jump with the height from which a ball falls.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import multiply_rotations, rotation_exponential
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.motion import double_quat, double_vec3, rounded_quaternion


@cache
def impact_time_shift_func(real):
    """Function of a contact m: its bodies are moved to where they would have come from."""
    t, Rig = types(real), rig_type(real)

    @wp.func
    def move_body_back(f: int, dv: t.vec3, turn: t.vec3, rig: Rig):
        """A body by -dv [m] and -turn [rad]."""
        if f < rig.b.w.shape[0]:
            step = rig.now.e[f] - dv
            x = rig.now.x[f] + step
            rig.now.e[f] = step - (x - rig.now.x[f])
            rig.now.x[f] = x
            r = rotation_exponential(-double_vec3(turn))
            q = multiply_rotations(wp.quatd(r[0], r[1], r[2], r[3]), double_quat(rig.now.q[f], rig.now.o[f]))
            rig.now.q[f] = rounded_quaternion(q, rig.now.q[f])
            rig.now.o[f] = rounded_quaternion(q - double_quat(rig.now.q[f], wp.quatd()), rig.now.q[f])

    @wp.func
    def shift_to_impact_time(m: int, k: int, h: real, biased: int, rig: Rig):
        n = rig.c.n[m]
        P = t.vec3()
        T_a = t.vec3()
        T_b = t.vec3()
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            if rig.work.goal[j] >= real(0.0) and rig.work.hit[j] > real(0.0):
                one = rig.work.when[j] * (rig.work.hit[j] * n + rig.work.scrape[j])
                P += one
                T_a += wp.cross(rig.work.r_a[j], one)
                T_b += wp.cross(rig.work.r_b[j], one)
        f = rig.s.frame[rig.c.a[m]]
        g = rig.s.frame[rig.c.b[m]]
        if f < rig.b.w.shape[0]:
            move_body_back(f, rig.b.w[f] * P, rig.work.spread[f] * T_a, rig)
        if g < rig.b.w.shape[0]:
            move_body_back(g, -rig.b.w[g] * P, -(rig.work.spread[g] * T_b), rig)

    return shift_to_impact_time
