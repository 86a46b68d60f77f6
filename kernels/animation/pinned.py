"""Targets of pins over a frame: points of a pin go where their prim takes them. In float64, rounded once.

    x_jk = A_k l_j + p_k - o_j        A, p    motion of the prim at time k, as kernels/animation/motion.py samples it
                                      l       place in the prim's frame [m]        o    origin of the point's body [m]
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types


@wp.struct
class Pinned:
    column: wp.array(dtype=int)               # of the targets, of each point, (points,)
    motion: wp.array(dtype=int)
    local: wp.array(dtype=wp.vec3d)           # l
    origin: wp.array(dtype=wp.vec3d)          # o


@cache
def place(real, module):
    """Kernel over (times, points): targets of all times behind the first."""
    vec3 = types(real).vec3

    def place(c: Pinned, A: wp.array2d(dtype=wp.mat33d), p: wp.array2d(dtype=wp.vec3d), target_out: wp.array2d(dtype=vec3)):
        k, j = wp.tid()
        m = c.motion[j]
        target_out[k, c.column[j]] = vec3(A[m, k + 1] * c.local[j] + p[m, k + 1] - c.origin[j])

    return wp.kernel(place, name=f"place_targets_{types(real).name}", module=module, enable_backward=False)
