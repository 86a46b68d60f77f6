"""Steps of a frame, counted on the device: as many as keep the fastest air within `cfl` cells a step, evenly.

    clock   h [s] of a step, time [s] since the frame began, steps of the frame, frame [s], (4,)
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import grid_structs
from wsim.kernels.math.real import types

MOST = 1 << 24         # largest number of steps that is counted


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ float part[32];
    float most = v;
    for (unsigned k = 16; k > 0; k >>= 1) most = fmaxf(most, __shfl_xor_sync(0xffffffffu, most, k));
    if ((threadIdx.x & 31) == 0) part[threadIdx.x >> 5] = most;
    __syncthreads();
    for (unsigned k = 0; k < blockDim.x >> 5; ++k) most = fmaxf(most, part[k]);
    return most;
#else
    return v;
#endif
""")
def most_of(v: float) -> float:
    """Greatest of the threads of a block, the same in each; every one must come. Blocks of whole warps."""
    ...


@cache
def fastest_speed_kernel(dim: int, real, module):
    """Kernel over blocks of threads: the greatest |u| of all components into most_out; the order does not matter to a
    maximum. In float32, which a step that is as long as the speed allows does not feel."""
    S = grid_structs(real)

    @wp.func
    def fastest_component(u: wp.array(dtype=real), first: int, threads: int):
        most = real(0.0)
        for c in range(first, u.shape[0], threads):
            most = wp.max(most, wp.abs(u[c]))
        return most

    def fastest_face_speed(u: S.Faces, threads: int, most_out: wp.array(dtype=real)):
        c = wp.tid()
        most = wp.max(fastest_component(u.x, c, threads), fastest_component(u.y, c, threads))
        if wp.static(dim == 3):
            most = wp.max(most, fastest_component(u.z, c, threads))
        all = real(most_of(float(most)))
        if c % wp.block_dim() == 0:
            wp.atomic_max(most_out, 0, all)

    return wp.kernel(fastest_face_speed, name=f"fastest_{dim}d_{types(real).name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def frame_clock_kernel(real, module):
    """Kernel of one thread: the clock of a frame. way: distance that a step may cross [m]; least, most: bounds of the number
    of steps. steps_out: the number of steps, and the number that the speed needs without these bounds."""

    def begin_fluid_clock(speed: wp.array(dtype=real), frame: real, way: real, least: int, most: int,
                          clock_out: wp.array(dtype=real), going_out: wp.array(dtype=int), steps_out: wp.array(dtype=int)):
        wanted = real(wp.static(MOST))
        if speed[0] * frame < way * wanted:
            wanted = wp.ceil(speed[0] * frame / way)
        n = wp.clamp(wanted, real(least), real(most))
        clock_out[0] = frame / n
        clock_out[1] = real(0.0)
        clock_out[2] = n
        clock_out[3] = frame
        going_out[0] = 1
        steps_out[0] = int(n)
        steps_out[1] = int(wanted)

    return wp.kernel(begin_fluid_clock, name=f"steps_begin_{types(real).name}", module=module, enable_backward=False)


@cache
def next_step_kernel(real, module):
    """Kernel of one thread: a step is done."""

    def advance_fluid_clock(done: wp.array(dtype=int), clock_out: wp.array(dtype=real), going_out: wp.array(dtype=int)):
        k = done[0] + 1
        done[0] = k
        clock_out[1] = clock_out[0] * real(k)
        going_out[0] = int(real(k) < clock_out[2])

    return wp.kernel(advance_fluid_clock, name=f"steps_next_{types(real).name}", module=module, enable_backward=False)
