"""The tree of a deforming mesh, fitted in launches that the body of a loop on a GPU can hold.

Warp's own refit takes memory for a sum of edge lengths, which such a body cannot. It stands before the loop and behind it, and
keeps that sum; here boxes and solid angles alone become those of the points (as native/mesh.cu of Warp 1.19: Karras 2012,
section 4, bottom up: the second of two children to arrive goes on to their parent). A tree of up to SMALL triangles is one
block's: who has arrived is counted in its shared memory, and no level waits for other multiprocessors. Solid angles, which are
most of the work (H200, 1280 triangles: 100 us by many blocks, 200 by one), are made only where something asks for winding
numbers: `deep`, or SUNK in a mark.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.project import SUNK
from wsim.kernels.math.block import meet

MODULE, BLOCK_MODULE = "wsim_mesh_refit", "wsim_mesh_refit_block"
SMALL, BLOCK = 5000, 512                 # triangles of a tree that one block fits (8 bytes of its memory each); its threads
BOUND = """
    wp::Mesh* m = (wp::Mesh*)mesh;
    const wp::vec3* x = m->points.data;
    const int* c = m->indices.data;
    for (int i = thread; i < m->num_tris; i += threads) {
        m->lowers[i] = wp::min(wp::min(x[c[3 * i]], x[c[3 * i + 1]]), x[c[3 * i + 2]]);
        m->uppers[i] = wp::max(wp::max(x[c[3 * i]], x[c[3 * i + 1]]), x[c[3 * i + 2]]);
    }
    for (int i = thread; i < m->bvh.max_nodes; i += threads)
        COUNTS[i] = 0;
    int asked = deep.data[0];
    for (int i = thread; i < mark.shape[0]; i += threads)
        asked |= mark.data[i] & SUNK;
""".replace("SUNK", str(SUNK))
FIT = """
    wp::Mesh* m = (wp::Mesh*)mesh;
    wp::BVH& tree = m->bvh;
    const wp::vec3* x = m->points.data;
    const int* c = m->indices.data;
    wp::SolidAngleProps* angles = WOUND ? m->solid_angle_props : nullptr;

    auto fill_leaf = [&](int node) {
        wp::BVHPackedNodeHalf& low = tree.node_lowers[node];
        wp::BVHPackedNodeHalf& high = tree.node_uppers[node];
        wp::bounds3 box;
        wp::SolidAngleProps whole;
        for (int k = low.i; k < (int)high.i; k++) {
            const int t = tree.primitive_indices[k];
            box.add_bounds(m->lowers[t], m->uppers[t]);
            if (angles) {
                wp::SolidAngleProps own;
                wp::precompute_triangle_solid_angle_props(x[c[3 * t]], x[c[3 * t + 1]], x[c[3 * t + 2]], own);
                whole = k == (int)low.i ? own : wp::combine_precomputed_solid_angle_props(&whole, &own);
            }
        }
        low.x = box.lower[0]; low.y = box.lower[1]; low.z = box.lower[2];
        high.x = box.upper[0]; high.y = box.upper[1]; high.z = box.upper[2];
        if (angles)
            angles[node] = whole;
    };
    auto fill_parent = [&](int node) {
        wp::BVHPackedNodeHalf& low = tree.node_lowers[node];
        wp::BVHPackedNodeHalf& high = tree.node_uppers[node];
        const int a = low.i, b = high.i;
        const wp::BVHPackedNodeHalf la = tree.node_lowers[a], lb = tree.node_lowers[b];
        const wp::BVHPackedNodeHalf ha = tree.node_uppers[a], hb = tree.node_uppers[b];
        low.x = wp::min(la.x, lb.x); low.y = wp::min(la.y, lb.y); low.z = wp::min(la.z, lb.z);
        high.x = wp::max(ha.x, hb.x); high.y = wp::max(ha.y, hb.y); high.z = wp::max(ha.z, hb.z);
        if (angles)
            wp::combine_precomputed_solid_angle_props(angles[node], &angles[a], a != b ? &angles[b] : nullptr);
    };

    for (int leaf = thread; leaf < tree.num_leaf_nodes; leaf += threads) {
        int node = leaf;
        if (!tree.node_lowers[node].b)
            continue;
        int parent = tree.node_parents[node];
        if (parent == -1 || !tree.node_lowers[parent].b)
            fill_leaf(node);
        while (parent != -1) {
            FENCE();
            if (atomicAdd(&COUNTS[parent], 1) != 1)
                break;
            FENCE();
            const int above = tree.node_parents[parent];
            if (!tree.node_lowers[parent].b)
                fill_parent(parent);
            else if (above == -1 || !tree.node_lowers[above].b)
                fill_leaf(parent);
            node = parent;
            parent = above;
        }
        LEAVE
    }
"""
# many blocks: `wound` becomes 1 where something asks, and 0 behind the root, which nobody reaches before all have read it
ASK, DONE = "    if (asked) wound.data[0] = 1;", "if (parent == -1) wound.data[0] = 0;"
GRID = "m->bvh.node_counts"
BY_BLOCK = f"""
    __shared__ int arrived[{2 * SMALL}];
    bool whole;
    {{{BOUND.replace("COUNTS", "arrived")}
    whole = __syncthreads_or(asked) != 0;}}
    {{{FIT.replace("COUNTS", "arrived").replace("FENCE", "__threadfence_block").replace("WOUND", "whole")}}}
""".replace("LEAVE", "")


@wp.func_native(BOUND.replace("COUNTS", GRID) + ASK)
def bound_triangles(mesh: wp.uint64, thread: int, threads: int, deep: wp.array(dtype=int), mark: wp.array(dtype=int),
                    wound: wp.array(dtype=int)): ...


@wp.func_native(FIT.replace("COUNTS", GRID).replace("FENCE", "__threadfence").replace("WOUND", "wound.data[0]")
                .replace("LEAVE", DONE))
def fit_nodes(mesh: wp.uint64, thread: int, threads: int, wound: wp.array(dtype=int)): ...


@wp.func_native(BY_BLOCK)
def fit_by_block(mesh: wp.uint64, thread: int, threads: int, deep: wp.array(dtype=int), mark: wp.array(dtype=int)): ...


@cache
def bound():
    """Kernel: boxes of the triangles of a mesh; nothing has arrived at nodes of its tree. wound: 0 before."""
    @wp.kernel(module=MODULE, enable_backward=False)
    def bound_mesh(mesh: wp.uint64, threads: int, deep: wp.array(dtype=int), mark: wp.array(dtype=int),
                   wound: wp.array(dtype=int)):
        bound_triangles(mesh, wp.tid(), threads, deep, mark, wound)

    return bound_mesh


@cache
def fit():
    """Kernel: boxes of the nodes of the tree, behind `bound`, and solid angles where `wound` is not 0, which becomes 0."""
    @wp.kernel(module=MODULE, enable_backward=False)
    def fit_mesh(mesh: wp.uint64, threads: int, wound: wp.array(dtype=int)):
        fit_nodes(mesh, wp.tid(), threads, wound)

    return fit_mesh


@cache
def fit_block():
    """Kernel of one block: the shape at the end of a substep, as `wsim.kernels.animation.deformed.pose_mesh`, and boxes and
    solid angles of a tree of up to SMALL triangles. track: shapes, (substeps + 1, points); now: the substep."""
    @wp.kernel(module=BLOCK_MODULE, enable_backward=False, launch_bounds=BLOCK)
    def fit_small_mesh(mesh: wp.uint64, track: wp.array2d(dtype=wp.vec3f), now: wp.array(dtype=int), deep: wp.array(dtype=int),
                       mark: wp.array(dtype=int), point_out: wp.array(dtype=wp.vec3f), step_out: wp.array(dtype=wp.vec3f)):
        k = now[0]
        for i in range(wp.tid(), track.shape[1], wp.block_dim()):
            end = track[k + 1, i]
            point_out[i] = end
            step_out[i] = end - track[k, i]
        meet()
        fit_by_block(mesh, wp.tid(), wp.block_dim(), deep, mark)

    return fit_small_mesh
