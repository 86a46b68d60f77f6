"""Systems of strands, made by a thread a point: what the point, the edge behind it and the bend behind that give the blocks of
three points in a row (kernels/rods/eliminate.py has them as a window that moves), and nodes of two points that these are summed
into (kernels/rods/coupled_newton/reduction.py)."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.rods.air import air_force_on_edge
from wsim.kernels.rods.contact import TINY, Colliders
from wsim.kernels.rods.coupled_newton.coupled import GOING, CoupledRods
from wsim.kernels.rods.coupled_newton.reduction import NEXT, OWN
from wsim.kernels.rods.edges.inside import inside_edge_functions
from wsim.kernels.rods.eliminate import EliminationWindow
from wsim.kernels.rods.forces import damped_strains, damping_gain, edge_tension
from wsim.kernels.rods.system import (
    add_bending,
    add_edge_contact,
    add_edge_tension,
    add_stiffness,
    point_block_func,
    push_edge_ends,
    strains,
)
from wsim.kernels.rods.tables import RodMotion, RodStep, RodTable, RodTrial, is_own_point


@wp.struct
class RodTeam:
    """Parts of blocks by point, systems by node (two points)."""

    parts: wp.array3d(dtype=wp.mat44d)              # as `EliminationWindow` has them: D0, D1, D2, P, N, F, (6, points, strands)
    sides: wp.array3d(dtype=wp.vec4d)               # r0, r1, r2
    nodes: wp.array3d(dtype=wp.float64)             # see `reduction.factor`
    work: wp.array(dtype=wp.float64)
    most: wp.array(dtype=int)                       # nodes of the longest strand of each world
    sums: wp.array(dtype=wp.vec3d)                  # of worlds, see `coupled.judge`
    before: wp.array2d(dtype=wp.vec3d)              # places before a correction is taken [m]
    ids: wp.array(dtype=wp.vec4i)                   # points of pairs, and their weights; only where edges touch each other
    b: wp.array(dtype=wp.vec4d)
    # kernels/rods/coupled_newton/closed.py, where some strands are closed:
    slack: wp.array3d(dtype=wp.vec4d)               # M^-1 J^T, (7, points, strands)
    lam: wp.array2d(dtype=wp.vec4d)                 # lam, (strands, 2)
    # kernels/rods/coupled_newton/reduced.py, where there is room for it:
    chosen: wp.array2d(dtype=int)                   # pairs that press, (worlds, PAIRS)
    number: wp.array(dtype=int)                     # of a pair among them
    where: wp.array3d(dtype=int)                    # node at which a column is eliminated, -1: none, (worlds, steps, COLUMNS)
    path: wp.array3d(dtype=wp.float64)              # v and D^-1 v there, (worlds, 16 steps, COLUMNS)
    compliance: wp.array3d(dtype=wp.float64)        # W [m/N], (worlds, COLUMNS, COLUMNS)


@cache
def part_point_kernel(kinds: tuple[str, ...], airy: bool, module: str):
    """Kernel over points: their parts of the blocks. kinds: of colliders. airy: with air."""
    point, meets = point_block_func(kinds, airy, True), bool(kinds)
    clear, touch = (inside_edge_functions(kinds).clear, inside_edge_functions(kinds).touch) if meets else (None, None)

    @wp.kernel(module=module, enable_backward=False)
    def part_points(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, G: CoupledRods, A: RodTeam, p: RodStep,
                    words: wp.array(dtype=int)):
        m = S.points.shape[0]
        i = wp.tid() / m
        k = wp.tid() - i * m
        if wp.tid() == 0:
            words[GOING] = 0
        if i >= S.points[k] or G.on[G.world[k]] != 1:
            return
        w = EliminationWindow()
        D, r = point(S, C, Q, T, p, i, k)
        w.D0 = D
        w.r0 = r
        if i + 1 < S.points[k]:
            e0 = T.x[i + 1, k] - T.x[i, k]
            l0 = wp.length(e0)
            t0 = e0 / wp.max(l0, TINY)
            w = add_edge_tension(S, T, w, t0, l0, edge_tension(S, Q, T, p, t0, l0, i, k), i, k)
            if wp.static(meets):
                held = S.hold[i, k] >= 0 and S.hold[i + 1, k] >= 0
                if not held and is_own_point(S, i, k) and not clear(C, S, T, p.at, i, k):
                    w = add_edge_contact(S, w, touch(C, S, Q, T, p.h * p.h, p.at, i, k), i, k)
            if wp.static(airy):
                f, K = air_force_on_edge(S, Q, T, p, i, k)
                w = push_edge_ends(S, w, f, K, i, k)
            w.P = add_stiffness(w.P, T.along[i, k])
            if T.bridge:
                w.P = add_stiffness(w.P, T.bridge[i, k])
            if i + 2 < S.points[k] and S.clamped[i, k] + S.clamped[i + 1, k] < 2:
                e1 = T.x[i + 2, k] - T.x[i + 1, k]
                l1 = wp.length(e1)
                s = strains(t0, e1 / wp.max(l1, TINY), wp.max(l0, TINY), wp.max(l1, TINY), T.d[i, k], T.d[i + 1, k],
                            T.phi[i + 1, k])
                T.phi[i + 1, k] = s.s[2]
                w = add_bending(S, w, s, damped_strains(S, Q, T, p, s, i + 1, k), damping_gain(S, Q, p.h, i, i + 2, k), i + 1,
                                k)
        A.parts[0, i, k] = w.D0
        A.parts[1, i, k] = w.D1
        A.parts[2, i, k] = w.D2
        A.parts[3, i, k] = w.P
        A.parts[4, i, k] = w.N
        A.parts[5, i, k] = w.F
        A.sides[0, i, k] = w.r0
        A.sides[1, i, k] = w.r1
        A.sides[2, i, k] = w.r2

    return part_points


@wp.func
def assemble_strand_node(S: RodTable, G: CoupledRods, A: RodTeam, i: int, k: int):
    """Puts the blocks of a point into its node, and its right-hand side into G; the force along the last step."""
    n = S.points[k]
    D = A.parts[0, i, k]
    r = A.sides[0, i, k]
    near = A.parts[3, i, k]
    far = A.parts[5, i, k]
    if i > 0:
        D += A.parts[1, i - 1, k]
        r += A.sides[1, i - 1, k]
        near += A.parts[4, i - 1, k]
    if i > 1:
        D += A.parts[2, i - 2, k]
        r += A.sides[2, i - 2, k]
    G.force[i, k] = r
    G.r[i, k] = r
    first = 4 * (i % 2)
    place = 8 * ((i / 2) * S.points.shape[0] + k)
    four = int(4)
    zero = wp.float64(0.0)
    for c in range(four):
        for j in range(four):
            A.nodes[wp.static(OWN), first + c, place + first + j] = D[j, c]
            if first == 0:
                one = wp.where(j == c, wp.float64(1.0), zero)
                if i + 1 == n:                               # the node's second point is none
                    A.nodes[wp.static(OWN), 4 + c, place + 4 + j] = one
                A.nodes[wp.static(OWN), 4 + c, place + j] = near[j, c]
                A.nodes[wp.static(OWN), c, place + 4 + j] = near[c, j]
                A.nodes[wp.static(NEXT), c, place + j] = far[j, c]
                A.nodes[wp.static(NEXT), 4 + c, place + j] = zero
            else:
                A.nodes[wp.static(NEXT), c, place + 4 + j] = near[j, c]
                A.nodes[wp.static(NEXT), 4 + c, place + 4 + j] = far[j, c]
    return wp.dot(r, G.last[i, k])
