"""Products with the inverses of domains (kernels/solver/schwarz/setup.py): what one group, or one domain above groups, makes of
the forces on its points.

    moment of a node    sum over its points of (1, x - c) (x) r, c its place;  about another place c_a, m_p += (c - c_a)_p m_0
    motion of a leaf    a = a_K + G_K (c - c_K), G = G_K, summed over the nodes K of all levels that it is in

A group has two domains of points and is one of leaves: three inverses, which stand one behind the other in `into`, `mid`,
`out`. Each function is run by a block of threads, lane of lanes, or by one thread of the CPU.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.block import block_barrier
from wsim.kernels.math.real import types
from wsim.kernels.solver.schwarz import dense
from wsim.kernels.solver.schwarz.setup import NODES, TWELVE, affine_weight, schwarz_tables


@cache
def schwarz_works(real):
    """Struct of what phases leave for each other."""

    @wp.struct
    class SchwarzWork:
        into: wp.array(dtype=real)           # 3 x 96 of a group: forces on points of its two domains, moments of its leaves
        mid: wp.array(dtype=real)
        out: wp.array(dtype=real)
        moment: wp.array(dtype=real)         # 12 of a group
        upper: wp.array(dtype=real)          # 96 of a domain above: moments of nodes, then their motions
        between: wp.array(dtype=real)
        motion: wp.array(dtype=real)         # 96 of a group: of its leaves, by all levels
        gamma: wp.array(dtype=wp.float64)    # parts of r.z of a group
        delta: wp.array(dtype=wp.float64)    # parts of z.w
        gate: wp.array(dtype=int)            # of the teams
        size: int                            # blocks of a team
        systems: int
        leaves: int                          # of all groups
        tolerance: wp.float64                # of sqrt(r.z)
        cap: int                             # iterations
        drop: wp.array(dtype=wp.float64)     # f.y of each system [J]
        count: wp.array(dtype=int)           # of each system, grows by iterations

    return SchwarzWork


@cache
def restriction_functions(real):
    """Functions of a group: moments of its leaves from r, its own moment, and products with its three W."""
    t, o, Work = types(real), schwarz_tables(real), schwarz_works(real)
    lower, upper, side, twelve, nodes = (dense.dense_product_function("lower", real),
                                         dense.dense_product_function("upper", real), dense.SIDE, TWELVE, NODES)

    @wp.func
    def leaf_moments(g: int, tree: o.Tree, m: o.Blocks, r: wp.array(dtype=t.vec3), k: Work, lane: int, lanes: int):
        base = 3 * side * g
        for e in range(lane, side, lanes):
            leaf = nodes * g + e // twelve
            p = (e % twelve) // 3
            c = e % 3
            at = m.X[tree.place[leaf]]
            sum = real(0.0)
            for n in range(tree.first[leaf], tree.first[leaf + 1]):
                i = tree.order[n]
                sum += affine_weight(m.X[i] - at, p) * r[i][c]
            k.into[base + 2 * side + e] = sum

    @wp.func
    def group_moment(g: int, tree: o.Tree, m: o.Blocks, k: Work, lane: int, lanes: int):
        base = 3 * side * g + 2 * side
        at = m.X[tree.place[k.leaves + g]]
        for e in range(lane, twelve, lanes):
            p = e // 3
            c = e % 3
            sum = real(0.0)
            for n in range(nodes):
                v = k.into[base + twelve * n + e]
                if p > 0:
                    v += (m.X[tree.place[nodes * g + n]] - at)[p - 1] * k.into[base + twelve * n + c]
                sum += v
            k.moment[twelve * g + e] = sum

    @wp.func
    def multiply_lower_blocks(g: int, tree: o.Tree, m: o.Blocks, k: Work, lane: int, lanes: int):
        for e in range(lane, wp.where(lanes == 1, 3, 3 * side), lanes):
            d = wp.where(lanes == 1, e, e // side)
            block = wp.where(d < 2, 2 * g + d, 2 * (k.leaves // nodes) + g)
            lower(m.W, block, tree.size[block], k.into, side * (3 * g + d), e % side, k.mid)

    @wp.func
    def multiply_upper_blocks(g: int, tree: o.Tree, m: o.Blocks, k: Work, lane: int, lanes: int):
        for e in range(lane, wp.where(lanes == 1, 3, 3 * side), lanes):
            d = wp.where(lanes == 1, e, e // side)
            block = wp.where(d < 2, 2 * g + d, 2 * (k.leaves // nodes) + g)
            upper(m.W, block, tree.size[block], k.mid, side * (3 * g + d), e % side, k.out)

    return leaf_moments, group_moment, multiply_lower_blocks, multiply_upper_blocks


@cache
def upper_domain_functions(real):
    """Functions of a domain above groups: its motions from moments of groups; and of a group: motions of its leaves."""
    o, Work = schwarz_tables(real), schwarz_works(real)
    lower, upper, side, twelve, nodes = (dense.dense_product_function("lower", real),
                                         dense.dense_product_function("upper", real), dense.SIDE, TWELVE, NODES)

    @wp.func
    def solve_upper_domain(q: int, tree: o.Tree, m: o.Blocks, k: Work, lane: int, lanes: int):
        node = tree.node[q]
        block = 3 * (k.leaves // nodes) + q
        for e in range(lane, side, lanes):
            n = e // twelve
            p = (e % twelve) // 3
            at = m.X[tree.place[node[3] + n]]
            sum = real(0.0)
            begin = node[0] + n * node[1]
            for g in range(begin, wp.min(begin + node[1], node[2])):
                v = k.moment[twelve * g + e % twelve]
                if p > 0:
                    v += (m.X[tree.place[k.leaves + g]] - at)[p - 1] * k.moment[twelve * g + e % 3]
                sum += v
            k.upper[side * q + e] = sum
        block_barrier()
        for e in range(lane, wp.where(lanes == 1, 1, side), lanes):
            lower(m.W, block, tree.size[block], k.upper, side * q, e, k.between)
        block_barrier()
        for e in range(lane, wp.where(lanes == 1, 1, side), lanes):
            upper(m.W, block, tree.size[block], k.between, side * q, e, k.upper)
        block_barrier()

    @wp.func
    def leaf_motions(g: int, tree: o.Tree, m: o.Blocks, k: Work, lane: int, lanes: int):
        for e in range(lane, side, lanes):
            c = e % 3
            at = m.X[tree.place[nodes * g + e // twelve]]
            sum = k.out[side * (3 * g + 2) + e]
            for level in range(tree.levels):
                a = tree.above[tree.levels * g + level]
                if a[0] >= 0:
                    base = side * a[0] + twelve * a[1]
                    sum += k.upper[base + e % twelve]
                    if e % twelve < 3:
                        arm = at - m.X[tree.place[a[2]]]
                        for p in range(3):
                            sum += arm[p] * k.upper[base + 3 * (p + 1) + c]
            k.motion[side * g + e] = sum

    return solve_upper_domain, leaf_motions
