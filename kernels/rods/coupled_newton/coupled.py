"""Substeps of strands that press each other: Newton's method for all strands of a world at once. Corrections come of the blocks
of strands alone (kernels/rods/system.py) where nothing presses, else of conjugate gradients (conjugate.py, beside this file).

A step along which the force turns round, f . z < -OVERSHOT f0 . z, is taken back to where the force along it is 0, to OVERSHOT
(regula falsi; Dowell, Jarratt 1971). What is met on the way pushes a thousand times as much as what was left: where that force
would be 0 if it were linear, nothing is met yet, and the next step would go the same way. Friction has no stiffness
along its slip, and turns round too. For ROUGH iterations behind that, or half as many as there were, it is taken to be as stiff
along as across, which descends for certain, and slowly.

Every world has its own scalars and ends by itself; sums over strands are taken in their order. A world where something is
touched steps by backward Euler as a whole: points that stepped otherwise than those they pull at would make momentum.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.rods.contact import Colliders
from wsim.kernels.rods.eliminate import substitute_strand_backward
from wsim.kernels.rods.march import TOLERANCE
from wsim.kernels.rods.seam import SeamForces, close_seam, factor_seam, free_of_seam
from wsim.kernels.rods.system import apply_strand_corrections, strand_assembly_func
from wsim.kernels.rods.tables import RodContacts, RodMotion, RodStep, RodTable, RodTrial

MOST = wp.constant(150)                  # iterations of Newton: friction that turns round settles by a fifth in each
OVERSHOT = wp.constant(wp.float64(0.5))
ROUGH = wp.constant(8)                   # iterations behind a step back
BACK = wp.constant(8)                    # steps back, or on again, in a row, at most
EDGE = wp.constant(wp.float64(0.05))     # part of what is left of a step that each of them leaves on either side
# words: Newton goes on; conjugate gradients do; a pair presses; this is the first frame
GOING, TURNING, ACTIVE, FIRST = range(4)
WORDS = 4


@wp.struct
class CoupledRods:
    """By strand: its world, sums, the greatest correction over its shortest edge. By world: Newton's state, gradients' scalars.
    By block of 4: vectors of conjugate gradients."""

    first: wp.array(dtype=int)                      # first strand of each world, and their number, (worlds + 1,)
    world: wp.array(dtype=int)
    least: wp.array(dtype=wp.float64)               # shortest edge [m]
    sum: wp.array(dtype=wp.float64)
    ahead: wp.array(dtype=wp.float64)               # force along the last step, and along the correction
    gain: wp.array(dtype=wp.float64)
    left: wp.array(dtype=wp.float64)
    on: wp.array(dtype=int)                         # 1: Newton goes on; -1: one step is taken yet; 0: it has ended
    turn: wp.array(dtype=int)                       # 1: conjugate gradients go on
    count: wp.array(dtype=int)                      # iterations of Newton
    rounds: wp.array(dtype=int)                     # and of the gradients in this one
    scale: wp.array(dtype=wp.float64)               # part of the correction, or of the step before, that is taken
    back: wp.array(dtype=int)                       # times in a row that another part of the last step was taken
    rough: wp.array(dtype=int)                      # iterations to come in which friction is as stiff along its slip as across
    slope: wp.array(dtype=wp.float64)               # force along the last step where it began
    part: wp.array(dtype=wp.float64)                # of that step, that is taken
    low: wp.array(dtype=wp.vec2d)                   # the greatest part where the force along it was above 0, and that force
    high: wp.array(dtype=wp.vec2d)                  # the least where it was below, 0 if none, and that force
    above: wp.array(dtype=int)                      # 1: the last part that was tried is low
    body: wp.array(dtype=wp.float64)                # greatest correction of a rigid body, over an edge, or its own radius
    rho: wp.array(dtype=wp.float64)                 # r . z
    rho0: wp.array(dtype=wp.float64)
    alpha: wp.array(dtype=wp.float64)
    beta: wp.array(dtype=wp.float64)
    touched: wp.array(dtype=int)                    # 1: something is touched
    force: wp.array2d(dtype=wp.vec4d)               # right-hand side
    last: wp.array2d(dtype=wp.vec4d)                # the last step
    x: wp.array2d(dtype=wp.vec4d)
    r: wp.array2d(dtype=wp.vec4d)
    p: wp.array2d(dtype=wp.vec4d)
    w: wp.array2d(dtype=wp.vec4d)                   # M p
    q: wp.array2d(dtype=wp.vec4d)                   # A p


@wp.func
def search_step_length(G: CoupledRods, ahead: wp.float64, k: int):
    """Whether another part of the last step of world k is taken, by `scale` of what was. ahead: force along that."""
    part = G.part[k]
    f = ahead / part
    half = wp.float64(0.5)
    zero = wp.float64(0.0)
    low = G.low[k]
    high = G.high[k]
    if G.back[k] >= BACK:
        return False
    if f < -OVERSHOT * G.slope[k]:
        if high[0] > zero and G.above[k] == 0:
            low[1] = half * low[1]
        high = wp.vec2d(part, f)
        G.above[k] = 0
    elif high[0] > zero and f > OVERSHOT * G.slope[k]:
        if G.above[k] == 1:
            high[1] = half * high[1]
        low = wp.vec2d(part, f)
        G.above[k] = 1
    else:
        return False
    edge = EDGE * (high[0] - low[0])
    there = wp.clamp((low[0] * high[1] - high[0] * low[1]) / (high[1] - low[1]), low[0] + edge, high[0] - edge)
    G.low[k] = low
    G.high[k] = high
    G.part[k] = there
    G.scale[k] = there / part - wp.float64(1.0)
    G.back[k] = G.back[k] + 1
    G.rough[k] = wp.max(ROUGH, G.count[k] / 2)
    return True


@wp.func
def begin_newton_step(G: CoupledRods, z: wp.float64, gain: wp.float64, k: int):
    """A new step of world k, as long as an edge at most. z: greatest correction; gain: force along it."""
    one = wp.float64(1.0)
    G.scale[k] = wp.min(one, one / wp.max(z, wp.float64(1e-12)))
    G.slope[k] = gain * G.scale[k]
    G.part[k] = one
    G.low[k] = wp.vec2d(wp.float64(0.0), G.slope[k])
    G.high[k] = wp.vec2d()
    G.back[k] = 0
    G.rough[k] = wp.max(G.rough[k] - 1, 0)
    if z <= TOLERANCE:
        G.on[k] = -1                                    # it is taken yet


@wp.func
def judge_world_iteration(G: CoupledRods, B: RodContacts, sums: wp.vec3d, k: int):
    """What follows for world k of an iteration. sums: of its strands, greatest correction over the shortest edge, force along
    the last step, and along the correction."""
    z = sums[0]
    ahead = sums[1]
    gain = sums[2]
    if B.many:
        least = G.least[G.first[k]]
        for j in range(G.first[k], G.first[k + 1]):
            least = wp.min(least, G.least[j])
        G.body[k] = wp.float64(0.0)
        for j in range(B.first[k], B.first[k + 1]):
            G.body[k] = wp.max(G.body[k], B.left[j] / wp.min(least, B.size[j]))
            ahead += B.ahead[j]
            gain += B.gain[j]
        z = wp.max(z, G.body[k])
    begun = G.count[k] > 0
    G.count[k] = G.count[k] + 1
    if z <= TOLERANCE or not begun or not search_step_length(G, ahead, k):
        begin_newton_step(G, z, gain, k)
    if G.count[k] >= MOST:
        G.on[k] = -1


@cache
def coupled_newton_kernels(kinds: tuple[str, ...], airy: bool, module: str, closed: bool = False):
    """Kernels over strands: assemble; measure corrections; judge them (over worlds); take them. kinds: of colliders. airy: with
    air. closed: some strands are."""
    assemble = strand_assembly_func(kinds, airy, True, closed)

    @wp.kernel(module=module, enable_backward=False)
    def assemble_strands(S: RodTable, C: Colliders, Q: RodMotion, T: RodTrial, G: CoupledRods, h: wp.float64, at: int):
        k = wp.tid()
        if G.on[G.world[k]] != 1:
            return
        p = RodStep()
        p.h = h
        p.at = at
        assemble(S, C, Q, T, p, k)
        substitute_strand_backward(S, T, k)
        f = SeamForces()
        if wp.static(closed):
            if S.own[k] < S.points[k]:
                factor_seam(S, T, k)
                f, _ = close_seam(S, T, k)
        total = wp.float64(0.0)
        ahead = wp.float64(0.0)
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
            G.force[i, k] = r
            total += wp.dot(r, z)
            ahead += wp.dot(r, G.last[i, k])
        if wp.static(closed):
            if S.own[k] < S.points[k]:
                free_of_seam(S, G.r, f, k)
                free_of_seam(S, G.w, f, k)
        G.sum[k] = total
        G.ahead[k] = ahead

    @wp.kernel(module=module, enable_backward=False)
    def measure_strands(S: RodTable, T: RodTrial, G: CoupledRods):
        k = wp.tid()
        if G.on[G.world[k]] != 1:
            return
        most = wp.float64(0.0)
        gain = wp.float64(0.0)
        for i in range(S.points[k]):
            z = T.z[i, k]
            most = wp.max(most, wp.length(wp.vec3d(z[0], z[1], z[2])))
            gain += wp.dot(z, G.force[i, k])
        G.left[k] = most / G.least[k]
        G.gain[k] = gain

    @wp.kernel(module=module, enable_backward=False)
    def judge_worlds(G: CoupledRods, B: RodContacts, words: wp.array(dtype=int)):
        words[ACTIVE] = 0
        going = int(0)
        for k in range(G.on.shape[0]):
            G.on[k] = wp.max(G.on[k], 0)
            if G.on[k] == 1:
                z = wp.float64(0.0)
                ahead = wp.float64(0.0)
                gain = wp.float64(0.0)
                for j in range(G.first[k], G.first[k + 1]):
                    z = wp.max(z, G.left[j])
                    ahead += G.ahead[j]
                    gain += G.gain[j]
                judge_world_iteration(G, B, wp.vec3d(z, ahead, gain), k)
                going = going + wp.max(G.on[k], 0)
        words[GOING] = wp.min(going, 1)

    @wp.kernel(module=module, enable_backward=False)
    def take_strands(S: RodTable, T: RodTrial, G: CoupledRods):
        k = wp.tid()
        world = G.world[k]
        if G.on[world] != 0:
            a = G.scale[world]
            for i in range(S.points[k]):
                if G.back[world] > 0:
                    T.z[i, k] = G.last[i, k] * a
                    G.last[i, k] = G.last[i, k] + T.z[i, k]
                else:
                    G.last[i, k] = T.z[i, k] * a
            if G.back[world] > 0:
                a = wp.float64(1.0)
            apply_strand_corrections(S, T, a, k)

    return assemble_strands, measure_strands, judge_worlds, take_strands
