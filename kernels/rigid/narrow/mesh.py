"""Triangle meshes that bodies touch: their tables, and the list of triangles that come near to a shape.

Warp's tree over a mesh is walked on the device for the bounds of each shape; a triangle whose bounds meet them is a candidate
(row, face). The list is appended to in any order, up to the room there is, and says how many it wanted; whoever uses it sorts
it, or reads what it finds by the key of row and face. The tree is float32: bounds are widened by what that rounds.

No scene uses this yet.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import matrix
from wsim.kernels.rigid.narrow.shape import extent, hulls, shape, support

WIDER = wp.constant(1.0e-6)              # of a coordinate: some roundings of float32


@cache
def surfaces(real):
    """Struct of the tables of meshes, each in its own frame; faces and points stand one after another."""
    t = types(real)

    @wp.struct
    class Surfaces:
        id: wp.array(dtype=wp.uint64)        # tree of each mesh
        sided: wp.array(dtype=int)           # 1: closed, only the front is outside; 0: sheet
        first: wp.array(dtype=int)           # face of each mesh, (meshes + 1,)
        face: wp.array(dtype=wp.vec3i)       # points
        beside: wp.array(dtype=wp.vec3i)     # face across each edge, -1 at a rim
        point: wp.array(dtype=t.vec3)        # [m]
        first_around: wp.array(dtype=int)    # neighbour of each point, (points + 1,)
        around: wp.array(dtype=int)          # points at the other ends of its edges

    return Surfaces


@cache
def reading(real):
    """(corners, normal): functions of a face, (surfaces, face, R, c) -> corners, rows, in the frame of a body whose pose in the
    mesh's frame is (R, c), differences first; (surfaces, face) -> unit normal in the mesh's frame."""
    t, Surfaces = types(real), surfaces(real)

    @wp.func
    def corners(S: Surfaces, face: int, R: t.mat33, c: t.vec3):
        f = S.face[face]
        return wp.matrix_from_rows((S.point[f[0]] - c) * R, (S.point[f[1]] - c) * R, (S.point[f[2]] - c) * R)

    @wp.func
    def normal(S: Surfaces, face: int):
        f = S.face[face]
        o = S.point[f[0]]
        return wp.normalize(wp.cross(S.point[f[1]] - o, S.point[f[2]] - o))

    return corners, normal


@cache
def bounds(kinds: frozenset[str], real):
    """Function (a, hulls, R) -> (low, high) of a shape that is turned by R, about its origin [m]."""
    t, Shape, Hulls = types(real), shape(real), hulls(real)
    farthest = support(kinds, real)
    radius, _size = extent(real)

    @wp.func
    def bounds(a: Shape, H: Hulls, R: t.mat33):
        low = t.vec3()
        high = t.vec3()
        r = radius(a)
        for k in range(3):
            low[k] = wp.dot(R[k], farthest(a, H, -R[k])) - r
            high[k] = wp.dot(R[k], farthest(a, H, R[k])) + r
        return low, high

    return bounds


@cache
def relative(real):
    """Function (pose, of) -> (R, c): a pose as seen in the frame of another."""
    t = types(real)

    @wp.func
    def relative(pose: t.transform, of: t.transform):
        R = matrix(wp.transform_get_rotation(of))
        c = (wp.transform_get_translation(pose) - wp.transform_get_translation(of)) * R
        return wp.transpose(R) * matrix(wp.transform_get_rotation(pose)), c

    return relative


@cache
def candidates(kinds: frozenset[str], real, module):
    """Kernel of `threads` threads that walk the pairs up to counts[0], (shape, mesh) each. found: (pair, face among those of
    all meshes); counts[1], 0 before, is how many there are: more than `found` has room for where it overflows."""
    t, Shape, Hulls, Surfaces = types(real), shape(real), hulls(real), surfaces(real)
    bound, seen = bounds(kinds, real), relative(real)

    @wp.struct
    class Near:
        shape: wp.array(dtype=Shape)
        hulls: Hulls
        surfaces: Surfaces
        pose: wp.array(dtype=t.transform)
        mesh_pose: wp.array(dtype=t.transform)
        pairs: wp.array(dtype=wp.vec2i)
        margin: wp.array(dtype=real)         # of each shape [m]

    def candidates(near: Near, threads: int, counts: wp.array(dtype=int), found: wp.array(dtype=wp.vec2i)):
        i = wp.tid()
        while i < counts[0]:
            pair = near.pairs[i]
            a = near.shape[pair[0]]
            R, c = seen(near.pose[pair[0]], near.mesh_pose[pair[1]])
            low, high = bound(a, near.hulls, R)
            more = near.margin[pair[0]] + real(WIDER) * (wp.length(c) + wp.length(high - low))
            low += c - t.vec3(more, more, more)
            high += c + t.vec3(more, more, more)
            query = wp.mesh_query_aabb(near.surfaces.id[pair[1]], wp.vec3f(float(low[0]), float(low[1]), float(low[2])),
                                       wp.vec3f(float(high[0]), float(high[1]), float(high[2])))
            face = int(0)
            while wp.mesh_query_aabb_next(query, face):
                row = wp.atomic_add(counts, 1, 1)
                if row < found.shape[0]:
                    found[row] = wp.vec2i(i, near.surfaces.first[pair[1]] + face)
            i += threads

    return Near, wp.kernel(candidates, name="mesh_candidates", module=module, enable_backward=False)
