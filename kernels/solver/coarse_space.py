"""A coarse space for conjugate gradients (kernels/solver/pcg.py): points move together as rigid bodies, those as larger ones,
and on.

    z_i = P_i r_i + S_i R_i L_K^-T t_K            K the node of point i, S_i the filter: projects on the range of P_i
    R_i = [1, -[a_i]x]                            a rigid motion (v, w) about the place of the node, a_i the arm from there [m]
    A_KJ = sum over i in K, j in J of R_i^T S_i A_ij S_j R_j            (Galerkin; unsmoothed aggregation, Vanek et al. 1996)

Rigid motions cost a body at rest nothing, turned or not: arms are those of the displaced points. D_K = A_KK = L_K L_K^T; nodes
are written in the basis R L^-T, in which every D_K is 1. A rigid motion T_c about a parent is Q_c = L_c^T T_c L_K^-T at its
child c, and A_KJ = sum of Q_c^T A_cd Q_d. Directions that a node does not have (one point, a line) are dropped: a zero row of
L^-1. t comes from a cycle (kernels/solver/coarse_cycle.py). The points themselves are only added (Bramble, Pasciak, Xu 1990):
further products with their matrix cost more than they save.

An element of k points belongs to at most k nodes, so A <= k D at every level: with omega < 2 / k the whole is symmetric and
positive. All sums are gathered, in the order of the lists; bodies share no node.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver.newton import newton_structs
from wsim.kernels.solver.pcg import range_projector

SIX = 6                # int(SIX) is a variable in a kernel: loops to it are not unrolled, which takes half the time to compile
LOST = {wp.float32: 1e-5, wp.float64: 1e-12}      # part of a diagonal under which what elimination left of it is rounding


@cache
def coarse_spaces(real):
    """Struct of all levels: nodes and blocks are numbered on from level to level, bodies in order within each."""
    vec3, mat33, vec6 = types(real).vec3, types(real).mat33, wp.types.vector(6, real)

    @wp.struct
    class Coarse:
        node: wp.array(dtype=int)            # of each point; -1: none, (points,)
        place: wp.array(dtype=int)           # the point where a node is, (nodes,)
        parent: wp.array(dtype=int)          # -1: none, (nodes,)
        first: wp.array(dtype=int)           # children first[K] .. first[K + 1], (nodes + 1,)
        child: wp.array(dtype=int)           # points, of the first level; else nodes
        row: wp.array(dtype=int)             # blocks row[K] .. row[K + 1], (nodes + 1,)
        owner: wp.array(dtype=int)           # K of a block, (blocks,)
        column: wp.array(dtype=int)          # J of a block, (blocks,)
        part: wp.array(dtype=int)            # blocks below that a block is made of, part[b] .. part[b + 1], (blocks + 1,)
        pair: wp.array(dtype=wp.vec2i)       # each with its row: a point, of the first level; else a node
        arm: wp.array(dtype=vec3)            # [m], (points,)
        S: wp.array(dtype=mat33)             # (points,)
        share: wp.array(dtype=vec6)          # rows of what a point adds to D of its node, (6 points,)
        A: wp.array(dtype=vec6)              # rows of A_KJ, K != J, (6 blocks,)
        D: wp.array(dtype=vec6)              # rows of A_KK, (6 nodes,)
        inverse: wp.array(dtype=vec6)        # rows of L^-1, (6 nodes,)
        Q: wp.array(dtype=vec6)              # rows of Q of a node in its parent, (6 nodes,)
        r: wp.array(dtype=real)              # (6 nodes,)
        e: wp.array(dtype=real)
        t: wp.array(dtype=real)
        omega: real

    return Coarse


@wp.func
def rigid_motion_column(k: int, arm: Any):
    """Column k of R: along axis k, or the turn about axis k - 3."""
    u = arm - arm
    u[k % 3] = type(arm[0])(1.0)
    if k > 2:
        u = wp.cross(u, arm)
    return u


@wp.func
def wrench_of_force(arm: Any, f: Any):
    """R^T f."""
    m = wp.cross(arm, f)
    return wp.vector(f[0], f[1], f[2], m[0], m[1], m[2])


@wp.func
def row_times_block(M: wp.array(dtype=Any), k: int, u: Any):
    """u^T M_k; M_k has the rows M[6 k] .. M[6 k + 5]."""
    v = M.dtype()
    six = int(SIX)
    for b in range(six):
        v += u[b] * M[6 * k + b]
    return v


@wp.func
def block_column(M: wp.array(dtype=Any), k: int, a: int):
    """Column a of M_k."""
    u = M.dtype()
    six = int(SIX)
    for b in range(six):
        u[b] = M[6 * k + b][a]
    return u


@wp.func
def block_times_vector(M: wp.array(dtype=Any), k: int, u: Any):
    """M_k u."""
    v = M.dtype()
    six = int(SIX)
    for b in range(six):
        v[b] = wp.dot(M[6 * k + b], u)
    return v


def name_kernels(real, module, *functions) -> dict:
    """Kernels of functions, by the names of these."""
    return {f.__name__: wp.kernel(f, name=f"multigrid_{f.__name__}_{types(real).name}", module=module, enable_backward=False)
            for f in functions}


@cache
def coarse_point_kernels(real, module) -> dict:
    """arms, and shares: R_i^T S_i (own S_i R_i + sum over j of A_ij (S_j R_j - S_i R_i)), S_j R_j where j has the same node."""
    s, Coarse, vec3 = newton_structs(real), coarse_spaces(real), wp.array(dtype=types(real).vec3)

    def arms(A: s.Matrix, x: vec3, d: vec3, g: Coarse):
        i = wp.tid()
        if g.node[i] >= 0:
            c = g.place[g.node[i]]
            g.arm[i] = (x[i] - x[c]) + (d[i] - d[c])
            g.S[i] = range_projector(A.P[i])

    def shares(rows: s.Rows, A: s.Matrix, g: Coarse):
        i = wp.tid() // 6
        a = wp.tid() % 6
        K = g.node[i]
        if K < 0:
            return
        arm = g.arm[i]
        S = g.S[i]
        u = S * rigid_motion_column(a, arm)
        out = A.own[i] * wrench_of_force(arm, u)
        for e in range(rows.pair[i], rows.pair[i + 1]):
            j = rows.column[e]
            q = u * A.block[e]
            w = wrench_of_force(arm, S * q)
            if g.node[j] == K:
                out += wrench_of_force(g.arm[j], g.S[j] * q) - w  # the difference: what moves alike cancels exactly
            else:
                out -= w
        g.share[6 * i + a] = out

    return name_kernels(real, module, arms, shares)


@cache
def first_level(real, module) -> dict:
    """own_points: sums of shares; pairs_points: sums of R_i^T S_i A_ij S_j R_j."""
    s, Coarse, vec6 = newton_structs(real), coarse_spaces(real), wp.types.vector(6, real)

    def own_points(at: int, g: Coarse):
        K = at + wp.tid() // 6
        a = wp.tid() % 6
        out = vec6()
        for m in range(g.first[K], g.first[K + 1]):
            out += g.share[6 * g.child[m] + a]
        g.D[6 * K + a] = out

    def pairs_points(at: int, rows: s.Rows, A: s.Matrix, g: Coarse):
        b = at + wp.tid() // 6
        a = wp.tid() % 6
        out = vec6()
        for m in range(g.part[b], g.part[b + 1]):
            e = g.pair[m][0]
            i = g.pair[m][1]
            j = rows.column[e]
            q = (g.S[i] * rigid_motion_column(a, g.arm[i])) * A.block[e]
            out += wrench_of_force(g.arm[j], g.S[j] * q)
        g.A[6 * b + a] = out

    return name_kernels(real, module, own_points, pairs_points)


@cache
def next_levels(real, module) -> dict:
    """own_nodes: sums of Q_c^T (Q_c + sum over d of A_cd Q_d), c and d children of one node; pairs_nodes: of Q_c^T A_cd Q_d."""
    Coarse, vec6 = coarse_spaces(real), wp.types.vector(6, real)

    def own_nodes(at: int, g: Coarse):
        K = at + wp.tid() // 6
        a = wp.tid() % 6
        out = vec6()
        for m in range(g.first[K], g.first[K + 1]):
            c = g.child[m]
            u = block_column(g.Q, c, a)
            out += row_times_block(g.Q, c, u)
            for e in range(g.row[c], g.row[c + 1]):
                if g.parent[g.column[e]] == K:
                    out += row_times_block(g.Q, g.column[e], row_times_block(g.A, e, u))
        g.D[6 * K + a] = out

    def pairs_nodes(at: int, g: Coarse):
        b = at + wp.tid() // 6
        a = wp.tid() % 6
        out = vec6()
        for m in range(g.part[b], g.part[b + 1]):
            e = g.pair[m][0]
            out += row_times_block(g.Q, g.column[e], row_times_block(g.A, e, block_column(g.Q, g.pair[m][1], a)))
        g.A[6 * b + a] = out

    return name_kernels(real, module, own_nodes, pairs_nodes)


@cache
def coarse_factor_kernels(real, module) -> dict:
    """factor: D = L L^T and L^-1 row by row; a row of which elimination leaves only rounding is zero in both."""
    t, Coarse, vec6, vec3 = types(real), coarse_spaces(real), wp.types.vector(6, real), wp.array(dtype=types(real).vec3)
    mat66 = wp.types.matrix((6, 6), real)

    def factor(at: int, x: vec3, d: vec3, g: Coarse):
        K = at + wp.tid()
        L = mat66()
        X = mat66()
        six = int(SIX)
        for k in range(six):
            row = g.D[6 * K + k]
            for j in range(k):
                v = row[j]
                for m in range(j):
                    v -= L[k, m] * L[j, m]
                if L[j, j] > real(0.0):
                    L[k, j] = v / L[j, j]
            v = row[k]
            for m in range(k):
                v -= L[k, m] * L[k, m]
            if v > real(wp.static(LOST[real])) * row[k]:
                L[k, k] = wp.sqrt(v)
                for j in range(k):
                    v = real(0.0)
                    for m in range(j, k):
                        v -= L[k, m] * X[m, j]
                    X[k, j] = v / L[k, k]
                X[k, k] = real(1.0) / L[k, k]
        for k in range(six):
            g.inverse[6 * K + k] = X[k]
        if g.parent[K] >= 0:
            i = g.place[K]
            c = g.place[g.parent[K]]
            arm = (x[i] - x[c]) + (d[i] - d[c])
            for k in range(six):
                f = t.vec3(L[0, k], L[1, k], L[2, k])
                w = wrench_of_force(arm, f)
                g.Q[6 * K + k] = w + vec6(real(0.0), real(0.0), real(0.0), L[3, k], L[4, k], L[5, k])

    return name_kernels(real, module, factor)


@cache
def coarse_scale_kernels(real, module) -> dict:
    """scale: L_K^-1 A_KJ L_J^-T, and Q L_K^-T."""
    Coarse, mat66 = coarse_spaces(real), wp.types.matrix((6, 6), real)

    def scale(at: int, blocks: int, children: int, g: Coarse):
        n = wp.tid()
        six = int(SIX)
        if n < blocks:
            b = at + n
            M = mat66()
            for k in range(six):
                M[k] = block_times_vector(g.inverse, g.column[b], g.A[6 * b + k])
            M = wp.transpose(M)
            for k in range(six):
                M[k] = block_times_vector(g.inverse, g.owner[b], M[k])
            M = wp.transpose(M)
            for k in range(six):
                g.A[6 * b + k] = M[k]
        else:
            c = children + n - blocks
            for k in range(six):
                g.Q[6 * c + k] = block_times_vector(g.inverse, g.parent[c], g.Q[6 * c + k])

    return name_kernels(real, module, scale)


@cache
def coarse_setup_kernels(real, module) -> SimpleNamespace:
    """Kernels that make the matrices of the levels, in the order of launch; `at` is the first node or block of the level:

    arms            over points: arms and filters
    shares          over 6 rows of a point
    own_points, own_nodes        over 6 rows of a node: D of the first level, of the others
    pairs_points, pairs_nodes    over 6 rows of a block
    factor          over nodes: L^-1, and L^T T
    scale           over blocks, then children: A_KJ and Q in the basis of L
    """
    groups = coarse_point_kernels, first_level, next_levels, coarse_factor_kernels, coarse_scale_kernels
    return SimpleNamespace(**{name: kernel for group in groups for name, kernel in group(real, module).items()})
