"""Which shapes may meet until manifolds are made anew: balls about them, grown by how far their bodies can go.

Of shapes i < j: not both of colliders, not of one body, of one world (or all), and

    |c_i - c_j| < ball_i + ball_j + way_i + way_j,    way = time (|v| + |a| time) + a part of the size

A thread takes shape i and counts, then, behind a scan, writes its partners in order: the list is sorted, and the same from run
to run. Places are float64 sums of the bodies' origins and displacements.
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import whole

SLACK = wp.constant(0.02)          # part of a ball's radius within which shapes count as near, however slow


def reach(real, module):
    """Kernel of the centre, (ball, way) of every shape: where it has no end, its ball is < 0. Also notes where bodies are."""
    t = types(real)
    Rig = whole(real)

    def rigid_reach(rig: Rig, k: int, time: real):
        i = wp.tid()
        f = rig.s.frame[i]
        n = rig.b.w.shape[0]
        x = t.vec3()
        q = t.quat()
        way = real(0.0)
        if f < n:
            x = rig.now.x[f]
            q = rig.now.q[f]
            way = time * rig.b.w[f] * (wp.length(rig.now.p[f]) + time * wp.length(rig.b.push[f]))
            spin = wp.length(wp.cw_mul(rig.b.inverse[f], wp.quat_rotate_inv(q, rig.now.L[f])))
            way += time * spin * wp.length(wp.transform_get_translation(rig.s.place[i]))
        else:
            row = k * rig.still.moving
            x = rig.still.x[row, f - n]
            q = rig.still.q[row, f - n]
            turning = wp.length(rig.still.omega[row, f - n]) * wp.max(rig.s.ball[i], real(0.0))
            way = time * (wp.length(rig.still.v[row, f - n]) + turning)
        rig.work.from_x[f] = x
        p = x + wp.quat_rotate(q, wp.transform_get_translation(rig.s.place[i]))
        rig.work.center[i] = rig.s.origin[f] + wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))
        rig.work.span[i] = t.vec2(rig.s.ball[i], way + real(SLACK) * wp.max(rig.s.ball[i], real(0.0)))

    return wp.kernel(rigid_reach, name="rigid_reach", module=module, enable_backward=False)


def listed(real, module):
    """Kernel that counts the partners of each shape (write = 0), or writes them behind `first`, where there is room."""
    Rig = whole(real)

    @wp.func
    def near(i: int, j: int, rig: Rig):
        bodies = rig.b.w.shape[0]
        fi = rig.s.frame[i]
        fj = rig.s.frame[j]
        if fi == fj or (fi >= bodies and fj >= bodies):
            return False
        if rig.s.world[i] != rig.s.world[j] and rig.s.world[i] >= 0 and rig.s.world[j] >= 0:
            return False
        one = rig.work.span[i]
        other = rig.work.span[j]
        if one[0] < real(0.0) or other[0] < real(0.0):
            return True
        return real(wp.length(rig.work.center[i] - rig.work.center[j])) < one[0] + one[1] + other[0] + other[1]

    def rigid_pairs(rig: Rig, first: wp.array(dtype=int), write: int, count: wp.array(dtype=int), wanted: wp.array(dtype=int)):
        i = wp.tid()
        found = int(0)
        at = int(0)
        if write == 1 and i > 0:
            at = first[i - 1]
        for j in range(i + 1, rig.s.kind.shape[0]):
            if near(i, j, rig):
                if write == 1 and at + found < rig.c.a.shape[0]:
                    rig.c.a[at + found] = i
                    rig.c.b[at + found] = j
                found += 1
        if write == 0:
            count[i] = found
        elif i == rig.s.kind.shape[0] - 1:
            wanted[0] = wp.max(wanted[0], at + found)
            for m in range(at + found, rig.c.a.shape[0]):
                rig.c.a[m] = -1

    return wp.kernel(rigid_pairs, name="rigid_pairs", module=module, enable_backward=False)
