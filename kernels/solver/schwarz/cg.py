"""Conjugate gradients with a multilevel Schwarz preconditioner (kernels/solver/schwarz/setup.py), all iterations in one launch.

The recurrence is that of kernels/solver/pcg.py. A system is solved by a team of blocks of threads, on the CPU by one thread.
A block has some of its groups, 64 points each, and everything that these need of others crosses a meeting of the team:

    step        y, r of own points; u = W r of their domains and of their group; moments of groups          | meet
    above       z = W^T u of the domains above groups, of moments                                           | meet
    prolong     z of own points, from all levels; parts of r.z                                              | meet
    multiply    w = A z of own points; parts of z.w                                                         | meet

Parts are summed by every block in the same order, in float64: a step depends neither on who ran first nor on the number of
blocks. A team's blocks wait for each other, so all of a launch must be on the device at once: `teams` times `size` is at most
its number of multiprocessors.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.block import block_barrier
from wsim.kernels.math.real import types
from wsim.kernels.solver.newton import newton_structs
from wsim.kernels.solver.pcg import block_sum, pcg_point_functions, pcg_vectors
from wsim.kernels.solver.schwarz import dense
from wsim.kernels.solver.schwarz.domains import restriction_functions, schwarz_works, upper_domain_functions
from wsim.kernels.solver.schwarz.setup import NODES, TWELVE, affine_weight, schwarz_tables

THREADS = 288          # of a block: rows of the three domains of a group


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
    if (size > 1) {
        if (threadIdx.x == 0) {
            __threadfence();
            const int now = atomicAdd(gate.data + team, 1) + 1, goal = (now + size - 1) / size * size;
            while (*(volatile int*)(gate.data + team) < goal) __nanosleep(20);
            __threadfence();
        }
        __syncthreads();
    }
#endif
""")
def gather_team(gate: wp.array(dtype=int), team: int, size: int):
    """All blocks of a team wait for each other. gate (teams,): zero when a launch begins."""
    ...


@cache
def schwarz_phase_functions(real, elements: bool):
    """Functions of a group in an iteration, by one block: step, prolong and multiply."""
    t, s, o, Work, Vectors = types(real), newton_structs(real), schwarz_tables(real), schwarz_works(real), pcg_vectors(real)
    side, nodes, twelve, product = dense.SIDE, NODES, TWELVE, pcg_point_functions(real, False, elements).product
    moments, whole, forward, backward = restriction_functions(real)
    _, motions = upper_domain_functions(real)

    @wp.func
    def schwarz_step(g: int, alpha: real, beta: real, tree: o.Tree, m: o.Blocks, v: Vectors, k: Work, lane: int):
        """y and r go on, and what the domains of the group make of r."""
        lanes = wp.block_dim()
        begin = tree.first[nodes * g]
        for n in range(begin + lane, tree.first[nodes * g + nodes], lanes):
            i = tree.order[n]
            p = v.z[i] + beta * v.p[i]
            q = v.w[i] + beta * v.s[i]
            r = m.S[i] * (v.r[i] - alpha * q)
            v.p[i] = p
            v.s[i] = q
            v.y[i] = v.y[i] + alpha * p
            v.r[i] = r
            at = side * (3 * g + (tree.leaf[i] % nodes) // 4) + 3 * tree.rank[i]
            for c in range(3):
                k.into[at + c] = r[c]
        block_barrier()
        moments(g, tree, m, v.r, k, lane, lanes)
        block_barrier()
        whole(g, tree, m, k, lane, lanes)
        forward(g, tree, m, k, lane, lanes)
        block_barrier()
        backward(g, tree, m, k, lane, lanes)
        block_barrier()

    @wp.func
    def schwarz_prolong(g: int, tree: o.Tree, m: o.Blocks, v: Vectors, k: Work, lane: int):
        """z of the points of the group; part of r.z."""
        lanes = wp.block_dim()
        motions(g, tree, m, k, lane, lanes)
        block_barrier()
        gamma = wp.float64(0.0)
        for n in range(tree.first[nodes * g] + lane, tree.first[nodes * g + nodes], lanes):
            i = tree.order[n]
            leaf = tree.leaf[i] % nodes
            z = t.vec3()
            at = side * (3 * g + leaf // 4) + 3 * tree.rank[i]
            for c in range(3):
                z[c] = k.out[at + c]
            at = side * g + twelve * leaf
            arm = m.X[i] - m.X[tree.place[tree.leaf[i]]]
            for p in range(4):
                for c in range(3):
                    z[c] += affine_weight(arm, p) * k.motion[at + 3 * p + c]
            z = m.S[i] * z
            v.z[i] = z
            gamma += wp.float64(wp.dot(v.r[i], z))
        return block_sum(gamma)

    @wp.func
    def schwarz_multiply(g: int, tree: o.Tree, rows: s.Rows, A: s.Matrix, v: Vectors, lane: int):
        """w of the points of the group; part of z.w."""
        delta = wp.float64(0.0)
        for n in range(tree.first[nodes * g] + lane, tree.first[nodes * g + nodes], wp.block_dim()):
            i = tree.order[n]
            w = product(i, rows, A, v.z)
            v.w[i] = w
            delta += wp.float64(wp.dot(v.z[i], w))
        return block_sum(delta)

    return schwarz_step, schwarz_prolong, schwarz_multiply


@wp.func
def sum_group_parts(parts: wp.array(dtype=wp.float64), first: int, last: int, lane: int):
    """Sum of parts first .. last, by all threads of a block."""
    sum = wp.float64(0.0)
    for g in range(first + lane, last, wp.block_dim()):
        sum += parts[g]
    return block_sum(sum)


@cache
def schwarz_cg_kernel(real, module, elements: bool = True):
    """Kernel over teams of blocks: y of v becomes A^-1 f, see `Work` for the rest."""
    t, s, o, Work, Vectors = types(real), newton_structs(real), schwarz_tables(real), schwarz_works(real), pcg_vectors(real)
    step, prolong, multiply = schwarz_phase_functions(real, elements)
    solve_above, _ = upper_domain_functions(real)

    @wp.func
    def precondition_team(b: int, who: wp.vec3i, tree: o.Tree, m: o.Blocks, v: Vectors, k: Work):
        """z of r, when all of the team have made their step; parts of r.z. who: team, block of it, thread of
        that."""
        team = who[0]
        rank = who[1]
        lane = who[2]
        if tree.upper[b + 1] > tree.upper[b]:
            gather_team(k.gate, team, k.size)
            for q in range(tree.upper[b] + rank, tree.upper[b + 1], k.size):
                solve_above(q, tree, m, k, lane, wp.block_dim())
            gather_team(k.gate, team, k.size)
        for g in range(tree.group[b] + rank, tree.group[b + 1], k.size):
            gamma = prolong(g, tree, m, v, k, lane)
            if lane == 0:
                k.gamma[g] = gamma
        gather_team(k.gate, team, k.size)

    @wp.func
    def begin_schwarz_cg(b: int, who: wp.vec3i, tree: o.Tree, m: o.Blocks, f: wp.array(dtype=t.vec3), v: Vectors, k: Work):
        rank = who[1]
        lane = who[2]
        for g in range(tree.group[b] + rank, tree.group[b + 1], k.size):
            for n in range(tree.first[NODES * g] + lane, tree.first[NODES * g + NODES], wp.block_dim()):
                i = tree.order[n]
                v.r[i] = f[i]
                v.y[i] = t.vec3()
                v.z[i] = t.vec3()
                v.w[i] = t.vec3()
                v.p[i] = t.vec3()
                v.s[i] = t.vec3()
            block_barrier()
            step(g, real(0.0), real(0.0), tree, m, v, k, lane)

    def schwarz_cg(rows: s.Rows, A: s.Matrix, f: wp.array(dtype=t.vec3), tree: o.Tree, m: o.Blocks, v: Vectors, k: Work):
        block = wp.tid() // wp.block_dim()
        lane = wp.tid() - block * wp.block_dim()
        team = block // k.size
        rank = block - team * k.size
        who = wp.vec3i(team, rank, lane)
        for b in range(team, k.systems, k.gate.shape[0]):
            begin_schwarz_cg(b, who, tree, m, f, v, k)
            precondition_team(b, who, tree, m, v, k)
            gamma = sum_group_parts(k.gamma, tree.group[b], tree.group[b + 1], lane)
            enough = k.tolerance * k.tolerance * gamma
            before = wp.float64(1.0)
            alpha = wp.float64(1.0)
            drop = wp.float64(0.0)
            count = int(0)  # noqa: UP018
            while gamma > enough and count < k.cap:
                for g in range(tree.group[b] + rank, tree.group[b + 1], k.size):
                    part = multiply(g, tree, rows, A, v, lane)
                    if lane == 0:
                        k.delta[g] = part
                gather_team(k.gate, team, k.size)
                delta = sum_group_parts(k.delta, tree.group[b], tree.group[b + 1], lane)
                beta = wp.float64(0.0)
                if count > 0:
                    beta = gamma / before
                    delta -= beta * gamma / alpha
                if not delta > wp.float64(0.0):
                    break
                alpha = gamma / delta
                before = gamma
                drop += alpha * gamma
                for g in range(tree.group[b] + rank, tree.group[b + 1], k.size):
                    step(g, real(alpha), real(beta), tree, m, v, k, lane)
                precondition_team(b, who, tree, m, v, k)
                gamma = sum_group_parts(k.gamma, tree.group[b], tree.group[b + 1], lane)
                count += 1
            if lane == 0 and rank == 0:
                k.drop[b] = drop
                k.count[b] = k.count[b] + count

    return wp.kernel(schwarz_cg, module=module, enable_backward=False, grid_stride=False, launch_bounds=THREADS)
