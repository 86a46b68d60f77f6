"""Skinned points on the device, as wsim/physics/animation/skinning.py has them on the host.

    linear   x_i = sum_c w_ic A_j(i,c) p_i
    dual     x_i = Q_i (sum_c w_ic S_j) p_i,  Q_i = sum_c +-w_ic q_j / |...|         A_j = R_j S_j + t_j, q_j of (R_j, t_j)

(Kavan, Collins, Zara, O'Sullivan 2008, Geometric skinning with approximate dual quaternion blending, section 4.) Influence c of
point i stands at c n + i, so that neighbouring threads read neighbouring memory: joints as 16 bits, which 65536 joints fill,
weights in the precision of the run (nothing is lost to either). Traffic of a point in float32: 12 m, one pose: 24 + 6 m bytes
and, in its cache, the transforms: 12 numbers an influence by linear blend, 8 by dual quaternions, each read once. For that the
influence with the largest weight, whose sign the others take, comes first; and Q y = y + 2 (w u x y + u x (u x y)) / |q|^2
needs no root.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import matrix_to_quaternion, polar_rotation, rotate_vector

UNROLLED = 8           # influences of which the loop is written out


@cache
def skin_table_type(real):
    """Table of a mesh."""
    t = types(real)

    @wp.struct
    class SkinTable:
        joint: wp.array(dtype=wp.uint16)          # of the influences, (m * points,)
        weight: wp.array(dtype=t.scalar)          # (m * points,)
        influences: int                           # m
        first: int                                # joint of the skeleton among all joints
        stretch: t.mat33                          # of the skeleton, behind all else

    return SkinTable


@cache
def dual_type(real):
    """Table of joints at some times: rotation and translation as a dual quaternion, and the stretch before it."""
    t = types(real)

    @wp.struct
    class DualQuaternions:
        turn: wp.array2d(dtype=t.quat)            # q, (times, joints)
        shift: wp.array2d(dtype=t.quat)           # t q / 2
        stretch: wp.array2d(dtype=t.mat33)        # S

    return DualQuaternions


@cache
def linear_blend_kernel(real, out, m: int, stretched: bool, module):
    """Kernel over (times, points): linear blend by m influences (0: as many as the table says), written in `out`."""
    t, o = types(real), types(out)
    Skin, rows, unrolled = skin_table_type(real), wp.types.matrix((3, 4), real), m > 0

    def blend_linear(skin: Skin, point: wp.array2d(dtype=t.vec3), A: wp.array2d(dtype=rows),
                     x_out: wp.array2d(dtype=o.vec3)):
        k, i = wp.tid()
        n = point.shape[1]
        p = point[wp.min(k, point.shape[0] - 1), i]
        q = t.vec4(p[0], p[1], p[2], real(1.0))
        x = t.vec3()
        if unrolled:
            for c in range(m):
                x += skin.weight[c * n + i] * (A[k, skin.first + int(skin.joint[c * n + i])] * q)
        else:
            for c in range(skin.influences):
                x += skin.weight[c * n + i] * (A[k, skin.first + int(skin.joint[c * n + i])] * q)
        if stretched:
            x = skin.stretch * x
        x_out[k, i] = o.vec3(out(x[0]), out(x[1]), out(x[2]))

    name = f"blend_linear_{m}_{stretched}_{t.name}_{o.name}"
    return wp.kernel(blend_linear, name=name, module=module, enable_backward=False)


@cache
def joint_part_kernel(real, rigid: bool, module):
    """Kernel over (times, joints): dual quaternion and stretch of A. rigid: A is a rotation and a translation."""
    t, Duals, rows = types(real), dual_type(real), wp.types.matrix((3, 4), real)

    def part_joints(A: wp.array2d(dtype=rows), duals_out: Duals):
        k, j = wp.tid()
        M = A[k, j]
        F = t.mat33(M[0, 0], M[0, 1], M[0, 2], M[1, 0], M[1, 1], M[1, 2], M[2, 0], M[2, 1], M[2, 2])
        one = real(1.0)
        q = t.quat(real(0.0), real(0.0), real(0.0), one)
        S = t.mat33(one, real(0.0), real(0.0), real(0.0), one, real(0.0), real(0.0), real(0.0), one)
        if rigid:
            e = matrix_to_quaternion(F)
            q = t.quat(e[0], e[1], e[2], e[3])
        else:
            q = polar_rotation(F - S, t.quat(real(0.0), real(0.0), real(0.0), real(0.0)))
            back = wp.quat_inverse(q)
            X = t.mat33()
            for c in range(3):
                column = rotate_vector(back, t.vec3(F[0, c], F[1, c], F[2, c]))
                for r in range(3):
                    X[r, c] = column[r]
            S = X
        duals_out.turn[k, j] = q
        duals_out.shift[k, j] = t.quat(M[0, 3], M[1, 3], M[2, 3], real(0.0)) * q * real(0.5)
        duals_out.stretch[k, j] = S

    return wp.kernel(part_joints, name=f"part_joints_{rigid}_{t.name}", module=module, enable_backward=False)


@cache
def dual_blend_kernel(real, out, m: int, rigid: bool, stretched: bool, module):
    """Kernel over (times, points): dual quaternion blend by m influences (0: as many as the table says), of which the first has
    the largest weight, written in `out`."""
    t, o, Skin, Duals, unrolled = types(real), types(out), skin_table_type(real), dual_type(real), m > 0

    @wp.func
    def signed_influence(skin: Skin, joints: Duals, at: wp.vec2i, c: int, n: int, first: t.quat):
        """Weight of influence c, with the sign that its rotation agrees with the first by, its joint and its rotation."""
        j = skin.first + int(skin.joint[c * n + at[1]])
        w = skin.weight[c * n + at[1]]
        q = joints.turn[at[0], j]
        if wp.dot(q, first) < real(0.0):
            return -w, w, j, q
        return w, w, j, q

    def blend_dual(skin: Skin, point: wp.array2d(dtype=t.vec3), joints: Duals, x_out: wp.array2d(dtype=o.vec3)):
        k, i = wp.tid()
        n = point.shape[1]
        p = point[wp.min(k, point.shape[0] - 1), i]
        j = skin.first + int(skin.joint[i])
        w = skin.weight[i]
        first = joints.turn[k, j]
        q = w * first
        d = w * joints.shift[k, j]
        y = p
        if not rigid:
            y = w * (joints.stretch[k, j] * p)
        if unrolled:
            for c in range(1, m):
                sign, w, j, turn = signed_influence(skin, joints, wp.vec2i(k, i), c, n, first)
                q = q + sign * turn
                d = d + sign * joints.shift[k, j]
                if not rigid:
                    y = y + w * (joints.stretch[k, j] * p)
        else:
            for c in range(1, skin.influences):
                sign, w, j, turn = signed_influence(skin, joints, wp.vec2i(k, i), c, n, first)
                q = q + sign * turn
                d = d + sign * joints.shift[k, j]
                if not rigid:
                    y = y + w * (joints.stretch[k, j] * p)
        over = real(1.0) / wp.dot(q, q)
        shift = d * t.quat(-q[0], -q[1], -q[2], q[3])
        u = t.vec3(q[0], q[1], q[2])
        across = wp.cross(u, y)
        x = y + (real(2.0) * over) * (q[3] * across + wp.cross(u, across) + t.vec3(shift[0], shift[1], shift[2]))
        if stretched:
            x = skin.stretch * x
        x_out[k, i] = o.vec3(out(x[0]), out(x[1]), out(x[2]))

    name = f"blend_dual_{m}_{rigid}_{stretched}_{t.name}_{o.name}"
    return wp.kernel(blend_dual, name=name, module=module, enable_backward=False)


@cache
def blend_shape_kernel(real, module):
    """Kernel over (times, points): bound points and the offsets of blend shapes. first: of each point's offsets, (points + 1,);
    part: number of the weight of each; weight: (times, parts)."""
    t = types(real)

    def shape_points(point: wp.array2d(dtype=t.vec3), first: wp.array(dtype=int), part: wp.array(dtype=int),
                     offset: wp.array(dtype=t.vec3), weight: wp.array2d(dtype=t.scalar), point_out: wp.array2d(dtype=t.vec3)):
        k, i = wp.tid()
        p = point[0, i]
        for e in range(first[i], first[i + 1]):
            p = p + weight[k, part[e]] * offset[e]
        point_out[k, i] = p

    return wp.kernel(shape_points, name=f"shape_points_{t.name}", module=module, enable_backward=False)


@cache
def point_key_kernel(module):
    """Kernel over (moments, points): points by keys, straight between them and held outside. start: when the frame begins."""

    def blend_keys(time: wp.array(dtype=wp.float64), value: wp.array2d(dtype=wp.vec3f), start: wp.array(dtype=wp.float64),
                   moment: wp.array(dtype=wp.float64), x_out: wp.array2d(dtype=wp.vec3f)):
        k, i = wp.tid()
        t = start[0] + moment[k]
        low = int(0)
        high = time.shape[0]
        while low < high:                         # the first key later than t
            middle = (low + high) // 2
            if time[middle] <= t:
                low = middle + 1
            else:
                high = middle
        b = wp.min(low, time.shape[0] - 1)
        a = wp.max(low - 1, 0)
        x = value[a, i]
        if b > a:
            s = (t - time[a]) / (time[b] - time[a])
            x = x + float(s) * (value[b, i] - x)
        x_out[k, i] = x

    return wp.kernel(blend_keys, name="blend_keys", module=module, enable_backward=False)


@cache
def skin_extent_kernel(module):
    """Kernel over (substeps, points): the greatest distance from `center` at either end of a substep, and the greatest way in
    it [m]. Maxima: the order does not matter; most points only look."""

    def skin_extents(track: wp.array2d(dtype=wp.vec3f), center: wp.vec3f, far_out: wp.array(dtype=float),
                     way_out: wp.array(dtype=float)):
        k, i = wp.tid()
        x = track[k, i]
        y = track[k + 1, i]
        far = wp.max(wp.length(x - center), wp.length(y - center))
        way = wp.length(y - x)
        if far > far_out[k]:
            wp.atomic_max(far_out, k, far)
        if way > way_out[k]:
            wp.atomic_max(way_out, k, way)

    return wp.kernel(skin_extents, name="skin_extents", module=module, enable_backward=False)


@cache
def skin_ball_kernel(real, module):
    """Kernel over (substeps, rows of a collider): the bounding ball and the stride of a mesh whose points the device has, in
    place of the radius that the host took [m]."""
    t = types(real)

    def widen_balls(row: wp.array(dtype=int), far: wp.array(dtype=float), way: wp.array(dtype=float), radius: real,
                    ball: wp.array2d(dtype=t.vec4), ball_out: wp.array2d(dtype=t.vec4),
                    stride_out: wp.array2d(dtype=t.scalar)):
        k, i = wp.tid()
        r = row[i]
        b = ball[k, r]
        one = real(1.0) + real(1.0e-6)                      # rounding of float32
        ball_out[k, r] = t.vec4(b[0], b[1], b[2], b[3] - radius + one * (real(far[k]) + real(way[k])))
        stride_out[k, r] = one * real(way[k])

    return wp.kernel(widen_balls, name=f"widen_balls_{t.name}", module=module, enable_backward=False)
