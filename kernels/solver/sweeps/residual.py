"""What coloured sweeps have left of C + a lam = 0, a = alpha / h^2 (Macklin, Mueller, Chentanez 2016, eq. 8).

XPBD keeps the momentum rows exactly, so these rows are the whole residual of the implicit step (damping's part is left
out). A row counts by what one more projection would do about it,

    |C + a lam| S / (S + a) / l,   S = sum_k w_k |G_k|^2,   l the length (area) at rest, 1 of strains and angles

so a soft hinge weighs as little as it moves. The largest is found by an atomic maximum: no order of threads changes it.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import Constraint
from wsim.kernels.cloth.terms import batch_of, plane_stress_matrix
from wsim.kernels.math.real import types


@wp.func
def compliance_share(S: Any, a: Any):
    """S / (S + a); 0 where nothing can move."""
    r = type(S)(0.0)
    if S > type(S)(0.0):
        r = S / (S + a)
    return r


@cache
def xpbd_residual_kernel(kind: Constraint, *, real, module, uniform: bool = False):
    """Kernel: raises largest[row] to the residual of every constraint. Positions are x + d."""
    t, Batch = types(real), batch_of(kind, real)
    vec3, formula, n, block = t.vec3, kind.formula, kind.points - 1, kind.rows == 3
    rows = wp.types.matrix((n, 3), real)
    multiplier = vec3 if block else real
    length = kind.unit.startswith("m")

    def xpbd_residual(batch: Batch, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), lam: wp.array(dtype=multiplier),
                      rate: real, row: int, largest: wp.array(dtype=real)):
        c = wp.tid()
        p = batch.point[c]
        i = p[0]
        X = rows()
        for k in range(n):
            X[k] = (x[p[k + 1]] - x[i]) + (d[p[k + 1]] - d[i])
        u = c
        if wp.static(uniform):
            u = 0
        r = real(0.0)
        if wp.static(block):
            C, G1, G2 = formula(X, batch.rest[c])
            G0 = -(G1 + G2)
            A = (rate * rate) * plane_stress_matrix(batch.alpha[u])
            S = (batch.w[i] * (G0 * wp.transpose(G0)) + batch.w[p[1]] * (G1 * wp.transpose(G1))
                 + batch.w[p[2]] * (G2 * wp.transpose(G2)))
            C += A * lam[c]
            for k in range(3):
                r = wp.max(r, wp.abs(C[k]) * compliance_share(S[k, k], A[k, k]))
        else:
            C, G = formula(X, batch.rest[c])
            a = (rate * rate) * batch.alpha[u]
            G0 = vec3()
            S = real(0.0)
            for k in range(n):
                G0 -= G[k]
                S += batch.w[p[k + 1]] * wp.dot(G[k], G[k])
            S += batch.w[i] * wp.dot(G0, G0)
            r = wp.abs(C + a * lam[c]) * compliance_share(S, a)
            if wp.static(length):
                r /= wp.max(wp.abs(batch.rest[c]), real(1.0e-12))
        wp.atomic_max(largest, row, r)

    name = "_".join(["residual", kind.name, *(["uniform"] if uniform else []), t.name])
    return wp.kernel(xpbd_residual, name=name, module=module, enable_backward=False)


@cache
def residual_verdict_kernel(real, module):
    """Kernel: status becomes the number (from 1) of the last row above `most`."""

    @wp.kernel(module=module, enable_backward=False)
    def judge_residuals(largest: wp.array(dtype=real), most: real, status: wp.array(dtype=int)):
        i = wp.tid()
        if largest[i] > most:
            wp.atomic_max(status, 0, i + 1)

    return judge_residuals
