"""Conjugate gradients for the corrections of strands that press each other.

    A = M + E,   M: blocks of strands (kernels/rods/system.py) with what contacts add within an edge, factored strand by strand
                 E: what contacts add between the two edges of a pair, and
                    between all points and edges that touch one rigid body, whose motion is eliminated
                    (kernels/rigid/touch/strands.py)

They are preconditioned by M. Since p = z + beta p with M z = r, M p is summed up likewise (w), and no block of M is kept.
Worlds end by themselves: at GAIN, or ROUNDS of them.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.rods.coupled_newton.coupled import TURNING, CoupledRods
from wsim.kernels.rods.eliminate import substitute_strand_backward
from wsim.kernels.rods.seam import close_seam, free_of_seam
from wsim.kernels.rods.tables import EdgePairs, RodContacts, RodTable, RodTrial

GAIN = wp.constant(wp.float64(1e-8))     # residual over that of the start, squared, at which conjugate gradients end
ROUNDS = wp.constant(400)                # of them, at most


@cache
def strand_preconditioner_func(closed: bool):
    """Function (S, T, G, k): T.z = M^-1 r; r . z. closed: some strands are."""

    @wp.func
    def strand_preconditioner(S: RodTable, T: RodTrial, G: CoupledRods, k: int):
        n = S.points[k]
        t1 = wp.vec4d()
        t2 = wp.vec4d()
        for i in range(n):
            t = G.r[i, k]
            if i > 0:
                t = t - wp.transpose(T.near[i - 1, k]) * t1
            if i > 1:
                t = t - wp.transpose(T.far[i - 2, k]) * t2
            T.z[i, k] = T.pivot[i, k] * t
            t2 = t1
            t1 = t
        substitute_strand_backward(S, T, k)
        if wp.static(closed):
            if S.own[k] < n:
                f, _ = close_seam(S, T, k)
                free_of_seam(S, G.r, f, k)
        total = wp.float64(0.0)
        for i in range(n):
            total += wp.dot(G.r[i, k], T.z[i, k])
        return total

    return strand_preconditioner


@cache
def conjugate_gradient_kernels(module: str, closed: bool = False):
    """Kernels of conjugate gradients: what bodies by themselves give; start; A p; step and residual; next direction; the
    correction into T.z. closed: some strands are."""
    precondition = strand_preconditioner_func(closed)

    @wp.func
    def world_sum(G: CoupledRods, k: int):
        a = wp.float64(0.0)
        for j in range(G.first[k], G.first[k + 1]):
            a += G.sum[j]
        return a

    @wp.kernel(module=module, enable_backward=False)
    def carry_strands(S: RodTable, T: RodTrial, B: RodContacts, G: CoupledRods):
        k = wp.tid()
        if G.on[G.world[k]] != 1 or B.near[G.world[k]] == 0:
            return
        for i in range(S.points[k]):
            if S.hold[i, k] < 0:
                f = B.push[i * G.world.shape[0] + k]
                G.r[i, k] = G.r[i, k] + wp.vec4d(f[0], f[1], f[2], wp.float64(0.0))
        G.sum[k] = precondition(S, T, G, k)
        for i in range(S.points[k]):
            G.p[i, k] = T.z[i, k]
            G.w[i, k] = G.r[i, k]

    @wp.kernel(module=module, enable_backward=False)
    def start_worlds(G: CoupledRods, words: wp.array(dtype=int)):
        words[TURNING] = 0
        for k in range(G.on.shape[0]):
            G.turn[k] = 0
            if G.on[k] == 1:
                G.rho[k] = world_sum(G, k)
                G.rho0[k] = G.rho[k]
                G.rounds[k] = 0
                if G.rho[k] > wp.float64(0.0):
                    G.turn[k] = 1
                    words[TURNING] = 1

    @wp.kernel(module=module, enable_backward=False)
    def apply_strands(S: RodTable, P: EdgePairs, b: wp.array(dtype=wp.vec4d), B: RodContacts, G: CoupledRods):
        k = wp.tid()
        if G.turn[G.world[k]] != 1:
            return
        m = G.world.shape[0]
        a = wp.float64(0.0)
        for i in range(S.points[k]):
            move = G.w[i, k]
            if S.hold[i, k] < 0:
                q = wp.vec3d()
                point = i * m + k
                if P.ons:
                    for j in range(P.ons[point]):
                        entry = P.on[point, j]
                        pair = entry / 4
                        c = entry - 4 * pair
                        if c < 2:
                            q += P.cross[pair, 1] * b[pair][c]
                        else:
                            q += P.cross[pair, 0] * b[pair][c]
                if B.many:
                    q -= B.push[point]
                move = move + wp.vec4d(q[0], q[1], q[2], wp.float64(0.0))
            G.q[i, k] = move
            a += wp.dot(move, G.p[i, k])
        G.sum[k] = a

    @wp.kernel(module=module, enable_backward=False)
    def length_worlds(G: CoupledRods):
        k = wp.tid()
        if G.turn[k] == 1:
            a = world_sum(G, k)
            G.alpha[k] = wp.float64(0.0)
            if a > wp.float64(0.0):
                G.alpha[k] = G.rho[k] / a

    @wp.kernel(module=module, enable_backward=False)
    def step_strands(S: RodTable, T: RodTrial, G: CoupledRods):
        k = wp.tid()
        if G.turn[G.world[k]] != 1:
            return
        a = G.alpha[G.world[k]]
        for i in range(S.points[k]):
            G.x[i, k] = G.x[i, k] + G.p[i, k] * a
            G.r[i, k] = G.r[i, k] - G.q[i, k] * a
        G.sum[k] = precondition(S, T, G, k)

    @wp.kernel(module=module, enable_backward=False)
    def turn_worlds(G: CoupledRods, words: wp.array(dtype=int)):
        words[TURNING] = 0
        for k in range(G.on.shape[0]):
            if G.turn[k] == 1:
                rho = world_sum(G, k)
                G.beta[k] = rho / G.rho[k]
                G.rho[k] = rho
                G.rounds[k] = G.rounds[k] + 1
                if rho <= GAIN * G.rho0[k] or G.rounds[k] >= ROUNDS or G.alpha[k] == wp.float64(0.0):
                    G.turn[k] = -1
                else:
                    words[TURNING] = 1

    @wp.kernel(module=module, enable_backward=False)
    def aim_strands(S: RodTable, T: RodTrial, G: CoupledRods):
        k = wp.tid()
        world = G.world[k]
        if G.turn[world] != 1:
            return
        b = G.beta[world]
        for i in range(S.points[k]):
            G.w[i, k] = G.r[i, k] + G.w[i, k] * b
            G.p[i, k] = T.z[i, k] + G.p[i, k] * b

    @wp.kernel(module=module, enable_backward=False)
    def end_strands(S: RodTable, T: RodTrial, G: CoupledRods):
        k = wp.tid()
        if G.on[G.world[k]] == 1:
            for i in range(S.points[k]):
                T.z[i, k] = G.x[i, k]

    return carry_strands, start_worlds, apply_strands, length_worlds, step_strands, turn_worlds, aim_strands, end_strands
