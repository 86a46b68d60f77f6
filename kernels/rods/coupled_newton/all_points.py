"""A round of conjugate gradients (kernels/rods/coupled_newton/conjugate.py) of a world in all its points, by a block of
threads: where more pairs press than kernels/rods/coupled_newton/reduced.py takes, or rigid bodies are met, in worlds of any
size."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.math.block import block_barrier, no_barrier
from wsim.kernels.rods.coupled_newton import closed as seams
from wsim.kernels.rods.coupled_newton.borne import force_pulled_by_contact, point_force_of_bodies, solve_body_block
from wsim.kernels.rods.coupled_newton.coupled import CoupledRods
from wsim.kernels.rods.coupled_newton.nodes import RodTeam
from wsim.kernels.rods.coupled_newton.reduction import solve_cyclic_reduction
from wsim.kernels.rods.coupled_newton.warps import warp_sum
from wsim.kernels.rods.tables import EdgePairs, RodContacts, RodTable, RodTrial
from wsim.kernels.solver.pcg import block_sum


@wp.func
def point_of(v: wp.vec4d):
    return wp.vec3d(v[0], v[1], v[2])


@wp.func
def pair_product_at_point(S: RodTable, G: CoupledRods, P: EdgePairs, A: RodTeam, i: int, k: int):
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
def world_solve_func(threads: int, closed: bool):
    """Function of a block of so many threads: T.z = M^-1 r of world w, with what factorizations have left. closed: some strands
    are; then r is freed of J^T lam (kernels/rods/seam.py)."""
    together = no_barrier if threads == 1 else block_barrier

    @wp.func
    def solve_world(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, lane: int, w: int):
        first = G.first[w]
        count = G.first[w + 1] - first
        solve_cyclic_reduction(S.points, A.nodes, A.work, G.r, T.z, first, count, A.most[w])
        if wp.static(closed):
            seams.find_seam_forces(S, T, G, A, lane, wp.static(threads), w)
            together()
            for t in range(lane, count * S.length.shape[0], wp.static(threads)):
                i = t / count
                seams.close_point_seam(S, T, G, A, i, first + t - i * count)
            together()

    return solve_world


@cache
def conjugate_round_funcs(threads: int, bearing: bool, closed: bool = False):
    """(go_round, aim): functions of a block of so many threads; 1 on a CPU. bearing: with rigid bodies. closed: some strands
    are."""
    together = no_barrier if threads == 1 else block_barrier
    width, solve = min(threads, 32), world_solve_func(threads, closed)

    @wp.func
    def give_way(S: RodTable, G: CoupledRods, B: RodContacts, lane: int, w: int):
        """What bodies of world w give way as points are moved by G.p, a warp a body."""
        for i in range(B.first[w] + lane / wp.static(width), B.first[w + 1], wp.static(threads // width)):
            u = wp.vec3d()
            a = wp.vec3d()
            for j in range(B.start[i] + lane % wp.static(width), B.start[i + 1], wp.static(width)):
                f, turn = force_pulled_by_contact(S, B, G.p, j)
                u += f
                a += turn
            u, a = solve_body_block(B, i, warp_sum(u), warp_sum(a))
            if lane % wp.static(width) == 0:
                B.y[i, 0] = u
                B.y[i, 1] = a

    @wp.func
    def go_round(S: RodTable, T: RodTrial, G: CoupledRods, P: EdgePairs, A: RodTeam, B: RodContacts, rho: wp.float64,
                 at: wp.vec2i):
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
                q = G.w[i, k] + pair_product_at_point(S, G, P, A, i, k)
                if wp.static(bearing):
                    if B.near[w] == 1 and S.hold[i, k] < 0:
                        f = point_force_of_bodies(B, S.points.shape[0], i * S.points.shape[0] + k)
                        q = q - wp.vec4d(f[0], f[1], f[2], wp.float64(0.0))
                G.q[i, k] = q
                sum += wp.dot(q, G.p[i, k])
        sum = block_sum(sum)
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
        solve(S, T, G, A, lane, w)
        sum = wp.float64(0.0)
        for t in range(lane, all, wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                sum += wp.dot(G.r[i, k], T.z[i, k])
        return block_sum(sum), alpha

    @wp.func
    def aim_next_direction(S: RodTable, T: RodTrial, G: CoupledRods, beta: wp.float64, lane: int, w: int):
        """The next direction."""
        first = G.first[w]
        count = G.first[w + 1] - first
        for t in range(lane, count * S.length.shape[0], wp.static(threads)):
            i = t / count
            k = first + t - i * count
            if i < S.points[k]:
                G.w[i, k] = G.r[i, k] + G.w[i, k] * beta
                G.p[i, k] = T.z[i, k] + G.p[i, k] * beta

    return go_round, aim_next_direction
