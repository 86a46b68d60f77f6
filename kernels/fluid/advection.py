"""What the air carries along: dq/dt + u . grad q = 0, by following each row back (semi-Lagrangian; Stam 1999).

    q_out(x) = q(X),    X = where the air at x was a time h before

X by the midpoint rule, X = x - h u(x - h/2 u(x)) (order 2), or by Ralston's Runge-Kutta (1962, order 3). Never by Euler's
method: a blob that turns loses itself. q at X is

    linear       a convex combination: no new extremes, order 1 in time, much diffusion
    cubic        four rows an axis, kept within the 2^dim around it: order 3 where nothing is clamped
    MacCormack   p = A q,  q' = A^-1 p (velocity turned round),  p + (q - q') / 2, kept within what p came of
                 (Selle et al. 2008)
    BFECC        A (q + (q - q') / 2), kept likewise (Kim et al. 2005; the limiter of Selle et al.)

Any h is stable: what is clamped stays within what there was. Where the way back leaves by a side through which air comes, q is
that of the air around: 0, or its velocity.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.forces import buoyancy_function, buoyancy_inputs
from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs, wrap_near_row
from wsim.kernels.math.real import types

SCHEMES = ("linear", "cubic")
BOUNDS = (128, 8)        # threads of a block, blocks of a processor: 64 registers a thread. Two scalars would take 122, and an
                         # H200 4.1 ms for 256^3 where it takes 2.2


@cache
def face_velocity_function(dim: int, axis: int, real):
    """Function (g, u, i) -> velocity [m/s] at face i of an axis (-1: in the middle of cell i): its own component, and means of
    the two or four rows about it, which is what `velocity` finds there."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    @cache
    def component_mean_function(of: int):
        @wp.func
        def component_mean(g: S.Grid, q: wp.array(dtype=real), i: wp.vec3i):
            shape = f.faces(g, wp.static(of))
            value = q[flat_cell_index(i, shape)]
            if wp.static(of != axis):
                ahead = wp.vec3i(i[0], i[1], i[2])
                ahead[wp.static(of)] = wrap_near_row(i[wp.static(of)] + 1, shape[wp.static(of)], g.periodic[wp.static(of)])
                if wp.static(axis < 0):
                    value = real(0.5) * (value + q[flat_cell_index(ahead, shape)])
                else:
                    n = shape[wp.static(axis)]
                    here = wp.min(i[wp.static(axis)], n - 1)
                    behind = wrap_near_row(i[wp.static(axis)] - 1, n, g.periodic[wp.static(axis)])
                    now = wp.vec3i(i[0], i[1], i[2])
                    now[wp.static(axis)] = here
                    ahead[wp.static(axis)] = here
                    value = q[flat_cell_index(now, shape)] + q[flat_cell_index(ahead, shape)]
                    now[wp.static(axis)] = behind
                    ahead[wp.static(axis)] = behind
                    value = real(0.25) * (value + q[flat_cell_index(now, shape)] + q[flat_cell_index(ahead, shape)])
            return value

        return component_mean

    @cache
    def inner_mean_function(of: int):
        @wp.func
        def inner_component_mean(g: S.Grid, q: wp.array(dtype=real), i: wp.vec3i):
            """`component_mean_function` where all of its rows are within."""
            shape = f.faces(g, wp.static(of))
            c = flat_cell_index(i, shape)
            value = q[c]
            if wp.static(of != axis):
                step = wp.vec3i(shape[1] * shape[2], shape[2], 1)
                ahead = step[wp.static(of)]
                if wp.static(axis < 0):
                    value = real(0.5) * (value + q[c + ahead])
                else:
                    behind = c - step[wp.static(axis)]
                    value = real(0.25) * (value + q[c + ahead] + q[behind] + q[behind + ahead])
            return value

        return inner_component_mean

    x, y, z = component_mean_function(0), component_mean_function(1), component_mean_function(2)
    inner_x, inner_y, inner_z = inner_mean_function(0), inner_mean_function(1), inner_mean_function(2)

    @wp.func
    def velocity_at_face(g: S.Grid, u: S.Faces, i: wp.vec3i):
        v = t.vec3()
        within = i[0] > 0 and i[0] + 1 < g.n[0] and i[1] > 0 and i[1] + 1 < g.n[1]
        if wp.static(dim == 3):
            within = within and i[2] > 0 and i[2] + 1 < g.n[2]
        if within:
            v[0] = inner_x(g, u.x, i)
            v[1] = inner_y(g, u.y, i)
            if wp.static(dim == 3):
                v[2] = inner_z(g, u.z, i)
        else:
            v[0] = x(g, u.x, i)
            v[1] = y(g, u.y, i)
            if wp.static(dim == 3):
                v[2] = z(g, u.z, i)
        return v

    return velocity_at_face


@cache
def backtrace_function(dim: int, axis: int, real, third: bool = False, sharp: bool = False):
    """Function (g, u, i, h) -> X of the middle of face i of an axis (-1: of cell i); X in cells, h in [s]. sharp: of order 2,
    by velocities between rows that are cubics, not linear."""
    t, S, f, here = types(real), grid_structs(real), grid_functions(dim, real), face_velocity_function(dim, axis, real)

    @wp.func
    def cubic_velocity(g: S.Grid, u: S.Faces, x: t.vec3):
        v = t.vec3()
        v[0] = f.cubic(u.x, f.faces(g, 0), g.periodic, x - f.offset(0))
        v[1] = f.cubic(u.y, f.faces(g, 1), g.periodic, x - f.offset(1))
        if wp.static(dim == 3):
            v[2] = f.cubic(u.z, f.faces(g, 2), g.periodic, x - f.offset(2))
        return v

    @wp.func
    def departure_point(g: S.Grid, u: S.Faces, i: wp.vec3i, h: real):
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(wp.static(axis))
        s = h / g.dx
        if wp.static(sharp):
            return x - s * cubic_velocity(g, u, x - (real(0.5) * s) * cubic_velocity(g, u, x))
        k1 = here(g, u, i)
        k2 = f.velocity(g, u, x - (real(0.5) * s) * k1)
        if wp.static(third):
            k3 = f.velocity(g, u, x - (real(0.75) * s) * k2)
            return x - s * (real(2.0 / 9.0) * k1 + real(3.0 / 9.0) * k2 + real(4.0 / 9.0) * k3)
        return x - s * k2

    return departure_point


@cache
def left_domain_function(real):
    """Function (g, X) -> whether X is outside by a side through which air comes."""
    t, S = types(real), grid_structs(real)

    @wp.func
    def left_domain(g: S.Grid, X: t.vec3):
        gone = bool(False)  # noqa: UP018
        for a in range(3):
            if (g.outside[a] & 1) != 0 and X[a] < real(0.0):
                gone = True
            if (g.outside[a] & 2) != 0 and X[a] > real(g.n[a]):
                gone = True
        return gone

    return left_domain


@cache
def carried_value_function(dim: int, axis: int, scheme: str, clamped: bool, real):
    """Function (g, q, X) -> a component (axis 0 .. dim - 1) or scalar (axis -1) at X. scheme: "linear" or "cubic"."""
    t, S, f, gone = types(real), grid_structs(real), grid_functions(dim, real), left_domain_function(real)
    cubic = scheme == "cubic"

    @wp.func(inline=False)
    def carried_value(g: S.Grid, q: wp.array(dtype=real), X: t.vec3):
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if wp.static(axis >= 0):
            shape = f.faces(g, wp.static(axis))
        value = real(0.0)
        if gone(g, X):
            if wp.static(axis >= 0):
                wind = g.air[0]
                value = wind[wp.static(max(axis, 0))]
        else:
            s = X - f.offset(wp.static(axis))
            if wp.static(cubic and clamped):
                value = f.limited(q, shape, g.periodic, s)
            elif wp.static(cubic):
                value = f.cubic(q, shape, g.periodic, s)
            else:
                value = f.linear(q, shape, g.periodic, s)
        return value

    return carried_value


@cache
def advection_kernel(dim: int, axis: int, how: tuple[str, bool, bool, bool], pushed: str, real, module):
    """Kernel over the rows of a component (axis 0 .. dim - 1), or of a scalar (axis -1): q_out = q followed back
    over `part` of the step clock[0] [s]. how: scheme, whether clamped, a way back of order 3, a sharp one. pushed: what
    lifts and weighs there, see `forces.lift`; "": nothing."""
    S, f, F = grid_structs(real), grid_functions(dim, real), buoyancy_inputs(real)
    scheme, clamped, third, sharp = how
    back, at = backtrace_function(dim, axis, real, third, sharp), carried_value_function(dim, axis, scheme, clamped, real)
    push = buoyancy_function(dim, axis, pushed, real) if pushed else None

    def advect_semi_lagrangian(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), lifting: F, clock: wp.array(dtype=real),
                               part: real, q_out: wp.array(dtype=real)):
        c = wp.tid()
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if wp.static(axis >= 0):
            shape = f.faces(g, wp.static(axis))
        i = f.place(c, shape)
        h = part * clock[0]
        value = at(g, q, back(g, u, i, h))
        if wp.static(bool(pushed)):
            value += h * push(g, lifting, i)
        q_out[c] = value

    which = f"{'c' if axis < 0 else 'xyz'[axis]}_{scheme}{'_clamped' * clamped}{'_rk3' * third}{'_sharp' * sharp}"
    name = f"advect_{which}{'_' * bool(pushed)}{pushed}_{f.name}"
    return wp.kernel(advect_semi_lagrangian, name=name, module=module, enable_backward=False)


@cache
def maccormack_kernel(dim: int, axis: int, bfecc: bool, real, module):
    """Kernel over the rows: MacCormack's correction of p = A q by q' = A^-1 p, kept within the rows that p came of; bfecc: the
    same limit for p = A (q + (q - q') / 2), without a correction."""
    S, f = grid_structs(real), grid_functions(dim, real)
    back, gone = backtrace_function(dim, axis, real), left_domain_function(real)

    def correct_maccormack(g: S.Grid, u: S.Faces, q: wp.array(dtype=real), p: wp.array(dtype=real),
                           turned: wp.array(dtype=real), clock: wp.array(dtype=real), part: real, q_out: wp.array(dtype=real)):
        c = wp.tid()
        shape = wp.vec3i(g.n[0], g.n[1], g.n[2])
        if wp.static(axis >= 0):
            shape = f.faces(g, wp.static(axis))
        X = back(g, u, f.place(c, shape), part * clock[0])
        value = p[c]
        if not gone(g, X):
            if wp.static(not bfecc):
                value += real(0.5) * (q[c] - turned[c])
            least, most = f.around(q, shape, g.periodic, X - f.offset(wp.static(axis)))
            value = wp.clamp(value, least, most)
        q_out[c] = value

    name = f"correct_{'c' if axis < 0 else 'xyz'[axis]}_{'bfecc' if bfecc else 'maccormack'}_{f.name}"
    return wp.kernel(correct_maccormack, name=name, module=module, enable_backward=False)


@cache
def bfecc_kernel(real, module):
    """Kernel over the rows: q + (q - q') / 2, of BFECC."""

    def compensate_bfecc(q: wp.array(dtype=real), turned: wp.array(dtype=real), q_out: wp.array(dtype=real)):
        c = wp.tid()
        q_out[c] = q[c] + real(0.5) * (q[c] - turned[c])

    return wp.kernel(compensate_bfecc, name=f"compensate_{types(real).name}", module=module, enable_backward=False)
