"""An iteration of Newton's method (kernels/rods/coupled_newton/coupled.py) by a block of threads a world, for a GPU and few
strands: `part_points` (kernels/rods/coupled_newton/nodes.py) by a thread a point, then `correct_strands`, which sums a world's
system, factors it by odd-even reduction (kernels/rods/coupled_newton/reduction.py), goes through all rounds of conjugate
gradients (kernels/rods/coupled_newton/conjugate.py), judges the correction, and takes it; where rigid bodies are among the
unknowns, a launch of its own does the latter, behind that which measures theirs.

Sums over a world are made by its block, in one order. On a CPU one thread is a block, for tests. A thread a strand finds the
same but for rounding.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.math.block import block_barrier, no_barrier
from wsim.kernels.math.team import any_of
from wsim.kernels.rods.coupled_newton import closed as seams
from wsim.kernels.rods.coupled_newton.all_points import conjugate_round_funcs, point_of, world_solve_func
from wsim.kernels.rods.coupled_newton.conjugate import GAIN, ROUNDS
from wsim.kernels.rods.coupled_newton.coupled import ACTIVE, GOING, MOST, CoupledRods, judge_world_iteration, search_step_length
from wsim.kernels.rods.coupled_newton.nodes import RodTeam, assemble_strand_node
from wsim.kernels.rods.coupled_newton.reduced import go_reduced
from wsim.kernels.rods.coupled_newton.reduction import factor_cyclic_reduction, solve_cyclic_reduction
from wsim.kernels.rods.coupled_newton.rounds import SMALL, go_rounds
from wsim.kernels.rods.coupled_newton.warps import warp_greatest
from wsim.kernels.rods.system import turn_edge
from wsim.kernels.rods.tables import EdgePairs, RodContacts, RodTable, RodTrial
from wsim.kernels.solver.pcg import block_sum

BLOCK = 256              # threads of a world on a GPU


@cache
def correction_kernels(threads: int, bearing: bool, module: str, closed: bool = False):
    """Kernels over threads of worlds: the correction; with `bearing`, rigid bodies, apart from it, what follows. threads: of a
    block; 1 on a CPU. closed: some strands are."""
    together = no_barrier if threads == 1 else block_barrier
    width, (go_round, aim), ints = min(threads, 32), conjugate_round_funcs(threads, bearing, closed), wp.array(dtype=int)
    solve, alone = world_solve_func(threads, closed), not (bearing or closed)

    @wp.func
    def sum_up(S: RodTable, G: CoupledRods, P: EdgePairs, A: RodTeam, B: RodContacts, lane: int, w: int):
        """Systems of world w; the force along the last step, how many pairs press and points touch bodies."""
        first = G.first[w]
        count = G.first[w + 1] - first
        all = count * S.length.shape[0]
        ahead = wp.float64(0.0)
        active = int(0)
        for t in range(lane, all, wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                ahead += assemble_strand_node(S, G, A, i, k)
                point = i * S.points.shape[0] + k
                if P.ons:
                    active += P.ons[point]
                if wp.static(bearing):
                    if B.near[w] == 1:
                        active += B.many[point]
                        if S.hold[i, k] < 0:
                            f = B.push[point]
                            G.r[i, k] = G.r[i, k] + wp.vec4d(f[0], f[1], f[2], wp.float64(0.0))
        return block_sum(ahead), block_sum(wp.float64(active))

    @wp.func
    def start_conjugate_gradients(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, lane: int, w: int):
        """Systems of world w, factored, and the first correction; r . z."""
        first = G.first[w]
        count = G.first[w + 1] - first
        together()
        factor_cyclic_reduction(S.points, A.nodes, first, count, A.most[w])
        if wp.static(closed):
            columns = int(seams.ROWS)
            for c in range(columns):
                seams.fill_seam_column(S, G, c, lane, wp.static(threads), w)
                together()
                solve_cyclic_reduction(S.points, A.nodes, A.work, G.q, T.z, first, count, A.most[w])
                seams.keep_seam_column(S, T, G, A, c, lane, wp.static(threads), w)
                together()
            seams.factor_seams(S, T, G, A, lane, wp.static(threads), w)
        solve(S, T, G, A, lane, w)
        rho = wp.float64(0.0)
        for t in range(lane, count * S.length.shape[0], wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                z = T.z[i, k]
                G.x[i, k] = wp.vec4d()
                G.p[i, k] = z
                G.w[i, k] = G.r[i, k]
                rho += wp.dot(G.r[i, k], z)
        return block_sum(rho)

    @wp.func
    def step_turns_back(G: CoupledRods, ahead: wp.float64, words: wp.array(dtype=int), lane: int, w: int):
        """Whether the last step of world w is taken in another part, by the force along it: a correction would be lost."""
        back = int(0)
        if lane == 0 and G.count[w] > 0:
            G.count[w] = G.count[w] + 1
            if search_step_length(G, ahead, w):
                back = 1
                if G.count[w] >= MOST:
                    G.on[w] = -1
                else:
                    wp.atomic_max(words, GOING, 1)
            else:
                G.count[w] = G.count[w] - 1
        return any_of(back) == 1

    @wp.func
    def measure_world_correction(S: RodTable, T: RodTrial, G: CoupledRods, active: bool, lane: int, w: int):
        """The correction into T.z, where pairs press; how great it is, of strands, and the force along it."""
        first = G.first[w]
        count = G.first[w + 1] - first
        gain = wp.float64(0.0)
        for strand in range(lane / wp.static(width), count, wp.static(threads // width)):
            k = first + strand
            most = wp.float64(0.0)
            for i in range(lane % wp.static(width), S.points[k], wp.static(width)):
                z = T.z[i, k]
                if active:
                    z = G.x[i, k]
                    T.z[i, k] = z
                most = wp.max(most, wp.length(point_of(z)))
                gain += wp.dot(z, G.force[i, k])
            most = warp_greatest(most)
            if lane % wp.static(width) == 0:
                G.left[k] = most / G.least[k]
        return block_sum(gain)

    @wp.func
    def correct_world(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, lane: int, w: int):
        """Moves by what was judged."""
        first = G.first[w]
        count = G.first[w + 1] - first
        all = count * S.length.shape[0]
        part = G.scale[w]
        back = G.back[w] > 0
        move = wp.where(back, wp.float64(1.0), part)
        for t in range(lane, all, wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                z = T.z[i, k]
                if back:
                    z = G.last[i, k] * part
                    T.z[i, k] = z
                    G.last[i, k] = G.last[i, k] + z
                else:
                    G.last[i, k] = z * part
                A.before[i, k] = T.x[i, k]
                T.x[i, k] = T.x[i, k] + point_of(z) * move
        together()
        for t in range(lane, all, wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i + 1 < S.points[k]:
                turn_edge(S, T, A.before[i + 1, k] - A.before[i, k], T.x[i + 1, k] - T.x[i, k], T.z[i + 1, k] - T.z[i, k],
                          T.z[i, k][3] * move, i, k)

    @wp.func
    def conclude_world(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, B: RodContacts, words: wp.array(dtype=int),
                       lane: int, w: int):
        """Judges the correction of world w, and takes it."""
        if lane == 0:
            judge_world_iteration(G, B, A.sums[w], w)
            if G.on[w] == 1:
                wp.atomic_max(words, GOING, 1)
        together()
        correct_world(S, T, G, A, lane, w)

    @wp.kernel(module=module, enable_backward=False, launch_bounds=threads)
    def move_strands(S: RodTable, T: RodTrial, G: CoupledRods, P: EdgePairs, A: RodTeam, B: RodContacts, words: ints):
        w = wp.tid() / wp.static(threads)
        lane = wp.tid() - w * wp.static(threads)
        on = G.on[w]
        together()
        if on != 1:
            if lane == 0:
                G.on[w] = 0
            return
        ahead, active = sum_up(S, G, P, A, B, lane, w)
        if not wp.static(bearing):
            if step_turns_back(G, ahead, words, lane, w):
                correct_world(S, T, G, A, lane, w)
                return
        rho = start_conjugate_gradients(S, T, G, A, lane, w)
        rounds = int(0)
        pressed = active > wp.float64(0.0) and words[ACTIVE] == 1          # else the list's N are of an earlier one
        least = GAIN * rho
        turning = pressed and rho > wp.float64(0.0)
        count = G.first[w + 1] - G.first[w]
        if wp.static(alone):
            if turning:
                rounds = go_reduced(S, T, G, P, A, rho, wp.vec3i(lane, wp.static(threads), w))
                turning = rounds == 0
            if turning and A.most[w] * count <= wp.static(SMALL):
                rounds = go_rounds(S, T, G, P, A, rho, wp.vec3i(G.first[w], count, A.most[w]))
                turning = False
        while turning:
            together()
            sum, alpha = go_round(S, T, G, P, A, B, rho, wp.vec2i(lane, w))
            rounds += 1
            turning = sum > least and rounds < ROUNDS and alpha != wp.float64(0.0)
            if turning:
                aim(S, T, G, sum / rho, lane, w)
            rho = sum
        together()
        gain = measure_world_correction(S, T, G, pressed, lane, w)
        if lane == 0:
            G.rounds[w] = rounds
            z = wp.float64(0.0)
            for k in range(G.first[w], G.first[w + 1]):
                z = wp.max(z, G.left[k])
            A.sums[w] = wp.vec3d(z, ahead, gain)
        if not wp.static(bearing):
            conclude_world(S, T, G, A, B, words, lane, w)

    if not bearing:
        return move_strands, None

    @wp.kernel(module=module, enable_backward=False, launch_bounds=threads)
    def conclude_strands(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, B: RodContacts, words: wp.array(dtype=int)):
        w = wp.tid() / wp.static(threads)
        lane = wp.tid() - w * wp.static(threads)
        on = G.on[w]
        together()
        if on == 1:
            conclude_world(S, T, G, A, B, words, lane, w)

    return move_strands, conclude_strands
