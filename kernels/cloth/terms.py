"""What a projection of XPBD (kernels/solver/xpbd.py) is made of: tables of constraints, and C, r and G of one of them.

Symbols as there. Variants read only what they need.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.cloth.constraint import Constraint, distance_constraint, inverse_or_zero, membrane_constraint
from wsim.kernels.math.real import types


@cache
def constraint_batches(points: int, value, compliance, scalar):
    """Struct of a constraint's tables. No stage writes them, so gradients and the overwrite detector stay right."""

    @wp.struct
    class ConstraintBatch:
        point: wp.array(dtype=wp.types.vector(points, int))  # points of each constraint, (m,)
        rest: wp.array(dtype=value)           # rest value: a length, an angle, or Dm^-1, (m,)
        alpha: wp.array(dtype=compliance)     # compliance, (m,), or (1,) for all; unused by a unilateral constraint
        tau: wp.array(dtype=scalar)           # relaxation time [s], (m,) or (1,); only when damped
        left: wp.array(dtype=scalar)          # what float32 has left of rest lengths [m], (m,); only where `exact`
        w: wp.array(dtype=scalar)             # inverse masses [1/kg] of all points; 0 pins

    return ConstraintBatch


def batch_of(row: Constraint, real):
    """Struct for constraints of a kind. The membrane's alpha has its four different entries: (uu, uv, shear, vv)."""
    t = types(real)
    return constraint_batches(row.points, t.mat22, t.vec4, real) if row.rows == 3 else constraint_batches(row.points, real,
                                                                                                          real, real)


def constraint_variant(row: Constraint, real, multipliers, damped, uniform, stored: bool = False,
                       exact: bool = False) -> SimpleNamespace:
    """What the makers of kernels need: the constraint, the types, the flags, a name, and the function `terms`.

    stored   dlam is left in lam_out by constraints without a multiplier too
    exact    of float32: lengths are compared as kernels/math/compensated.py does, and the strains of a membrane taken in
             float64
    """
    t = types(real)
    flags = {"lam": multipliers and not row.unilateral, "damped": damped and not row.unilateral, "uniform": uniform}
    name = "_".join([row.name, *(word for word, on in flags.items() if on), t.name])
    exact = (stored or exact) and row.formula in (distance_constraint, membrane_constraint) and real is wp.float32
    o = SimpleNamespace(**vars(row) | {"name": name}, **flags, stored=stored, exact=exact, t=t, Batch=batch_of(row, real))
    o.value, o.entry = (t.vec3, t.vec4) if row.rows == 3 else (real, real)        # of lam and C, of alpha
    o.place = first_entry if uniform else own_entry
    o.ids = wp.types.vector(row.points, int)
    o.terms = _terms_block(o) if row.rows == 3 else _terms_row(o)
    return o


@wp.func
def own_entry(c: int):
    """Place of constraint c in a table with an entry for each."""
    return c


@wp.func
def first_entry(c: int):
    """Place of constraint c in a table with one entry for all."""
    return 0


@wp.func
def plane_stress_matrix(alpha: Any):
    """Compliance matrix [[uu, uv, 0], [uv, vv, 0], [0, 0, shear]]; alpha = (uu, uv, shear, vv)."""
    o = type(alpha[0])(0.0)
    return wp.matrix_from_rows(wp.vector(alpha[0], alpha[1], o), wp.vector(alpha[1], alpha[3], o),
                               wp.vector(o, o, alpha[2]))


def rest_length_function(o):
    """Function: rest value of constraint c; where `exact`, and what float32 has left of it."""
    vec2, read_rest = o.t.vec2, o.read_rest

    @wp.func
    def read_rest_length(batch: o.Batch, c: int):
        return read_rest(batch.rest, c)

    @wp.func
    def read_rest_remainder(batch: o.Batch, c: int):
        return vec2(read_rest(batch.rest, c), batch.left[c])

    return read_rest_remainder if o.exact else read_rest_length


def _terms_row(o):
    """C, r, G of the first point, G of the others (rows) and d of all (rows) for a constraint with one row."""
    real, vec3, n, formula, kept = o.t.scalar, o.t.vec3, o.points - 1, o.formula, o.t.vec2 if o.exact else o.t.scalar
    rows, displacements, squared_length_gain = wp.types.matrix((n, 3), real), wp.types.matrix((n + 1, 3), real), None
    if o.exact:
        from wsim.kernels.math.compensated import squared_length_gain

    @wp.func
    def terms(p: o.ids, rest: kept, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), a: wp.array(dtype=vec3),
              alpha: real, gamma: real, lam: real):
        i = p[0]
        x0 = x[i]
        N = displacements()
        N[0] = d[i]
        X = rows()
        for k in range(n):
            j = p[k + 1]
            N[k + 1] = d[j]
            X[k] = (x[j] - x0) + (N[k + 1] - N[0])
        if wp.static(o.exact):
            C, G = formula(X, rest[0])
            C = squared_length_gain(x0, x[p[1]], N[0], N[1], rest[0], rest[1]) * inverse_or_zero(wp.length(X[0]) + rest[0])
        else:
            C, G = formula(X, rest)
        if wp.static(o.unilateral):
            C = wp.max(C, real(0.0))
        r = -C
        if wp.static(o.lam):
            r -= alpha * lam
        if wp.static(o.damped):
            a0 = a[i]
            for k in range(n):
                r -= gamma * wp.dot(G[k], (N[k + 1] - N[0]) - (a[p[k + 1]] - a0))
        G0 = vec3()
        for k in range(n):
            G0 -= G[k]
        return C, r, G0, G, N

    return terms


def _terms_block(o):
    """C, r, G1 and G2 (rows: those of C) and d of all points (rows) of a constraint with three rows on three points."""
    real, vec3, formula, mat22 = o.t.scalar, o.t.vec3, o.formula, o.t.mat22

    @wp.func
    def terms(p: o.ids, rest: mat22, x: wp.array(dtype=vec3), d: wp.array(dtype=vec3), a: wp.array(dtype=vec3),
              alpha: o.t.vec4, gamma: real, lam: vec3):
        i = p[0]
        j = p[1]
        k = p[2]
        x0 = x[i]
        d0 = d[i]
        d1 = d[j]
        d2 = d[k]
        D1 = d1 - d0
        D2 = d2 - d0
        C, G1, G2 = formula(wp.matrix_from_rows((x[j] - x0) + D1, (x[k] - x0) + D2), rest)
        if wp.static(o.exact):
            at = wp.vec3d(x0)
            exactly, _G1, _G2 = formula(wp.matrix_from_rows((wp.vec3d(x[j]) - at) + wp.vec3d(D1),
                                                            (wp.vec3d(x[k]) - at) + wp.vec3d(D2)), wp.mat22d(rest))
            C = vec3(exactly)
        r = -C
        if wp.static(o.lam):
            r -= plane_stress_matrix(alpha) * lam
        if wp.static(o.damped):
            a0 = a[i]
            r -= gamma * (G1 * (D1 - (a[j] - a0)) + G2 * (D2 - (a[k] - a0)))
        return C, r, G1, G2, wp.matrix_from_rows(d0, d1, d2)

    return terms
