"""Momenta of bodies under leapfrog's points as they are read at the end of a frame: with half of the last substep behind them.

Points are read behind a last half kick, of which what contacts would take back, m delta, is left out (`settle` of
kernels/motion/explicit.py): the half of an impulse that their bodies have not given yet. So it is given where bodies are read,
with half of all that others do to them in a substep,

    p_read = p + (p' - p_0 + J) / 2 - sum m delta            p_0 .. p': of the last substep, J what points had of it

so that momentum is that of points and bodies together, and what rests is read as resting.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact import project
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.motion import double_vec3
from wsim.kernels.rigid.touch.body_point_solve import star_structs as stars
from wsim.kernels.rigid.touch.points import touch_structs


@cache
def half_impulse_kernel(real, module):
    """Kernel over bodies: half of what others than points have done; from then on `total` is 0."""
    t, Found, Rig = types(real), touch_structs(real)[1], rig_type(real)
    vectors = wp.array(dtype=t.vec3)

    def touch_half(rig: Rig, found: Found, p_out: vectors, L_out: vectors):
        i = wp.tid()
        n = rig.b.w.shape[0]
        p = wp.vec3d()
        L = wp.vec3d()
        if rig.work.asleep[i] == 0:
            p = wp.float64(0.5) * (double_vec3(rig.now.p[i]) - double_vec3(rig.work.p0[i]) + found.total[i] + found.still[i])
            L = wp.float64(0.5) * (double_vec3(rig.now.L[i]) - double_vec3(rig.work.L0[i]) + found.total[n + i]
                                   + found.still[n + i])
        p_out[i] = t.vec3(real(p[0]), real(p[1]), real(p[2]))
        L_out[i] = t.vec3(real(L[0]), real(L[1]), real(L[2]))
        found.total[i] = wp.vec3d()
        found.total[n + i] = wp.vec3d()

    return wp.kernel(touch_half, name=f"touch_half_{t.name}", module=module, enable_backward=False)


@cache
def half_kick_kernel(real, module):
    """Kernel over the room for contacts: what was left out of a point's half kick, bare to v, by the part of its push that is
    of this contact; `f` is its mass."""
    t, Points, Rows, Slots = types(real), touch_structs(real)[2], stars(real)[0], project.slot_type(real)
    vectors = wp.array(dtype=t.vec3)

    def touch_back(s: Slots, p: Points, bare: vectors, bodies: int, rows_out: Rows, back_out: vectors):
        m = wp.tid()
        if m >= rows_out.first[bodies]:
            return
        j = rows_out.slot[m]
        i = j % s.points
        whole = real(0.0)
        for slot in range(s.count[i]):
            whole += wp.length(p.push[slot * s.points + i])
        given = t.vec3()
        if whole > real(0.0):
            given = (wp.length(p.push[j]) / whole) * (p.v[i] - bare[i])
        back_out[j] = given
        rows_out.f[m] = real(1.0) / p.w[i]

    return wp.kernel(touch_back, name=f"touch_back_{t.name}", module=module, enable_backward=False)
