"""Pressure p [Pa] in a closed surface of triangles (a, b, c), counter-clockwise from outside: energy -p V, forces p dV/dx.

    V = sum a.(b x c) / 6            f_a = f_b = f_c = p (b - a) x (c - a) / 6 = p A n / 3

The three corners of a triangle share the force on its area (exact for flat triangles); around each point of a closed surface
that is the same as b x c / 6. The forces of a closed surface sum to nothing, and turn nothing. Corners are taken relative to a
point o of the body, so that far from the origin nothing is lost.

-p d^2V/dx^2 has no sign, and is left out of the matrix of Newton's method: its steps stay right, for they come from the forces,
but the error falls by p / E a step and no faster. The line search knows all of -p V, as a polynomial of the step t:

    6 V(t) = 6 V(0) + t (Y.(b x c) + ..) + t^2 (a.(Y_b x Y_c) + ..) + t^3 Y_a.(Y_b x Y_c)
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.hessian import elements_of
from wsim.kernels.math.marks import writes_all
from wsim.kernels.math.real import types
from wsim.kernels.solver.line_search import LineSearchTrial

D = types(wp.float64)


@cache
def pressure_tables(real):
    """Struct of the triangles: reads only."""

    @wp.struct
    class Triangles:
        point: wp.array(dtype=wp.vec4i)          # a, b, c and o, (m,)
        pressure: wp.array(dtype=real)           # [Pa], (m,)
        force: int                               # place of the first corner's force

    return Triangles


@cache
def corner_pressure(real):
    """Function: p A n / 3 [N] of triangle c at x + d."""
    t, Triangles = types(real), pressure_tables(real)

    @wp.func
    def pressure_corner_force(tri: Triangles, c: int, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3)):
        p = tri.point[c]
        u = (x[p[1]] - x[p[0]]) + (d[p[1]] - d[p[0]])
        v = (x[p[2]] - x[p[0]]) + (d[p[2]] - d[p[0]])
        return (tri.pressure[c] / real(6.0)) * wp.cross(u, v)

    return pressure_corner_force


@cache
def inflation_force_kernel(real, module):
    """Kernel over triangles: forces [N] of corner k of triangle c at `force` + 3 c + k."""
    t, Triangles, corner = types(real), pressure_tables(real), corner_pressure(real)
    vec3 = wp.array(dtype=t.vec3)

    def inflation_forces(tri: Triangles, x: vec3, d: vec3, f_out: vec3):
        c = wp.tid()
        f = corner(tri, c, x, d)
        for k in range(3):
            f_out[tri.force + 3 * c + k] = f

    return writes_all(wp.kernel(inflation_forces, name=f"pressure_forces_{t.name}", module=module, enable_backward=False))


@cache
def inflation_newton_kernel(real, module):
    """The same for Newton's method, with the arguments of kernels/soft/fem.py: a, q, rate are not read, no block is written."""
    t, Triangles, corner, Elements = types(real), pressure_tables(real), corner_pressure(real), elements_of(real)
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    def linearise_inflation(tri: Triangles, x: vec3, d: vec3, a: vec3, q: quat, rate: real, q_out: quat, out: Elements):
        c = wp.tid()
        f = corner(tri, c, x, d)
        for k in range(3):
            out.force[tri.force + 3 * c + k] = f

    return wp.kernel(linearise_inflation, name=f"pressure_linearise_{t.name}", module=module, enable_backward=False)


@wp.func
def scalar_triple_product(a: D.vec3, b: D.vec3, c: D.vec3):
    return wp.dot(a, wp.cross(b, c))


@cache
def inflation_energy_kernel(real, module):
    """Kernel over bodies times lanes: adds the change of -p V along y to a `LineSearchTrial`, in float64; arguments of
    kernels/soft/fem.py."""
    t, Triangles = types(real), pressure_tables(real)
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    @wp.func
    def from_o(x: vec3, i: int, o: int):
        return D.vec3(x[i]) - D.vec3(x[o])

    def inflation_energy_change(trial: LineSearchTrial, tri: Triangles, x: vec3, d: vec3, a: vec3, y: vec3, q: quat,
                                rate: wp.float64):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        for c in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            p = tri.point[c]
            X0 = from_o(x, p[0], p[3]) + from_o(d, p[0], p[3])
            X1 = from_o(x, p[1], p[3]) + from_o(d, p[1], p[3])
            X2 = from_o(x, p[2], p[3]) + from_o(d, p[2], p[3])
            Y0 = from_o(y, p[0], p[3])
            Y1 = from_o(y, p[1], p[3])
            Y2 = from_o(y, p[2], p[3])
            one = scalar_triple_product(Y0, X1, X2) + scalar_triple_product(Y1, X2, X0) + scalar_triple_product(Y2, X0, X1)
            two = scalar_triple_product(X0, Y1, Y2) + scalar_triple_product(X1, Y2, Y0) + scalar_triple_product(X2, Y0, Y1)
            three = scalar_triple_product(Y0, Y1, Y2)
            s = -wp.float64(tri.pressure[c]) / wp.float64(6.0)
            part = wp.float64(1.0) / wp.float64(1 << trial.begin)
            for k in range(trial.begin, trial.end):
                trial.change[row, k] = trial.change[row, k] + s * part * (one + part * (two + part * three))
                part *= wp.float64(0.5)

    return wp.kernel(inflation_energy_change, name=f"pressure_change_{t.name}", module=module, enable_backward=False)
