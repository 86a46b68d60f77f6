"""Distance of points to the nearest triangle of a mesh, for colours of contact. No sign: a surface may be open."""

import warp as wp


@wp.kernel(module="wsim_picture_distance")
def measure_mesh_distance(mesh: wp.uint64, points: wp.array(dtype=wp.vec3), most: wp.float32, out: wp.array(dtype=wp.float32)):
    """out: distance [unit of the mesh] up to `most`, which stands for everything farther."""
    i = wp.tid()
    p = points[i]
    query = wp.mesh_query_point_no_sign(mesh, p, most)
    found = most
    if query.result:
        found = wp.length(wp.mesh_eval_position(mesh, query.face, query.u, query.v) - p)
    out[i] = found
