"""Viscosity by backward Euler, (I - a L) u' = u with a = nu h / dx^2: stable for any h, order 1 in time, 2 in space.

L is the sum of differences to the neighbours on the faces of an axis. Across a closed side, and inside obstacles, u is known
and stays. Beside a wall that is not slippery, along which u runs, stands 2 w - u, w being the wall's velocity; beside any
other, u. The change that is solved for is driven by the wall's friction to order 2, where asked for: there stands
(8 w - 6 u + u') / 3 beside the wall, a parabola through w, u and the next u', and when nothing changes any more that holds.
Solved for the change d = u' - u: (I - a L) d = a L u, by conjugate gradients (kernels/fluid/conjugate.py).
"""

# ruff: noqa: UP018
# bool(False) makes a variable of what would be a constant.

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.forces import VISCOSITY
from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def viscosity_functions(dim: int, axis: int, fractions: bool, slip: bool, real) -> SimpleNamespace:
    """Functions: fixed(g, low, high, o, i) whether u of a face is known; spread(g, low, high, o, u, i, walls) -> (L u)_i, with
    the velocities of walls (walls 1; 2: to order 2) or walls at rest (0)."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    @wp.func
    def face_is_fixed(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), i: wp.vec3i):
        known = bool(False)
        if i[wp.static(axis)] == 0 and low[wp.static(axis)] == real(0.0):
            known = True
        if i[wp.static(axis)] == g.n[wp.static(axis)] and high[wp.static(axis)] == real(0.0):
            known = True
        if wp.static(fractions):
            if o[flat_cell_index(i, f.faces(g, wp.static(axis)))] == real(0.0):
                known = True
        return known

    @wp.func
    def viscous_laplacian(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), u: wp.array(dtype=real), i: wp.vec3i,
                          walls: real):
        shape = f.faces(g, wp.static(axis))
        own = u[flat_cell_index(i, shape)]
        sum = real(0.0)
        for b in range(wp.static(dim)):
            for side in range(2):
                j = wp.vec3i(i[0], i[1], i[2])
                j[b] = i[b] + 2 * side - 1
                if j[b] < 0 or j[b] >= shape[b]:
                    if g.periodic[b] != 0:
                        j[b] = (j[b] + shape[b]) % shape[b]
                        sum += u[flat_cell_index(j, shape)] - own
                    elif wp.static(not slip):
                        kind = low[b]
                        if side == 1:
                            kind = high[b]
                        if kind == real(0.0) and b != wp.static(axis):
                            v = g.air[1 + 2 * b + side]
                            if walls > real(1.0):
                                j[b] = i[b] + 1 - 2 * side
                                sum += (real(8.0) * v[wp.static(axis)] - real(9.0) * own
                                        + u[flat_cell_index(j, shape)]) / real(3.0)
                            else:
                                sum += real(2.0) * (walls * v[wp.static(axis)] - own)
                else:
                    c = flat_cell_index(j, shape)
                    if wp.static(fractions and slip):
                        if o[c] > real(0.0):
                            sum += u[c] - own
                    else:
                        sum += u[c] - own
        return sum

    return SimpleNamespace(fixed=face_is_fixed, spread=viscous_laplacian,
                           name=f"{'xyz'[axis]}{'_fractions' * fractions}{'_slip' * slip}_{dim}d_{t.name}")


@cache
def viscosity_start_kernel(dim: int, axis: int, fractions: bool, slip: bool, real, module, second: bool = False):
    """Kernel over blocks of threads: r_out = a L u, parts of its square. second: friction of walls to order 2."""
    t, S, f, s = (types(real), grid_structs(real), grid_functions(dim, real),
                  viscosity_functions(dim, axis, fractions, slip, real))
    walls = 2.0 if second else 1.0

    def viscosity_first_residual(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), u: wp.array(dtype=real),
                                 scale: wp.array(dtype=real), r_out: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        for c in range(wp.tid(), u.shape[0], part_out.shape[0] * wp.block_dim()):
            i = f.place(c, f.faces(g, wp.static(axis)))
            r = real(0.0)
            if not s.fixed(g, low, high, o, i):
                r = scale[0] * s.spread(g, low, high, o, u, i, real(walls))
            r_out[c] = r
            sum += wp.float64(r) * wp.float64(r)
        sum = block_sum(sum)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, wp.float64(0.0))

    return wp.kernel(viscosity_first_residual, name=f"viscosity_begin{'_second' * second}_{s.name}", module=module,
                     enable_backward=False, grid_stride=False)


@cache
def viscosity_product_kernel(dim: int, axis: int, fractions: bool, slip: bool, real, module):
    """Kernel over blocks of threads: w_out = (I - a L) p, parts of p.w."""
    t, S, f, s = (types(real), grid_structs(real), grid_functions(dim, real),
                  viscosity_functions(dim, axis, fractions, slip, real))

    def multiply_viscosity(g: S.Grid, low: t.vec3, high: t.vec3, o: wp.array(dtype=real), p: wp.array(dtype=real),
                           scale: wp.array(dtype=real), w_out: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        for c in range(wp.tid(), p.shape[0], part_out.shape[0] * wp.block_dim()):
            i = f.place(c, f.faces(g, wp.static(axis)))
            w = real(0.0)
            if not s.fixed(g, low, high, o, i):
                w = p[c] - scale[0] * s.spread(g, low, high, o, p, i, real(0.0))
            w_out[c] = w
            sum += wp.float64(p[c]) * wp.float64(w)
        sum = block_sum(sum)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, wp.float64(0.0))

    return wp.kernel(multiply_viscosity, name=f"viscosity_multiply_{s.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def viscosity_scale_kernel(real, module):
    """Kernel of one thread: a of `part` of the step."""

    def compute_viscosity_scale(live: wp.array(dtype=real), clock: wp.array(dtype=real), part: real, dx: real,
                                scale_out: wp.array(dtype=real)):
        scale_out[0] = live[VISCOSITY] * part * clock[0] / (dx * dx)

    return wp.kernel(compute_viscosity_scale, name=f"viscosity_scale_{types(real).name}", module=module, enable_backward=False)
