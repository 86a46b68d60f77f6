"""Manifolds of a list of pairs with one of both bodies moved a little: how points, gaps and normals change with poses.

Samples of a direction d (a shift along x, y, z, a turn about x, y, z; of A, then of B) are at -2, -1, 1 and 2 steps, for
differences of order 4. A point is known by its key again; where it is not there, 0 stands beside the gap.
"""

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.lists.rows import posed_pair_type
from wsim.kernels.rigid.narrow.pair import narrow_phase_func
from wsim.kernels.rigid.narrow.shape import hull_type

SAMPLES = wp.constant(48)          # 12 directions of 4


def pose_slope_kernel(pairs, real, module):
    """Kernel over (rows, SAMPLES): n and x (4 rows, SAMPLES), gap with 1 where it is there (4 rows, SAMPLES). step: a part of
    sizes. size (rows): of the smaller shape [m], the gap up to which points are kept [m], and a turn [rad] that moves points by
    that size at most."""
    t = types(real)
    Rig, Hulls = rig_type(real), hull_type(real)
    found, posed = narrow_phase_func(pairs, real), posed_pair_type(real)[1]

    @wp.func
    def nudged_pose(pose: t.transform, about: t.vec3, d: int, much: real, turn: real):
        """A pose moved along axis d, or turned about it through a place."""
        axis = t.vec3()
        axis[d % 3] = real(1.0)
        out = t.transform(wp.transform_get_translation(pose) + much * axis, wp.transform_get_rotation(pose))
        if d >= 3:
            q = wp.quat_from_axis_angle(axis, turn)
            out = t.transform(about, q) * t.transform(-about, t.quat(real(0.0), real(0.0), real(0.0), real(1.0))) * pose
        return out

    def rigid_slopes(rig: Rig, H: Hulls, k: int, step: real, size: wp.array(dtype=t.vec3),
                     n: wp.array2d(dtype=t.vec3), x: wp.array2d(dtype=t.vec3), gap: wp.array2d(dtype=t.vec2)):
        m, s = wp.tid()
        d = s // 4
        j = s % 4
        steps = real(j - 2)
        if j >= 2:
            steps = real(j - 1)
        if rig.c.a[m] >= 0 and rig.c.count[m] > 0:
            p = posed(m, k, rig)
            pose_a = p.pose_a
            pose_b = p.pose_b
            much = steps * step * size[m][0]
            turn = steps * step * size[m][2]
            if d < 6:
                pose_a = nudged_pose(pose_a, t.vec3(), d, much, turn)
            else:
                pose_b = nudged_pose(pose_b, p.x_b, d - 6, much, turn)
            f = found(p.a, p.b, H, pose_a, pose_b, size[m][1])
            for i in range(4):
                at = 4 * m + i
                if i < rig.c.count[m]:
                    for e in range(4):
                        if e < f.count and f.key[e] == rig.c.key[at] and gap[at, s][1] == real(0.0):
                            n[at, s] = f.n
                            x[at, s] = f.x[e] + wp.transform_get_translation(pose_a)
                            gap[at, s] = t.vec2(f.gap[e], real(1.0))

    return wp.kernel(rigid_slopes, name="rigid_slopes", module=module, enable_backward=False)
