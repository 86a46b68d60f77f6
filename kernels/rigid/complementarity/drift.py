"""Drift: what friction owes, so that what it holds does not creep.

The drift of a point is how far its places on both bodies have parted across the normal n since friction held it, where neither
body is round there and B is a collider that moves (kernels/rigid/impulse.py, `prepare`). The force that carries a body along
turns with it, and a few sweeps leave some of the slip in every substep: without a memory a box on a turntable creeps by 0.03
mm/s. Sweeps with bias take a little of the drift back. What lies on something at rest does not creep, and needs none.

A new manifold takes the drift over, point by point (kernels/rigid/lists/rows.py). It is kept as a shift of the place on B, and
so turns with B.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type

SLIPS = wp.constant(1.0e-5)            # of the friction that there is: a point that has all but that slips


@cache
def drift_holding_func(real):
    """Function (m, count, mu, rig): points of manifold m that slip, or are new, drift as those that stick move and turn about
    n, or not at all: else points would rub against one another for ever."""
    t, Rig = types(real), rig_type(real)

    @wp.func
    def friction_sticks(j: int, mu: t.vec2, rig: Rig):
        """Whether friction has held point j, and has more to give."""
        most = mu[1] * rig.c.push[j]
        return wp.length(rig.c.drift[j]) > real(0.0) and wp.abs(wp.length(rig.c.rub[j]) - most) > real(SLIPS) * most

    @wp.func(inline=False)
    def hold_points(m: int, count: int, mu: t.vec2, rig: Rig):
        n = rig.c.n[m]
        R = rig.work.turn[rig.s.frame[rig.c.b[m]]]
        held = real(0.0)
        center = t.vec3()
        mean = t.vec3()
        for i in range(count):
            if friction_sticks(4 * m + i, mu, rig):
                held += real(1.0)
                center += rig.work.r_a[4 * m + i]
                mean += rig.c.drift[4 * m + i]
        if held < real(count):
            moment = real(0.0)
            square = real(0.0)
            if held > real(0.0):
                center = center / held
                mean = mean / held
                for i in range(count):
                    if friction_sticks(4 * m + i, mu, rig):
                        arm = rig.work.r_a[4 * m + i] - center
                        moment += wp.dot(n, wp.cross(arm, rig.c.drift[4 * m + i] - mean))
                        square += wp.dot(arm, arm)
            turn = real(0.0)
            if square > real(0.0):
                turn = moment / square
            for i in range(count):
                j = 4 * m + i
                if not friction_sticks(j, mu, rig):
                    drift = mean + turn * wp.cross(n, rig.work.r_a[j] - center)
                    rig.c.core_b[j] = rig.c.core_b[j] + wp.transpose(R) * (rig.c.drift[j] - drift)
                    rig.c.drift[j] = drift

    return hold_points
