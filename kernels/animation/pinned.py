"""Targets of pins over a frame: points of a pin go where their prim takes them. In float64, rounded once.

    x_jk = A_k l_j + p_k - o_j        A, p    motion of the prim at moment k, as kernels/animation/motion.py samples it
                                      l       place in the prim's frame [m]        o    origin of the point's body [m]
    v_j  = A' l_j + p'                A', p'  its rate, as kernels/animation/track_rate.py has it

Behind the moments of the targets stand three more: where the frame begins, its middle and its end. The greatest speed between
these is that of a pin in the frame.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

MORE = 3                                      # moments behind those of the targets


@wp.struct
class PinnedPoints:
    column: wp.array(dtype=int)               # of the targets, of each point, (points,)
    motion: wp.array(dtype=int)               # row of A and p
    pin: wp.array(dtype=int)                  # number among the speeds
    local: wp.array(dtype=wp.vec3d)           # l
    origin: wp.array(dtype=wp.vec3d)          # o


@wp.func
def fastest_half_frame_speed(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, dt: wp.float64):
    """The greater speed [m/s] of two halves of a frame."""
    return wp.float64(2.0) / dt * wp.max(wp.length(b - a), wp.length(c - b))


@cache
def pin_target_kernel(real, module):
    """Kernel over (moments, points): targets."""
    vec3 = types(real).vec3

    def place_pin_targets(c: PinnedPoints, A: wp.array2d(dtype=wp.mat33d), p: wp.array2d(dtype=wp.vec3d),
                          target_out: wp.array2d(dtype=vec3)):
        k, j = wp.tid()
        m = c.motion[j]
        target_out[k, c.column[j]] = vec3(A[m, k] * c.local[j] + p[m, k] - c.origin[j])

    return wp.kernel(place_pin_targets, name=f"place_targets_{types(real).name}", module=module, enable_backward=False)


@cache
def pin_pull_kernel(module):
    """Kernel over points: the greatest speed of each pin [m/s], a maximum over its points."""

    def pull_points(c: PinnedPoints, A: wp.array2d(dtype=wp.mat33d), p: wp.array2d(dtype=wp.vec3d), dt: wp.float64,
                    speed_out: wp.array(dtype=wp.float64)):
        j = wp.tid()
        m = c.motion[j]
        k = A.shape[1] - MORE
        x = A[m, k] * c.local[j] + p[m, k]
        y = A[m, k + 1] * c.local[j] + p[m, k + 1]
        z = A[m, k + 2] * c.local[j] + p[m, k + 2]
        wp.atomic_max(speed_out, c.pin[j], fastest_half_frame_speed(x, y, z, dt))

    return wp.kernel(pull_points, name="pull_points", module=module, enable_backward=False)


@cache
def pin_speed_kernel(real, module):
    """Kernel over points: their velocities [m/s]. A, p: rates of motions, (motions,)."""
    vec3 = types(real).vec3

    def pin_speeds(c: PinnedPoints, A: wp.array(dtype=wp.mat33d), p: wp.array(dtype=wp.vec3d), speed_out: wp.array(dtype=vec3)):
        j = wp.tid()
        m = c.motion[j]
        speed_out[c.column[j]] = vec3(A[m] * c.local[j] + p[m])

    return wp.kernel(pin_speeds, name=f"pin_speeds_{types(real).name}", module=module, enable_backward=False)
