"""Kinetic energy of points and the work on them in a frame: of gravity and loads, and what was added up on the way.

    K = 1/2 sum m v^2          W = sum m g . (x - x0)      x0 where the frame began; g with the loads on a point [m/s^2]

Work that is added up impulse by impulse is right to first order in the substep: `bounded_work` adds the part ERROR of it. (A
cube of 100 J between plates that move, 300 substeps of leapfrog a frame: it is 0.5 % short.)

Points that hard pins hold take no part: what they bear is the pin's. Sums are float64, of a fixed number of threads.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_constants

ERROR = wp.constant(wp.float64(0.01))


@wp.func
def bounded_work(work: wp.float64):
    """What work [J] that was added up impulse by impulse is at most."""
    return work + ERROR * wp.abs(work)


@cache
def point_motion_type(real):
    """Struct of points, or of the centres of bodies, now and where the frame began; given: other work on them [J], or none."""
    t = types(real)

    @wp.struct
    class PointMotions:
        x: wp.array(dtype=t.vec3)
        e: wp.array(dtype=t.vec3)              # rounding remainder of x
        v: wp.array(dtype=t.vec3)
        x0: wp.array(dtype=t.vec3)
        e0: wp.array(dtype=t.vec3)
        given: wp.array(dtype=wp.float64)

    @wp.func
    def displacement_in_frame(at: PointMotions, i: int):
        return wp.vec3d(at.x[i]) - wp.vec3d(at.x0[i]) + (wp.vec3d(at.e[i]) - wp.vec3d(at.e0[i]))

    return PointMotions, displacement_in_frame


@cache
def point_balance_kernel(real):
    """Kernel over (worlds x threads): a row of the ledger each. counted: 0 for points that another stands for, or none."""
    t, Constants, (Motions, moved) = types(real), point_constants(real), point_motion_type(real)

    def sum_point_balance(c: Constants, counted: wp.array(dtype=int), worlds: int, at: Motions, rows: wp.array(dtype=wp.vec4d)):
        threads = rows.shape[0] // worlds
        world = wp.tid() // threads
        each = at.x.shape[0] // worlds
        K = wp.float64(0.0)
        W = wp.float64(0.0)
        for i in range(world * each + wp.tid() % threads, (world + 1) * each, threads):
            counts = int(1)
            if counted:
                counts = counted[i]
            if c.w[i] > real(0.0) and counts != 0:
                m = wp.float64(1.0) / wp.float64(c.w[i])
                u = wp.vec3d(at.v[i])
                K += wp.float64(0.5) * m * wp.dot(u, u)
                W += m * wp.dot(wp.vec3d(c.gravity[c.object[i]]), moved(at, i))
        rows[wp.tid()] = wp.vec4d(K, wp.float64(0.0), wp.float64(0.0), W)

    return wp.kernel(sum_point_balance, name=f"balance_points_{t.name}", module=f"wsim_balance_{t.name}", enable_backward=False)


@wp.kernel(module="wsim_ledger", enable_backward=False)
def take_work(given: wp.array(dtype=wp.float64), worlds: int, rows: wp.array(dtype=wp.vec4d)):
    """Over (worlds x threads): a row of the ledger of the work on each world's share, which is then taken."""
    threads = rows.shape[0] // worlds
    world = wp.tid() // threads
    each = given.shape[0] // worlds
    W = wp.float64(0.0)
    for i in range(world * each + wp.tid() % threads, (world + 1) * each, threads):
        W += given[i]
        given[i] = wp.float64(0.0)
    rows[wp.tid()] = wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), bounded_work(W))
