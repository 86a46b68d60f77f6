"""An integrator that is no part of wsim: a two-step method. One file and one row (`ROW`), and it is checked, planned, run and
watched as those of wsim are. It carries on a part c of the step before, BDF2 a third (symbols: kernels/motion/points.py):

    a = e + c s,    v~ = v + c (v - u),    g = (1 - c) h

Order 1 for c = 1/10, with a smaller error than backward Euler, which is c = 0.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import has_adjoint, types
from wsim.kernels.motion.points import bdf2_finish_kernel, point_constants
from wsim.physics.motion.points import Multistep
from wsim.scene.integrator import Integrator

C = 0.1
ROW = Integrator("two_step", 1, "every h", g=1.0 - C, nodes=(1.0,), memory=C, met=(0.5, 2e-2), title="the two-step method",
                 motion="tests.make.rows.two_step.TwoStep")


@cache
def predict_two_step(real, module):
    """Kernel: anchor and unconstrained displacement."""
    t, Constants, c = types(real), point_constants(real), real(C)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def predict_two_step(table: Constants, e: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), s: wp.array(dtype=t.vec3),
                         u: wp.array(dtype=t.vec3), g: real,
                         a_out: wp.array(dtype=t.vec3), d_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        free = wp.where(table.w[i] > real(0.0), real(1.0), real(0.0))
        a = e[i] + c * s[i]
        a_out[i] = a
        d_out[i] = a + (free * g) * (v[i] + c * (v[i] - u[i]) + g * table.gravity[table.object[i]])

    return predict_two_step


class TwoStep(Multistep):
    def make_kernels(self, real, module: str) -> None:
        self.kernels |= {"on": predict_two_step(real, module), "end": bdf2_finish_kernel(real, module)}
