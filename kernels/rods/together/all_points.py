"""A round of conjugate gradients (kernels/rods/together/conjugate.py) of a world in all its points, by a block of threads:
where more pairs press than kernels/rods/together/reduced.py takes, or rigid bodies are met, in worlds of any size."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.math.block import alone, meet
from wsim.kernels.rods.tables import Borne, Pressed, Strands, Trial
from wsim.kernels.rods.together.borne import pulled, pushed, solved
from wsim.kernels.rods.together.coupled import Coupled
from wsim.kernels.rods.together.nodes import Team
from wsim.kernels.rods.together.reduction import solve
from wsim.kernels.rods.together.warps import warp_sum
from wsim.kernels.solver.pcg import total


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
def rounding(threads: int, bearing: bool):
    """(go_round, aim): functions of a block of so many threads; 1 on a CPU. bearing: with rigid bodies."""
    together = alone if threads == 1 else meet
    width = min(threads, 32)

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

    return go_round, aim
