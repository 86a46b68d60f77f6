"""An iteration of Newton's method (kernels/rods/together/coupled.py) by a block of threads a world, for a GPU and few strands:
`part_points` (kernels/rods/together/nodes.py) by a thread a point, then `correct_strands`, which sums a world's system, factors
it by odd-even reduction (kernels/rods/together/reduction.py), goes through all rounds of conjugate gradients
(kernels/rods/together/conjugate.py), judges the correction, and takes it; where rigid bodies are among the unknowns, a launch
of its own does the latter, behind that which measures theirs.

Sums over a world are made by its block, in one order. On a CPU one thread is a block, for tests. A thread a strand finds the
same but for rounding.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.math.block import alone, meet
from wsim.kernels.math.team import any_of
from wsim.kernels.rods.system import turn_edge
from wsim.kernels.rods.tables import Borne, Pressed, Strands, Trial
from wsim.kernels.rods.together.all_points import point_of, rounding
from wsim.kernels.rods.together.conjugate import GAIN, ROUNDS
from wsim.kernels.rods.together.coupled import ACTIVE, GOING, MOST, Coupled, judge, searched
from wsim.kernels.rods.together.nodes import Team, assemble
from wsim.kernels.rods.together.reduced import go_reduced
from wsim.kernels.rods.together.reduction import factor, solve
from wsim.kernels.rods.together.rounds import SMALL, go_rounds
from wsim.kernels.rods.together.warps import greatest
from wsim.kernels.solver.pcg import total

BLOCK = 256              # threads of a world on a GPU


@cache
def correcting(threads: int, bearing: bool, module: str):
    """Kernels over threads of worlds: the correction; with `bearing`, rigid bodies, apart from it, what follows. threads: of a
    block; 1 on a CPU."""
    together = alone if threads == 1 else meet
    width, (go_round, aim) = min(threads, 32), rounding(threads, bearing)

    @wp.func
    def sum_up(S: Strands, G: Coupled, P: Pressed, A: Team, B: Borne, lane: int, w: int):
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
                ahead += assemble(S, G, A, i, k)
                point = i * S.points.shape[0] + k
                if P.ons:
                    active += P.ons[point]
                if wp.static(bearing):
                    if B.near[w] == 1:
                        active += B.many[point]
                        if S.hold[i, k] < 0:
                            f = B.push[point]
                            G.r[i, k] = G.r[i, k] + wp.vec4d(f[0], f[1], f[2], wp.float64(0.0))
        return total(ahead), total(wp.float64(active))

    @wp.func
    def start(S: Strands, T: Trial, G: Coupled, A: Team, lane: int, w: int):
        """Systems of world w, factored, and the first correction; r . z."""
        first = G.first[w]
        count = G.first[w + 1] - first
        together()
        factor(S.points, A.nodes, first, count, A.most[w])
        solve(S.points, A.nodes, A.work, G.r, T.z, first, count, A.most[w])
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
        return total(rho)

    @wp.func
    def returns(G: Coupled, ahead: wp.float64, words: wp.array(dtype=int), lane: int, w: int):
        """Whether the last step of world w is taken in another part, by the force along it: a correction would be lost."""
        back = int(0)
        if lane == 0 and G.count[w] > 0:
            G.count[w] = G.count[w] + 1
            if searched(G, ahead, w):
                back = 1
                if G.count[w] >= MOST:
                    G.on[w] = -1
                else:
                    wp.atomic_max(words, GOING, 1)
            else:
                G.count[w] = G.count[w] - 1
        return any_of(back) == 1

    @wp.func
    def measure(S: Strands, T: Trial, G: Coupled, active: bool, lane: int, w: int):
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
            most = greatest(most)
            if lane % wp.static(width) == 0:
                G.left[k] = most / G.least[k]
        return total(gain)

    @wp.func
    def take(S: Strands, T: Trial, G: Coupled, A: Team, lane: int, w: int):
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
    def conclude(S: Strands, T: Trial, G: Coupled, A: Team, B: Borne, words: wp.array(dtype=int), lane: int, w: int):
        """Judges the correction of world w, and takes it."""
        if lane == 0:
            judge(G, B, A.sums[w], w)
            if G.on[w] == 1:
                wp.atomic_max(words, GOING, 1)
        together()
        take(S, T, G, A, lane, w)

    @wp.kernel(module=module, enable_backward=False, launch_bounds=threads)
    def correct_strands(S: Strands, T: Trial, G: Coupled, P: Pressed, A: Team, B: Borne, words: wp.array(dtype=int)):
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
            if returns(G, ahead, words, lane, w):
                take(S, T, G, A, lane, w)
                return
        rho = start(S, T, G, A, lane, w)
        rounds = int(0)
        pressed = active > wp.float64(0.0) and words[ACTIVE] == 1          # else the list's N are of an earlier one
        least = GAIN * rho
        turning = pressed and rho > wp.float64(0.0)
        count = G.first[w + 1] - G.first[w]
        if not wp.static(bearing):
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
        gain = measure(S, T, G, pressed, lane, w)
        if lane == 0:
            G.rounds[w] = rounds
            z = wp.float64(0.0)
            for k in range(G.first[w], G.first[w + 1]):
                z = wp.max(z, G.left[k])
            A.sums[w] = wp.vec3d(z, ahead, gain)
        if not wp.static(bearing):
            conclude(S, T, G, A, B, words, lane, w)

    if not bearing:
        return correct_strands, None

    @wp.kernel(module=module, enable_backward=False, launch_bounds=threads)
    def conclude_strands(S: Strands, T: Trial, G: Coupled, A: Team, B: Borne, words: wp.array(dtype=int)):
        w = wp.tid() / wp.static(threads)
        lane = wp.tid() - w * wp.static(threads)
        on = G.on[w]
        together()
        if on == 1:
            conclude(S, T, G, A, B, words, lane, w)

    return correct_strands, conclude_strands
