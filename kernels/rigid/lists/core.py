"""The core of a shape, a ball well inside it, is stopped by what the shape meets, so that what spins stays before a thin wall.

Where a body is fast, its manifold knows the places that touch first. The blow turns the body, and within the same substep
another end of it swings through the wall; once its middle is on the far side it is pushed out there. The core c only
translates, so its time of impact is exact. Where the core would touch in this substep, and

    (x_i - c) . (c - mean x) < 0       for all points x_i of the manifold across n: the core is not above them

or one of the points is deep, it becomes a point of the manifold: the fourth, or in the place of the one that is farthest
apart. It takes no part in impacts that bounce. Of two shapes the smaller one has a core that counts. Friction may still throw a
rod through that a blow turns by some radians in a substep.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import PLANE, SPHERE
from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.lists.manifold import manifold_type
from wsim.kernels.rigid.lists.pairs import ROWS
from wsim.kernels.rigid.lists.renewal import LATER, twist_functions
from wsim.kernels.rigid.lists.rows import posed_pair_type
from wsim.kernels.rigid.narrow.mesh import mesh_type, relative_pose_func

CORE = wp.constant(2147483647)         # key of its point
HIT = wp.constant(0.1)                 # of its radius: nearer, it touches
ALONG = wp.constant(0.9)               # cosine: its normal is that of a manifold


@cache
def core_stop_funcs(real):
    """(reached, alone, stopped). reached(gap, way, m, rig): 1 where the core of shape A of row m counts, -1 of B, 0 none; gap,
    way [m]: between the shapes, and how much nearer their frames come. alone(posed, side, m, rig): both shapes with the core
    in the place of its shape. stopped(mm, n, c, r): a manifold with the core at c, of radius |r|, as a point; r < 0: the core
    is that of B. n: normal along which it touches."""
    t, Rig, Manifold, Posed = types(real), rig_type(real), manifold_type(real), posed_pair_type(real)[0]

    @wp.func
    def core_side_in_reach(gap: real, way: real, m: int, rig: Rig):
        a = rig.c.a[m]
        b = rig.c.b[m]
        found = int(0)
        if rig.s.kind[a] != PLANE and rig.s.kind[b] != PLANE:
            if rig.s.ball[b] > rig.s.ball[a]:
                found = wp.where(rig.s.kind[a] == SPHERE, 0, 1)
            else:
                found = wp.where(rig.s.kind[b] == SPHERE, 0, -1)
        if found != 0:
            i = wp.where(found > 0, a, b)
            if gap + rig.s.core[i][3] > way:           # so much farther away than its shape
                found = 0
        return found

    @wp.func(inline=False)
    def pose_of_core_alone(p: Posed, side: int, m: int, rig: Rig):
        out = p
        i = wp.where(side > 0, rig.c.a[m], rig.c.b[m])
        core = rig.s.core[i]
        at = t.transform(t.vec3(core[0], core[1], core[2]), t.quat(real(0.0), real(0.0), real(0.0), real(1.0)))
        size = t.vec3(core[3], real(0.0), real(0.0))
        if side > 0:
            out.a.kind = SPHERE
            out.a.size = size
            out.pose_a = p.pose_a * at
        else:
            out.b.kind = SPHERE
            out.b.size = size
            out.pose_b = p.pose_b * at
        return out

    @wp.func
    def core_beside_manifold(mm: Manifold, c: t.vec3, deep: real):
        """Whether the core is not above the points of a manifold, or one of them is deep."""
        mean = t.vec3()
        for i in range(4):
            if i < mm.count:
                mean += mm.x[i] / real(mm.count)
        out = c - mean
        out -= wp.dot(mm.n, out) * mm.n
        found = bool(True)
        for i in range(4):
            if i < mm.count:
                found = found and wp.dot(mm.x[i] - c, out) < real(0.0)
        for i in range(4):
            if i < mm.count:
                found = found or mm.gap[i] < -deep
        return found

    @wp.func(inline=False)
    def stop_core_by_manifold(mm: Manifold, n: t.vec3, c: t.vec3, r: real):
        out = mm
        if mm.count > 0 and wp.dot(mm.n, n) > real(ALONG) and core_beside_manifold(mm, c, real(HIT) * wp.abs(r)):
            way = wp.sign(r) * mm.n
            gap = wp.dot(way, c - mm.x[0]) + real(0.5) * mm.gap[0] - wp.abs(r)
            i = int(mm.count)
            if mm.count == 4:
                i = 0
                for e in range(1, 4):
                    if mm.gap[e] > mm.gap[i]:
                        i = e
            else:
                out.count = mm.count + 1
            out.x[i] = c - (wp.abs(r) + real(0.5) * gap) * way
            out.gap[i] = gap
            out.key[i] = CORE
        return out

    return core_side_in_reach, pose_of_core_alone, stop_core_by_manifold


@cache
def cores_on_meshes(real):
    """Function (m, posed, twist, h, surfaces, rig): the core of a shape becomes a point of the rows of its pair with a mesh,
    from m on and in A's frame, if it would come to a triangle within a substep."""
    t, Rig, Manifold, Posed, Surfaces = (types(real), rig_type(real), manifold_type(real), posed_pair_type(real)[0],
                                         mesh_type(real))
    Twist, seen, stopped = twist_functions(real).Twist, relative_pose_func(real), core_stop_funcs(real)[2]

    @wp.func
    def triangle_ahead_of_core(p: Posed, both: Twist, time: real, core: t.vec4, S: Surfaces):
        """Normal of the triangle to which the core comes, in A's frame; 0: none."""
        R, c = seen(p.pose_a, p.pose_b)
        start = c + R * t.vec3(core[0], core[1], core[2])
        arm = wp.quat_rotate(wp.transform_get_rotation(p.pose_b), start)
        v = wp.quat_rotate_inv(wp.transform_get_rotation(p.pose_b), both.v_a - both.v_b - wp.cross(both.o_b, arm))
        speed = wp.length(v)
        n = t.vec3()
        if speed > real(0.0):
            d = v / speed
            ray = wp.mesh_query_ray(S.id[p.b.row], wp.vec3f(float(start[0]), float(start[1]), float(start[2])),
                                    wp.vec3f(float(d[0]), float(d[1]), float(d[2])), float(time * speed + real(2.0) * core[3]))
            if ray.result:
                n = wp.normalize(t.vec3(real(ray.normal[0]), real(ray.normal[1]), real(ray.normal[2])))
                if wp.dot(n, d) > real(0.0):
                    n = wp.where(S.sided[p.b.row] == 1, t.vec3(), -n)
        return wp.transpose(R) * n

    @standalone_function
    @wp.func
    def block_core_by_mesh(m: int, p: Posed, both: Twist, h: real, S: Surfaces, rig: Rig):
        core = rig.s.core[rig.c.a[m]]
        n = t.vec3()
        gap = real(0.0)
        for j in range(4 * m, 4 * (m + ROWS)):
            if j % 4 < rig.c.count[j // 4]:
                gap = wp.min(gap, rig.c.gap[j])
        if gap + core[3] < h * wp.length(both.v_a - both.v_b):
            n = triangle_ahead_of_core(p, both, real(LATER) * h, core, S)
        best = real(ALONG)
        row = int(-1)
        rows = int(ROWS)
        for r in range(rows):
            if rig.c.count[m + r] > 0 and wp.dot(rig.c.n[m + r], n) > best:
                best = wp.dot(rig.c.n[m + r], n)
                row = m + r
        if row >= 0:
            mm = Manifold()
            mm.n = rig.c.n[row]
            mm.count = rig.c.count[row]
            for i in range(mm.count):
                mm.x[i] = rig.c.first_a[4 * row + i]
                mm.gap[i] = rig.c.gap[4 * row + i]
                mm.key[i] = rig.c.key[4 * row + i]
            mm = stopped(mm, n, t.vec3(core[0], core[1], core[2]), core[3])
            rig.c.count[row] = mm.count
            for i in range(mm.count):
                rig.c.first_a[4 * row + i] = mm.x[i]
                rig.c.gap[4 * row + i] = mm.gap[i]
                rig.c.key[4 * row + i] = mm.key[i]

    return block_core_by_mesh
