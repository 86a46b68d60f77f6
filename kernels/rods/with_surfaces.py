"""Strands among surfaces: their points go to the tables of self-contact (kernels/contact/selfcontact/pairs.py) and come back
moved.

A strand's substep is solved with the force F that surfaces gave its points in the substep before, so that tension and bending
bear it; before pairs push anew, what F does to each point by itself is taken back, and all of what they push then is the force
of the next substep:

    d' = d - k^2 F / m,   v' = v - k F / m,   a = d' - g v',       d = d' + D by contact,   v = v' + D / g

    P = m D / k^2,   F = P max(1 - |P - P0| / |P|, 0),   P0 that of the substep before: what lasts, since a blow is over by then

At rest D is what was taken back, and nothing moves; momentum is what pairs exchange, m D / g, whatever F was. What proofs add
to D moves points, and is no force. Points stand in self-contact's precision, rounded once; proofs count that (`far`).

k is h, or 2 h / 3 of a strand that carries on the step before; g likewise, of the surfaces' integrator. By BDF2 a strand's
point takes an impulse as theirs do, and what kernels/contact/selfcontact/velocity_solve.py changes of its velocity, and of the
one before, is given to it as well: else one side would go on by the memory of an impact that the other has none of. F then
follows what lasts by EASE.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.kernels.rods.forces import multistep_memory
from wsim.kernels.rods.tables import RodMotion, RodTable, mass_with_copy

REAL = wp.float64
TINY = wp.constant(wp.float64(1e-30))      # [N]
# part by which F follows what lasts, of strands that carry on the step before: at 1 a rope over a ridge rang between 0.2 and
# 0.96 of its weight for ever, its edges stretched 3 times as much; at 0.5 it still did, a little; at 0.25 it lies still
EASE = wp.constant(wp.float64(0.2))


@cache
def surface_strand_struct(real):
    """Struct of points of strands among surfaces, (points,), and what they have by (number, strand)."""
    t = types(real)

    @wp.struct
    class StrandsOnSurfaces:
        own: wp.array(dtype=int)                   # flat rows of the points in tables of strands
        first: int                                 # place of the first among surfaces' points
        g: wp.float64                              # effective step of the surfaces [s]
        frame: wp.array2d(dtype=wp.vec3d)          # origin of a strand from that of surfaces, from that of its prim [m]
        lent: wp.array(dtype=t.vec3)               # d' [m]
        pushed: wp.array(dtype=t.vec3)             # d before proofs [m]
        force: wp.array2d(dtype=wp.vec3d)          # F [N]
        before: wp.array2d(dtype=wp.vec3d)         # what was pushed in the substep before [N]
        over: wp.array2d(dtype=wp.vec3d)           # [m/s] that velocities which carry on the step before have of D too much
        settled: wp.array(dtype=t.vec3)            # [m/s] that velocities were settled by, (points,); only where g is not h
        past: wp.array(dtype=t.vec3)               # and those before

    return StrandsOnSurfaces


@cache
def surface_exchange_kernels(real, module: str):
    """Kernels over points of strands. lend: to surfaces. give: what these have moved, to displacements d [m] and F. slow: takes
    what is over off velocities. read: what velocities are read with behind leapfrog's last half kick of surfaces [m/s]."""
    vec3, Company, State = types(real).vec3, surface_strand_struct(real), point_states(real)

    @wp.func
    def strand_point_row(A: Company, j: int):
        """Number of a point in its strand, and the strand."""
        i = A.own[j] / A.force.shape[1]
        return i, A.own[j] - i * A.force.shape[1]

    @wp.kernel(module=module, enable_backward=False)
    def lend_strands(A: Company, S: RodTable, Q: RodMotion, d: wp.array2d(dtype=wp.vec3d), h: wp.float64, to: State,
                     far_out: wp.array(dtype=vec3)):
        j = wp.tid()
        i, k = strand_point_row(A, j)
        b = multistep_memory(Q, i, k)
        own = h / (REAL(1.0) + b)
        take = wp.vec3d()
        if S.hold[i, k] < 0:
            take = A.force[i, k] * (own / mass_with_copy(S, i, k))
        v = (d[i, k] * (REAL(1.0) + b) - Q.s[i, k] * b) / h - take
        way = d[i, k] - take * own
        x = Q.x[i, k] + A.frame[k, 0]
        to.x[A.first + j] = vec3(x)
        to.d[A.first + j] = vec3(way)
        to.a[A.first + j] = vec3(way - v * A.g)
        A.lent[j] = vec3(way)
        away = wp.length(Q.x[i, k] + A.frame[k, 1])
        size = wp.length(x)
        far = wp.vec3d(away, REAL(0.0), REAL(0.0))
        if size > REAL(0.0):
            far = x * (away / size)                      # |x + far| = |x| + away: what is rounded here, and in a file
        far_out[A.first + j] = vec3(far)

    @wp.kernel(module=module, enable_backward=False)
    def give_strands(A: Company, S: RodTable, Q: RodMotion, h: wp.float64, now: wp.array(dtype=vec3),
                     d: wp.array2d(dtype=wp.vec3d)):
        j = wp.tid()
        i, k = strand_point_row(A, j)
        moved = wp.vec3d(now[A.first + j] - A.lent[j])
        change = moved / A.g                                       # of velocities
        if S.hold[i, k] < 0:
            own = h / (REAL(1.0) + multistep_memory(Q, i, k))
            w = wp.float64(1.0) / mass_with_copy(S, i, k)
            share = own * own * w
            moved = moved - A.force[i, k] * share
            change = change - A.force[i, k] * (own * w)
            push = wp.vec3d(A.pushed[j] - A.lent[j]) / share
            other = wp.length(push - A.before[i, k]) / wp.max(wp.length(push), TINY)
            lasts = push * wp.max(REAL(1.0) - other, REAL(0.0))
            if own < h:
                lasts = A.force[i, k] + (lasts - A.force[i, k]) * EASE
            A.force[i, k] = lasts
            A.before[i, k] = push
        d[i, k] = d[i, k] + moved
        A.over[i, k] = moved * ((REAL(1.0) + multistep_memory(Q, i, k)) / h) - change

    @wp.kernel(module=module, enable_backward=False)
    def slow_strands(A: Company, S: RodTable, Q: RodMotion):
        i, k = strand_point_row(A, wp.tid())
        Q.v[i, k] = Q.v[i, k] - A.over[i, k]
        if A.settled and S.hold[i, k] < 0:
            Q.v[i, k] = Q.v[i, k] + wp.vec3d(A.settled[wp.tid()])
            Q.u[i, k] = Q.u[i, k] + wp.vec3d(A.past[wp.tid()])
        if S.own:
            copy = i + S.own[k]
            if copy < S.points[k]:
                Q.v[copy, k] = Q.v[i, k]
                Q.u[copy, k] = Q.u[i, k]

    @wp.kernel(module=module, enable_backward=False)
    def read_strands(A: Company, v: wp.array(dtype=vec3), kick_out: wp.array(dtype=wp.vec3d)):
        j = wp.tid()
        kick_out[A.own[j]] = wp.vec3d(v[A.first + j])

    return lend_strands, give_strands, slow_strands, read_strands


@cache
def strand_velocity_kernels(real, module: str):
    """Kernels over points of strands. before: their velocities where a substep begins, to those of surfaces; change: of
    velocities beside what they were."""
    vec3, Company = types(real).vec3, surface_strand_struct(real)

    @wp.kernel(module=module, enable_backward=False)
    def before_strands(A: Company, Q: RodMotion, v_out: wp.array(dtype=vec3)):
        j = wp.tid()
        i = A.own[j] / A.force.shape[1]
        v_out[A.first + j] = vec3(Q.v[i, A.own[j] - i * A.force.shape[1]])

    @wp.kernel(module=module, enable_backward=False)
    def change_strands(A: Company, v: wp.array(dtype=vec3), change: wp.array(dtype=vec3)):
        j = wp.tid()
        change[j] = v[A.first + j] - change[j]

    return before_strands, change_strands
