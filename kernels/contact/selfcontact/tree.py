"""A tree of boxes that move: each has corners where its tubes begin and where they end, linear in time between.

Boxes that are apart along one axis, on the same side, where they begin and where they end are apart all the time between:
corners go linearly. Only differences of motions enter, so that what goes along together, however far, has few boxes to look
at, which boxes about whole ways do not.

Nodes are numbered as those of a heap: 1 is the root, 2 i and 2 i + 1 are below node i, and leaves, as many as a power of two,
stand in the order of a curve that keeps what is near together (wsim/physics/contact/selfcontact/tree.py). A walk looks at the
two nodes below one at once, whose boxes lie side by side, and needs no stack: bit k of its trail says that the node behind the
one k levels up is met, too, and is to be seen (Laine 2010, Restart trail for stackless BVH traversal, keeps one bit a level
alike). A CPU goes through a tree level by level instead, for one that looks at a time: 20 ns for two nodes where it took 50.
Each world has a tree of its own, 2 leaves nodes further on; empty leaves have boxes that meet none.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.motion_bounds import frame_type
from wsim.kernels.contact.selfcontact.pairs import Box, BoxTree, TreeQuery, query_of_thread

ROUNDED = 2.0 ** -22                     # of coordinates, that boxes are larger by: results of a few operations in float32
BITS = 10                                # of places along an axis


@wp.func_native("""
    wp::mat_t<4, 3, wp::float32> found;
#ifdef __CUDA_ARCH__
    const float4* p = reinterpret_cast<const float4*>(of.data + i);
    const float4 a = p[0], b = p[1], c = p[2];
    const float each[12] = {a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x, c.y, c.z, c.w};
    for (int k = 0; k < 12; ++k)
        found.data[k / 3][k % 3] = each[k];
#else
    found = of.data[i];
#endif
    return found;
""")
def tree_node_box(of: wp.array(dtype=Box), i: int) -> Box:
    """Box of a node, by three reads."""


@wp.func
def boxes_stay_apart(a: Box, b: Box, room: float):
    """True if boxes stay more than `room` apart [m]."""
    found = bool(False)
    for k in range(3):
        if a[0, k] - b[1, k] > room and a[2, k] - b[3, k] > room:
            found = True
        if b[0, k] - a[1, k] > room and b[2, k] - a[3, k] > room:
            found = True
    return found


@wp.func
def children_met(ours: Box, into: BoxTree, root: int, node: int, room: float):
    """Which of the two nodes below one are met: 1 the first, 2 the second, 3 both."""
    met = int(0)
    if not boxes_stay_apart(ours, tree_node_box(into.box, root + 2 * node), room):
        met = 1
    if not boxes_stay_apart(ours, tree_node_box(into.box, root + 2 * node + 1), room):
        met += 2
    return met


@wp.func
def trail_after_leaf(ours: Box, into: BoxTree, root: int, leaf: int, top: int, room: float):
    """The trail of a walk below node `top` that is to see what stands behind a leaf there."""
    trail = int(0)
    bit = int(1)
    node = leaf
    while node > top:
        if node % 2 == 0 and not boxes_stay_apart(ours, tree_node_box(into.box, root + node + 1), room):
            trail += bit
        bit *= 2
        node = node / 2
    return trail


@wp.func
def next_walk_node(node: int, trail: int):
    """(node, trail) that a walk goes on with behind a node and all below it; node 0: it ends."""
    if trail == 0:
        return 0, 0
    here = node
    left = trail
    while left % 2 == 0:
        here = here / 2
        left = left / 2
    return here + 1, left - 1


LANES = """
    typedef float four __attribute__((ext_vector_type(4), aligned(4)));
    typedef int each __attribute__((ext_vector_type(4)));
    const float* p = &a.data[0][0];
    const four a0 = *(const four*)p, a1 = *(const four*)(p + 3), a2 = *(const four*)(p + 6), a3 = (*(const four*)(p + 8)).yzww;
    const auto meets = [&](int node) {
        const float* q = &of.data[root + node].data[0][0];
        const four b0 = *(const four*)q, b1 = *(const four*)(q + 3), b2 = *(const four*)(q + 6),
                   b3 = (*(const four*)(q + 8)).yzww;
        const each apart = ((a0 - b1 > room) & (a2 - b3 > room)) | ((b0 - a1 > room) & (b2 - a3 > room));
        return __builtin_reduce_or(apart & each{-1, -1, -1, 0}) == 0 ? 1 : 0;
    };
"""


@wp.func_native(LANES + """
    int *now = front.data, *next = now + leaves, count = 0, path = 1;
    if (after < 0) {
        now[0] = 1;
        count = meets(1);
    }
    for (int level = 2; level <= leaves; level *= 2) {
        int found = 0;
        if (after >= 0) {
            path = (leaves + after) / (leaves / level);
            next[0] = path + 1;
            found = path % 2 == 0 ? meets(path + 1) : 0;
        }
        for (int k = 0; k < count; ++k)
            for (int side = 0; side < 2; ++side) {
                const int node = 2 * now[k] + side;
                next[found] = node;
                found += meets(node);
            }
        int* const other = now;
        now = next, next = other, count = found;
    }
    if (now != front.data)
        for (int k = 0; k < count; ++k)
            front.data[k] = now[k];
    return count;
""")
def count_leaves_met(a: Box, of: wp.array(dtype=Box), root: int, leaves: int, after: int, room: float,
                     front: wp.array(dtype=int)) -> int:
    """Number of leaves that a box meets, which stand in order in `front`: level by level, without a branch that depends on a
    box, since a CPU takes longer to guess wrong than to look. after: only leaves behind that one, -1: all."""


@wp.func_native(LANES + """
    int *const found = front.data + leaves, n = 0;
    for (int k = 0; k < count; ++k) {
        found[n] = front.data[k];
        n += front.data[k] > leaves + after ? meets(front.data[k]) : 0;
    }
    return n;
""")
def filter_leaves_met(a: Box, of: wp.array(dtype=Box), root: int, leaves: int, after: int, room: float,
                      front: wp.array(dtype=int), count: int) -> int:
    """As `count_leaves_met`, but of the first `count` nodes in `front`; they stand behind the first `leaves` places there."""


@wp.func
def joined_swept_box(a: Box, b: Box):
    """Box about two."""
    c = Box()
    for k in range(3):
        c[0, k] = wp.min(a[0, k], b[0, k])
        c[1, k] = wp.max(a[1, k], b[1, k])
        c[2, k] = wp.min(a[2, k], b[2, k])
        c[3, k] = wp.max(a[3, k], b[3, k])
    return c


@cache
def tube_box_funcs(real):
    """Functions: box about the tube of a point; and about that of points a, b, c."""
    Frames = frame_type(real)

    @wp.func
    def box_about_tube(f: Frames, i: int):
        lead = real(f.lead[0])
        c = Box()
        for k in range(3):
            begin = f.start[i][k]
            end = begin + lead * f.way[i][k]
            room = f.beta[i] + real(ROUNDED) * (wp.abs(begin) + wp.abs(end))
            c[0, k] = float(begin - room)
            c[1, k] = float(begin + room)
            c[2, k] = float(end - room)
            c[3, k] = float(end + room)
        return c

    @wp.func
    def box_about_points(f: Frames, a: int, b: int, c: int):
        found = joined_swept_box(box_about_tube(f, a), box_about_tube(f, b))
        if c != b:
            found = joined_swept_box(found, box_about_tube(f, c))
        return found

    return box_about_tube, box_about_points


@cache
def leaf_box_kernel(real, module):
    """Kernel over the leaves of all trees: their boxes."""
    Surfaces, Frames = pairs.surface_type(real), frame_type(real)
    _, about = tube_box_funcs(real)

    @wp.kernel(module=module, enable_backward=False)
    def lay_leaves(s: Surfaces, f: Frames, trees: wp.array(dtype=TreeQuery)):
        to = trees[query_of_thread(trees, wp.tid())]
        j = wp.tid() - to.first
        i = to.order[j]
        if i >= 0:
            ids = wp.vec3i(0, 0, 0)
            if to.kind == 0:
                ids = s.triangle[i]
            if to.kind == 1:
                ids = wp.vec3i(s.edge[i][0], s.edge[i][1], s.edge[i][1])
            to.into.box[j + (1 + j / to.into.leaves) * to.into.leaves] = about(f, ids[0], ids[1], ids[2])

    return lay_leaves


@wp.func
def join_below(to: BoxTree, root: int, node: int, levels: int):
    """Boxes of a node and of `levels` - 1 levels below it, of those below these."""
    width = (1 << levels) / 2
    while width > 0:
        for k in range(node * width, (node + 1) * width):
            to.box[root + k] = joined_swept_box(tree_node_box(to.box, root + 2 * k), tree_node_box(to.box, root + 2 * k + 1))
        width = width / 2


@cache
def node_box_kernel(module):
    """Kernel over nodes of all trees, as many of each world as `shares` says: their boxes, and those of `kind` - 1 levels below
    them, of those below these. A thread takes what is below its node: a launch for some levels."""
    @wp.kernel(module=module, enable_backward=False)
    def join_node_boxes(trees: wp.array(dtype=TreeQuery)):
        to = trees[query_of_thread(trees, wp.tid())]
        j = wp.tid() - to.first
        join_below(to.into, (j / to.shares) * 2 * to.into.leaves, to.shares + j % to.shares, to.kind)

    return join_node_boxes


@cache
def morton_order_kernel(real, module):
    """Kernel: places along a Morton curve, BITS for each axis in units of `cell` [m], anew where they end, of triangles
    (kind 0), edges (1) or points (2) in `item`; its stretches of `each` stay together, -1 behind the others."""
    Surfaces, Frames = pairs.surface_type(real), frame_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def number_items(s: Surfaces, f: Frames, kind: int, each: int, cell: float, item: wp.array(dtype=int),
                     key: wp.array(dtype=wp.int64)):
        j = wp.tid()
        i = item[j]
        stretch = wp.int64(j / each)
        if i < 0:
            key[j] = (wp.int64(2) * stretch + wp.int64(1)) << wp.int64(3 * BITS)
            return
        ids = wp.vec3i(i, i, i)
        if kind == 0:
            ids = s.triangle[i]
        if kind == 1:
            ids = wp.vec3i(s.edge[i][0], s.edge[i][1], s.edge[i][0])
        x = f.start[ids[0]] + f.start[ids[1]] + f.start[ids[2]]
        found = wp.int64(0)
        for axis in range(3):
            place = int(wp.floor(float(x[axis]) / (3.0 * cell)))
            for bit in range(BITS):
                found |= wp.int64((place >> bit) & 1) << wp.int64(3 * bit + axis)
        key[j] = (wp.int64(2) * stretch) << wp.int64(3 * BITS) | found

    return number_items
