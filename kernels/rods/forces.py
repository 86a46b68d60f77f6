"""Forces of edges and bends of a strand, with damping, and what they are made of: rates where a substep ends.

    force of a strain s    k (s + tau ds/dt),  ds/dt = grad s . v                    k: its stiffness, tau: `RodTable.tau` [s]
    stiffness              k (1 + gain),  gain = tau dv/dx = tau (1 + b) / h         b as in kernels/rods/system.py

Velocities are those where the substep ends, so that damping takes energy in steps of any length; of order 2, as steps are.
`strand_force_kernel` says what points feel, held ones too, where a frame has ended: what pins bear
(wsim/physics/rods/forces.py).
"""

from functools import cache

import warp as wp

from wsim.kernels.rods.air import cylinder_drag_force, strand_end_velocity
from wsim.kernels.rods.contact import TINY
from wsim.kernels.rods.element import bending_spin_stiffness, rod_strain_functions, spinning_damped
from wsim.kernels.rods.tables import RodMotion, RodStep, RodTable, RodTrial

_bend = rod_strain_functions()
Bend, rates, strains = _bend.Bend, _bend.rates, _bend.strains


@wp.func
def multistep_memory(Q: RodMotion, i: int, k: int):
    """1/2 of a point that carries on the step before, 0 of one that starts anew."""
    return wp.float64(0.5) * wp.float64(Q.begun[i, k])


@wp.func
def edge_spin_rate(Q: RodMotion, T: RodTrial, h: wp.float64, i: int, k: int):
    """Of an edge about itself, where a substep ends [rad/s]."""
    b = multistep_memory(Q, i, k)
    return (T.turn[i, k] * (wp.float64(1.0) + b) - Q.w[i, k][1] * b) / h


@wp.func
def damping_gain(S: RodTable, Q: RodMotion, h: wp.float64, first: int, last: int, k: int):
    """Stiffness of damping over that of elasticity between two points: tau dv/dx, where points carry on that of these."""
    found = wp.float64(0.0)
    if S.tau:
        found = S.tau[k] * (wp.float64(1.0) + wp.max(multistep_memory(Q, first, k), multistep_memory(Q, last, k))) / h
    return found


@wp.func
def edge_tension(S: RodTable, Q: RodMotion, T: RodTrial, p: RodStep, t: wp.vec3d, length: wp.float64, i: int, k: int):
    """Tension [N] of an edge of tangent t, and its stiffness along t [N/m]."""
    far = length - S.length[i, k]
    if S.tau:
        far += S.tau[k] * wp.dot(t, strand_end_velocity(Q, T, p.h, i + 1, k) - strand_end_velocity(Q, T, p.h, i, k))
    return wp.vec2d(S.A[i, k] * far, S.A[i, k] * (wp.float64(1.0) + damping_gain(S, Q, p.h, i, i + 1, k)))


@wp.func
def damped_strains(S: RodTable, Q: RodMotion, T: RodTrial, p: RodStep, f: Bend, i: int, k: int):
    """Strains less those at rest of a point, and tau times their rates."""
    s = f.s - S.rest[i, k]
    if S.tau:
        s += S.tau[k] * rates(f, strand_end_velocity(Q, T, p.h, i - 1, k), strand_end_velocity(Q, T, p.h, i, k),
                              strand_end_velocity(Q, T, p.h, i + 1, k),
                              edge_spin_rate(Q, T, p.h, i - 1, k), edge_spin_rate(Q, T, p.h, i, k))
    return s


@wp.func
def spin_stiffness_with_gain(S: RodTable, f: Bend, more: wp.float64, i: int, k: int):
    """What the angles have of a point's stiffness (`bending_spin_stiffness`); more: `damping_gain`."""
    turn = bending_spin_stiffness(f.s, S.rest[i, k])
    if more > wp.float64(0.0):
        turn = spinning_damped(turn, f.u, f.w, more)
    return turn


@cache
def strand_force_kernel(airy: bool, module: str):
    """Kernel over strands: f_out [N], (points of the longest, strands), which is 0. airy: with air."""

    @wp.kernel(module=module, enable_backward=False)
    def force_strands(S: RodTable, Q: RodMotion, f_out: wp.array2d(dtype=wp.vec3d)):
        k = wp.tid()
        tau = wp.float64(0.0)
        if S.tau:
            tau = S.tau[k]
        n = S.points[k]
        half = wp.float64(0.5)
        for i in range(n - 1):
            e = Q.x[i + 1, k] - Q.x[i, k]
            length = wp.length(e)
            t = e / wp.max(length, TINY)
            rate = wp.dot(t, Q.v[i + 1, k] - Q.v[i, k])
            f = t * (S.A[i, k] * (length - S.length[i, k] + tau * rate))
            f_out[i, k] = f_out[i, k] + f
            f_out[i + 1, k] = f_out[i + 1, k] - f
            if wp.static(airy):
                g, _ = cylinder_drag_force(t, (Q.v[i, k] + Q.v[i + 1, k]) * half - S.wind[k], S.across[i, k], S.along[i, k])
                f_out[i, k] = f_out[i, k] + g * half
                f_out[i + 1, k] = f_out[i + 1, k] + g * half
            if i > 0:
                if S.clamped[i - 1, k] + S.clamped[i, k] < 2:
                    e0 = Q.x[i, k] - Q.x[i - 1, k]
                    l0 = wp.max(wp.length(e0), TINY)
                    s = strains(e0 / l0, t, l0, wp.max(length, TINY), Q.d[i - 1, k], Q.d[i, k], Q.phi[i, k])
                    r = rates(s, Q.v[i - 1, k], Q.v[i, k], Q.v[i + 1, k], Q.w[i - 1, k][0], Q.w[i, k][0])
                    off = wp.cw_mul(s.s - S.rest[i, k] + r * tau, wp.vec3d(S.B[i, k], S.B[i, k], S.C[i, k]))
                    a = wp.transpose(s.a) * off
                    b = wp.transpose(s.b) * off
                    f_out[i - 1, k] = f_out[i - 1, k] + a
                    f_out[i, k] = f_out[i, k] - a + b
                    f_out[i + 1, k] = f_out[i + 1, k] - b
        if S.own:
            for j in range(S.points[k] - S.own[k]):      # copies of the first points
                f_out[j, k] = f_out[j, k] + f_out[S.own[k] + j, k]

    return force_strands
