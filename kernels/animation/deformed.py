"""Meshes that deform, in a substep: their points, and the boxes of their trees."""

from functools import cache

import warp as wp

from wsim.kernels.contact.project import SUNK
from wsim.kernels.math.real import substep_number


@wp.func_native("""
    typedef void (*Refit)(wp::uint64);
    ((Refit)function)(mesh);
""")
def call_warp_refit(function: wp.uint64, mesh: wp.uint64): ...


@wp.func_native("""
    wp::Mesh* m = (wp::Mesh*)mesh;
    float sum = 0.0f;
    for (int i = 0; i < m->num_tris; ++i) {
        const wp::vec3 p = m->points.data[m->indices.data[3 * i]];
        const wp::vec3 q = m->points.data[m->indices.data[3 * i + 1]];
        const wp::vec3 r = m->points.data[m->indices.data[3 * i + 2]];
        m->lowers[i] = wp::min(wp::min(p, q), r);
        m->uppers[i] = wp::max(wp::max(p, q), r);
        sum += wp::length(p - q) + wp::length(p - r) + wp::length(r - q);
    }
    m->average_edge_length = sum / (3 * m->num_tris);
    for (int k = m->bvh.num_nodes - 1; k >= 0; --k) {
        wp::BVHPackedNodeHalf& low = m->bvh.node_lowers[k];
        wp::BVHPackedNodeHalf& high = m->bvh.node_uppers[k];
        wp::vec3 a, b;
        if (low.b) {
            const int first = m->bvh.primitive_indices[low.i];
            a = m->lowers[first];
            b = m->uppers[first];
            for (unsigned int c = low.i + 1; c < high.i; ++c) {
                const int item = m->bvh.primitive_indices[c];
                a = wp::min(a, m->lowers[item]);
                b = wp::max(b, m->uppers[item]);
            }
        } else {
            const wp::BVHPackedNodeHalf& u = m->bvh.node_lowers[low.i];
            const wp::BVHPackedNodeHalf& v = m->bvh.node_lowers[high.i];
            const wp::BVHPackedNodeHalf& s = m->bvh.node_uppers[low.i];
            const wp::BVHPackedNodeHalf& t = m->bvh.node_uppers[high.i];
            a = wp::min(wp::vec3(u.x, u.y, u.z), wp::vec3(v.x, v.y, v.z));
            b = wp::max(wp::vec3(s.x, s.y, s.z), wp::vec3(t.x, t.y, t.z));
        }
        low.x = a[0]; low.y = a[1]; low.z = a[2];
        high.x = b[0]; high.y = b[1]; high.z = b[2];
    }
""")
def refit_boxes(mesh: wp.uint64): ...


@cache
def mesh_refit_kernel(module):
    """Kernel of one thread, on a CPU, whose graph leaves Warp's refit out. The boxes of a mesh: from the last node to the
    first, as a node stands before those below it. `function` is the address of Warp's refit, which makes what winding numbers
    need too, at four times the cost: where `always` is not 0, or a point asks for them (`deep`, and SUNK in a mark)."""

    def refit_deformed_mesh(function: wp.uint64, mesh: wp.uint64, always: int, deep: wp.array(dtype=int),
                            mark: wp.array(dtype=int)):
        wound = always | deep[0]
        for i in range(mark.shape[0]):
            wound = wound | (mark[i] & SUNK)
        if wound != 0:
            call_warp_refit(function, mesh)
        else:
            refit_boxes(mesh)

    return wp.kernel(refit_deformed_mesh, name="refit_mesh", module=module, enable_backward=False)


@cache
def mesh_pose_kernel(module):
    """Kernel over the points of a deforming mesh: its shape at the end of substep k, and the way there [m]."""

    def pose_deformed_mesh(track: wp.array2d(dtype=wp.vec3f), k: int, now: wp.array(dtype=int),
                           point_out: wp.array(dtype=wp.vec3f), step_out: wp.array(dtype=wp.vec3f)):
        i = wp.tid()
        j = substep_number(k, now)
        end = track[j + 1, i]
        point_out[i] = end
        step_out[i] = end - track[j, i]

    return wp.kernel(pose_deformed_mesh, name="pose_mesh", module=module, enable_backward=False)
