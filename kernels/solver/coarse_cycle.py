"""The cycle through the levels of kernels/solver/coarse_space.py: t = B r, block Jacobi before and after the correction of the
parents.

    e = omega r,  t = r - A e,  r of the parents = sum of Q_c^T t_c;  e += Q t of the parent,  t = e + omega (r - A e)

Nodes without parents: t = r, exact, since their blocks are 1 and they have no others. In a thread: component a of node K.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.block import BLOCK, block_barrier
from wsim.kernels.math.real import types
from wsim.kernels.solver.coarse_space import SIX, coarse_spaces, wrench_of_force
from wsim.kernels.solver.pcg import Chunks, block_sum, pcg_vectors


@cache
def cycle_functions(real) -> SimpleNamespace:
    """Functions of component a of node K: gather (from points), down (from children), residual, up, post."""
    t, Coarse, vec6 = types(real), coarse_spaces(real), wp.types.vector(6, real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def node_vector(v: wp.array(dtype=real), K: int):
        k = 6 * K
        return vec6(v[k], v[k + 1], v[k + 2], v[k + 3], v[k + 4], v[k + 5])

    @wp.func
    def coarse_block_product(K: int, a: int, g: Coarse, v: wp.array(dtype=real)):
        sum = v[6 * K + a]
        for e in range(g.row[K], g.row[K + 1]):
            sum += wp.dot(g.A[6 * e + a], node_vector(v, g.column[e]))
        return sum

    @wp.func
    def gather_node_wrench(K: int, a: int, g: Coarse, r: vec3):
        sum = vec6()
        for m in range(g.first[K], g.first[K + 1]):
            i = g.child[m]
            sum += wrench_of_force(g.arm[i], r[i])
        v = wp.dot(g.inverse[6 * K + a], sum)
        g.r[6 * K + a] = v
        g.t[6 * K + a] = v

    @wp.func
    def gather_from_children(K: int, a: int, g: Coarse):
        v = real(0.0)
        for m in range(g.first[K], g.first[K + 1]):
            c = g.child[m]
            six = int(SIX)
            for b in range(six):
                v += g.Q[6 * c + b][a] * g.t[6 * c + b]
        g.r[6 * K + a] = v
        g.t[6 * K + a] = v

    @wp.func
    def coarse_residual(K: int, a: int, g: Coarse):
        g.t[6 * K + a] = g.r[6 * K + a] - g.omega * coarse_block_product(K, a, g, g.r)

    @wp.func
    def correct_from_parent(K: int, a: int, g: Coarse):
        g.e[6 * K + a] = g.omega * g.r[6 * K + a] + wp.dot(g.Q[6 * K + a], node_vector(g.t, g.parent[K]))

    @wp.func
    def post_smooth(K: int, a: int, g: Coarse):
        g.t[6 * K + a] = g.e[6 * K + a] + g.omega * (g.r[6 * K + a] - coarse_block_product(K, a, g, g.e))

    return SimpleNamespace(gather=gather_node_wrench, down=gather_from_children, residual=coarse_residual,
                           up=correct_from_parent, post=post_smooth)


@cache
def level_cycle_kernels(real, module) -> SimpleNamespace:
    """Kernels over 6 rows of the nodes of a level, from node `at` on; they do nothing once no body is `going`."""
    t, Coarse, o = types(real), coarse_spaces(real), cycle_functions(real)

    def gather(at: int, going: wp.array(dtype=int), r: wp.array(dtype=t.vec3), g: Coarse):
        if going[0] != 0:
            o.gather(at + wp.tid() // 6, wp.tid() % 6, g, r)

    def down(at: int, going: wp.array(dtype=int), g: Coarse):
        if going[0] != 0:
            o.down(at + wp.tid() // 6, wp.tid() % 6, g)

    def residual(at: int, going: wp.array(dtype=int), g: Coarse):
        if going[0] != 0:
            o.residual(at + wp.tid() // 6, wp.tid() % 6, g)

    def up(at: int, going: wp.array(dtype=int), g: Coarse):
        if going[0] != 0:
            o.up(at + wp.tid() // 6, wp.tid() % 6, g)

    def post(at: int, going: wp.array(dtype=int), g: Coarse):
        if going[0] != 0:
            o.post(at + wp.tid() // 6, wp.tid() % 6, g)

    return SimpleNamespace(**{f.__name__: wp.kernel(f, name=f"multigrid_{f.__name__}_{t.name}", module=module,
                                                    enable_backward=False) for f in (gather, down, residual, up, post)})


@cache
def small_cycle_kernels(real, module) -> SimpleNamespace:
    """Kernels of blocks of threads:

    small      a block for each body: the cycle from level `begin` up to the last, `end` - 1, and back; span are the first
               nodes of each body in each level, (levels * bodies + 1,)
    prolong    over chunks, as in pcg.py: z gets its part of the parents, gamma [side] its part of r.z
    """
    t, Coarse, Vectors, o, vec6 = (types(real), coarse_spaces(real), pcg_vectors(real), cycle_functions(real),
                                   wp.types.vector(6, real))
    gather, down, residual, up, post = o.gather, o.down, o.residual, o.up, o.post

    def small(begin: int, end: int, span: wp.array(dtype=int), going: wp.array(dtype=int), r: wp.array(dtype=t.vec3),
              g: Coarse):
        if going[0] == 0:
            return
        bodies = (span.shape[0] - 1) // end
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        for level in range(begin, end):
            lo = 6 * span[level * bodies + body] + lane
            hi = 6 * span[level * bodies + body + 1]
            for k in range(lo, hi, wp.block_dim()):
                if level == 0:
                    gather(k // 6, k % 6, g, r)
                else:
                    down(k // 6, k % 6, g)
            block_barrier()
            if level < end - 1:
                for k in range(lo, hi, wp.block_dim()):
                    residual(k // 6, k % 6, g)
                block_barrier()
        for n in range(begin, end - 1):
            level = begin + end - 2 - n
            lo = 6 * span[level * bodies + body] + lane
            hi = 6 * span[level * bodies + body + 1]
            for k in range(lo, hi, wp.block_dim()):
                up(k // 6, k % 6, g)
            block_barrier()
            for k in range(lo, hi, wp.block_dim()):
                post(k // 6, k % 6, g)
            block_barrier()

    def prolong(c: Chunks, g: Coarse, side: int, v: Vectors):
        chunk = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        if c.done[side, c.body[chunk]] != 0:
            return
        gamma = wp.float64(0.0)
        for i in range(c.first[chunk] + lane, c.first[chunk + 1], wp.block_dim()):
            z = v.z[i]
            K = g.node[i]
            if K >= 0:
                m = vec6()
                six = int(SIX)
                for b in range(six):
                    m += g.t[6 * K + b] * g.inverse[6 * K + b]
                u = t.vec3(m[0], m[1], m[2]) + wp.cross(t.vec3(m[3], m[4], m[5]), g.arm[i])
                z += g.S[i] * u
                v.z[i] = z
            gamma += wp.float64(wp.dot(v.r[i], z))
        c.gamma[side, chunk] = block_sum(gamma)

    return SimpleNamespace(**{f.__name__: wp.kernel(f, name=f"multigrid_{f.__name__}_{t.name}", module=module,
                                                    enable_backward=False, grid_stride=False, launch_bounds=BLOCK)
                              for f in (small, prolong)})
