"""Forces on the air, on the faces of a staggered grid.

    buoyancy      a = g (weight s - lift T): smoke s sinks, heat T rises (Boussinesq)
    confinement   a = e dx (N x w),  w = curl u,  N = grad |w| / |grad |w||: turns what the grid has smoothed away
                  (Fedkiw, Stam, Jensen 2001)
    field         a at the cells' centres, any other
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs, wrap_near_row
from wsim.kernels.math.real import types

LIFT, WEIGHT, VORTICITY, SMOKE_DECAY, COOLING, VISCOSITY, NUMBERS = 3, 4, 5, 6, 7, 8, 9      # of `live`, behind gravity (3)


@cache
def buoyancy_inputs(real):
    """Struct: live numbers, gravity along the axes of the grid [m/s^2] and those above; smoke and heat of the cells."""

    @wp.struct
    class Lifting:
        live: wp.array(dtype=real)
        smoke: wp.array(dtype=real)
        heat: wp.array(dtype=real)

    return Lifting


@cache
def face_cells_function(dim: int, axis: int, real):
    """Function (g, i) -> flat indices of the cells on both sides of face i of an axis; beyond a side the one within."""
    S = grid_structs(real)

    @wp.func
    def cells_beside_face(g: S.Grid, i: wp.vec3i):
        n = i[wp.static(axis)]
        before = wp.vec3i(i[0], i[1], i[2])
        after = wp.vec3i(i[0], i[1], i[2])
        before[wp.static(axis)] = wrap_near_row(n - 1, g.n[wp.static(axis)], g.periodic[wp.static(axis)])
        after[wp.static(axis)] = wp.min(n, g.n[wp.static(axis)] - 1)
        return flat_cell_index(before, g.n), flat_cell_index(after, g.n)

    return cells_beside_face


@cache
def buoyancy_function(dim: int, axis: int, of: str, real):
    """Function (g, lifting, i) -> acceleration [m/s^2] across face i of an axis, of what `of` names: "smoke", "heat"."""
    S, F, cells = grid_structs(real), buoyancy_inputs(real), face_cells_function(dim, axis, real)
    smoky, hot = "smoke" in of, "heat" in of

    @wp.func
    def buoyancy_acceleration(g: S.Grid, lifting: F, i: wp.vec3i):
        push = real(0.0)
        down = lifting.live[wp.static(axis)]
        if down != real(0.0):                                  # of most axes nothing is read
            a, b = cells(g, i)
            if wp.static(smoky):
                push += lifting.live[WEIGHT] * real(0.5) * (lifting.smoke[a] + lifting.smoke[b])
            if wp.static(hot):
                push -= lifting.live[LIFT] * real(0.5) * (lifting.heat[a] + lifting.heat[b])
        return push * down

    return buoyancy_acceleration


@cache
def air_force_kernel(dim: int, axis: int, of: str, swirling: bool, real, module):
    """Kernel over the faces of an axis: u plus `part` of the step clock[0] of all accelerations: `buoyancy_function`, and
    swirl, that of confinement and of a field at the cells' centres [m/s^2]."""
    t, S, F, f = types(real), grid_structs(real), buoyancy_inputs(real), grid_functions(dim, real)
    force, cells = buoyancy_function(dim, axis, of, real), face_cells_function(dim, axis, real)

    def accelerate_air_faces(g: S.Grid, lifting: F, swirl: wp.array(dtype=t.vec3), clock: wp.array(dtype=real), part: real,
                             u_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, f.faces(g, wp.static(axis)))
        push = real(0.0)
        if wp.static(bool(of)):
            push = force(g, lifting, i)
        if wp.static(swirling):
            a, b = cells(g, i)
            push += real(0.5) * (swirl[a][wp.static(axis)] + swirl[b][wp.static(axis)])
        u_out[c] = u_out[c] + part * clock[0] * push

    name = f"push_{'xyz'[axis]}{'_' * bool(of)}{of}{'_swirl' * swirling}_{f.name}"
    return wp.kernel(accelerate_air_faces, name=name, module=module, enable_backward=False)


@cache
def vorticity_kernel(dim: int, real, module):
    """Kernel over cells: w [1/s] at the centres; of a flat fluid its third component is all there is."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    @wp.func
    def velocity_slope(g: S.Grid, u: wp.array(dtype=real), of: int, along: int, x: t.vec3):
        step = t.vec3()
        step[along] = real(1.0)
        shape = f.faces(g, of)
        o = f.offset(of)
        ahead = f.linear(u, shape, g.periodic, x + step - o)
        return (ahead - f.linear(u, shape, g.periodic, x - step - o)) / (real(2.0) * g.dx)

    def vorticity_at_centers(g: S.Grid, u: S.Faces, curl_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        i = f.place(c, g.n)
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(-1)
        w = t.vec3()
        w[2] = velocity_slope(g, u.y, 1, 0, x) - velocity_slope(g, u.x, 0, 1, x)
        if wp.static(dim == 3):
            w[0] = velocity_slope(g, u.z, 2, 1, x) - velocity_slope(g, u.y, 1, 2, x)
            w[1] = velocity_slope(g, u.x, 0, 2, x) - velocity_slope(g, u.z, 2, 0, x)
        curl_out[c] = w

    return wp.kernel(vorticity_at_centers, name=f"curl_{f.name}", module=module, enable_backward=False)


@cache
def confinement_kernel(dim: int, fielded: bool, real, module):
    """Kernel over cells: the acceleration of confinement, and of a field if there is one [m/s^2]."""
    t, S, f = types(real), grid_structs(real), grid_functions(dim, real)

    def confine_vorticity(g: S.Grid, live: wp.array(dtype=real), w: wp.array(dtype=t.vec3), field: wp.array(dtype=t.vec3),
                          a_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        i = f.place(c, g.n)
        N = t.vec3()
        for a in range(wp.static(dim)):
            ahead = wp.vec3i(i[0], i[1], i[2])
            ahead[a] = i[a] + 1
            behind = wp.vec3i(i[0], i[1], i[2])
            behind[a] = i[a] - 1
            N[a] = (wp.length(w[f.row(ahead[0], ahead[1], ahead[2], g.n, g.periodic)])
                    - wp.length(w[f.row(behind[0], behind[1], behind[2], g.n, g.periodic)]))
        push = live[VORTICITY] * g.dx * wp.cross(wp.normalize(N), w[c])
        if wp.static(fielded):
            push += field[c]
        a_out[c] = push

    return wp.kernel(confine_vorticity, name=f"confine{'_field' * fielded}_{f.name}", module=module, enable_backward=False)
