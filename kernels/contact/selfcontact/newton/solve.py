"""Conjugate gradients and the line search of Newton steps whose bodies touch: all of a world are one system.

kernels/solver/pcg.py with the product of contact rows (kernels/contact/selfcontact/newton/law.py) beside that of elasticity.
Where nothing is near, each body stays a system of its own.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact.newton.law import GOING, STEPS, WRONG, law_type
from wsim.kernels.contact.selfcontact.pairs import SCALE
from wsim.kernels.math.real import types
from wsim.kernels.solver import pcg
from wsim.kernels.solver.newton import newton_structs


@cache
def joined_product_kernel(real, module, springs: bool, elements: bool):
    """Kernel over chunks times a block of threads: as `joined_product_kernel` of `pcg.pcg_chunk_kernels`, with the sums of
    rows, which it empties."""
    s, Vectors, Laws, t = newton_structs(real), pcg.pcg_vectors(real), law_type(real), types(real)
    product = pcg.pcg_point_functions(real, springs, elements).product

    def multiply_joined(c: pcg.Chunks, rows: s.Rows, A: s.Matrix, law: Laws, side: int, v: Vectors):
        chunk = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        if wp.tid() == 0:
            c.going[0] = 0
        done = c.done[side, c.body[chunk]] != 0
        delta = wp.float64(0.0)
        for i in range(c.first[chunk] + lane, c.first[chunk + 1], wp.block_dim()):
            if law.scale[i] > real(0.0):
                if not done:
                    part = real(1.0) / (real(SCALE) * law.scale[i])
                    w = product(i, rows, A, v.z)
                    w += part * t.vec3(real(law.sum[3 * i]), real(law.sum[3 * i + 1]), real(law.sum[3 * i + 2]))
                    v.w[i] = w
                    delta += wp.float64(wp.dot(v.z[i], w))
                for k in range(3):
                    law.sum[3 * i + k] = wp.int64(0)
            elif not done:
                v.w[i] = t.vec3()
        if not done:
            c.delta[chunk] = pcg.block_sum(delta)

    return wp.kernel(multiply_joined, name=f"multiply_joined_{pcg.pcg_point_functions(real, springs, elements).name}",
                     module=module, enable_backward=False, grid_stride=False)


@cache
def step_energy_kernel(real, module):
    """Kernel over chunks times a block of threads: parts of sum own |y|^2."""
    s, t = newton_structs(real), types(real)

    def measure_way(c: pcg.Chunks, A: s.Matrix, y: wp.array(dtype=t.vec3)):
        chunk = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        sum = wp.float64(0.0)
        for i in range(c.first[chunk] + lane, c.first[chunk + 1], wp.block_dim()):
            sum += wp.float64(A.own[i] * wp.dot(y[i], y[i]))
        c.delta[chunk] = pcg.block_sum(sum)

    return wp.kernel(measure_way, module=module, enable_backward=False, grid_stride=False)


@cache
def energy_scale_kernel(real, module):
    """Kernel over worlds: what rows measure changes of energy by: the sum of `step_energy_kernel`."""
    Laws = law_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def compare_way(c: pcg.Chunks, law: Laws):
        world = wp.tid()
        sum = wp.float64(0.0)
        for chunk in range(c.own[world], c.own[world + 1]):
            sum += c.delta[chunk]
        law.unit[world] = sum

    return compare_way


@cache
def share_solution_kernel(real, module):
    """Kernel over systems: drop and iterations of the world, and what its rows measure changes of energy by."""
    Laws = law_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def spread_solution(systems: int, drop: wp.array(dtype=wp.float64), count: wp.array(dtype=int), law: Laws,
                        drop_out: wp.array(dtype=wp.float64), count_out: wp.array(dtype=int)):
        i = wp.tid()
        world = i // systems
        drop_out[i] = drop[world]
        count_out[i] = count_out[i] + count[world]
        if i == world * systems:
            law.unit[world] = drop[world]

    return spread_solution


@cache
def count_newton_kernel(real, module):
    """Kernel of one thread: counts further steps, which go on for a residual above `bound` too, and ends them behind `most`.
    steps 0: they begin."""
    @wp.kernel(module=module, enable_backward=False)
    def count_steps(residual: wp.array(dtype=real), bound: real, steps: int, most: int, words: wp.array(dtype=int)):
        going = words[WRONG]
        for i in range(residual.shape[0]):
            if residual[i] > bound:
                going = 1
        words[STEPS] = wp.where(steps > 0, words[STEPS] + steps, 0)
        words[GOING] = wp.where(words[STEPS] < most, going, 0)

    return count_steps


@cache
def share_step_kernel(module):
    """Kernel over systems: the step of the world."""
    @wp.kernel(module=module, enable_backward=False)
    def share_step(systems: int, step: wp.array(dtype=wp.float64), step_out: wp.array(dtype=wp.float64)):
        i = wp.tid()
        step_out[i] = step[i // systems]

    return share_step
