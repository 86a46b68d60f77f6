"""Forces of membranes on their points, element by element; points gather them (kernels/motion/explicit.py). Hinges, which stand
in the same tables: kernels/cloth/curvature.py.

    f_k = -G_k^T s,   s = S C + tau S dC/dt,   S = alpha^-1,   dC/dt = sum_k G_k v_k

the gradient of the energy 1/2 C S C, and damping in proportion to stiffness. C and G: kernels/cloth/constraint.py.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import MEMBRANE, Constraint, membrane_constraint
from wsim.kernels.math.marks import writes_all
from wsim.kernels.math.real import types


@cache
def force_elements(row: Constraint, real):
    """Struct of the constraints of one kind: reads only."""
    t = types(real)
    value, stiff = (t.mat22, t.vec4) if row.rows == 3 else (real, real)

    @wp.struct
    class ForceElements:
        point: wp.array(dtype=wp.types.vector(row.points, int))
        rest: wp.array(dtype=value)
        stiffness: wp.array(dtype=stiff)     # alpha^-1; of a membrane (uu, uv, shear, vv) of plane stress
        tau: wp.array(dtype=real)            # [s]; only when damped

    return ForceElements


@wp.func
def plane_stress_product(S: Any, C: Any):
    """S C of plane stress, S = [[uu, uv, 0], [uv, vv, 0], [0, 0, shear]]."""
    return wp.vector(S[0] * C[0] + S[1] * C[1], S[1] * C[0] + S[3] * C[1], S[2] * C[2])


@cache
def membrane_force_kernel(*, real, module, damped: bool):
    """Kernel over triangles: force on each of their points, f[first + 3 c + k] [N]."""
    t, Elements = types(real), force_elements(MEMBRANE, real)
    vec3 = t.vec3
    rows = wp.types.matrix((2, 3), real)

    def membrane_corner_forces(batch: Elements, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), source: int, first: int,
                               f_out: wp.array(dtype=vec3)):
        c = wp.tid()
        m = x.shape[0]
        p = batch.point[c]
        i = p[0]
        x0 = x[i]
        d0 = d[source * m + i]
        X = rows()
        V = rows()
        for k in range(2):
            j = p[k + 1]
            X[k] = (x[j] - x0) + (d[source * m + j] - d0)
            if wp.static(damped):
                V[k] = d[(2 + source) * m + j] - d[(2 + source) * m + i]
        out = first + 3 * c
        C, G1, G2 = membrane_constraint(X, batch.rest[c])
        if wp.static(damped):
            C += batch.tau[c] * (G1 * V[0] + G2 * V[1])
        s = plane_stress_product(batch.stiffness[c], C)
        f1 = -(wp.transpose(G1) * s)
        f2 = -(wp.transpose(G2) * s)
        f_out[out] = -(f1 + f2)
        f_out[out + 1] = f1
        f_out[out + 2] = f2

    name = "_".join(["corners_membrane", *(["damped"] if damped else []), t.name])
    return writes_all(wp.kernel(membrane_corner_forces, name=name, module=module, enable_backward=False))
