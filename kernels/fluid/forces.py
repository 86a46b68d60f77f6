"""Forces on the air, on the faces of a staggered grid.

    buoyancy      a = g (weight s - lift T): smoke s sinks, heat T rises (Boussinesq)
    confinement   a = e dx (N x w),  w = curl u,  N = grad |w| / |grad |w||: turns what the grid has smoothed away
                  (Fedkiw, Stam, Jensen 2001)
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid.grid import flat, functions, structs
from wsim.kernels.math.real import types

LIFT, WEIGHT, VORTICITY, SMOKE_DECAY, COOLING, VISCOSITY, NUMBERS = 3, 4, 5, 6, 7, 8, 9      # of `live`, behind gravity (3)


@cache
def push(dim: int, axis: int, smoky: bool, hot: bool, swirling: bool, real, module):
    """Kernel over the faces of an axis: u plus `part` of the step clock[0] of all accelerations. live: gravity along the axes
    of the grid [m/s^2], then the numbers above; swirl: confinement at the cells' centres [m/s^2]."""
    t, S, f = types(real), structs(real), functions(dim, real)

    def push(g: S.Grid, live: wp.array(dtype=real), smoke: wp.array(dtype=real), heat: wp.array(dtype=real),
             swirl: wp.array(dtype=t.vec3), clock: wp.array(dtype=real), part: real, u_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, f.faces(g, wp.static(axis)))
        n = i[wp.static(axis)]
        before = wp.vec3i(i[0], i[1], i[2])
        before[wp.static(axis)] = n - 1
        if n == 0 and g.periodic[wp.static(axis)] != 0:
            before[wp.static(axis)] = g.n[wp.static(axis)] - 1
        elif n == 0:
            before[wp.static(axis)] = 0
        elif n == g.n[wp.static(axis)]:
            i[wp.static(axis)] = n - 1
        a = flat(before, g.n)
        b = flat(i, g.n)
        push = real(0.0)
        if wp.static(smoky):
            push += live[WEIGHT] * real(0.5) * (smoke[a] + smoke[b])
        if wp.static(hot):
            push -= live[LIFT] * real(0.5) * (heat[a] + heat[b])
        push = push * live[wp.static(axis)]
        if wp.static(swirling):
            push += real(0.5) * (swirl[a][wp.static(axis)] + swirl[b][wp.static(axis)])
        u_out[c] = u_out[c] + part * clock[0] * push

    name = f"push_{'xyz'[axis]}{'_smoke' * smoky}{'_heat' * hot}{'_swirl' * swirling}_{f.name}"
    return wp.kernel(push, name=name, module=module, enable_backward=False)


@cache
def curl(dim: int, real, module):
    """Kernel over cells: w [1/s] at the centres; of a flat fluid its third component is all there is."""
    t, S, f = types(real), structs(real), functions(dim, real)

    @wp.func
    def slope(g: S.Grid, u: wp.array(dtype=real), of: int, along: int, x: t.vec3):
        step = t.vec3()
        step[along] = real(1.0)
        shape = f.faces(g, of)
        o = f.offset(of)
        ahead = f.linear(u, shape, g.periodic, x + step - o)
        return (ahead - f.linear(u, shape, g.periodic, x - step - o)) / (real(2.0) * g.dx)

    def curl(g: S.Grid, u: S.Faces, curl_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        i = f.place(c, g.n)
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(-1)
        w = t.vec3()
        w[2] = slope(g, u.y, 1, 0, x) - slope(g, u.x, 0, 1, x)
        if wp.static(dim == 3):
            w[0] = slope(g, u.z, 2, 1, x) - slope(g, u.y, 1, 2, x)
            w[1] = slope(g, u.x, 0, 2, x) - slope(g, u.z, 2, 0, x)
        curl_out[c] = w

    return wp.kernel(curl, name=f"curl_{f.name}", module=module, enable_backward=False)


@cache
def confine(dim: int, real, module):
    """Kernel over cells: the acceleration of confinement [m/s^2]."""
    t, S, f = types(real), structs(real), functions(dim, real)

    def confine(g: S.Grid, live: wp.array(dtype=real), w: wp.array(dtype=t.vec3), a_out: wp.array(dtype=t.vec3)):
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
        a_out[c] = live[VORTICITY] * g.dx * wp.cross(wp.normalize(N), w[c])

    return wp.kernel(confine, name=f"confine_{f.name}", module=module, enable_backward=False)
