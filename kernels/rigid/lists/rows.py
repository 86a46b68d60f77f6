"""Rows of the list of manifolds: what a thread reads of their shapes, and writes of their points.

Of a point the midpoint x is known from the centre of A's body; its core is that place of each body, less the skin along the
normal and the rim across the axis, in the body's frame (kernels/rigid/contact.py). Impulses are those that a point of the same
key had before: in the same row, or in a row of the last list, which is sorted by (a, b), so that a pair finds its rows there by
bisection. A pair with a mesh has several.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.shape import CONE, CYLINDER
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type, rigid_contact_structs
from wsim.kernels.rigid.lists.pairs import ROWS
from wsim.kernels.rigid.narrow.shape import FLAT, MESH, shape_type

ROUND = wp.constant(0.99)              # cosine: a point of a round surface lies where the normal says
AXIS = wp.constant(1.0e-5)             # of the rim: a core lies on the axis


@cache
def last_list_type(real):
    """Struct of the list before: pairs (room,), sorted, -1 behind the last; keys and impulses (4 room,)."""
    t = types(real)

    @wp.struct
    class LastManifolds:
        a: wp.array(dtype=int)
        b: wp.array(dtype=int)
        count: wp.array(dtype=int)
        colour: wp.array(dtype=int)
        key: wp.array(dtype=int)
        push: wp.array(dtype=real)
        rub: wp.array(dtype=t.vec3)
        drift: wp.array(dtype=t.vec3)

    return LastManifolds


def list_memory_kernel(real, module):
    """Kernel over the rows of a list that keeps what the next list asks for."""
    Contacts, Last, keep = rigid_contact_structs(real)[2], last_list_type(real), keep_row_func(real)

    def rigid_keep(c: Contacts, last: Last):
        keep(wp.tid(), c, last)

    return wp.kernel(rigid_keep, name="rigid_keep", module=module, enable_backward=False)


@cache
def keep_row_func(real):
    """Function (m, contacts, last): row m becomes the same row of the last list."""
    Contacts, Last = rigid_contact_structs(real)[2], last_list_type(real)

    @wp.func
    def copy_row_to_last(m: int, c: Contacts, last: Last):
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
            last.drift[j] = c.drift[j]

    return copy_row_to_last


@cache
def posed_pair_type(real):
    """(Posed, posed): struct of the two shapes of a row, with their poses from the centre of A's body, axes of the world; the
    function (m, k, rig) -> Posed, as they are where substep k begins."""
    t, Rig, Shape = types(real), rig_type(real), shape_type(real)

    @wp.struct
    class PosedPair:
        a: Shape
        b: Shape
        pose_a: t.transform
        pose_b: t.transform
        q_a: t.quat                            # of the frames
        q_b: t.quat
        x_b: t.vec3                            # of B's frame
        from_a: t.vec3                         # places of the frames, each from its own origin
        from_b: t.vec3
        margin: real

    @wp.func
    def convex_shape_of(i: int, rig: Rig):
        a = Shape()
        a.kind = rig.s.kind[i]
        a.row = rig.s.row[i]
        a.size = rig.s.size[i]
        return a

    @wp.func
    def frame_pose_from_origin(f: int, k: int, rig: Rig):
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
    def pose_pair_of_row(m: int, k: int, rig: Rig):
        a = rig.c.a[m]
        b = rig.c.b[m]
        f = rig.s.frame[a]
        g = rig.s.frame[b]
        frame_a = frame_pose_from_origin(f, k, rig)
        frame_b = frame_pose_from_origin(g, k, rig)
        away = rig.s.origin[g] - rig.s.origin[f]
        apart = t.vec3(real(away[0]), real(away[1]), real(away[2])) - wp.transform_get_translation(frame_a)
        p = PosedPair()
        p.a = convex_shape_of(a, rig)
        p.b = convex_shape_of(b, rig)
        p.q_a = wp.transform_get_rotation(frame_a)
        p.q_b = wp.transform_get_rotation(frame_b)
        p.x_b = wp.transform_get_translation(frame_b) + apart
        p.from_a = wp.transform_get_translation(frame_a)
        p.from_b = wp.transform_get_translation(frame_b)
        p.pose_a = t.transform(t.vec3(), p.q_a) * rig.s.place[a]
        p.pose_b = t.transform(p.x_b, p.q_b) * rig.s.place[b]
        p.margin = rig.work.span[a][1] + rig.work.span[b][1]
        return p

    return PosedPair, pose_pair_of_row


@cache
def row_writing_funcs(real) -> SimpleNamespace:
    """known(m, last, rig) -> first row of the last list with the pair of row m, or -1. point(m, i, x, gap, row, posed, last,
    rig): point i of row m, whose normal and key are there. poses(m, posed, rig): what the gaps of row m count from."""
    t, Rig, Last, Posed = types(real), rig_type(real), last_list_type(real), posed_pair_type(real)[0]

    @wp.func(inline=False)
    def find_pair_in_last(m: int, last: Last, rig: Rig):
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
    def recall_point_impulses(m: int, j: int, row: int, q: t.quat, last: Last, rig: Rig):
        """Impulses and the drift of point j of row m, as the pair's rows of the last list have them; q: of B's frame."""
        rig.c.push[j] = real(0.0)
        rig.c.rub[j] = t.vec3()
        rig.c.drift[j] = t.vec3()
        r = int(row)
        found = bool(False)
        while r >= 0 and not found:
            for e in range(last.count[r]):
                if last.key[4 * r + e] == rig.c.key[j]:
                    rig.c.push[j] = last.push[4 * r + e]
                    rig.c.rub[j] = last.rub[4 * r + e]
                    drift = last.drift[4 * r + e]
                    drift -= wp.dot(rig.c.n[m], drift) * rig.c.n[m]
                    rig.c.drift[j] = drift
                    rig.c.core_b[j] = rig.c.core_b[j] - wp.quat_rotate_inv(q, drift)
                    found = True
            r += 1
            more = r < last.a.shape[0] and r < row + ROWS
            if more:
                more = last.a[r] == rig.c.a[m] and last.b[r] == rig.c.b[m]
                if rig.s.kind[rig.c.a[m]] != MESH and rig.s.kind[rig.c.b[m]] != MESH:
                    more = False
            if not more:
                r = -1

    @wp.func
    def core_of(shape: int, pose: t.transform, center: t.vec3, q: t.quat, arm: t.vec3, n: t.vec3, rig: Rig):
        """(core, rim) of a point, from the centre of its frame, whose orientation is q; pose: of the shape; arm: the point from
        the centre; n: to the outside. Exactly on the axis where it is but for rounding, which would brake what rolls."""
        core = wp.quat_rotate_inv(q, arm)
        rim = real(0.0)
        if rig.s.kind[shape] == CYLINDER or rig.s.kind[shape] == CONE:
            z = wp.quat_rotate(wp.transform_get_rotation(pose), t.vec3(real(0.0), real(0.0), real(1.0)))
            across = n - wp.dot(n, z) * z
            if wp.length(across) > real(FLAT):
                e = wp.normalize(across)
                d = arm - (wp.transform_get_translation(pose) - center)
                height = wp.dot(d, z)
                d -= height * z
                along = wp.dot(d, e)
                if along > real(ROUND) * wp.length(d):
                    rim = along
                    core = wp.quat_rotate_inv(q, arm - rim * e)
                    if wp.length(d - rim * e) < real(AXIS) * rim:
                        core = wp.transform_point(rig.s.place[shape], t.vec3(real(0.0), real(0.0), height))
        return core, rim

    @wp.func
    def write_manifold_point(m: int, i: int, x: t.vec3, gap: real, row: int, posed: Posed, last: Last, rig: Rig):
        j = 4 * m + i
        n = rig.c.n[m]
        half = real(0.5)
        arm_a = x + (half * gap + rig.c.skin[m][0]) * n
        arm_b = x - (half * gap + rig.c.skin[m][1]) * n - posed.x_b
        rig.c.gap[j] = gap
        rig.c.first_a[j] = arm_a
        rig.c.first_b[j] = arm_b
        core_a, rim_a = core_of(rig.c.a[m], posed.pose_a, t.vec3(), posed.q_a, arm_a, -n, rig)
        core_b, rim_b = core_of(rig.c.b[m], posed.pose_b, posed.x_b, posed.q_b, arm_b, n, rig)
        rig.c.rim[j] = t.vec2(rim_a, rim_b)
        rig.c.core_a[j] = core_a
        rig.c.core_b[j] = core_b
        recall_point_impulses(m, j, row, posed.q_b, last, rig)

    @wp.func
    def note_manifold_poses(m: int, posed: Posed, rig: Rig):
        """Notes for which poses row m is made."""
        rig.c.from_a[m] = posed.from_a
        rig.c.from_b[m] = posed.from_b
        rig.c.turn_a[m] = posed.q_a
        rig.c.turn_b[m] = posed.q_b

    return SimpleNamespace(known=find_pair_in_last, point=write_manifold_point, poses=note_manifold_poses)
