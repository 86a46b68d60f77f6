"""Triangle meshes that bodies touch: their tables, and the bounds by which a shape looks for triangles.

Warp's tree over a mesh is walked on the device (kernels/rigid/lists/collide_mesh.py); a triangle whose bounds meet those of a
shape is met. The tree is float32: bounds are widened by what that rounds.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.narrow.shape import hull_type, shape_extent_funcs, shape_type, support_map_func

WIDER = wp.constant(1.0e-6)              # of a coordinate: some roundings of float32


@cache
def mesh_type(real):
    """Struct of the tables of meshes, each in its own frame; faces and points stand one after another."""
    t = types(real)

    @wp.struct
    class MeshSurfaces:
        id: wp.array(dtype=wp.uint64)        # tree of each mesh
        sided: wp.array(dtype=int)           # 1: closed, only the front is outside; 0: sheet
        first: wp.array(dtype=int)           # face of each mesh, (meshes + 1,)
        face: wp.array(dtype=wp.vec3i)       # points
        beside: wp.array(dtype=wp.vec3i)     # face across each edge, -1 at a rim
        point: wp.array(dtype=t.vec3)        # [m]
        first_around: wp.array(dtype=int)    # neighbour of each point, (points + 1,)
        around: wp.array(dtype=int)          # points at the other ends of its edges
        corner: wp.array(dtype=wp.vec3i)     # of meshes of bodies: 1 at points that this face has for all, and that stand out
        sharp: wp.array(dtype=wp.vec3i)      # 1: an edge that this face has for both, and that stands out
        patch: wp.array(dtype=int)           # of a face: number of the plane that it lies in with its neighbours
        reach: wp.array(dtype=real)          # of a mesh [m]: depth up to which a contact is sought

    return MeshSurfaces


@cache
def surface_face_readers(real):
    """(corners, normal): functions of a face, (surfaces, face, R, c) -> corners, rows, in the frame of a body whose pose in the
    mesh's frame is (R, c), differences first; (surfaces, face) -> unit normal in the mesh's frame."""
    t, Surfaces = types(real), mesh_type(real)

    @wp.func
    def body_frame_corners(S: Surfaces, face: int, R: t.mat33, c: t.vec3):
        f = S.face[face]
        return wp.matrix_from_rows((S.point[f[0]] - c) * R, (S.point[f[1]] - c) * R, (S.point[f[2]] - c) * R)

    @wp.func
    def surface_face_normal(S: Surfaces, face: int):
        f = S.face[face]
        o = S.point[f[0]]
        return wp.normalize(wp.cross(S.point[f[1]] - o, S.point[f[2]] - o))

    return body_frame_corners, surface_face_normal


@cache
def shape_bounds_func(kinds: frozenset[str], real):
    """Function (a, hulls, R) -> (low, high) of a shape that is turned by R, about its origin [m]."""
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)
    farthest = support_map_func(kinds, real)
    radius, _size = shape_extent_funcs(real)

    @standalone_function
    @wp.func
    def turned_shape_bounds(a: Shape, H: Hulls, R: t.mat33):
        low = t.vec3()
        high = t.vec3()
        r = radius(a)
        for k in range(3):
            low[k] = wp.dot(R[k], farthest(a, H, -R[k])) - r
            high[k] = wp.dot(R[k], farthest(a, H, R[k])) + r
        return low, high

    return turned_shape_bounds


@cache
def relative_pose_func(real):
    """Function (pose, of) -> (R, c): a pose as seen in the frame of another."""
    t = types(real)

    @wp.func
    def relative_pose(pose: t.transform, of: t.transform):
        R = rotation_to_matrix(wp.transform_get_rotation(of))
        c = (wp.transform_get_translation(pose) - wp.transform_get_translation(of)) * R
        return wp.transpose(R) * rotation_to_matrix(wp.transform_get_rotation(pose)), c

    return relative_pose
