"""Rows of a pair with a triangle mesh: of as many normals as there are, ROWS at most, each with four points.

What touches, face by face, comes into the row whose normal is its own to ALIKE, else into a new one. Once all rows are taken,
the row that is least deep makes room for what is deeper. A row keeps four of its points, those of one place once: the corners
of what the shape stands on, however many triangles it is cut into. Rows are in A's frame until they are written.

    key   a corner of A's face: its own number, so that it lasts from triangle to triangle; else that of the face with it
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import scratch, standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.lists.manifold import manifold_reduction_func, manifold_type
from wsim.kernels.rigid.lists.pairs import ROWS
from wsim.kernels.rigid.lists.renewal import twist_functions
from wsim.kernels.rigid.lists.rows import posed_pair_type
from wsim.kernels.rigid.narrow.clip import SIDES, WHOLE

ALIKE = wp.constant(0.9995)            # cosine, 1.8 degrees: triangles of one plane, and of what is nearly one
SAME = wp.constant(1.0e-3)             # of the shape's size: points nearer than that are one


@cache
def gather_func(real, own_keys: bool = False):
    """(gathered, key_of). gathered(m, mm, face, size, rig): the points of a triangle's manifold, in A's frame, into the rows
    from m on, whose normals are in A's frame and whose places are in `first_a` meanwhile. own_keys: keys are those of the
    manifold."""
    vec3, Rig, Manifold = types(real).vec3, rig_type(real), manifold_type(real)
    reduce = manifold_reduction_func(real, True)

    @wp.func
    def key_of(key: int, face: int):
        """A number for a point; see the head of the file."""
        edge = (key // 64) % 64
        other = key % 64
        found = key
        if key == 0 or (key < 1073741824 and edge < SIDES) or (key >= 1073741824 and other != WHOLE):
            found = (key * 31 + face * 7919) % 1073741824 - 1073741824             # below 0
        return found

    @wp.func
    def least_row_gap(row: int, rig: Rig):
        gap = rig.c.gap[4 * row]
        for i in range(1, rig.c.count[row]):
            gap = wp.min(gap, rig.c.gap[4 * row + i])
        return gap

    @wp.func
    def row_for_normal(m: int, n: vec3, gap: real, rig: Rig):
        """The row for a normal: emptied, if it was another's; -1: none."""
        row = int(-1)
        best = real(ALIKE)
        free = int(-1)
        shallow = int(-1)
        most = gap
        rows = int(ROWS)
        for r in range(rows):
            if rig.c.count[m + r] > 0:
                alike = wp.dot(rig.c.n[m + r], n)
                if alike > best:
                    best = alike
                    row = m + r
                if least_row_gap(m + r, rig) > most:
                    most = least_row_gap(m + r, rig)
                    shallow = m + r
            elif free < 0:
                free = m + r
        if row < 0:
            row = free
            if row < 0:
                row = shallow
            if row >= 0:
                rig.c.count[row] = 0
                rig.c.n[row] = n
        return row

    @standalone_function
    @wp.func
    def gather_triangle_points(m: int, mm: Manifold, face: int, size: real, rig: Rig):
        gap_m = mm.gap[0]
        for i in range(1, mm.count):
            gap_m = wp.min(gap_m, mm.gap[i])
        row = row_for_normal(m, mm.n, gap_m, rig)
        if row >= 0:
            P = scratch(shape=(8,), dtype=vec3)
            gap = scratch(shape=(8,), dtype=real)
            key = scratch(shape=(8,), dtype=int)
            count = int(rig.c.count[row])
            for i in range(count):
                P[i] = rig.c.first_a[4 * row + i]
                gap[i] = rig.c.gap[4 * row + i]
                key[i] = rig.c.key[4 * row + i]
            for i in range(mm.count):
                twin = int(-1)
                for e in range(count):
                    if wp.length_sq(P[e] - mm.x[i]) < real(SAME) * real(SAME) * size * size:
                        twin = e
                number = mm.key[i]
                if wp.static(not own_keys):
                    number = key_of(mm.key[i], face)
                if twin < 0:
                    P[count] = mm.x[i]
                    gap[count] = mm.gap[i]
                    key[count] = number
                    count += 1
                else:
                    gap[twin] = wp.min(gap[twin], mm.gap[i])
                    key[twin] = wp.max(key[twin], number)
            kept = reduce(rig.c.n[row], P, gap, key, count, size)
            rig.c.count[row] = kept.count
            for i in range(kept.count):
                rig.c.first_a[4 * row + i] = kept.x[i]
                rig.c.gap[4 * row + i] = kept.gap[i]
                rig.c.key[4 * row + i] = kept.key[i]

    return gather_triangle_points


@cache
def approach_func(real):
    """Function (m, twist, posed, rig) -> (least gap, time until the first point of the rows of a pair touches; < 0: none does).
    Rows are in A's frame."""
    Rig, Posed, of = rig_type(real), posed_pair_type(real)[0], twist_functions(real)
    Twist, closing = of.Twist, of.closing

    @wp.func
    def mesh_row_approach(m: int, both: Twist, p: Posed, rig: Rig):
        q = wp.transform_get_rotation(p.pose_a)
        o = wp.transform_get_translation(p.pose_a)
        least = real(1.0e30)
        soonest = real(-1.0)
        rows = int(ROWS)
        for r in range(rows):
            n = wp.quat_rotate(q, rig.c.n[m + r])
            for i in range(rig.c.count[m + r]):
                j = 4 * (m + r) + i
                least = wp.min(least, rig.c.gap[j])
                rate = closing(n, wp.quat_rotate(q, rig.c.first_a[j]) + o, both, p)
                if rate < real(0.0):
                    after = -rig.c.gap[j] / rate
                    if soonest < real(0.0) or after < soonest:
                        soonest = after
        return least, soonest

    return mesh_row_approach
