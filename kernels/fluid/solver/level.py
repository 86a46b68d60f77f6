"""The struct of an equation for a pressure on a grid, on any level of its solver: see kernels/fluid/pressure.py."""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

FREE = 2                 # in the place of `fractions`: with a free surface too (kernels/particles/surface.py)


@cache
def pressure_levels(real):
    """Struct of an equation: cells, which axes are periodic, k of inner faces, factors on it at low and high sides; with
    obstacles k of every face of an axis instead, before those factors; of a free surface that of each cell itself, to a
    pressure of 0."""
    t = types(real)

    @wp.struct
    class PressureLevel:
        n: wp.vec3i
        periodic: wp.vec3i
        k: t.vec3
        low: t.vec3                        # 0 closed, 2 open, 1 periodic
        high: t.vec3
        x: wp.array(dtype=real)
        y: wp.array(dtype=real)
        z: wp.array(dtype=real)
        own: wp.array(dtype=real)

    return PressureLevel
