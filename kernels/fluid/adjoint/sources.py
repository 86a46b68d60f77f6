"""Adjoint of what shapes put into the air, kernels/fluid/sources.py: back through the sources of a cell, the last one first.

    q = max(q, d a), the branch that was taken;  q' = max(q + h d a, 0);  e += d b;  d = p s

p: the part of the cell that is covered (kernels/fluid/adjoint/covering.py), s: the strength.
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.fluid.adjoint.covering import (
    EXPANSION,
    FIRST,
    HEAT,
    LAST,
    NUMBERS,
    PLACE,
    SMOKE,
    Numbers,
    coverage_slope_function,
    source_coverage_function,
)
from wsim.kernels.fluid.forces import COOLING, SMOKE_DECAY
from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.fluid.sources import HELD, source_tables
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def source_chain_functions(dim: int, kinds: tuple[str, ...], real) -> SimpleNamespace:
    """Functions of a cell about x: before(sources, x, clock, k, begun) -> (smoke, heat) as source k finds them; back(sources,
    x, clock, k, begun, by) -> cotangents behind source k, of those at the end."""
    t, Sources, within = types(real), source_tables(real), source_coverage_function(dim, kinds, real)

    @wp.func
    def apply_source_dose(sources: Sources, k: int, dose: real, h: real, now: t.vec2):
        s = now[0]
        q = now[1]
        if (sources.what[k] & HELD) != 0:
            s = wp.max(s, dose * sources.smoke[k])
            q = wp.max(q, dose * sources.heat[k])
        else:
            s = wp.max(s + h * dose * sources.smoke[k], real(0.0))
            q = q + h * dose * sources.heat[k]
        return t.vec2(s, q)

    @wp.func
    def emitted_before_source(sources: Sources, x: t.vec3, clock: wp.array(dtype=real), k: int, begun: t.vec2):
        now = begun
        for j in range(k):
            part, strength = within(sources, j, x, clock)
            if part > real(0.0):
                now = apply_source_dose(sources, j, part * strength, clock[0], now)
        return now

    @wp.func
    def dose_derivatives(sources: Sources, k: int, dose: real, h: real, now: t.vec2):
        """Of smoke and heat: 1 where what there was goes on; and what a dose adds, by the value of the source."""
        on = t.vec2(real(1.0), real(1.0))
        own = t.vec2(h, h)
        if (sources.what[k] & HELD) != 0:
            own = t.vec2()
            if dose * sources.smoke[k] > now[0]:
                on[0] = real(0.0)
                own[0] = real(1.0)
            if dose * sources.heat[k] > now[1]:
                on[1] = real(0.0)
                own[1] = real(1.0)
        elif now[0] + h * dose * sources.smoke[k] < real(0.0):
            on[0] = real(0.0)
            own[0] = real(0.0)
        return on, own

    @wp.func
    def source_chain_adjoint(sources: Sources, x: t.vec3, clock: wp.array(dtype=real), k: int, begun: t.vec2, by: t.vec2):
        found = by
        for m in range(sources.what.shape[0] - 1 - k):
            j = sources.what.shape[0] - 1 - m
            part, strength = within(sources, j, x, clock)
            if part > real(0.0):
                now = emitted_before_source(sources, x, clock, j, begun)
                on, own = dose_derivatives(sources, j, part * strength, clock[0], now)
                found = wp.cw_mul(found, on)
        return found

    return SimpleNamespace(before=emitted_before_source, taken=dose_derivatives, back=source_chain_adjoint, within=within)


@cache
def emitted_states(real):
    """Struct of smoke and heat as a step finds them, of the cotangents of both and of the expansion behind the sources."""

    @wp.struct
    class Emitted:
        smoke: wp.array(dtype=real)
        heat: wp.array(dtype=real)
        by_smoke: wp.array(dtype=real)
        by_heat: wp.array(dtype=real)
        by_expansion: wp.array(dtype=real)

    return Emitted


@cache
def decay_state_function(carried: str, real):
    """Function (emitted, live, h, c) -> smoke and heat of a cell behind their decay, cotangents of both behind the sources."""
    t, Emitted = types(real), emitted_states(real)
    smoky, hot = "smoke" in carried, "heat" in carried

    @wp.func
    def decayed_cell_state(emitted: Emitted, live: wp.array(dtype=real), h: real, c: int):
        now = t.vec2()
        by = t.vec2()
        if wp.static(smoky):
            now[0] = emitted.smoke[c] * wp.exp(-live[SMOKE_DECAY] * h)
            by[0] = emitted.by_smoke[c]
        if wp.static(hot):
            now[1] = emitted.heat[c] * wp.exp(-live[COOLING] * h)
            by[1] = emitted.by_heat[c]
        return now, by

    return decayed_cell_state


@cache
def emission_adjoint_kernel(dim: int, kinds: tuple[str, ...], carried: str, real, module):
    """Kernel over cells: cotangents of smoke and heat before the sources and the decay."""
    t, S, f, Sources, Emitted = (types(real), grid_structs(real), grid_functions(dim, real), source_tables(real),
                                 emitted_states(real))
    way, fade = source_chain_functions(dim, kinds, real), decay_state_function(carried, real)
    smoky, hot = "smoke" in carried, "heat" in carried

    def emit_cells_adjoint(g: S.Grid, sources: Sources, emitted: Emitted, live: wp.array(dtype=real),
                           clock: wp.array(dtype=real), smoke_out: wp.array(dtype=real), heat_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, g.n)
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(-1)
        now, by = fade(emitted, live, clock[0], c)
        found = way.back(sources, x, clock, -1, now, by)
        if wp.static(smoky):
            smoke_out[c] = found[0] * wp.exp(-live[SMOKE_DECAY] * clock[0])
        if wp.static(hot):
            heat_out[c] = found[1] * wp.exp(-live[COOLING] * clock[0])

    name = f"emit_adjoint_{carried}_{dim}d_{'_'.join(kinds)}_{types(real).name}"
    return wp.kernel(emit_cells_adjoint, name=name, module=module, enable_backward=False)


@cache
def source_number_kernel(dim: int, kinds: tuple[str, ...], carried: str, expanding: bool, real, module):
    """Kernel over blocks of threads: parts of what the numbers of source k get of smoke, heat and expansion."""
    t, S, f, Sources, Emitted = (types(real), grid_structs(real), grid_functions(dim, real), source_tables(real),
                                 emitted_states(real))
    way, fade, out = (source_chain_functions(dim, kinds, real), decay_state_function(carried, real),
                      coverage_slope_function(dim, kinds, real))

    @wp.func
    def of_cell(g: S.Grid, sources: Sources, k: int, e: Emitted, live: wp.array(dtype=real), clock: wp.array(dtype=real),
                c: int):
        found = Numbers()
        i = f.place(c, g.n)
        x = t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(-1)
        part, strength = way.within(sources, k, x, clock)
        if part > real(0.0):
            start, last = fade(e, live, clock[0], c)
            now = way.before(sources, x, clock, k, start)
            by = way.back(sources, x, clock, k, start, last)
            dose = part * strength
            on, own = way.taken(sources, k, dose, clock[0], now)
            by_smoke = by[0] * own[0]
            by_heat = by[1] * own[1]
            by_dose = by_smoke * sources.smoke[k] + by_heat * sources.heat[k]
            found[SMOKE] = wp.float64(by_smoke * dose)
            found[HEAT] = wp.float64(by_heat * dose)
            if wp.static(expanding):
                found[EXPANSION] = wp.float64(e.by_expansion[c] * dose)
                by_dose += e.by_expansion[c] * sources.expansion[k]
            late = (clock[1] + real(0.5) * clock[0]) / clock[3]
            found[FIRST] = wp.float64(by_dose * part * (real(1.0) - late))
            found[LAST] = wp.float64(by_dose * part * late)
            if part < real(1.0):
                by_place = (by_dose * strength) * out(sources, k, x, clock)
                for a in range(3):
                    found[PLACE + a] = wp.float64(by_place[a])
        return found

    def source_number_parts(g: S.Grid, sources: Sources, k: int, e: Emitted, live: wp.array(dtype=real),
                            clock: wp.array(dtype=real), part_out: wp.array(dtype=Numbers)):
        sum = Numbers()
        for c in range(wp.tid(), g.n[0] * g.n[1] * g.n[2], part_out.shape[0] * wp.block_dim()):
            sum += of_cell(g, sources, k, e, live, clock, c)
        for j in range(NUMBERS):
            sum[j] = block_sum(sum[j])
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = sum

    name = f"emitted_adjoint_{carried}{'_expanding' * expanding}_{dim}d_{'_'.join(kinds)}_{types(real).name}"
    return wp.kernel(source_number_parts, name=name, module=module, enable_backward=False, grid_stride=False)


@cache
def decay_adjoint_kernel(rate: int, real, module):
    """Kernel over cells, where nothing is emitted: the cotangent before a decay."""

    def decay_cells_adjoint(live: wp.array(dtype=real), clock: wp.array(dtype=real), by_out: wp.array(dtype=real)):
        c = wp.tid()
        by_out[c] = by_out[c] * wp.exp(-live[wp.static(rate)] * clock[0])

    return wp.kernel(decay_cells_adjoint, name=f"decay_adjoint_{rate}_{types(real).name}", module=module, enable_backward=False)
