"""Adjoints of the forces on the air, kernels/fluid/forces.py, gathered by cell, and the sums that numbers of a scene get.

    u' = u + h a,  a = g (weight s - lift T) + f:    share = M^T u',  s += h g weight share,  T -= h g lift share,  f += h share

with a bar over each; M takes the mean of the two cells beside a face. Confinement a = e dx (N x w), N = grad |w| / |grad |w||:
w += e dx (a x N) + what |w| of the cells around hands back; where grad |w| is 0 nothing does.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.adjoint.grid import interpolation_adjoints
from wsim.kernels.fluid.forces import VORTICITY
from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def face_mean_transpose_kernel(dim: int, real, module):
    """Kernel over cells: share_out = M^T by, of an axis."""
    S, f = grid_structs(real), grid_functions(dim, real)

    def face_mean_transpose(g: S.Grid, axis: int, by: wp.array(dtype=real), share_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        shape = f.faces(g, axis)
        far = wp.vec3i(i[0], i[1], i[2])
        far[axis] = i[axis] + 1
        ahead = real(0.5)
        behind = real(0.5)
        if g.periodic[axis] == 0:
            if i[axis] == 0:
                behind = real(1.0)
            if far[axis] == g.n[axis]:
                ahead = real(1.0)
        elif far[axis] == g.n[axis]:
            far[axis] = 0
        share_out[c] = behind * by[flat_cell_index(i, shape)] + ahead * by[flat_cell_index(far, shape)]

    return wp.kernel(face_mean_transpose, name=f"share_{f.name}", module=module, enable_backward=False)


@cache
def scaled_field_kernel(real, module):
    """Kernel over cells: y_out += factor h live[a] live[b] x."""

    def add_scaled_field(x: wp.array(dtype=real), live: wp.array(dtype=real), clock: wp.array(dtype=real), a: int, b: int,
                         factor: real, y_out: wp.array(dtype=real)):
        c = wp.tid()
        y_out[c] = y_out[c] + factor * clock[0] * live[a] * live[b] * x[c]

    return wp.kernel(add_scaled_field, name=f"add_scaled_{types(real).name}", module=module, enable_backward=False)


@cache
def swirl_push_kernel(real, module):
    """Kernel over cells: component `axis` of swirl_out is factor h x."""
    t = types(real)

    def set_swirl_component(x: wp.array(dtype=real), clock: wp.array(dtype=real), axis: int, factor: real,
                            swirl_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        v = swirl_out[c]
        v[axis] = factor * clock[0] * x[c]
        swirl_out[c] = v

    return wp.kernel(set_swirl_component, name=f"swirl_pushed_{t.name}", module=module, enable_backward=False)


@cache
def field_adjoint_kernel(real, module):
    """Kernel over cells: component `axis` of field_out += factor h x."""
    t = types(real)

    def add_field_component(x: wp.array(dtype=real), clock: wp.array(dtype=real), axis: int, factor: real,
                            field_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        v = field_out[c]
        v[axis] = v[axis] + factor * clock[0] * x[c]
        field_out[c] = v

    return wp.kernel(add_field_component, name=f"field_fed_{t.name}", module=module, enable_backward=False)


@cache
def field_sum_kernel(real, module):
    """Kernel over blocks of threads: parts of the sum of a."""

    def sum_field_parts(a: wp.array(dtype=real), part_out: wp.array(dtype=wp.vec2d)):
        sum = wp.float64(0.0)
        for c in range(wp.tid(), a.shape[0], part_out.shape[0] * wp.block_dim()):
            sum += wp.float64(a[c])
        sum = block_sum(sum)
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = wp.vec2d(sum, wp.float64(0.0))

    return wp.kernel(sum_field_parts, name=f"rows_sum_{types(real).name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def collect_gradient_kernel(real, module):
    """Kernel of one thread: out[slot] += factor times the sum of the parts, times h live[a] where a is not below 0, times h
    where it is -2; the second numbers of the parts go into the slot `other` likewise, where that is not below 0."""

    def collect_scalar_gradient(part: wp.array(dtype=wp.vec2d), live: wp.array(dtype=real), clock: wp.array(dtype=real), a: int,
                                factor: wp.float64, slot: int, other: int, out: wp.array(dtype=wp.float64)):
        first = wp.float64(0.0)
        second = wp.float64(0.0)
        for k in range(part.shape[0]):
            both = part[k]
            first += both[0]
            second += both[1]
        by = factor
        if a >= 0:
            by = by * wp.float64(clock[0] * live[a])
        elif a == -2:
            by = by * wp.float64(clock[0])
        out[slot] = out[slot] + by * first
        if other >= 0:
            out[other] = out[other] + by * second

    return wp.kernel(collect_scalar_gradient, name=f"collect_{types(real).name}", module=module, enable_backward=False)


@cache
def confinement_adjoint_kernels(dim: int, real, module):
    """Two kernels over cells. turned: by_N_out [1], the cotangent of grad |w|, and strength_out, what e gets, of swirl, that of
    the confinement. whirled: w_out, the cotangent of w."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    @wp.func
    def adjacent_cell_row(g: S.Grid, i: wp.vec3i, axis: int, step: int):
        j = wp.vec3i(i[0], i[1], i[2])
        j[axis] = i[axis] + step
        return f.row(j[0], j[1], j[2], g.n, g.periodic)

    @wp.func
    def vorticity_ascent(g: S.Grid, w: wp.array(dtype=t.vec3), i: wp.vec3i):
        N = t.vec3()
        for a in range(wp.static(dim)):
            N[a] = wp.length(w[adjacent_cell_row(g, i, a, 1)]) - wp.length(w[adjacent_cell_row(g, i, a, -1)])
        return N

    def confinement_adjoint(g: S.Grid, live: wp.array(dtype=real), w: wp.array(dtype=t.vec3), swirl: wp.array(dtype=t.vec3),
                            by_N_out: wp.array(dtype=t.vec3), strength_out: wp.array(dtype=real)):
        c = wp.tid()
        N = vorticity_ascent(g, w, f.place(c, g.n))
        size = wp.length(N)
        n = wp.normalize(N)
        found = t.vec3()
        if size > real(0.0):
            by = (live[VORTICITY] * g.dx) * wp.cross(w[c], swirl[c])
            found = (by - wp.dot(n, by) * n) / size
        by_N_out[c] = found
        strength_out[c] = g.dx * wp.dot(swirl[c], wp.cross(n, w[c]))

    def vorticity_cotangent(g: S.Grid, live: wp.array(dtype=real), w: wp.array(dtype=t.vec3), swirl: wp.array(dtype=t.vec3),
                            by_N: wp.array(dtype=t.vec3), w_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        i = f.place(c, g.n)
        by = real(0.0)
        for a in range(wp.static(dim)):
            ahead = adjacent_cell_row(g, i, a, 1)
            behind = adjacent_cell_row(g, i, a, -1)
            if g.periodic[a] != 0 or i[a] > 0:
                by += by_N[behind][a]
            else:
                by -= by_N[c][a]
            if g.periodic[a] != 0 or i[a] + 1 < g.n[a]:
                by -= by_N[ahead][a]
            else:
                by += by_N[c][a]
        n = wp.normalize(vorticity_ascent(g, w, i))
        w_out[c] = (live[VORTICITY] * g.dx) * wp.cross(swirl[c], n) + by * wp.normalize(w[c])

    return (wp.kernel(confinement_adjoint, name=f"confine_turned_{f.name}", module=module, enable_backward=False),
            wp.kernel(vorticity_cotangent, name=f"confine_whirled_{f.name}", module=module, enable_backward=False))


@cache
def curl_adjoint_kernel(dim: int, real, module):
    """Kernel over cells: adds to the cotangents u_out of a velocity that of its curl, by."""
    t, S, f, s = types(real), grid_structs(real), grid_functions(dim, real), interpolation_adjoints(dim, real)

    @wp.func
    def scatter_curl_slope(g: S.Grid, of: int, along: int, x: t.vec3, by: real, u_out: wp.array(dtype=real)):
        step = t.vec3()
        step[along] = real(1.0)
        shape = f.faces(g, of)
        v = by / (real(2.0) * g.dx)
        s.linear(u_out, shape, g.periodic, x + step - f.offset(of), v, u_out)
        s.linear(u_out, shape, g.periodic, x - step - f.offset(of), -v, u_out)

    def scatter_curl_adjoint(g: S.Grid, by: wp.array(dtype=t.vec3), u_out: S.Faces):
        c = wp.tid()
        i = f.place(c, g.n)
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(-1)
        w = by[c]
        scatter_curl_slope(g, 1, 0, x, w[2], u_out.y)
        scatter_curl_slope(g, 0, 1, x, -w[2], u_out.x)
        if wp.static(dim == 3):
            scatter_curl_slope(g, 2, 1, x, w[0], u_out.z)
            scatter_curl_slope(g, 1, 2, x, -w[0], u_out.y)
            scatter_curl_slope(g, 0, 2, x, w[1], u_out.x)
            scatter_curl_slope(g, 2, 0, x, -w[1], u_out.z)

    return wp.kernel(scatter_curl_adjoint, name=f"curl_adjoint_{f.name}", module=module, enable_backward=False)
