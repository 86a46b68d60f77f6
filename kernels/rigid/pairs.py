"""Which shapes may meet until manifolds are made anew: balls about them, grown by how far their bodies can go.

Of shapes i < j: not both of colliders, not of one body, of one world (or all), and

    |c_i - c_j| < ball_i + ball_j + way_i + way_j,    way = time (|v| + |a| time) + a part of the size

A thread takes shape i and counts, then, behind a scan, writes its partners in order: the list is sorted, and the same from run
to run. Places are float64 sums of the bodies' origins and displacements.
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import structs
from wsim.kernels.rigid.motion import structs as bodies

SLACK = wp.constant(0.02)          # part of a ball's radius within which shapes count as near, however slow


def reach(real, module):
    """Kernel of the centre, (ball, way) of every shape: where it has no end, its ball is < 0. Also notes where bodies are."""
    t = types(real)
    Bodies, Moving = bodies(real)
    Shapes, Still, _, Work = structs(real)

    def rigid_reach(s: Shapes, b: Bodies, now: Moving, still: Still, origin: wp.array(dtype=wp.vec3d), k: int, time: real,
                    center: wp.array(dtype=wp.vec3d), span: wp.array(dtype=t.vec2), from_x: wp.array(dtype=t.vec3)):
        i = wp.tid()
        f = s.frame[i]
        n = b.w.shape[0]
        x = t.vec3()
        q = t.quat()
        way = real(0.0)
        if f < n:
            x = now.x[f]
            q = now.q[f]
            way = time * b.w[f] * (wp.length(now.p[f]) + time * wp.length(b.push[f]))
            spin = wp.length(wp.cw_mul(b.inverse[f], wp.quat_rotate_inv(q, now.L[f])))
            way += time * spin * wp.length(wp.transform_get_translation(s.place[i]))
        else:
            row = k * still.moving
            x = still.x[row, f - n]
            q = still.q[row, f - n]
            way = time * (wp.length(still.v[row, f - n]) + wp.length(still.omega[row, f - n]) * wp.max(s.ball[i], real(0.0)))
        from_x[f] = x
        p = x + wp.quat_rotate(q, wp.transform_get_translation(s.place[i]))
        center[i] = origin[f] + wp.vec3d(wp.float64(p[0]), wp.float64(p[1]), wp.float64(p[2]))
        span[i] = t.vec2(s.ball[i], way + real(SLACK) * wp.max(s.ball[i], real(0.0)))

    return wp.kernel(rigid_reach, name="rigid_reach", module=module, enable_backward=False)


def listed(real, module):
    """Kernel that counts the partners of each shape (write = 0), or writes them behind `first`, where there is room."""
    t = types(real)
    Shapes, _, _, _ = structs(real)

    @wp.func
    def near(s: Shapes, i: int, j: int, bodies: int, center: wp.array(dtype=wp.vec3d), span: wp.array(dtype=t.vec2)):
        fi = s.frame[i]
        fj = s.frame[j]
        if fi == fj or (fi >= bodies and fj >= bodies):
            return False
        if s.world[i] != s.world[j] and s.world[i] >= 0 and s.world[j] >= 0:
            return False
        if span[i][0] < real(0.0) or span[j][0] < real(0.0):
            return True
        far = real(wp.length(center[i] - center[j]))
        return far < span[i][0] + span[i][1] + span[j][0] + span[j][1]

    def rigid_pairs(s: Shapes, bodies: int, center: wp.array(dtype=wp.vec3d), span: wp.array(dtype=t.vec2),
                    first: wp.array(dtype=int), write: int, count: wp.array(dtype=int), a: wp.array(dtype=int),
                    b: wp.array(dtype=int), wanted: wp.array(dtype=int)):
        i = wp.tid()
        found = int(0)
        at = int(0)
        if write == 1 and i > 0:
            at = first[i - 1]
        for j in range(i + 1, s.kind.shape[0]):
            if near(s, i, j, bodies, center, span):
                if write == 1 and at + found < a.shape[0]:
                    a[at + found] = i
                    b[at + found] = j
                found += 1
        if write == 0:
            count[i] = found
        elif i == s.kind.shape[0] - 1:
            wanted[0] = wp.max(wanted[0], at + found)
            for m in range(at + found, a.shape[0]):
                a[m] = -1

    return wp.kernel(rigid_pairs, name="rigid_pairs", module=module, enable_backward=False)
