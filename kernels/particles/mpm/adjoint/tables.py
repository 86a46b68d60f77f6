"""Struct of the adjoint of the material point method: cotangents of particles, and what numbers of materials get of each.

Cotangents of symmetric tensors are kept as those of the six numbers that a particle has: an entry beside the diagonal stands
for two. Sums over materials are taken on the host, in float64 and in one order.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.tables import NUMBERS


@cache
def cotangent_rows(real):
    """Struct CotangentRows: one row a particle."""
    t = types(real)
    vec8 = wp.types.vector(NUMBERS, wp.float64)

    @wp.struct
    class CotangentRows:
        o: wp.array(dtype=t.vec3)          # of fields of PointRows; within a step of velocity and gradient as nodes give them
        v: wp.array(dtype=t.vec3)
        C: wp.array(dtype=t.mat33)
        b: wp.array(dtype=t.vec3)
        s: wp.array(dtype=t.vec3)
        T: wp.array(dtype=t.vec3)
        S: wp.array(dtype=t.vec3)
        q: wp.array(dtype=real)
        numbers: wp.array(dtype=vec8)      # of numbers of the law, summed over steps
        mass: wp.array(dtype=wp.float64)   # [1/kg]
        g: wp.array(dtype=wp.vec3d)        # gravity [s^2/m]

    return CotangentRows
