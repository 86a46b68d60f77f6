"""Manifolds of a list of pairs, with the impulses that the same features had before.

A thread has a pair. Its manifold is computed from the poses of both shapes, from the place of A's body; points become cores in
the frames of the bodies (kernels/rigid/contact.py). The last list is sorted by (a, b): a pair finds itself there by bisection,
and its points by their keys; an impulse is kept, of which friction turns into the new plane.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import whole
from wsim.kernels.rigid.narrow.pair import narrow
from wsim.kernels.rigid.narrow.shape import hulls, shape


@cache
def lasts(real):
    """Struct of the list before: pairs (room,), sorted, -1 behind the last; keys and impulses (4 room,)."""
    t = types(real)

    @wp.struct
    class Last:
        a: wp.array(dtype=int)
        b: wp.array(dtype=int)
        count: wp.array(dtype=int)
        colour: wp.array(dtype=int)
        key: wp.array(dtype=int)
        push: wp.array(dtype=real)
        rub: wp.array(dtype=t.vec3)

    return Last


def collide(pairs, real, module):
    """Kernel over the pairs of a list; pairs: of kinds of shapes (`wsim.kernels.rigid.narrow.pair.every`)."""
    t = types(real)
    Rig = whole(real)
    Last, Shape, Hulls = lasts(real), shape(real), hulls(real)
    found = narrow(pairs, real)

    @wp.func
    def solid(i: int, rig: Rig):
        a = Shape()
        a.kind = rig.s.kind[i]
        a.row = rig.s.row[i]
        a.size = rig.s.size[i]
        return a

    @wp.func
    def framed(f: int, k: int, rig: Rig):
        """Pose of a frame from its own origin."""
        x = t.vec3()
        q = t.quat(real(0.0), real(0.0), real(0.0), real(1.0))
        bodies = rig.now.x.shape[0]
        if f < bodies:
            x = rig.now.x[f]
            q = rig.now.q[f]
        else:
            x = rig.still.x[k * rig.still.moving, f - bodies]
            q = rig.still.q[k * rig.still.moving, f - bodies]
        return t.transform(x, q)

    @wp.func
    def known(a: int, b: int, last: Last):
        """Row of a pair in the last list, or -1."""
        low = int(0)
        high = last.a.shape[0]
        while low < high:
            middle = (low + high) // 2
            before = bool(False)
            if last.a[middle] >= 0:
                if last.a[middle] < a or (last.a[middle] == a and last.b[middle] < b):
                    before = True
            if before:
                low = middle + 1
            else:
                high = middle
        row = int(-1)
        if low < last.a.shape[0]:
            if last.a[low] == a and last.b[low] == b:
                row = low
        return row

    @wp.func
    def recalled(row: int, j: int, last: Last, rig: Rig):
        """Impulses of point j, as the pair's row of the last list has them."""
        rig.c.push[j] = real(0.0)
        rig.c.rub[j] = t.vec3()
        if row >= 0:
            for e in range(last.count[row]):
                if last.key[4 * row + e] == rig.c.key[j]:
                    rig.c.push[j] = last.push[4 * row + e]
                    rig.c.rub[j] = last.rub[4 * row + e]

    def rigid_collide(rig: Rig, H: Hulls, k: int, last: Last):
        m = wp.tid()
        a = rig.c.a[m]
        b = rig.c.b[m]
        rig.c.count[m] = 0
        if a >= 0:
            f = rig.s.frame[a]
            g = rig.s.frame[b]
            frame_a = framed(f, k, rig)
            frame_b = framed(g, k, rig)
            away = rig.s.origin[g] - rig.s.origin[f]
            apart = t.vec3(real(away[0]), real(away[1]), real(away[2])) - wp.transform_get_translation(frame_a)
            q_a = wp.transform_get_rotation(frame_a)
            q_b = wp.transform_get_rotation(frame_b)
            x_b = wp.transform_get_translation(frame_b) + apart             # from the centre of A's body
            pose_a = t.transform(t.vec3(), q_a) * rig.s.place[a]
            pose_b = t.transform(x_b, q_b) * rig.s.place[b]
            margin = rig.work.span[a][1] + rig.work.span[b][1]
            found_m = found(solid(a, rig), solid(b, rig), H, pose_a, pose_b, margin)
            n = found_m.n
            row = known(a, b, last)
            rig.c.colour[m] = -1
            if row >= 0:
                rig.c.colour[m] = last.colour[row]
            rig.c.count[m] = found_m.count
            rig.c.n[m] = n
            rig.c.skin[m] = t.vec2(rig.s.skin[a], rig.s.skin[b])
            half = real(0.5)
            for i in range(found_m.count):
                j = 4 * m + i
                x = found_m.x[i] + wp.transform_get_translation(pose_a)
                arm_a = x + (half * found_m.gap[i] + rig.s.skin[a]) * n
                arm_b = x - (half * found_m.gap[i] + rig.s.skin[b]) * n - x_b
                rig.c.key[j] = found_m.key[i]
                rig.c.gap[j] = found_m.gap[i]
                rig.c.first_a[j] = arm_a
                rig.c.first_b[j] = arm_b
                rig.c.core_a[j] = wp.quat_rotate_inv(q_a, arm_a)
                rig.c.core_b[j] = wp.quat_rotate_inv(q_b, arm_b)
                recalled(row, j, last, rig)

    return wp.kernel(rigid_collide, name="rigid_collide", module=module, enable_backward=False)
