"""Tables of surfaces that may touch each other, the list of their near pairs, and how a launch reads the points of a pair.

A point of a surface is p = x + e + shift: shift leads from the origin of its object to one that all surfaces share, in whole
metres. Pairs are taken relative to their first point, so that only differences of coordinates are rounded.

The list has no order that results depend on: what pairs add to a point is summed in whole numbers of UNIT metres
(`fixed_point_sum`), sums of which are the same in any order, so that results are bitwise the same from run to run and by any
number of threads. What does not fit into 63 bits of them would be 8 km in a substep.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

SCALE = 2.0 ** 50                        # of metres: sums are whole numbers of 1 / SCALE
SHARES = 4096                            # of weights, rounded up: 1 / SHARES too many is a sweep that much shorter
OVER = 1.6                               # over-relaxation of sweeps along normals, below 2
OWN, MET, BALL = 0, 1, 2                 # role of a point: of a surface that touches others; that balls alone meet; a ball
STRANDS = 1 << 24                        # `body` of strands of rods, and of none else, is from here on
# Words on the device: a search before the next solve; pairs are listed; projections go on; cuts go on; the round of either;
# projections that a substep has at most; pairs without a proof; points out of their tubes; pairs that are let be, in this pass
# and in the first of a substep; projections and cuts that the substep took; its number, by which points are marked as cut;
# lists that were made in this substep; points out of their tubes behind projections; cuts have ended, and pairs lack a proof;
# 1: a point was cut by much in this substep; how many running; substeps that the list has held; sweeps go on, as pairs are too
# near; how many more were taken; percent of a mean edge by which a pair that meets comes nearer in the substep, where that is
# more than 100; pairs that a list of the frame had no room for; number of the substep behind the one that rows are of;
# 1: the list is for a proof alone; 1: contacts are of one with narrow tubes, 2: with those of pairs that
# are pressed in turn; most pairs of a list so far, or of what its candidates have taken room for; the end of the substep is not
# proven yet; no pair was about to push where the last substep ended
SOON, NEAR, GOING, LEFT, ROUND, ROUNDS, BAD, OUT, CLOSER, CLOSE, SWEPT, TURNED, EPOCH, MADE, STRAYED, PINCH = range(16)
WORST, RUN, AGE, NEARER, MORE, FAST, LACKED, BEHIND, PROOF, NARROW, LISTED, UNPROVEN, CALM = range(16, 29)
WORDS = 29
# Of a row: weights; normal and distance there; push and distance that the pair keeps; push that the sweep before made, from
# which the next leads ahead
B, NORMAL, PUSH, PRIOR = range(4)
Box = wp.types.matrix((4, 3), wp.float32)        # low and high corner where tubes begin, the same where they end [m]


@cache
def surface_type(real):
    """Struct of what never changes in a run, by point where nothing else is said."""
    t = types(real)

    @wp.struct
    class SurfaceTable:
        point: wp.array(dtype=int)                # places of the points of surfaces, (m,)
        triangle: wp.array(dtype=wp.vec3i)        # places, (t,)
        edge: wp.array(dtype=wp.vec2i)            # places, (k,)
        w: wp.array(dtype=t.scalar)               # inverse mass [1/kg]
        shift: wp.array(dtype=t.vec3)             # [m], see above
        far: wp.array(dtype=t.vec3)               # from the origin of the prim's frame to that of the object [m]
        unit: wp.array(dtype=t.scalar)            # bound of the rounding of a written coordinate over its distance there
        reach: wp.array(dtype=t.scalar)           # half of the thickness [m]
        friction: wp.array(dtype=t.vec2)          # static, dynamic
        rest: wp.array(dtype=t.vec3)              # place in the rest shape of the body [m]
        body: wp.array(dtype=int)                 # negative: of a collider; from STRANDS on: a strand
        world: wp.array(dtype=int)
        role: wp.array(dtype=int)                 # OWN, MET, BALL
        there: wp.array(dtype=int)                # 1: the ball is there; empty: all are
        rolls: wp.array(dtype=int)                # 1: a ball that turns, friction is not here (position_based/rolling); or none
        beta: t.scalar                            # least radius of tubes [m]
        longest: t.scalar                         # that they lead ahead by, at most [m]
        tied: int                                 # 1: bodies share points, and `rest` is where they start
        ulp: t.scalar                             # rounding of one operation

    return SurfaceTable


@cache
def pair_type(real):
    """Struct of near pairs, (capacity,). Kernels read it from an array of one on the device: where a list has grown, it has
    other arrays there, and graphs that hold launches of the kernels stay as they are."""
    t = types(real)

    @wp.struct
    class NearPairs:
        capacity: int
        count: wp.array(dtype=int)                # of pairs that were found, (1,); may be more than there is room for
        kind: wp.array(dtype=int)                 # closest.POINT, closest.EDGES
        ids: wp.array(dtype=wp.vec4i)             # places of the points
        keep: wp.array(dtype=t.scalar)            # distance that the pair keeps [m]
        n: wp.array(dtype=t.vec3)                 # normal where the substep begins
        b: wp.array(dtype=t.vec4)                 # weights of its closest points
        away: wp.array(dtype=t.scalar)            # distance there along n [m]
        gap: wp.array(dtype=t.scalar)             # least n . (p_i - p_j) there [m]
        least: wp.array(dtype=t.scalar)           # s, the gap that what is written needs [m]
        push: wp.array(dtype=t.vec3)              # accumulated push [m kg]
        past: wp.array(dtype=t.vec3)              # push of the substep before, 0 in the first of a list [m kg]
        rows: wp.array(dtype=int)                 # pairs that may meet in this substep, (1,): what sweeps are over
        row: wp.array(dtype=int)                  # them
        four: wp.array(dtype=wp.vec4i)            # their points, and what else sweeps need of row j, side by side in memory:
        swept: wp.array(dtype=t.vec4)             # B, NORMAL, PUSH and PRIOR of `4 j`, (4 capacity,)
        active: wp.array(dtype=int)               # rows that take part in sweeps, and that may soon do so, (2,)
        on: wp.array(dtype=int)                   # them
        seen: wp.array(dtype=int)                 # the latter, with those that do
        bad: wp.array(dtype=int)                  # 1: not certified; 2: it was closer than s already, and is let be
        # of row j where Newton steps solve for them (kernels/contact/selfcontact/newton/law.py), else empty:
        stiff: wp.array(dtype=t.scalar)           # stiffness over rate [kg]; 0: the row is not solved for
        force: wp.array(dtype=t.vec3)             # P+ [m kg]
        last: wp.array(dtype=t.scalar)            # C where the step before began [m]
        rho: wp.array(dtype=t.scalar)             # part of the stiffness across the normal; < 0: the row does not push

    return NearPairs


@wp.struct
class BoxPairs:
    """Struct of pairs whose boxes meet."""
    capacity: int
    count: wp.array(dtype=int)                    # (1,); may be more than there is room for
    pair: wp.array(dtype=wp.vec2i)                # (point, triangle), or (edge, -1 - edge), (capacity,)


@wp.struct
class BoxTree:
    leaves: int
    item: wp.array(dtype=int)            # the triangle or edge of a leaf, -1: none, (worlds * leaves,)
    box: wp.array(dtype=Box)             # (worlds * 2 * leaves,)
    front: wp.array(dtype=int)           # of walks on a CPU: nodes of two levels, (2 * leaves,)


@wp.struct
class TreeQuery:
    """A tree, and what looks into it: several share a launch, the threads of each from `first` on."""
    first: int
    kind: int                            # 0: points that look, or a tree of triangles; 1: edges; 2: those of the tree itself;
                                         # levels of nodes that are fitted
    shares: int                          # threads that share a walk, a power of two; nodes of a world that are fitted
    margin: float                        # that pairs keep more than others at most [m]
    order: wp.array(dtype=int)           # what looks, -1: none; what the tree is of, where it is fitted
    into: BoxTree


@wp.func
def query_of_thread(looks: wp.array(dtype=TreeQuery), j: int):
    """Number of the one that thread j is of."""
    n = int(0)
    for m in range(1, looks.shape[0]):
        if j >= looks[m].first:
            n = m
    return n


@cache
def sum_type(real):
    """Struct of what pairs add up by point."""
    @wp.struct
    class PairSums:
        move: wp.array(dtype=wp.int64)            # displacement in 1 / SCALE metres, (3 points,)
        share: wp.array(dtype=int)                # sum of weights in 1 / SHARES, (points,)
        factor: wp.array(dtype=types(real).scalar)       # part of its motion that a point keeps, (points,)
        taken: wp.array(dtype=wp.int64)  # of m |d|^2 that cuts took, see kernels/contact/selfcontact/step_clamp.py, (1,)
        cut: wp.array(dtype=int)                  # number of the substep in which its motion was cut last, (points,)

    return PairSums


@cache
def pair_geometry_funcs(real):
    """Functions (place, step): of point k relative to point o at the start of the substep [m]; and how far k goes."""
    t = types(real)
    Surfaces = surface_type(real)

    @wp.func
    def point_relative_to(s: Surfaces, x: wp.array(dtype=t.vec3), e: wp.array(dtype=t.vec3), k: int, o: int):
        return ((x[k] - x[o]) + (s.shift[k] - s.shift[o])) + (e[k] - e[o])

    @wp.func
    def file_rounding_bound(s: Surfaces, x: wp.array(dtype=t.vec3), k: int):
        """Bound of the rounding of a point in the file [m]: float32 in the frame of its prim."""
        return s.unit[k] * wp.length(x[k] + s.far[k])

    return point_relative_to, file_rounding_bound


@cache
def fixed_point_sum(real):
    """Function: adds a displacement [m] to a point's sum."""
    vec3, Sums = types(real).vec3, sum_type(real)

    @wp.func
    def add_fixed_point_move(to: Sums, k: int, move: vec3):
        scale = real(SCALE)
        wp.atomic_add(to.move, 3 * k, wp.int64(scale * move[0]))
        wp.atomic_add(to.move, 3 * k + 1, wp.int64(scale * move[1]))
        wp.atomic_add(to.move, 3 * k + 2, wp.int64(scale * move[2]))

    return add_fixed_point_move


@cache
def pair_sum_apply_func(real):
    """Function (d, done, i, to) -> d of point i as pairs have moved it; their sums are zero again. done 1: weights are, too."""
    t = types(real)
    Sums = sum_type(real)

    @wp.func
    def apply_pair_sum(d: t.vec3, done: int, i: int, to: Sums):
        scale = real(1.0 / SCALE)
        move = t.vec3(real(to.move[3 * i]), real(to.move[3 * i + 1]), real(to.move[3 * i + 2]))
        to.move[3 * i] = wp.int64(0)
        to.move[3 * i + 1] = wp.int64(0)
        to.move[3 * i + 2] = wp.int64(0)
        if done > 0:
            to.share[i] = 0
        return d + scale * move

    return apply_pair_sum


@cache
def settle_sums(real, module):
    """Kernel: points go as pairs have summed up; the sums are zero again. done 1: weights are, too; else the next sweep is of
    the same pairs."""
    t = types(real)
    Sums, add = sum_type(real), pair_sum_apply_func(real)

    @wp.kernel(module=module, enable_backward=False)
    def add_sums(point: wp.array(dtype=int), d: wp.array(dtype=t.vec3), done: int, to: Sums, d_out: wp.array(dtype=t.vec3)):
        i = point[wp.tid()]
        if to.share[i] > 0:
            d_out[i] = add(d[i], done, i, to)

    return add_sums


@cache
def absent_ball_func(real):
    """Function (s, k): whether point k is a ball that is not there."""
    Surfaces = surface_type(real)

    @wp.func
    def is_absent_ball(s: Surfaces, k: int):
        if not s.there:
            return False
        return s.role[k] == BALL and s.there[k] != 1

    return is_absent_ball


@cache
def presence_kernel(module):
    """Kernel over balls: where one has come or gone since `known`, the list is made anew. there: by place."""
    @wp.kernel(module=module, enable_backward=False)
    def watch_presence(balls: wp.array(dtype=int), there: wp.array(dtype=int), known: wp.array(dtype=int),
                       words: wp.array(dtype=int)):
        j = wp.tid()
        now = there[balls[j]]
        if now != known[j]:
            known[j] = now
            words[SOON] = 1

    return watch_presence
