"""Adjoint of what the air carries along, kernels/fluid/advection.py: of q' = q(X), X = x - h u(x - h/2 u(x)),

    q += W(X) q',    X = q' grad q (X),    u += what X hands back along the way, from its last velocity to the first

with a bar over each. Kept between the rows around, the branch that was taken counts: the cubic, or the row that it was kept at.
Of air that comes in through a side, `lost` is what q' knows of that air.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.adjoint.grid import interpolation_adjoints
from wsim.kernels.fluid.advection import left_domain_function
from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.math.real import types


@cache
def carried_adjoints(real):
    @wp.struct
    class CarriedAdjoint:
        q: wp.array(dtype=real)        # what was carried
        by: wp.array(dtype=real)       # cotangent of what came of it
        axis: int                      # of a component; -1: of a scalar
        part: real                     # of the step

    return CarriedAdjoint


@cache
def backtrace_adjoint(dim: int, third: bool, real) -> SimpleNamespace:
    """rows(g, axis) -> shape; trace(g, u, x, h) -> X, as `wsim.kernels.fluid.advection.backtrace_function`; back(g, u, x, h, v,
    u_out): spreads the cotangent v of X [1 / cells]."""
    t, S, f, s = types(real), grid_structs(real), grid_functions(dim, real), interpolation_adjoints(dim, real)

    @wp.func
    def component_shape(g: S.Grid, axis: int):
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if axis >= 0:
            shape = f.faces(g, axis)
        return shape

    @wp.func
    def departure_of_place(g: S.Grid, u: S.Faces, x: t.vec3, h: real):
        w = h / g.dx
        k1 = f.velocity(g, u, x)
        k2 = f.velocity(g, u, x - (real(0.5) * w) * k1)
        if wp.static(third):
            k3 = f.velocity(g, u, x - (real(0.75) * w) * k2)
            return x - w * (real(2.0 / 9.0) * k1 + real(3.0 / 9.0) * k2 + real(4.0 / 9.0) * k3)
        return x - w * k2

    @wp.func
    def scatter_departure(g: S.Grid, u: S.Faces, x: t.vec3, h: real, v: t.vec3, u_out: S.Faces):
        w = h / g.dx
        half = real(0.5) * w
        k1 = f.velocity(g, u, x)
        x1 = x - half * k1
        by1 = -w * v
        if wp.static(third):
            k2 = f.velocity(g, u, x1)
            far = real(0.75) * w
            by3 = s.velocity(g, u, x - far * k2, real(-4.0 / 9.0) * w * v, u_out)
            by2 = s.velocity(g, u, x1, real(-3.0 / 9.0) * w * v - far * by3, u_out)
            by1 = real(-2.0 / 9.0) * w * v - half * by2
        else:
            by1 = -half * s.velocity(g, u, x1, by1, u_out)
        s.velocity(g, u, x, by1, u_out)

    return SimpleNamespace(rows=component_shape, trace=departure_of_place, back=scatter_departure)


@cache
def advection_adjoint_kernel(dim: int, cubic: bool, clamped: bool, third: bool, real, module):
    """Kernel over rows: adds to the cotangents u_out and q_out; lost_out: of air from outside."""
    t, S, Carried, f = types(real), grid_structs(real), carried_adjoints(real), grid_functions(dim, real)
    s, way, gone = interpolation_adjoints(dim, real), backtrace_adjoint(dim, third, real), left_domain_function(real)

    @wp.func
    def scatter_carried_value(carried: Carried, shape: wp.vec3i, periodic: wp.vec3i, at: t.vec3, v: real,
                              q_out: wp.array(dtype=real)):
        slope = t.vec3()
        inside = bool(True)
        if wp.static(cubic):
            if wp.static(clamped):
                value = f.cubic(carried.q, shape, periodic, at)
                least, most = f.around(carried.q, shape, periodic, at)
                if value < least or value > most:
                    inside = False
                    s.extreme(carried.q, shape, periodic, at, value > most, v, q_out)
            if inside:
                slope = s.cubic(carried.q, shape, periodic, at, v, q_out)
        else:
            slope = s.linear(carried.q, shape, periodic, at, v, q_out)
        return slope

    def advect_values_adjoint(g: S.Grid, u: S.Faces, carried: Carried, clock: wp.array(dtype=real), u_out: S.Faces,
                              q_out: wp.array(dtype=real), lost_out: wp.array(dtype=real)):
        c = wp.tid()
        v = carried.by[c]
        lost = real(0.0)
        if v != real(0.0):
            h = carried.part * clock[0]
            shape = way.rows(g, carried.axis)
            o = f.offset(carried.axis)
            i = f.place(c, shape)
            x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + o
            X = way.trace(g, u, x, h)
            if gone(g, X):
                lost = v
            else:
                slope = scatter_carried_value(carried, shape, g.periodic, X - o, v, q_out)
                if slope[0] != real(0.0) or slope[1] != real(0.0) or slope[2] != real(0.0):
                    way.back(g, u, x, h, v * slope, u_out)
        lost_out[c] = lost

    name = f"advect_adjoint_{'cubic' if cubic else 'linear'}{'_clamped' * clamped}{'_rk3' * third}_{f.name}"
    return wp.kernel(advect_values_adjoint, name=name, module=module, enable_backward=False)


@cache
def maccormack_adjoint_kernel(dim: int, bfecc: bool, real, module):
    """Kernel over rows: of a correction of p by (q - turned) / 2, kept within the rows around X: adds to p_out, q_out and
    turned_out. bfecc: p alone is kept."""
    t, S, Carried, f = types(real), grid_structs(real), carried_adjoints(real), grid_functions(dim, real)
    s, way, gone = interpolation_adjoints(dim, real), backtrace_adjoint(dim, False, real), left_domain_function(real)

    @wp.struct
    class CorrectedAdjoint:
        p: wp.array(dtype=real)
        turned: wp.array(dtype=real)

    def correct_values_adjoint(g: S.Grid, u: S.Faces, carried: Carried, now: CorrectedAdjoint, clock: wp.array(dtype=real),
                               p_out: wp.array(dtype=real), q_out: wp.array(dtype=real), turned_out: wp.array(dtype=real)):
        c = wp.tid()
        v = carried.by[c]
        shape = way.rows(g, carried.axis)
        o = f.offset(carried.axis)
        i = f.place(c, shape)
        X = way.trace(g, u, t.vec3(real(i[0]), real(i[1]), real(i[2])) + o, carried.part * clock[0])
        value = now.p[c]
        own = v
        half = real(0.0)
        if not gone(g, X):
            if wp.static(not bfecc):
                value += real(0.5) * (carried.q[c] - now.turned[c])
                half = real(0.5) * v
            least, most = f.around(carried.q, shape, g.periodic, X - o)
            if value < least or value > most:
                own = real(0.0)
                half = real(0.0)
                s.extreme(carried.q, shape, g.periodic, X - o, value > most, v, q_out)
        p_out[c] = own
        turned_out[c] = -half
        wp.atomic_add(q_out, c, half)

    name = f"correct_adjoint_{'bfecc' if bfecc else 'maccormack'}_{f.name}"
    return CorrectedAdjoint, wp.kernel(correct_values_adjoint, name=name, module=module, enable_backward=False)
