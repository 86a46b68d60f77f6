"""Mean relative velocity of the contact points of a manifold over a substep, while the bodies turn.

    u = v_a + omega_a x r_a - (v_b + omega_b x r_b)          at the start of the substep
    u + bend                                                 mean over the substep

A point that turns with its body, r = R c, goes along an arc: (R(h) - 1) r / h differs from omega x r by

    h/2 omega x (omega x r) + h^2/6 omega x (omega x (omega x r))

With it a box stays in place on a turntable, and a body that tips over a corner keeps the corner in place. The contact point of
a rim, -rim e, does not turn with its body: e follows the axis z, z' = omega x z. The material point there has the velocity
omega x r of the middle of the substep. The angular velocity of a free body changes too, as L is constant:

    omega' = -I^-1 (omega x L)

With all three terms a coin that rolls in a circle, or an Euler's disc, keeps its energy to second order in h. Without the last
two it gains or loses energy to first order, and a disc at 10 degrees lay flat within a second at h = 1/240 s.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type, rim_axis_functions
from wsim.kernels.rigid.impulse import impulse_formulas

TURNS = wp.constant(1.0e-4)            # [rad] in a substep; below it, and above 1 rad, points are taken to go straight


@cache
def mean_velocity_funcs(real):
    """Functions (bends, bend). bends: True if the bodies turn enough in a substep. bend: mean velocity of point j of manifold m
    over the substep, minus the velocity at its start [m/s], see the head of the file."""
    t, Rig, (axis, across) = types(real), rig_type(real), rim_axis_functions(real)
    Two = impulse_formulas(real)[0]

    @wp.func
    def of_turn(o: t.vec3, arm: t.vec3, h: real):
        inward = wp.cross(o, wp.cross(o, arm))
        return (real(0.5) * h) * inward + (h * h / real(6.0)) * wp.cross(o, inward)

    @wp.func
    def rim_velocity_change(shape: int, o: t.vec3, R: t.mat33, n: t.vec3, h: real, rig: Rig):
        """omega x (e' - e), e' in the middle of the substep; 0 where the shape tips to the other side of its rim."""
        z = axis(shape, R, rig)
        e = across(z, n)
        later = across(wp.normalize(z + (real(0.5) * h) * wp.cross(o, z)), n)
        moved = t.vec3()
        if wp.dot(e, later) > real(0.0):
            moved = wp.cross(o, later - e)
        return moved

    @wp.func
    def of_spin(f: int, o: t.vec3, S: t.mat33, T: t.vec3, arm: t.vec3, h: real, rig: Rig):
        """h/2 omega' x r; a collider turns as it is told."""
        more = t.vec3()
        if f < rig.b.w.shape[0]:
            more = (real(-0.5) * h) * wp.cross(S * wp.cross(o, rig.now.L[f] + T), arm)
        return more

    @wp.func
    def bodies_turn_enough(two: Two, h: real):
        square = h * h * wp.max(wp.dot(two.o_a, two.o_a), wp.dot(two.o_b, two.o_b))
        return square > real(TURNS) * real(TURNS) and square < real(1.0)

    @standalone_function
    @wp.func(inline=False)
    def mean_velocity_change(two: Two, m: int, j: int, h: real, rig: Rig):
        n = rig.c.n[m]
        R_a = rig.work.turn[two.f]
        R_b = rig.work.turn[two.g]
        u = of_turn(two.o_a, R_a * rig.c.core_a[j], h) - of_turn(two.o_b, R_b * rig.c.core_b[j], h)
        u += of_spin(two.f, two.o_a, two.S_a, two.T_a, rig.work.r_a[j], h, rig)
        u -= of_spin(two.g, two.o_b, two.S_b, two.T_b, rig.work.r_b[j], h, rig)
        if rig.c.rim[j][0] > real(0.0):
            u -= rig.c.rim[j][0] * rim_velocity_change(rig.c.a[m], two.o_a, R_a, n, h, rig)
        if rig.c.rim[j][1] > real(0.0):
            u -= rig.c.rim[j][1] * rim_velocity_change(rig.c.b[m], two.o_b, R_b, n, h, rig)
        return u

    return bodies_turn_enough, mean_velocity_change
