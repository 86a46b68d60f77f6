"""Numbers that points of strands leave for the elimination (lanes.py): of a point, of the edge behind it, of the bend at it."""

import warp as wp

from wsim.kernels.rods.edges.edge_contact_law import EdgeForces
from wsim.kernels.rods.element import rod_strain_functions
from wsim.kernels.rods.forces import damped_strains, damping_gain, spin_stiffness_with_gain
from wsim.kernels.rods.tables import RodMotion, RodStep, RodTable, RodTrial

LANES = 4
# Numbers of a point: of itself; of the edge behind it; of the bend at it; of the air, and of colliders, on that edge.
SYMMETRIC, LAST, RIGHT, FREE = 0, 6, 7, 11   # upper triangle of its block, by rows; the angle's; right side; 1: free, it spins
EDGE, BENT, MORE = 13, 19, 46                # MORE: the air's AIR, if there is any, then
AIR, TOUCH, OWNED = 9, 18, 9                 # colliders', those of the edge's second point, then those of its first
OFF, SLOPES, SPINS, OWN, TORQUES = BENT, BENT + 3, BENT + 21, BENT + 24, BENT + 25      # of a bend
STEPS = 5                        # of points whose numbers are under way from memory
Bend = rod_strain_functions().Bend


@wp.struct
class RodParts:
    """Table of what points leave for their strands, and the state of Newton's method, (strands,).

    part (`numbers_per_point`, points + 2, strands), what a point has not is 0, of points past the end the block is 1:
    from EDGE on the tangent, stiffness along it less that across, that across [N/m], tension [N]; from BENT on strains less
    those at rest, their gradients by both edges and, as `spinning` has them, by the angles, all times the root of their
    stiffness with damping (strains times stiffness over that root), what adds to the angles' own stiffness [N m], torques on
    the angles [N m]; of the air half its force [N], and the upper triangle of its stiffness [N/m]; of colliders the upper
    triangle of the stiffness of the edge's second point, that between both by rows [N/m], and the force on the second [N]: 0
    where there is no contact, and read only of strands that have one (`edges`); stiffness and force of the first likewise,
    which `measure` adds to the point's own"""

    part: wp.array3d(dtype=wp.float64)
    factor: wp.array3d(dtype=wp.float64)            # (36, points, strands): near, far, right side
    least: wp.array(dtype=wp.float64)               # shortest edge [m]
    before: wp.array(dtype=wp.float64)              # greatest correction of the iteration before [m]
    share: wp.array(dtype=wp.float64)               # of a correction that is taken
    taken: wp.array(dtype=wp.float64)               # the same, of steps that are longer than the shortest edge less
    count: wp.array(dtype=int)                      # iterations of its substep
    at: wp.array(dtype=int)                         # its substep
    on: wp.array(dtype=int)                         # 1: it has substeps to solve
    done: wp.array(dtype=int)                       # 1: it has solved one in this iteration
    moved: wp.array(dtype=int)                      # 1: it has moved in this iteration
    edges: wp.array(dtype=int)                      # 1: an edge touches a collider between its points in this iteration
    list: wp.array(dtype=int)                       # strands that launches go over, in any order
    listed: wp.array(dtype=int)                     # how many, (1,)
    h: wp.float64                                   # length of a substep [s]
    substeps: int                                   # of a frame


@wp.func
def store_point_vector(part: wp.array3d(dtype=wp.float64), first: int, i: int, k: int, v: wp.vec3d):
    """Stores three numbers of a point."""
    part[first, i, k] = v[0]
    part[first + 1, i, k] = v[1]
    part[first + 2, i, k] = v[2]


@wp.func
def keep_symmetric(part: wp.array3d(dtype=wp.float64), first: int, i: int, k: int, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Stores the upper triangle of a block's rows."""
    store_point_vector(part, first, i, k, a)
    part[first + 3, i, k] = b[1]
    part[first + 4, i, k] = b[2]
    part[first + 5, i, k] = c[2]


def numbers_per_point(airy: bool) -> int:
    """How many a point has that colliders do not touch between it and the next. airy: with air."""
    return MORE + AIR * airy


SIZES = (numbers_per_point(False), numbers_per_point(True))


@wp.func
def keep_inside(A: RodParts, first: int, i: int, k: int, t: EdgeForces):
    """Stores what colliders give the edge behind a point, and behind these what is the point's own. first: of these numbers."""
    keep_symmetric(A.part, first, i, k, t.K1[0], t.K1[1], t.K1[2])
    for c in range(wp.static(3)):
        store_point_vector(A.part, first + 6 + 3 * c, i, k, t.K[c])
    store_point_vector(A.part, first + 15, i, k, t.f1)
    keep_symmetric(A.part, first + wp.static(TOUCH), i, k, t.K0[0], t.K0[1], t.K0[2])
    store_point_vector(A.part, first + wp.static(TOUCH + 6), i, k, t.f0)


@wp.func
def inside_own(A: RodParts, first: int, i: int, k: int):
    """Stiffness and force that colliders give the first point of the edge behind it."""
    a = wp.vec3d(A.part[first, i, k], A.part[first + 1, i, k], A.part[first + 2, i, k])
    b = wp.vec3d(A.part[first + 3, i, k], A.part[first + 4, i, k], A.part[first + 5, i, k])
    f = wp.vec3d(A.part[first + 6, i, k], A.part[first + 7, i, k], A.part[first + 8, i, k])
    return wp.mat33d(a[0], a[1], a[2], a[1], b[0], b[1], a[2], b[1], b[2]), f


@wp.func
def keep_bend(S: RodTable, Q: RodMotion, T: RodTrial, A: RodParts, p: RodStep, i: int, k: int, f: Bend):
    """Stores the strains of a point."""
    more = damping_gain(S, Q, p.h, i - 1, i + 1, k)
    all = wp.float64(1.0) + more
    B = wp.sqrt(S.B[i, k] * all)
    q = wp.vec3d(B, B, wp.sqrt(S.C[i, k] * all))
    off = wp.cw_mul(damped_strains(S, Q, T, p, f, i, k), q) / all
    store_point_vector(A.part, wp.static(OFF), i, k, off)
    for c in range(wp.static(3)):
        store_point_vector(A.part, wp.static(SLOPES) + 3 * c, i, k, f.a[c] * q[c])
        store_point_vector(A.part, wp.static(SLOPES + 9) + 3 * c, i, k, f.b[c] * q[c])
    turn = spin_stiffness_with_gain(S, f, more, i, k)
    store_point_vector(A.part, wp.static(SPINS), i, k, wp.vec3d(B * turn[0], B * turn[1], q[2]))
    A.part[wp.static(OWN), i, k] = S.B[i, k] * turn[2]
    A.part[wp.static(TORQUES), i, k] = -wp.dot(off, wp.cw_mul(f.u, q))
    A.part[wp.static(TORQUES + 1), i, k] = -wp.dot(off, wp.cw_mul(f.w, q))


@wp.func
def keep_edge(T: RodTrial, A: RodParts, i: int, k: int, t: wp.vec3d, length: wp.float64, pull: wp.vec2d):
    """Stores the tension (pull: `drawn`) of the edge behind a point."""
    across = wp.max(T.pull[i, k] / wp.max(length, wp.float64(1e-30)), wp.float64(0.0))
    store_point_vector(A.part, wp.static(EDGE), i, k, t)
    store_point_vector(A.part, wp.static(EDGE + 3), i, k, wp.vec3d(pull[1] - across, across, pull[0]))
