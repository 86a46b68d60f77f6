"""How far a system is from its solution, in the norm of its own energy:

    left^2 = f.M^-1 f / sum over free points of own |d - b|^2 + |weight|^2 / own

f.M^-1 f is about f.A^-1 f, twice what the next Newton step would gain. Against forces (kernels/solver/line_search.py,
`schwarz_residual_kernel`) a sliver counts by the energy that is in it: its rounding, 1e-8 m times its stiffness, may be more
than all weights, and is nothing.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import inverse_or_zero
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_constants
from wsim.kernels.solver.newton import newton_structs
from wsim.kernels.solver.pcg import block_sum
from wsim.kernels.solver.schwarz.cg import THREADS, sum_group_parts


@cache
def schwarz_residual_kernel(real, module):
    """Kernel over systems times a block of threads, after a solve without iterations, which leaves gamma. group (systems + 1,),
    first (systems + 1,): groups and points of each. A system without inertia or weight: 0."""
    t, s, Constants = types(real), newton_structs(real), point_constants(real)

    def schwarz_left(c: Constants, A: s.Matrix, first: wp.array(dtype=int), group: wp.array(dtype=int),
                     gamma: wp.array(dtype=wp.float64), d: wp.array(dtype=t.vec3), b: wp.array(dtype=t.vec3),
                     part_out: wp.array(dtype=real)):
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() - body * wp.block_dim()
        above = sum_group_parts(gamma, group[body], group[body + 1], lane)
        below = wp.float64(0.0)
        for i in range(first[body] + lane, first[body + 1], wp.block_dim()):
            own = A.own[i]
            if own > real(0.0):
                below += wp.float64(own * wp.length_sq(d[i] - b[i]) + wp.length_sq(c.gravity[c.object[i]])
                                    / (c.w[i] * c.w[i] * own))
        below = block_sum(below)
        if lane == 0:
            part_out[body] = real(wp.sqrt(wp.max(above, wp.float64(0.0)) * inverse_or_zero(below)))

    return wp.kernel(schwarz_left, name=f"schwarz_left_{t.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=THREADS)
