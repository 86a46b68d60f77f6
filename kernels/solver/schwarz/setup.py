"""Matrices of a multilevel additive Schwarz preconditioner with affine coarse spaces (after Wu, Wang, Wang 2022, whose coarse
spaces are constant), for A of kernels/solver/newton.py:

    M^-1 = sum over domains d of E_d (E_d^T A E_d)^-1 E_d^T

    level 0     a domain is 32 points at most, E_d their unit vectors
    level 1     a node is a leaf of 8 points at most, with 12 affine motions a + G (x_i - c), c its place; a domain is 8 nodes
    level 2 ..  a node is a domain of the level before, moving affinely as a whole; a domain is 8 nodes; the last level has one

Affine motions of a node are affine on each of its leaves, so matrices of all levels are sums of those of pairs of leaves,

    A_KJ = sum over i in K, j in J of q_i q_j^T (x) S_i A_ij S_j,    q_i = (1, x_i - c_K),  S the filter of contacts and pins,

of which only K <= J are kept; about another place c_a, q' = q + (0, c_K - c_a) q_0. Component r of coefficient p has row
3 p + r.
Products: kernels/solver/schwarz/cg.py; inverses: kernels/solver/schwarz/dense.py.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.solver.newton import newton_structs
from wsim.kernels.solver.pcg import range_projector
from wsim.kernels.solver.schwarz import dense

LEAF = 4               # leaves of a domain of points
NODES = 8              # nodes of a domain of nodes, leaves of a group
TWELVE = 12            # coefficients of an affine motion


@cache
def schwarz_tables(real) -> SimpleNamespace:
    """Tree: who is where; constant. Blocks: matrices at one d. Work: what a product leaves."""
    t = types(real)
    vec12 = wp.types.vector(TWELVE, real)

    @wp.struct
    class SchwarzTree:
        order: wp.array(dtype=int)           # points by leaf, (points,)
        rank: wp.array(dtype=int)            # place of a point in its domain, (points,)
        first: wp.array(dtype=int)           # points first[K] .. first[K + 1] of a leaf, (leaves + 1,)
        leaf: wp.array(dtype=int)            # of each point
        group: wp.array(dtype=int)           # groups group[b] .. group[b + 1] of a system, (systems + 1,)
        place: wp.array(dtype=int)           # the point that is the place of each leaf, each group, each node above
        pair: wp.array(dtype=wp.vec2i)       # leaves K <= J that share blocks
        part: wp.array(dtype=int)            # their blocks part[e] .. part[e + 1]
        entry: wp.array(dtype=wp.vec2i)      # (block of the system, its row)
        block: wp.array(dtype=wp.vec3i)      # (matrix, a, b) of the nodes a <= b of a domain
        about: wp.array(dtype=wp.vec2i)      # the places of a and b
        leaves: wp.array(dtype=int)          # their pairs of leaves, by number
        run: wp.array(dtype=wp.vec3i)        # of a block e, in short runs: (e, its first pair in leaves, end)
        into: wp.array(dtype=int)            # place of a run's sum in `run`, or -1 where the run is all of its block
        joined: wp.array(dtype=wp.vec3i)     # of each block of several runs: (e, its first sum, end)
        upper: wp.array(dtype=int)           # domains above groups upper[b] .. upper[b + 1] of a system, (systems + 1,)
        node: wp.array(dtype=wp.vec4i)       # of such a domain: first group, groups of a node, end, number of its first place
        above: wp.array(dtype=wp.vec3i)      # (domain, node in it, place) of each group at each level above, (levels groups,)
        size: wp.array(dtype=int)            # rows of each domain: points, groups, above
        levels: int                          # above groups, of the deepest system

    @wp.struct
    class SchwarzBlocks:
        W: wp.array(dtype=real)              # 96 x 96 of each domain: points, groups, above
        pair: wp.array(dtype=vec12)          # 12 rows of each pair of leaves
        run: wp.array(dtype=vec12)           # 12 rows of each run that has a sum
        S: wp.array(dtype=t.mat33)           # filters, (points,)
        X: wp.array(dtype=t.vec3)            # places [m], (points,)
        scratch: wp.array(dtype=real)        # 96 of each domain

    return SimpleNamespace(Tree=SchwarzTree, Blocks=SchwarzBlocks, vec12=vec12)


@wp.func
def affine_weight(arm: Any, p: int):
    """Entry p of (1, arm)."""
    q = type(arm[0])(1.0)
    if p > 0:
        q = arm[p - 1]
    return q


@cache
def schwarz_filter_kernel(real, module):
    """Kernel over points: S and X."""
    t, s, o = types(real), newton_structs(real), schwarz_tables(real)

    @wp.kernel(module=module, enable_backward=False)
    def schwarz_filters(A: s.Matrix, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), m_out: o.Blocks):
        i = wp.tid()
        m_out.S[i] = range_projector(A.P[i])
        m_out.X[i] = x[i] + d[i]

    return schwarz_filters


@cache
def leaf_pair_kernel(real, module):
    """Kernel over 3 components of each pair of leaves: rows (p, r) for all p, by sums over j for each i, then over i."""
    t, s, o = types(real), newton_structs(real), schwarz_tables(real)
    vec12, Blocks, twelve = o.vec12, o.Blocks, TWELVE

    @wp.func
    def affine_force_share(arm: t.vec3, f: t.vec3):
        """q (x) f."""
        v = vec12()
        for c in range(3):
            v[c] = f[c]
            for q in range(3):
                v[3 * (q + 1) + c] = arm[q] * f[c]
        return v

    @wp.func
    def add_leaf_pair(m: Blocks, at: int, r: int, arm: t.vec3, T: vec12):
        """Rows (p, r) grow by q_p T."""
        m.pair[at + r] = m.pair[at + r] + T
        for p in range(3):
            m.pair[at + 3 * (p + 1) + r] = m.pair[at + 3 * (p + 1) + r] + arm[p] * T

    @wp.kernel(module=module, enable_backward=False)
    def schwarz_pairs(rows: s.Rows, A: s.Matrix, tree: o.Tree, m: Blocks):
        e = wp.tid() // 3
        r = wp.tid() - 3 * e
        K = tree.pair[e][0]
        J = tree.pair[e][1]
        cK = m.X[tree.place[K]]
        cJ = m.X[tree.place[J]]
        at = wp.static(twelve) * e
        for p in range(4):
            m.pair[at + 3 * p + r] = vec12()
        k = tree.part[e]
        end = tree.part[e + 1]
        for n in range(tree.first[K], tree.first[K + 1]):
            i = tree.order[n]
            arm = m.X[i] - cK
            row = m.S[i][r]
            T = vec12()
            own = t.vec3()
            if K == J:
                own = A.own[i] * row
            while k < end and tree.entry[wp.min(k, end - 1)][1] == i:
                b = tree.entry[k][0]
                j = rows.column[b]
                f = wp.transpose(A.block[b]) * row
                if K == J:                                 # what the row's blocks take from that of i with itself
                    own -= f
                if tree.leaf[j] == J:
                    T += affine_force_share(m.X[j] - cJ, m.S[j] * f)
                k += 1
            if K == J:
                T += affine_force_share(arm, m.S[i] * own)
            add_leaf_pair(m, at, r, arm, T)

    return schwarz_pairs


@cache
def node_block_kernel(real, module):
    """Kernel over 12 rows of runs of pairs of leaves: blocks of pairs of nodes of domains, zeroed before, or parts of one."""
    o = schwarz_tables(real)
    twelve, Blocks, vec12, put = TWELVE, o.Blocks, o.vec12, domain_row_function(real)

    @wp.func
    def leaf_pair_row(m: Blocks, e: int, p: int, r: int, turned: bool):
        """Row (p, r) of a pair of leaves, or column."""
        v = vec12()
        if turned:
            for q in range(wp.static(twelve)):
                v[q] = m.pair[wp.static(twelve) * e + q][3 * p + r]
        else:
            v = m.pair[wp.static(twelve) * e + 3 * p + r]
        return v

    @wp.kernel(module=module, enable_backward=False)
    def schwarz_blocks(tree: o.Tree, m: Blocks):
        at = wp.tid() // wp.static(twelve)
        row = wp.tid() - at * wp.static(twelve)
        run = tree.run[at]
        e = run[0]
        p = row // 3
        r = row - 3 * p
        a = m.X[tree.about[e][0]]
        b = m.X[tree.about[e][1]]
        same = tree.block[e][1] == tree.block[e][2]
        sum = vec12()
        for k in range(run[1], run[2]):
            pair = tree.leaves[k]
            K = tree.pair[pair][0]
            J = tree.pair[pair][1]
            for turn in range(wp.where(same and K != J, 2, 1)):
                first = wp.where(turn == 0, K, J)
                other = wp.where(turn == 0, J, K)
                v = leaf_pair_row(m, pair, p, r, turn == 1)
                if p > 0:
                    v += (m.X[tree.place[first]] - a)[p - 1] * leaf_pair_row(m, pair, 0, r, turn == 1)
                arm = m.X[tree.place[other]] - b
                for q in range(1, 4):
                    for c in range(3):
                        v[3 * q + c] += arm[q - 1] * v[c]
                sum += v
        if tree.into[at] < 0:
            put(tree, m, e, row, sum)
        else:
            m.run[tree.into[at] * wp.static(twelve) + row] = sum

    return schwarz_blocks


@cache
def domain_row_function(real):
    """Function: row `row` of the block of pair e of nodes goes into its domain's matrix."""
    o, twelve, side = schwarz_tables(real), TWELVE, dense.SIDE
    Tree, Blocks, vec12 = o.Tree, o.Blocks, o.vec12

    @wp.func
    def put_domain_row(tree: Tree, m: Blocks, e: int, row: int, v: vec12):
        at = tree.block[e][0] * wp.static(side * side) + (wp.static(twelve) * tree.block[e][1] + row) * wp.static(side)
        for q in range(wp.static(twelve)):
            m.W[at + wp.static(twelve) * tree.block[e][2] + q] = v[q]

    return put_domain_row


@cache
def block_run_sum_kernel(real, module):
    """Kernel over 12 rows of blocks of several runs: the sum of these, in their order."""
    o, twelve, put = schwarz_tables(real), TWELVE, domain_row_function(real)

    @wp.kernel(module=module, enable_backward=False)
    def schwarz_sums(tree: o.Tree, m: o.Blocks):
        at = wp.tid() // wp.static(twelve)
        row = wp.tid() - at * wp.static(twelve)
        it = tree.joined[at]
        sum = o.vec12()
        for k in range(it[1], it[2]):
            sum += m.run[k * wp.static(twelve) + row]
        put(tree, m, it[0], row, sum)

    return schwarz_sums


@cache
def point_domain_kernel(real, module):
    """Kernel over points: three rows of the matrix of a domain of points, zeroed before."""
    t, s, o = types(real), newton_structs(real), schwarz_tables(real)
    side, Blocks = dense.SIDE, o.Blocks

    @wp.func
    def put_point_block(m: Blocks, at: int, B: t.mat33):
        for r in range(3):
            for c in range(3):
                m.W[at + r * wp.static(side) + c] = B[r, c]

    @wp.kernel(module=module, enable_backward=False)
    def schwarz_points(rows: s.Rows, A: s.Matrix, tree: o.Tree, m: Blocks):
        i = wp.tid()
        if tree.leaf[i] < 0:
            return
        domain = tree.leaf[i] // wp.static(LEAF)
        at = domain * wp.static(side * side) + 3 * tree.rank[i] * wp.static(side)
        S = m.S[i]
        D = A.own[i] * wp.identity(n=3, dtype=real)
        for b in range(rows.pair[i], rows.pair[i + 1]):
            j = rows.column[b]
            D -= A.block[b]
            if tree.leaf[j] // wp.static(LEAF) == domain and tree.rank[j] > tree.rank[i]:
                put_point_block(m, at + 3 * tree.rank[j], S * A.block[b] * m.S[j])
        more = (wp.identity(n=3, dtype=real) - S) * (wp.trace(D) + real(1.0))      # of directions without motion
        put_point_block(m, at + 3 * tree.rank[i], S * D * S + more)

    return schwarz_points


@cache
def domain_factor_kernel(real, module, threads: int):
    """Kernel over domains times a block of threads: W. On the CPU over domains."""
    o, eliminate = schwarz_tables(real), dense.dense_factor_function(real)

    def schwarz_factor(tree: o.Tree, m: o.Blocks):
        block = wp.tid() // wp.block_dim()
        eliminate(m.W, m.scratch, block, tree.size[block], wp.tid() % wp.block_dim(), wp.block_dim())

    return wp.kernel(schwarz_factor, module=module, enable_backward=False, grid_stride=False, launch_bounds=threads)
