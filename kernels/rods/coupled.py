"""Substeps of strands that press each other: Newton's method for all strands of a world at once, and conjugate gradients.

    A = M + E,   M: blocks of strands (kernels/rods/system.py) with what contacts add within an edge, factored strand by strand
                 E: what contacts add between the two edges of a pair

Conjugate gradients are preconditioned by M. Since p = z + beta p with M z = r, M p is summed up likewise (w), and no block of M
is kept. Every world has its own scalars and ends by itself; sums over strands are taken in their order. A world where something
is touched steps by backward Euler as a whole: points that stepped otherwise than those they pull at would make momentum.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.rods.contact import Colliders
from wsim.kernels.rods.march import CALM, LEAST, MOST, TOLERANCE, begin, finish
from wsim.kernels.rods.system import backward, forward, take
from wsim.kernels.rods.tables import Holds, Motion, Step, Strands, Trial
from wsim.kernels.rods.touch import Pressed

GAIN = wp.constant(wp.float64(1e-8))     # residual over that of the start, squared, at which conjugate gradients end
ROUNDS = wp.constant(400)                # of them, at most
# words: Newton goes on; conjugate gradients do; a pair presses; this is the first frame
GOING, TURNING, ACTIVE, FIRST = range(4)
WORDS = 4


@wp.struct
class Coupled:
    """By strand: its world, sums, the greatest correction over its shortest edge. By world: Newton's state, gradients' scalars.
    By block of 4: vectors of conjugate gradients."""

    first: wp.array(dtype=int)                      # first strand of each world, and their number, (worlds + 1,)
    world: wp.array(dtype=int)
    least: wp.array(dtype=wp.float64)               # shortest edge [m]
    sum: wp.array(dtype=wp.float64)
    left: wp.array(dtype=wp.float64)
    on: wp.array(dtype=int)                         # 1: Newton goes on; -1: one step is taken yet; 0: it has ended
    turn: wp.array(dtype=int)                       # 1: conjugate gradients go on
    count: wp.array(dtype=int)                      # iterations of Newton
    rounds: wp.array(dtype=int)                     # and of the gradients in this one
    share: wp.array(dtype=wp.float64)               # part of a step that is taken
    scale: wp.array(dtype=wp.float64)               # and of this one, where steps are longer than edges
    before: wp.array(dtype=wp.float64)              # greatest correction before
    rho: wp.array(dtype=wp.float64)                 # r . z
    rho0: wp.array(dtype=wp.float64)
    alpha: wp.array(dtype=wp.float64)
    beta: wp.array(dtype=wp.float64)
    touched: wp.array(dtype=int)                    # 1: something is touched
    x: wp.array2d(dtype=wp.vec4d)
    r: wp.array2d(dtype=wp.vec4d)
    p: wp.array2d(dtype=wp.vec4d)
    w: wp.array2d(dtype=wp.vec4d)                   # M p
    q: wp.array2d(dtype=wp.vec4d)                   # A p


@wp.func
def solve(S: Strands, T: Trial, G: Coupled, k: int):
    """T.z = M^-1 r; r . z."""
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
    backward(S, T, k)
    total = wp.float64(0.0)
    for i in range(n):
        total += wp.dot(G.r[i, k], T.z[i, k])
    return total


@cache
def newton(kinds: tuple[str, ...], module: str):
    """Kernels of Newton's method: begin a substep; assemble; measure corrections; judge them; take them. kinds: of colliders."""
    assemble = forward(kinds, True)

    @wp.kernel(module=module, enable_backward=False)
    def begin_strands(S: Strands, H: Holds, Q: Motion, T: Trial, G: Coupled, h: wp.float64, at: int):
        k = wp.tid()
        begin(S, H, Q, T, h, at, k)
        short = S.length[0, k]
        for i in range(1, S.points[k] - 1):
            short = wp.min(short, S.length[i, k])
        G.least[k] = short

    @wp.kernel(module=module, enable_backward=False)
    def begin_worlds(G: Coupled, words: wp.array(dtype=int)):
        k = wp.tid()
        G.on[k] = 1
        G.count[k] = 0
        G.share[k] = wp.float64(1.0)
        G.before[k] = wp.float64(1e30)
        words[GOING] = 1

    @wp.kernel(module=module, enable_backward=False)
    def assemble_strands(S: Strands, C: Colliders, Q: Motion, T: Trial, G: Coupled, h: wp.float64, at: int):
        k = wp.tid()
        if G.on[G.world[k]] != 1:
            return
        p = Step()
        p.h = h
        p.at = at
        assemble(S, C, Q, T, p, k)
        backward(S, T, k)
        total = wp.float64(0.0)
        t1 = wp.vec4d()
        t2 = wp.vec4d()
        for i in range(S.points[k]):                    # what was eliminated on, as it was
            t = T.b[i, k]
            r = t
            if i > 0:
                r = r + wp.transpose(T.near[i - 1, k]) * t1
            if i > 1:
                r = r + wp.transpose(T.far[i - 2, k]) * t2
            t2 = t1
            t1 = t
            z = T.z[i, k]
            G.x[i, k] = wp.vec4d()
            G.r[i, k] = r
            G.p[i, k] = z
            G.w[i, k] = r
            total += wp.dot(r, z)
        G.sum[k] = total

    @wp.kernel(module=module, enable_backward=False)
    def measure_strands(S: Strands, T: Trial, G: Coupled):
        k = wp.tid()
        if G.on[G.world[k]] != 1:
            return
        most = wp.float64(0.0)
        for i in range(S.points[k]):
            z = T.z[i, k]
            most = wp.max(most, wp.length(wp.vec3d(z[0], z[1], z[2])))
        G.left[k] = most / G.least[k]

    @wp.kernel(module=module, enable_backward=False)
    def judge_worlds(G: Coupled, words: wp.array(dtype=int)):
        words[GOING] = 0
        words[ACTIVE] = 0
        one = wp.float64(1.0)
        for k in range(G.on.shape[0]):
            G.on[k] = wp.max(G.on[k], 0)
            if G.on[k] == 1:
                z = wp.float64(0.0)
                for j in range(G.first[k], G.first[k + 1]):
                    z = wp.max(z, G.left[j])
                if z > (one - CALM * G.share[k]) * G.before[k]:
                    G.share[k] = wp.max(wp.float64(0.5) * G.share[k], LEAST)
                else:
                    G.share[k] = wp.min(wp.float64(2.0) * G.share[k], one)
                G.scale[k] = G.share[k] * wp.min(one, one / wp.max(z, wp.float64(1e-12)))
                G.before[k] = z
                G.count[k] = G.count[k] + 1
                if z <= TOLERANCE or G.count[k] >= MOST:
                    G.on[k] = -1                        # the last step is taken yet
                else:
                    words[GOING] = 1

    @wp.kernel(module=module, enable_backward=False)
    def take_strands(S: Strands, T: Trial, G: Coupled):
        k = wp.tid()
        if G.on[G.world[k]] != 0:
            take(S, T, G.scale[G.world[k]], k)

    return begin_strands, begin_worlds, assemble_strands, measure_strands, judge_worlds, take_strands


@cache
def gradients(module: str):
    """Kernels of conjugate gradients: start, A p, step and residual, the next direction, and the end: the correction into T.z."""
    @wp.func
    def total(G: Coupled, k: int):
        a = wp.float64(0.0)
        for j in range(G.first[k], G.first[k + 1]):
            a += G.sum[j]
        return a

    @wp.kernel(module=module, enable_backward=False)
    def start_worlds(G: Coupled, words: wp.array(dtype=int)):
        words[TURNING] = 0
        for k in range(G.on.shape[0]):
            G.turn[k] = 0
            if G.on[k] == 1:
                G.rho[k] = total(G, k)
                G.rho0[k] = G.rho[k]
                G.rounds[k] = 0
                if G.rho[k] > wp.float64(0.0):
                    G.turn[k] = 1
                    words[TURNING] = 1

    @wp.kernel(module=module, enable_backward=False)
    def apply_strands(S: Strands, P: Pressed, b: wp.array(dtype=wp.vec4d), G: Coupled):
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
                for j in range(wp.min(P.many[point], P.of.shape[1])):
                    entry = P.of[point, j]
                    pair = entry / 4
                    c = entry - 4 * pair
                    if c < 2:
                        q += P.cross[pair, 1] * b[pair][c]
                    else:
                        q += P.cross[pair, 0] * b[pair][c]
                move = move + wp.vec4d(q[0], q[1], q[2], wp.float64(0.0))
            G.q[i, k] = move
            a += wp.dot(move, G.p[i, k])
        G.sum[k] = a

    @wp.kernel(module=module, enable_backward=False)
    def length_worlds(G: Coupled):
        k = wp.tid()
        if G.turn[k] == 1:
            a = total(G, k)
            G.alpha[k] = wp.float64(0.0)
            if a > wp.float64(0.0):
                G.alpha[k] = G.rho[k] / a

    @wp.kernel(module=module, enable_backward=False)
    def step_strands(S: Strands, T: Trial, G: Coupled):
        k = wp.tid()
        if G.turn[G.world[k]] != 1:
            return
        a = G.alpha[G.world[k]]
        for i in range(S.points[k]):
            G.x[i, k] = G.x[i, k] + G.p[i, k] * a
            G.r[i, k] = G.r[i, k] - G.q[i, k] * a
        G.sum[k] = solve(S, T, G, k)

    @wp.kernel(module=module, enable_backward=False)
    def turn_worlds(G: Coupled, words: wp.array(dtype=int)):
        words[TURNING] = 0
        for k in range(G.on.shape[0]):
            if G.turn[k] == 1:
                rho = total(G, k)
                G.beta[k] = rho / G.rho[k]
                G.rho[k] = rho
                G.rounds[k] = G.rounds[k] + 1
                if rho <= GAIN * G.rho0[k] or G.rounds[k] >= ROUNDS or G.alpha[k] == wp.float64(0.0):
                    G.turn[k] = -1
                else:
                    words[TURNING] = 1

    @wp.kernel(module=module, enable_backward=False)
    def aim_strands(S: Strands, T: Trial, G: Coupled):
        k = wp.tid()
        world = G.world[k]
        if G.turn[world] != 1:
            return
        b = G.beta[world]
        for i in range(S.points[k]):
            G.w[i, k] = G.r[i, k] + G.w[i, k] * b
            G.p[i, k] = T.z[i, k] + G.p[i, k] * b

    @wp.kernel(module=module, enable_backward=False)
    def end_strands(S: Strands, T: Trial, G: Coupled):
        k = wp.tid()
        if G.on[G.world[k]] == 1:
            for i in range(S.points[k]):
                T.z[i, k] = G.x[i, k]

    return start_worlds, apply_strands, length_worlds, step_strands, turn_worlds, aim_strands, end_strands
