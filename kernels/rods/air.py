"""Drag of moving air on the edges of a strand: of long cylinders, across and along their axis.

    r = (v0 + v1) / 2 - wind,  r_n = r - (r.t) t,  r_t = (r.t) t                          of an edge of unit tangent t
    F = -1/2 rho c d L |r_n| r_n - 1/2 rho c_t pi d L |r_t| r_t                           half to either end
    -dF/dr = a |r_n| ((1 - t t^T) + r_n r_n^T / |r_n|^2) + 2 b |r_t| t t^T               a, b [kg/m]: what stands before

(Taylor 1952, Analysis of the swimming of long and narrow animals, eq. 1 to 3: each part of a cylinder's velocity by itself.)
Velocities are those where the substep ends, so that no wind can overshoot; t is that of the points where they would go on to,
x + h v, which the forces of a substep do not turn: of order 2, as steps are. Beside it the decay of all velocities, m k v.
"""

import warp as wp

from wsim.kernels.rods.tables import RodMotion, RodStep, RodTable, RodTrial

CALM = wp.constant(wp.float64(1e-12))    # [m/s] under which air is still


@wp.func
def cylinder_drag_force(t: wp.vec3d, r: wp.vec3d, a: wp.float64, b: wp.float64):
    """Force on an edge [N] against its motion through air r [m/s], and its derivative with respect to -r [kg/s]."""
    along = wp.dot(r, t)
    across = r - t * along
    size = wp.length(across)
    n = across / wp.max(size, CALM)
    T = wp.outer(t, t)
    K = (wp.identity(n=3, dtype=wp.float64) - T + wp.outer(n, n)) * (a * size)
    return -across * (a * size) - t * (b * wp.abs(along) * along), K + T * (wp.float64(2.0) * b * wp.abs(along))


@wp.func
def coasting_place(S: RodTable, Q: RodMotion, T: RodTrial, h: wp.float64, i: int, k: int):
    """Where a point is at the end of a substep if nothing acts on it [m]."""
    x = T.x[i, k]
    if S.hold[i, k] < 0:
        x = Q.x[i, k] + Q.v[i, k] * h
    return x


@wp.func
def strand_end_velocity(Q: RodMotion, T: RodTrial, h: wp.float64, i: int, k: int):
    """Velocity of a point where a substep ends [m/s]."""
    b = wp.float64(0.5) * wp.float64(Q.begun[i, k])
    return ((T.x[i, k] - Q.x[i, k]) * (wp.float64(1.0) + b) - Q.s[i, k] * b) / h


@wp.func
def air_force_on_edge(S: RodTable, Q: RodMotion, T: RodTrial, p: RodStep, i: int, k: int):
    """Half the force on an edge [N], and a quarter of its derivative with respect to the place of its points [N/m]: of one that
    carries on by BDF2 and one that does not, the smaller."""
    t = wp.normalize(coasting_place(S, Q, T, p.h, i + 1, k) - coasting_place(S, Q, T, p.h, i, k))
    r = (strand_end_velocity(Q, T, p.h, i, k) + strand_end_velocity(Q, T, p.h, i + 1, k)) * wp.float64(0.5) - S.wind[k]
    f, K = cylinder_drag_force(t, r, S.across[i, k], S.along[i, k])
    b = wp.float64(0.5) * wp.float64(wp.min(Q.begun[i, k], Q.begun[i + 1, k]))
    return f * wp.float64(0.5), K * (wp.float64(0.25) * (wp.float64(1.0) + b) / p.h)
