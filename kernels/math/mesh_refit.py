"""The tree of a deforming mesh, fitted in launches that the body of a loop on a GPU can hold.

Warp's own refit takes memory for a sum of edge lengths, which such a body cannot. It stands before the loop and behind it, and
keeps that sum; here boxes and solid angles alone become those of the points (as native/mesh.cu of Warp 1.19: Karras 2012,
section 4, bottom up: the second of two children to arrive goes on to their parent). A tree of up to SMALL triangles is one
block's: who has arrived is counted in its shared memory, and no level waits for other multiprocessors. Solid angles, which are
most of the work (H200, 1280 triangles: 100 us by many blocks, 200 by one), are made only where something asks for winding
numbers: `deep`, or SUNK in a mark.

Boxes are fitted FITS times a frame, not in every substep (H200, 4672 triangles: 153 us). The shapes of a frame are known
before it, and queries see a mesh at the ends of substeps alone, so the box of a triangle holds its places at the ends of
all substeps until the next fit. Boxes of triangles of 2.4 cm that go 1.5 cm a frame, at most 6, have a tenth more area for it.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.project import SUNK
from wsim.kernels.math.block import block_barrier

MODULE, BLOCK_MODULE = "wsim_mesh_refit", "wsim_mesh_refit_block"
FITS = 8                                 # times that boxes are fitted in a frame, at most: with more, they are smaller
SMALL, BLOCK = 5000, 512                 # triangles of a tree that one block fits (8 bytes of its memory each); its threads
BOUND = """
    wp::Mesh* m = (wp::Mesh*)tree_of.mesh;
    const int* c = m->indices.data;
    const wp::vec3 *low = tree_of.low.data, *high = tree_of.high.data;
    for (int i = thread; i < m->num_tris && boxes; i += threads) {
        const int p = c[3 * i], q = c[3 * i + 1], r = c[3 * i + 2];
        m->lowers[i] = wp::min(wp::min(low[p], low[q]), low[r]);
        m->uppers[i] = wp::max(wp::max(high[p], high[q]), high[r]);
    }
    for (int i = thread; i < m->bvh.max_nodes; i += threads)
        COUNTS[i] = 0;
    int asked = tree_of.deep.data[0];
    for (int i = thread; i < tree_of.mark.shape[0]; i += threads)
        asked |= tree_of.mark.data[i] & SUNK;
""".replace("SUNK", str(SUNK))
FIT = """
    wp::Mesh* m = (wp::Mesh*)tree_of.mesh;
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
        if (boxes) {
            low.x = box.lower[0]; low.y = box.lower[1]; low.z = box.lower[2];
            high.x = box.upper[0]; high.y = box.upper[1]; high.z = box.upper[2];
        }
        if (angles)
            angles[node] = whole;
    };
    auto fill_parent = [&](int node) {
        wp::BVHPackedNodeHalf& low = tree.node_lowers[node];
        wp::BVHPackedNodeHalf& high = tree.node_uppers[node];
        const int a = low.i, b = high.i;
        if (boxes) {
            const wp::BVHPackedNodeHalf la = tree.node_lowers[a], lb = tree.node_lowers[b];
            const wp::BVHPackedNodeHalf ha = tree.node_uppers[a], hb = tree.node_uppers[b];
            low.x = wp::min(la.x, lb.x); low.y = wp::min(la.y, lb.y); low.z = wp::min(la.z, lb.z);
            high.x = wp::max(ha.x, hb.x); high.y = wp::max(ha.y, hb.y); high.z = wp::max(ha.z, hb.z);
        }
        if (angles)
            wp::combine_precomputed_solid_angle_props(angles[node], &angles[a], a != b ? &angles[b] : nullptr);
    };

    for (int leaf = thread; leaf < tree.num_leaf_nodes && (boxes || angles); leaf += threads) {
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
ASK, DONE = "    if (asked) tree_of.wound.data[0] = 1;", "if (parent == -1) tree_of.wound.data[0] = 0;"
GRID = "m->bvh.node_counts"
BY_BLOCK = f"""
    __shared__ int arrived[{2 * SMALL}];
    bool whole;
    {{{BOUND.replace("COUNTS", "arrived")}
    whole = __syncthreads_or(asked) != 0;}}
    {{{FIT.replace("COUNTS", "arrived").replace("FENCE", "__threadfence_block").replace("WOUND", "whole")}}}
""".replace("LEAVE", "")


@wp.struct
class FittedTree:
    mesh: wp.uint64
    track: wp.array2d(dtype=wp.vec3f)         # shapes at the moments of a frame [m], (substeps + 1, points)
    low: wp.array(dtype=wp.vec3f)             # boxes of the places of each point at the ends of `span` substeps, (points,)
    high: wp.array(dtype=wp.vec3f)
    deep: wp.array(dtype=int)                 # not 0: winding numbers are asked for, (1,)
    mark: wp.array(dtype=int)                 # of points: SUNK asks for them
    # whether something asks, between `triangle_bound_kernel` and `tree_fit_kernel`; 0 elsewhere, (1,)
    wound: wp.array(dtype=int)
    first: int                                # substep that the loop begins with
    span: int                                 # substeps that boxes hold for


@wp.func_native(BOUND.replace("COUNTS", GRID) + ASK)
def bound_triangles(tree_of: FittedTree, thread: int, threads: int, boxes: bool): ...


@wp.func_native(FIT.replace("COUNTS", GRID).replace("FENCE", "__threadfence").replace("WOUND", "tree_of.wound.data[0]")
                .replace("LEAVE", DONE))
def fit_nodes(tree_of: FittedTree, thread: int, threads: int, boxes: bool): ...


@wp.func_native(BY_BLOCK)
def fit_by_block(tree_of: FittedTree, thread: int, threads: int, boxes: bool): ...


def span_of(substeps: int) -> int:
    """Substeps that boxes hold for."""
    return -(-substeps // FITS)


@wp.func
def is_fitted(tree: FittedTree, k: int):
    """Whether boxes are fitted in substep k."""
    return (k - tree.first) % tree.span == 0


@wp.func
def pose_point(tree: FittedTree, i: int, k: int, point_out: wp.array(dtype=wp.vec3f), step_out: wp.array(dtype=wp.vec3f)):
    """Point i at the end of substep k, and the way there [m]; where boxes are fitted, its own."""
    end = tree.track[k + 1, i]
    point_out[i] = end
    step_out[i] = end - tree.track[k, i]
    if is_fitted(tree, k):
        low = end
        high = end
        for j in range(k + 2, wp.min(k + tree.span, tree.track.shape[0] - 1) + 1):
            low = wp.min(low, tree.track[j, i])
            high = wp.max(high, tree.track[j, i])
        tree.low[i] = low
        tree.high[i] = high


@cache
def pose_point_kernel():
    """Kernel over points: `pose_point` in substep now[0]."""
    @wp.kernel(module=MODULE, enable_backward=False)
    def pose_boxes(tree: FittedTree, now: wp.array(dtype=int), point_out: wp.array(dtype=wp.vec3f),
                   step_out: wp.array(dtype=wp.vec3f)):
        pose_point(tree, wp.tid(), now[0], point_out, step_out)

    return pose_boxes


@cache
def triangle_bound_kernel():
    """Kernel: boxes of the triangles of a mesh, behind `pose_point_kernel`; nothing has arrived at nodes of its tree. wound: 0
    before."""
    @wp.kernel(module=MODULE, enable_backward=False)
    def bound_mesh(tree: FittedTree, threads: int, now: wp.array(dtype=int)):
        bound_triangles(tree, wp.tid(), threads, is_fitted(tree, now[0]))

    return bound_mesh


@cache
def tree_fit_kernel():
    """Kernel: boxes of the nodes of the tree, behind `triangle_bound_kernel`, and solid angles where `wound` is not 0, which
    becomes 0."""
    @wp.kernel(module=MODULE, enable_backward=False)
    def fit_mesh(tree: FittedTree, threads: int, now: wp.array(dtype=int)):
        fit_nodes(tree, wp.tid(), threads, is_fitted(tree, now[0]))

    return fit_mesh


@cache
def fit_block():
    """Kernel of one block: `pose_point_kernel`, `triangle_bound_kernel` and `tree_fit_kernel` of a tree of up to SMALL
    triangles."""
    @wp.kernel(module=BLOCK_MODULE, enable_backward=False, launch_bounds=BLOCK)
    def fit_small_mesh(tree: FittedTree, now: wp.array(dtype=int), point_out: wp.array(dtype=wp.vec3f),
                       step_out: wp.array(dtype=wp.vec3f)):
        k = now[0]
        for i in range(wp.tid(), tree.track.shape[1], wp.block_dim()):
            pose_point(tree, i, k, point_out, step_out)
        block_barrier()
        fit_by_block(tree, wp.tid(), wp.block_dim(), is_fitted(tree, k))

    return fit_small_mesh
