"""Steps of a frame, counted on the device: as many as keep the fastest air within `cfl` cells a step, evenly.

    clock   h [s] of a step, time [s] since the frame began, steps of the frame, frame [s], (4,)
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types


@cache
def fastest(real, module):
    """Kernel over threads: the greatest |u| of a component into most_out; the order does not matter to a maximum."""

    def fastest(u: wp.array(dtype=real), threads: int, most_out: wp.array(dtype=real)):
        most = real(0.0)
        for c in range(wp.tid(), u.shape[0], threads):
            most = wp.max(most, wp.abs(u[c]))
        if most > most_out[0]:
            wp.atomic_max(most_out, 0, most)

    return wp.kernel(fastest, name=f"fastest_{types(real).name}", module=module, enable_backward=False)


@cache
def begin(real, module):
    """Kernel of one thread: the clock of a frame. way: cells of width dx that a step may cross; the count is kept in
    least .. most."""

    def begin(speed: wp.array(dtype=real), frame: real, way: real, least: int, most: int, clock_out: wp.array(dtype=real),
              going_out: wp.array(dtype=int), steps_out: wp.array(dtype=int)):
        n = real(most)
        if speed[0] * frame < way * real(most):
            n = wp.ceil(speed[0] * frame / way)
        n = wp.clamp(n, real(least), real(most))
        clock_out[0] = frame / n
        clock_out[1] = real(0.0)
        clock_out[2] = n
        clock_out[3] = frame
        going_out[0] = 1
        steps_out[0] = int(n)

    return wp.kernel(begin, name=f"steps_begin_{types(real).name}", module=module, enable_backward=False)


@cache
def next(real, module):
    """Kernel of one thread: a step is done."""

    def next(done: wp.array(dtype=int), clock_out: wp.array(dtype=real), going_out: wp.array(dtype=int)):
        k = done[0] + 1
        done[0] = k
        clock_out[1] = clock_out[0] * real(k)
        going_out[0] = int(real(k) < clock_out[2])

    return wp.kernel(next, name=f"steps_next_{types(real).name}", module=module, enable_backward=False)
