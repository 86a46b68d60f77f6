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
from wsim.kernels.rods.system import turn_edge
from wsim.kernels.rods.tables import Borne, Pressed, Strands, Trial
from wsim.kernels.rods.together.borne import pulled, pushed, solved
from wsim.kernels.rods.together.conjugate import GAIN, ROUNDS
from wsim.kernels.rods.together.coupled import ACTIVE, GOING, Coupled, judge
from wsim.kernels.rods.together.nodes import Team, assemble
from wsim.kernels.rods.together.reduced import go_reduced
from wsim.kernels.rods.together.reduction import factor, solve
from wsim.kernels.rods.together.rounds import SMALL, go_rounds
from wsim.kernels.rods.together.warps import greatest, warp_sum
from wsim.kernels.solver.pcg import total

BLOCK = 256              # threads of a world on a GPU


@wp.func
def point_of(v: wp.vec4d):
    return wp.vec3d(v[0], v[1], v[2])


@wp.func
def across(S: Strands, G: Coupled, P: Pressed, A: Team, i: int, k: int):
    """E p of a point: what pairs add between their two edges."""
    q = wp.vec3d()
    m = S.points.shape[0]
    point = i * m + k
    if P.ons and S.hold[i, k] < 0:
        for j in range(P.ons[point]):
            entry = P.on[point, j]
            pair = entry / 4
            c = entry - 4 * pair
            other = wp.where(c < 2, 2, 0)
            ids = A.ids[pair]
            b = A.b[pair]
            x = ids[other]
            y = ids[other + 1]
            move = point_of(G.p[x / m, x % m]) * b[other] + point_of(G.p[y / m, y % m]) * b[other + 1]
            q += P.K[pair] * move * b[c]
    return wp.vec4d(q[0], q[1], q[2], wp.float64(0.0))


@cache
def correcting(threads: int, bearing: bool, module: str):
    """Kernels over threads of worlds: the correction; with `bearing`, rigid bodies, apart from it, what follows. threads: of a
    block; 1 on a CPU."""
    together = alone if threads == 1 else meet
    width = min(threads, 32)

    @wp.func
    def start(S: Strands, T: Trial, G: Coupled, P: Pressed, A: Team, B: Borne, lane: int, w: int):
        """Systems of world w, factored, and the first correction; the force along the last step, how many pairs press and
        points touch bodies, r . z."""
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
        together()
        factor(S.points, A.nodes, first, count, A.most[w])
        solve(S.points, A.nodes, A.work, G.r, T.z, first, count, A.most[w])
        rho = wp.float64(0.0)
        for t in range(lane, all, wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                z = T.z[i, k]
                G.x[i, k] = wp.vec4d()
                G.p[i, k] = z
                G.w[i, k] = G.r[i, k]
                rho += wp.dot(G.r[i, k], z)
        return total(ahead), total(wp.float64(active)), total(rho)

    @wp.func
    def give_way(S: Strands, G: Coupled, B: Borne, lane: int, w: int):
        """What bodies of world w give way as points are moved by G.p, a warp a body."""
        for i in range(B.first[w] + lane / wp.static(width), B.first[w + 1], wp.static(threads // width)):
            u = wp.vec3d()
            a = wp.vec3d()
            for j in range(B.start[i] + lane % wp.static(width), B.start[i + 1], wp.static(width)):
                f, turn = pulled(S, B, G.p, j)
                u += f
                a += turn
            u, a = solved(B, i, warp_sum(u), warp_sum(a))
            if lane % wp.static(width) == 0:
                B.y[i, 0] = u
                B.y[i, 1] = a

    @wp.func
    def go_round(S: Strands, T: Trial, G: Coupled, P: Pressed, A: Team, B: Borne, rho: wp.float64, at: wp.vec2i):
        """A round of conjugate gradients of the world at[1], by its thread at[0]; r . z, and the length of its step."""
        lane = at[0]
        w = at[1]
        if wp.static(bearing):
            if B.near[w] == 1:
                give_way(S, G, B, lane, w)
                together()
        first = G.first[w]
        count = G.first[w + 1] - first
        all = count * S.length.shape[0]
        sum = wp.float64(0.0)
        for t in range(lane, all, wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                q = G.w[i, k] + across(S, G, P, A, i, k)
                if wp.static(bearing):
                    if B.near[w] == 1 and S.hold[i, k] < 0:
                        f = pushed(B, S.points.shape[0], i * S.points.shape[0] + k)
                        q = q - wp.vec4d(f[0], f[1], f[2], wp.float64(0.0))
                G.q[i, k] = q
                sum += wp.dot(q, G.p[i, k])
        sum = total(sum)
        alpha = wp.float64(0.0)
        if sum > wp.float64(0.0):
            alpha = rho / sum
        for t in range(lane, all, wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                G.x[i, k] = G.x[i, k] + G.p[i, k] * alpha
                G.r[i, k] = G.r[i, k] - G.q[i, k] * alpha
        together()
        solve(S.points, A.nodes, A.work, G.r, T.z, first, count, A.most[w])
        sum = wp.float64(0.0)
        for t in range(lane, all, wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                sum += wp.dot(G.r[i, k], T.z[i, k])
        return total(sum), alpha

    @wp.func
    def aim(S: Strands, T: Trial, G: Coupled, beta: wp.float64, lane: int, w: int):
        """The next direction."""
        first = G.first[w]
        count = G.first[w + 1] - first
        for t in range(lane, count * S.length.shape[0], wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                G.w[i, k] = G.r[i, k] + G.w[i, k] * beta
                G.p[i, k] = T.z[i, k] + G.p[i, k] * beta

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
        ahead, active, rho = start(S, T, G, P, A, B, lane, w)
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
