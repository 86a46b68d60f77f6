"""Which part of a cell a source covers, and what that part knows of the source's place:

    p = 1/2 - phi / dx within 0 .. 1:    dp / dplace = n / dx  with n = grad phi, where p is between the two

A row of NUMBERS a source, of what its numbers get: smoke, heat, expansion, the strengths at the frame's start and end, velocity
(3), place (3).
"""

# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.sources import source_tables
from wsim.kernels.math.real import types

SMOKE, HEAT, EXPANSION, FIRST, LAST, VELOCITY, PLACE, NUMBERS = 0, 1, 2, 3, 4, 5, 8, 11
Numbers = wp.types.vector(NUMBERS, wp.float64)


@cache
def coverage_slope_function(dim: int, kinds: tuple[str, ...], real):
    """Function (sources, k, x, clock) -> d part / d place [1/m], of a cell about x, along the world's axes."""
    t, Sources, s = types(real), source_tables(real), moved.shape_queries(dim, kinds, real)

    @wp.func
    def coverage_slope(sources: Sources, k: int, x: t.vec3, clock: wp.array(dtype=real)):
        shapes = sources.shapes
        at = clock[1] + real(0.5) * clock[0]
        y = s.spot(shapes, x)
        phi, n, p = s.closest(shapes.of, k, y, at)
        return n / shapes.dx

    return coverage_slope


@cache
def source_coverage_function(dim: int, kinds: tuple[str, ...], real):
    """As `wsim.kernels.fluid.sources.source_reach_function`, of a strength of 0 too: there it is that a source may begin."""
    t, Sources, s = types(real), source_tables(real), moved.shape_queries(dim, kinds, real)

    @wp.func
    def source_coverage(sources: Sources, k: int, x: t.vec3, clock: wp.array(dtype=real)):
        at = clock[1] + real(0.5) * clock[0]
        both = sources.strength[k]
        phi = s.signed(sources.shapes.of, k, s.spot(sources.shapes, x), at)
        part = wp.clamp(real(0.5) - phi / sources.shapes.dx, real(0.0), real(1.0))
        return part, both[0] + (both[1] - both[0]) * at / clock[3]

    return source_coverage


@cache
def number_sum_kernel(module):
    """Kernel of one thread: adds the parts to row k of out."""

    def add_number_parts(part: wp.array(dtype=Numbers), k: int, out: wp.array(dtype=Numbers)):
        sum = out[k]
        for j in range(part.shape[0]):
            sum += part[j]
        out[k] = sum

    return wp.kernel(add_number_parts, name="collect_numbers", module=module, enable_backward=False)
