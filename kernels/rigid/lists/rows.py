"""Rows of the list of manifolds: what a thread reads of their shapes, and writes of their points.

Of a point the midpoint x is known from the centre of A's body; its core is that place of each body, less the skin along the
normal, in the body's frame (kernels/rigid/contact.py). Impulses are those that a point of the same key had in the last list,
which is sorted by (a, b): a pair finds its rows there by bisection. A pair with a mesh has several.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import structs, whole
from wsim.kernels.rigid.narrow.shape import shape


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


def keeping(real, module):
    """Kernel over the rows of a list that keeps what the next list asks for."""
    Contacts, Last = structs(real)[2], lasts(real)

    def rigid_keep(c: Contacts, last: Last):
        m = wp.tid()
        last.a[m] = c.a[m]
        last.b[m] = c.b[m]
        last.count[m] = c.count[m]
        last.colour[m] = c.colour[m]
        points = int(4)
        for i in range(points):
            j = 4 * m + i
            last.key[j] = c.key[j]
            last.push[j] = c.push[j]
            last.rub[j] = c.rub[j]

    return wp.kernel(rigid_keep, name="rigid_keep", module=module, enable_backward=False)


@cache
def posing(real):
    """(Posed, posed): struct of the two shapes of a row, with their poses from the centre of A's body, axes of the world; the
    function (m, k, rig) -> Posed, as they are where substep k begins."""
    t, Rig, Shape = types(real), whole(real), shape(real)

    @wp.struct
    class Posed:
        a: Shape
        b: Shape
        pose_a: t.transform
        pose_b: t.transform
        q_a: t.quat                            # of the frames
        q_b: t.quat
        x_b: t.vec3                            # of B's frame
        margin: real

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

    @wp.func(inline=False)
    def posed(m: int, k: int, rig: Rig):
        a = rig.c.a[m]
        b = rig.c.b[m]
        f = rig.s.frame[a]
        g = rig.s.frame[b]
        frame_a = framed(f, k, rig)
        frame_b = framed(g, k, rig)
        away = rig.s.origin[g] - rig.s.origin[f]
        apart = t.vec3(real(away[0]), real(away[1]), real(away[2])) - wp.transform_get_translation(frame_a)
        p = Posed()
        p.a = solid(a, rig)
        p.b = solid(b, rig)
        p.q_a = wp.transform_get_rotation(frame_a)
        p.q_b = wp.transform_get_rotation(frame_b)
        p.x_b = wp.transform_get_translation(frame_b) + apart
        p.pose_a = t.transform(t.vec3(), p.q_a) * rig.s.place[a]
        p.pose_b = t.transform(p.x_b, p.q_b) * rig.s.place[b]
        p.margin = rig.work.span[a][1] + rig.work.span[b][1]
        return p

    return Posed, posed


@cache
def writing(real) -> SimpleNamespace:
    """known(m, last, rig) -> first row of the last list with the pair of row m, or -1. point(m, i, x, gap, row, posed, last,
    rig): point i of row m, whose normal and key are there."""
    t, Rig, Last, Posed = types(real), whole(real), lasts(real), posing(real)[0]

    @wp.func(inline=False)
    def known(m: int, last: Last, rig: Rig):
        a = rig.c.a[m]
        b = rig.c.b[m]
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

    @wp.func(inline=False)
    def recalled(m: int, j: int, row: int, last: Last, rig: Rig):
        """Impulses of point j of row m, as the pair's rows of the last list have them."""
        rig.c.push[j] = real(0.0)
        rig.c.rub[j] = t.vec3()
        r = int(row)
        found = bool(False)
        while r >= 0 and not found:
            for e in range(last.count[r]):
                if last.key[4 * r + e] == rig.c.key[j]:
                    rig.c.push[j] = last.push[4 * r + e]
                    rig.c.rub[j] = last.rub[4 * r + e]
                    found = True
            r += 1
            more = r < last.a.shape[0]
            if more:
                more = last.a[r] == rig.c.a[m] and last.b[r] == rig.c.b[m]
            if not more:
                r = -1

    @wp.func
    def point(m: int, i: int, x: t.vec3, gap: real, row: int, posed: Posed, last: Last, rig: Rig):
        j = 4 * m + i
        n = rig.c.n[m]
        half = real(0.5)
        arm_a = x + (half * gap + rig.c.skin[m][0]) * n
        arm_b = x - (half * gap + rig.c.skin[m][1]) * n - posed.x_b
        rig.c.gap[j] = gap
        rig.c.first_a[j] = arm_a
        rig.c.first_b[j] = arm_b
        rig.c.core_a[j] = wp.quat_rotate_inv(posed.q_a, arm_a)
        rig.c.core_b[j] = wp.quat_rotate_inv(posed.q_b, arm_b)
        recalled(m, j, row, last, rig)

    return SimpleNamespace(known=known, point=point)
