"""Momentum of a body, or of a group of bodies that share points, that nothing outside holds: what a Newton step y that was
not solved to the end has lost of it.

    y += -sum own (d + y - b) / sum own                own  m / g^2 [N/m], d, b, y: kernels/solver/newton.py

Forces within it sum to zero, so sum own (d - b) = 0 at the solution, which is the law of momentum. A y = own y for a
translation, all rows of A sum to own: this is the exact Newton step along translations, and Phi falls by it. Conjugate
gradients of block Jacobi, stopped at TOLERANCE, leave a part of that step: 1e-4 of the momentum of points at 1 km/s.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.math.block import BLOCK
from wsim.kernels.math.real import types
from wsim.kernels.solver.newton import newton_structs
from wsim.kernels.solver.pcg import block_sum


@cache
def momentum_part_kernel(real, module):
    """Kernel over bodies times lanes: parts of (sum own (d + y - b), sum own). spans (bodies,): the first of a body's points
    and the one behind its last."""
    t, s = types(real), newton_structs(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def momentum_parts(spans: wp.array(dtype=wp.vec2i), lanes: int, A: s.Matrix, d: vec3, b: vec3, y: vec3,
                       part_out: wp.array(dtype=wp.vec4d)):
        row = wp.tid()
        body = row // lanes
        span = spans[body]
        sum = wp.vec4d()
        for i in range(span[0] + row - body * lanes, span[1], lanes):
            p = wp.vec3d(d[i]) - wp.vec3d(b[i]) + wp.vec3d(y[i])
            sum += wp.float64(A.own[i]) * wp.vec4d(p[0], p[1], p[2], wp.float64(1.0))
        part_out[row] = sum

    return momentum_parts


@cache
def mean_translation_kernel(real, module):
    """Kernel over groups times a block of threads: the translation [m] of each group; of those that are held, none. first
    (groups + 1,): the first body of a group, among spans."""

    def mean_translation(first: wp.array(dtype=int), lanes: int, free: wp.array(dtype=int), part: wp.array(dtype=wp.vec4d),
                         shift_out: wp.array(dtype=wp.vec3d)):
        group = wp.tid() // wp.block_dim()
        lane = wp.tid() - group * wp.block_dim()
        sum = wp.vec4d()
        for row in range(first[group] * lanes + lane, first[group + 1] * lanes, wp.block_dim()):
            sum += part[row]
        x = block_sum(sum[0])
        y = block_sum(sum[1])
        z = block_sum(sum[2])
        own = block_sum(sum[3])
        if lane == 0:
            shift_out[group] = -(wp.float64(free[group]) * inverse_or_zero(own)) * wp.vec3d(x, y, z)

    return wp.kernel(mean_translation, name=f"mean_{types(real).name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=BLOCK)


@cache
def group_translation_kernel(real, module):
    """Kernel over points: y goes with its group. object (points,): group of a point."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def translate_groups(object: wp.array(dtype=int), shift: wp.array(dtype=wp.vec3d), y: wp.array(dtype=t.vec3),
                         y_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        y_out[i] = y[i] + t.vec3(shift[object[i]])

    return translate_groups
