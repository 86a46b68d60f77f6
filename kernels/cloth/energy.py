"""Strain and elastic energy of constraints, reduced without atomics.

Each of a fixed number of threads walks its share of the constraints in order and writes one partial result, so that
the numbers are the same from run to run; the host adds them up. Sums are kept in float64 at every precision.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import Constraint, inverse_or_zero
from wsim.kernels.cloth.terms import constraint_variant


@cache
def strain_statistics_kernel(constraint: Constraint, *, real=wp.float32, module="unique", uniform: bool = False):
    """Kernel: largest strain, sum of squared strains and energy 1/2 C alpha^-1 C [J] of each thread's share.

    Arguments: batch, x, count, worlds, d, out; launched over out, shape (threads,) of vec3d, as many threads for each world.
    Strain is C over the rest length, or C itself: an angle [rad], strains of the membrane. Hard constraints store no energy.
    """
    o = constraint_variant(constraint, real, False, False, uniform)
    return wp.kernel(_strain_statistics_function(o), name=f"statistics_{o.name}", module=module, enable_backward=False)


@wp.func
def size_row(C: Any):
    """Largest |row| of C."""
    return wp.abs(C)


@wp.func
def size_block(C: Any):
    """Largest |row| of C."""
    return wp.max(wp.max(wp.abs(C[0]), wp.abs(C[1])), wp.abs(C[2]))


@wp.func
def square_row(C: Any):
    """Sum of the squares of the rows of C."""
    return C * C


@wp.func
def square_block(C: Any):
    """Sum of the squares of the rows of C."""
    return wp.dot(C, C)


@wp.func
def energy_row(C: Any, alpha: Any):
    """1/2 C^2 / alpha [J]; 0 where alpha is 0."""
    return type(C)(0.5) * C * C * inverse_or_zero(alpha)


@wp.func
def energy_block(C: Any, alpha: Any):
    """1/2 C alpha^-1 C [J] with the compliance of plane stress; 0 where alpha is 0."""
    two = type(C[0])(2.0)
    plane = alpha[3] * C[0] * C[0] + alpha[0] * C[1] * C[1] - two * alpha[1] * C[0] * C[1]
    return (plane * inverse_or_zero(alpha[0] * alpha[3] - alpha[1] * alpha[1]) + C[2] * C[2] * inverse_or_zero(alpha[2])) / two


SIZE, SQUARE = {1: size_row, 3: size_block}, {1: square_row, 3: square_block}      # by rows of C
ENERGY = {1: energy_row, 3: energy_block}


def _strain_statistics_function(o):
    """Strain and energy of each thread's share of the constraints."""
    real, vec3, terms, place = o.t.scalar, o.t.vec3, o.terms, o.place
    size, square, energy = SIZE[o.rows], SQUARE[o.rows], ENERGY[o.rows]

    def strain_statistics(batch: o.Batch, x: wp.array(dtype=vec3), count: int, worlds: int, d: wp.array(dtype=vec3),
                          out: wp.array(dtype=wp.vec3d)):
        lanes = out.shape[0] // worlds
        world = wp.tid() // lanes
        each = count // worlds
        most = real(0.0)
        squares = wp.float64(0.0)
        stored = wp.float64(0.0)
        none = wp.static(o.value(0.0))
        rigid = wp.static(o.entry(0.0))
        for c in range(world * each + wp.tid() % lanes, (world + 1) * each, lanes):
            C, r, G, H, N = terms(batch.point[c], batch.rest[c], x, d, x, rigid, real(0.0), none)
            if wp.static(not o.unilateral):
                stored += wp.float64(energy(C, batch.alpha[place(c)]))
            if wp.static(o.unit == "m"):
                C *= inverse_or_zero(batch.rest[c])
            most = wp.max(most, size(C))
            squares += wp.float64(square(C))
        out[wp.tid()] = wp.vec3d(wp.float64(most), squares, stored)

    return strain_statistics
