"""What shapes put into the air, and what passes away: of a cell the part within a shape counts, 1/2 - phi / dx kept in 0 .. 1.

    smoke, heat     rates [1/s], [K/s], or values that are held: q = max(q, part * value)
    velocity        of the faces within: u += part (v - u)
    expansion       [1/s], the divergence there
    decay           q exp(-rate h)
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.forces import COOLING, SMOKE_DECAY
from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.fluid.passes.tiles import tile_function
from wsim.kernels.math.real import types

RATES, HELD, SPEED, EXPANSION = 1, 2, 4, 8                  # bits of `what`


@cache
def source_tables(real):
    t, S = types(real), moved.fluid_shape_structs(real)

    @wp.struct
    class FluidSources:
        shapes: S.Shapes
        what: wp.array(dtype=int)              # bits, (sources,)
        smoke: wp.array(dtype=real)            # [1/s] or [1]
        heat: wp.array(dtype=real)             # [K/s] or [K]
        velocity: wp.array(dtype=t.vec3)       # [m/s], along the axes of the grid
        expansion: wp.array(dtype=real)        # [1/s]
        strength: wp.array(dtype=t.vec2)       # at the start and at the end of the frame

    return FluidSources


@cache
def source_reach_function(dim: int, kinds: tuple[str, ...], real):
    """Function (sources, k, x, clock) -> (part of a cell about x within source k, its strength)."""
    t, Sources, s = types(real), source_tables(real), moved.shape_queries(dim, kinds, real)

    @wp.func
    def source_reach(sources: Sources, k: int, x: t.vec3, clock: wp.array(dtype=real)):
        at = clock[1] + real(0.5) * clock[0]
        both = sources.strength[k]
        strength = both[0] + (both[1] - both[0]) * at / clock[3]
        part = real(0.0)
        if strength != real(0.0):
            phi = s.signed(sources.shapes.of, k, s.spot(sources.shapes, x), at)
            part = wp.clamp(real(0.5) - phi / sources.shapes.dx, real(0.0), real(1.0))
        return part, strength

    return source_reach


@cache
def emission_kernel(dim: int, kinds: tuple[str, ...], carries: tuple[str, bool], expanding: bool, real, module):
    """Kernel over cells: smoke and heat, which `carries` names, a step on, and the expansion [1/s] in it; and whether tiles
    that hold some are marked."""
    t, S, f, Sources = types(real), grid_structs(real), grid_functions(dim, real), source_tables(real)
    within, tile = source_reach_function(dim, kinds, real), tile_function(dim, real)
    carried, marking = carries
    smoky, hot = "smoke" in carried, "heat" in carried

    def emit_smoke_heat(g: S.Grid, sources: Sources, live: wp.array(dtype=real), clock: wp.array(dtype=real),
                        smoke_out: wp.array(dtype=real), heat_out: wp.array(dtype=real), expansion_out: wp.array(dtype=real),
                        holds_out: wp.array(dtype=int)):
        c = wp.tid()
        i = f.place(c, g.n)
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(-1)
        h = clock[0]
        s = real(0.0)
        q = real(0.0)
        e = real(0.0)
        if wp.static(smoky):
            s = smoke_out[c] * wp.exp(-live[SMOKE_DECAY] * h)
        if wp.static(hot):
            q = heat_out[c] * wp.exp(-live[COOLING] * h)
        for k in range(sources.what.shape[0]):
            part, strength = within(sources, k, x, clock)
            if part > real(0.0):
                dose = part * strength
                if (sources.what[k] & HELD) != 0:
                    s = wp.max(s, dose * sources.smoke[k])
                    q = wp.max(q, dose * sources.heat[k])
                else:
                    s = wp.max(s + h * dose * sources.smoke[k], real(0.0))
                    q = q + h * dose * sources.heat[k]
                e += dose * sources.expansion[k]
        if wp.static(smoky):
            if s != smoke_out[c]:
                smoke_out[c] = s
        if wp.static(hot):
            if q != heat_out[c]:
                heat_out[c] = q
        if wp.static(marking):
            if s != real(0.0) or q != real(0.0):
                holds_out[tile(g, i)] = 1
        if wp.static(expanding):
            expansion_out[c] = e

    name = f"emit_{carried}{'_tiles' * marking}{'_expanding' * expanding}_{dim}d_{'_'.join(kinds)}_{t.name}"
    return wp.kernel(emit_smoke_heat, name=name, module=module, enable_backward=False)


@cache
def scalar_decay_kernel(rate: int, real, module):
    """Kernel over cells, where nothing is emitted: a scalar a step on; live[rate] [1/s]."""

    def decay_scalar(live: wp.array(dtype=real), clock: wp.array(dtype=real), q_out: wp.array(dtype=real)):
        c = wp.tid()
        q_out[c] = q_out[c] * wp.exp(-live[wp.static(rate)] * clock[0])

    return wp.kernel(decay_scalar, name=f"decay_{rate}_{types(real).name}", module=module, enable_backward=False)


@cache
def driven_faces_kernel(dim: int, axis: int, kinds: tuple[str, ...], real, module):
    """Kernel over the faces of an axis: u of those within sources that have a velocity."""
    t, S, f, Sources = types(real), grid_structs(real), grid_functions(dim, real), source_tables(real)
    within = source_reach_function(dim, kinds, real)

    def drive_source_faces(g: S.Grid, sources: Sources, clock: wp.array(dtype=real), u_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, f.faces(g, wp.static(axis)))
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(wp.static(axis))
        u = u_out[c]
        for k in range(sources.what.shape[0]):
            if (sources.what[k] & SPEED) != 0:
                part, strength = within(sources, k, x, clock)
                if strength > real(0.0):
                    v = sources.velocity[k]
                    u += part * (v[wp.static(axis)] - u)
        u_out[c] = u

    return wp.kernel(drive_source_faces, name=f"drive_{'xyz'[axis]}_{dim}d_{'_'.join(kinds)}_{t.name}", module=module,
                     enable_backward=False)
