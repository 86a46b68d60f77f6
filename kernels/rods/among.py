"""Strands among surfaces: their points go to the tables of self-contact (kernels/selfcontact/pairs.py) and come back moved.

A strand's substep is solved with the force F that surfaces gave its points in the substep before, so that tension and bending
bear it; before pairs push anew, what F does to each point by itself is taken back, and all of what they push then is the force
of the next substep:

    d' = d - h^2 F / m,   v' = v - h F / m,   a = d' - h v',       d = d' + D by contact,   v = v' + D / h

    P = m D / h^2,   F = P max(1 - |P - P0| / |P|, 0),   P0 that of the substep before: what lasts, since a blow is over by then

At rest D is what was taken back, and nothing moves; momentum is what pairs exchange, m D / h, whatever F was. What proofs add
to D moves points, and is no force. Points stand in self-contact's precision, rounded once; proofs count that (`far`).
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.rods.system import memory
from wsim.kernels.rods.tables import Motion, Strands

REAL = wp.float64
TINY = wp.constant(wp.float64(1e-30))      # [N]


@cache
def companies(real):
    """Struct of points of strands among surfaces, (points,), and what they have by (number, strand)."""
    t = types(real)

    @wp.struct
    class Company:
        own: wp.array(dtype=int)                   # flat rows of the points in tables of strands
        first: int                                 # place of the first among surfaces' points
        frame: wp.array2d(dtype=wp.vec3d)          # origin of a strand from that of surfaces, from that of its prim [m]
        lent: wp.array(dtype=t.vec3)               # d' [m]
        pushed: wp.array(dtype=t.vec3)             # d before proofs [m]
        force: wp.array2d(dtype=wp.vec3d)          # F [N]
        before: wp.array2d(dtype=wp.vec3d)         # what was pushed in the substep before [N]
        over: wp.array2d(dtype=wp.vec3d)           # [m/s] that velocities which carry on the step before have of D too much

    return Company


@cache
def among(real, module: str):
    """Kernels over points of strands. lend: to surfaces. give: what these have moved, to displacements d [m] and F. slow: takes
    what is over off velocities. read: what velocities are read with behind leapfrog's last half kick of surfaces [m/s]."""
    vec3, Company, State = types(real).vec3, companies(real), states(real)

    @wp.func
    def row(A: Company, j: int):
        """Number of a point in its strand, and the strand."""
        i = A.own[j] / A.force.shape[1]
        return i, A.own[j] - i * A.force.shape[1]

    @wp.kernel(module=module, enable_backward=False)
    def lend_strands(A: Company, S: Strands, Q: Motion, d: wp.array2d(dtype=wp.vec3d), h: wp.float64, to: State,
                     far_out: wp.array(dtype=vec3)):
        j = wp.tid()
        i, k = row(A, j)
        b = memory(Q, i, k)
        take = wp.vec3d()
        if S.hold[i, k] < 0:
            take = A.force[i, k] * (h / S.m[i, k])
        v = (d[i, k] * (REAL(1.0) + b) - Q.s[i, k] * b) / h - take
        way = d[i, k] - take * h
        x = Q.x[i, k] + A.frame[k, 0]
        to.x[A.first + j] = vec3(x)
        to.d[A.first + j] = vec3(way)
        to.a[A.first + j] = vec3(way - v * h)
        A.lent[j] = vec3(way)
        away = wp.length(Q.x[i, k] + A.frame[k, 1])
        size = wp.length(x)
        far = wp.vec3d(away, REAL(0.0), REAL(0.0))
        if size > REAL(0.0):
            far = x * (away / size)                      # |x + far| = |x| + away: what is rounded here, and in a file
        far_out[A.first + j] = vec3(far)

    @wp.kernel(module=module, enable_backward=False)
    def give_strands(A: Company, S: Strands, Q: Motion, h: wp.float64, now: wp.array(dtype=vec3),
                     d: wp.array2d(dtype=wp.vec3d)):
        j = wp.tid()
        i, k = row(A, j)
        moved = wp.vec3d(now[A.first + j] - A.lent[j])
        if S.hold[i, k] < 0:
            share = h * h / S.m[i, k]
            moved = moved - A.force[i, k] * share
            push = wp.vec3d(A.pushed[j] - A.lent[j]) / share
            change = wp.length(push - A.before[i, k]) / wp.max(wp.length(push), TINY)
            A.force[i, k] = push * wp.max(REAL(1.0) - change, REAL(0.0))
            A.before[i, k] = push
        d[i, k] = d[i, k] + moved
        A.over[i, k] = moved * (memory(Q, i, k) / h)

    @wp.kernel(module=module, enable_backward=False)
    def slow_strands(A: Company, Q: Motion):
        i, k = row(A, wp.tid())
        Q.v[i, k] = Q.v[i, k] - A.over[i, k]

    @wp.kernel(module=module, enable_backward=False)
    def read_strands(A: Company, v: wp.array(dtype=vec3), kick_out: wp.array(dtype=wp.vec3d)):
        j = wp.tid()
        kick_out[A.own[j]] = wp.vec3d(v[A.first + j])

    return lend_strands, give_strands, slow_strands, read_strands
