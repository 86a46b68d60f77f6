"""Adjoints of what shapes put into the air, kernels/fluid/sources.py: back through the sources of a cell, the last one first.

    q = max(q, d a), the branch that was taken;  q' = max(q + h d a, 0);  e += d b;  u' = u + p (v - u);     d = p s
    p = 1/2 - phi / dx within 0 .. 1:    the place of a source gets  p n / dx  with n = grad phi, where p is between the two

A row of NUMBERS a source: smoke, heat, expansion, the strengths at the frame's start and end, velocity (3), place (3).
"""

# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.mesh import SOLID
from wsim.kernels.contact.shape import distance
from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.forces import COOLING, SMOKE_DECAY
from wsim.kernels.fluid.grid import functions, structs
from wsim.kernels.fluid.sources import HELD, SPEED, reach, tables
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import total

SMOKE, HEAT, EXPANSION, FIRST, LAST, VELOCITY, PLACE, NUMBERS = 0, 1, 2, 3, 4, 5, 8, 11
Numbers = wp.types.vector(NUMBERS, wp.float64)


@cache
def outward(dim: int, kinds: tuple[str, ...], real):
    """Function (sources, k, x, clock) -> d part / d place [1/m], of a cell about x, along the world's axes."""
    t, Sources, s = types(real), tables(real), moved.functions(dim, kinds, real)
    convex = distance(tuple(k for k in kinds if k not in ("solid", "sheet")) or ("sphere",))
    solid = "solid" in kinds

    @wp.func
    def outward(sources: Sources, k: int, x: t.vec3, clock: wp.array(dtype=real)):
        shapes = sources.shapes
        at = clock[1] + real(0.5) * clock[0]
        y = s.spot(shapes, x)
        turn = s.turned(shapes, k, at)
        q = wp.quat_rotate_inv(turn, y - shapes.place[k] - at * shapes.speed[k])
        kind = shapes.kind[k]
        n = t.vec3()
        if wp.static(solid):
            if kind == SOLID:
                near = wp.mesh_query_point_sign_normal(shapes.mesh[k], wp.vec3f(q), float(1.0e9))
                if near.result:
                    p = wp.mesh_eval_position(shapes.mesh[k], near.face, near.u, near.v)
                    n = real(near.sign) * wp.normalize(q - t.vec3(real(p[0]), real(p[1]), real(p[2])))
        if kind < SOLID:
            phi, found = convex(kind, shapes.size[k], q)
            n = found
        return wp.quat_rotate(turn, n) / shapes.dx

    return outward


@cache
def covering(dim: int, kinds: tuple[str, ...], real):
    """As `wsim.kernels.fluid.sources.reach`, of a strength of 0 too: there it is that a source may begin."""
    t, Sources, s = types(real), tables(real), moved.functions(dim, kinds, real)

    @wp.func
    def covering(sources: Sources, k: int, x: t.vec3, clock: wp.array(dtype=real)):
        at = clock[1] + real(0.5) * clock[0]
        both = sources.strength[k]
        phi = s.signed(sources.shapes, k, s.spot(sources.shapes, x), at)
        part = wp.clamp(real(0.5) - phi / sources.shapes.dx, real(0.0), real(1.0))
        return part, both[0] + (both[1] - both[0]) * at / clock[3]

    return covering


@cache
def chain(dim: int, kinds: tuple[str, ...], real) -> SimpleNamespace:
    """Functions of a cell about x: before(sources, x, clock, k, now) -> (smoke, heat) as source k finds them; back(sources, x,
    clock, k, now, by) -> cotangents behind source k, of those at the end."""
    t, Sources, within = types(real), tables(real), covering(dim, kinds, real)

    @wp.func
    def one(sources: Sources, k: int, dose: real, h: real, now: t.vec2):
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
    def before(sources: Sources, x: t.vec3, clock: wp.array(dtype=real), k: int, begun: t.vec2):
        now = begun
        for j in range(k):
            part, strength = within(sources, j, x, clock)
            if part > real(0.0):
                now = one(sources, j, part * strength, clock[0], now)
        return now

    @wp.func
    def taken(sources: Sources, k: int, dose: real, h: real, now: t.vec2):
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
    def back(sources: Sources, x: t.vec3, clock: wp.array(dtype=real), k: int, begun: t.vec2, by: t.vec2):
        found = by
        for m in range(sources.what.shape[0] - 1 - k):
            j = sources.what.shape[0] - 1 - m
            part, strength = within(sources, j, x, clock)
            if part > real(0.0):
                now = before(sources, x, clock, j, begun)
                on, own = taken(sources, j, part * strength, clock[0], now)
                found = wp.cw_mul(found, on)
        return found

    return SimpleNamespace(before=before, taken=taken, back=back, within=within)


@cache
def state(real):
    """Struct of smoke and heat as a step finds them, and of the cotangents of both, and of the expansion, behind the sources."""

    @wp.struct
    class Emitted:
        smoke: wp.array(dtype=real)
        heat: wp.array(dtype=real)
        by_smoke: wp.array(dtype=real)
        by_heat: wp.array(dtype=real)
        by_expansion: wp.array(dtype=real)

    return Emitted


@cache
def faded(carried: str, real):
    """Function (emitted, live, h, c) -> smoke and heat of a cell behind their decay, cotangents of both behind the sources."""
    t, Emitted = types(real), state(real)
    smoky, hot = "smoke" in carried, "heat" in carried

    @wp.func
    def faded(emitted: Emitted, live: wp.array(dtype=real), h: real, c: int):
        now = t.vec2()
        by = t.vec2()
        if wp.static(smoky):
            now[0] = emitted.smoke[c] * wp.exp(-live[SMOKE_DECAY] * h)
            by[0] = emitted.by_smoke[c]
        if wp.static(hot):
            now[1] = emitted.heat[c] * wp.exp(-live[COOLING] * h)
            by[1] = emitted.by_heat[c]
        return now, by

    return faded


@cache
def emit(dim: int, kinds: tuple[str, ...], carried: str, real, module):
    """Kernel over cells: cotangents of smoke and heat before the sources and the decay."""
    t, S, f, Sources, Emitted = types(real), structs(real), functions(dim, real), tables(real), state(real)
    way, fade = chain(dim, kinds, real), faded(carried, real)
    smoky, hot = "smoke" in carried, "heat" in carried

    def emit(g: S.Grid, sources: Sources, emitted: Emitted, live: wp.array(dtype=real), clock: wp.array(dtype=real),
             smoke_out: wp.array(dtype=real), heat_out: wp.array(dtype=real)):
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
    return wp.kernel(emit, name=name, module=module, enable_backward=False)


@cache
def emitted(dim: int, kinds: tuple[str, ...], carried: str, expanding: bool, real, module):
    """Kernel over blocks of threads: parts of what the numbers of source k get of smoke, heat and expansion."""
    t, S, f, Sources, Emitted = types(real), structs(real), functions(dim, real), tables(real), state(real)
    way, fade, out = chain(dim, kinds, real), faded(carried, real), outward(dim, kinds, real)

    @wp.func
    def of_cell(g: S.Grid, sources: Sources, k: int, e: Emitted, live: wp.array(dtype=real), clock: wp.array(dtype=real), c: int):
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
            found[0] = wp.float64(by_smoke * dose)
            found[1] = wp.float64(by_heat * dose)
            if wp.static(expanding):
                found[2] = wp.float64(e.by_expansion[c] * dose)
                by_dose += e.by_expansion[c] * sources.expansion[k]
            late = (clock[1] + real(0.5) * clock[0]) / clock[3]
            found[3] = wp.float64(by_dose * part * (real(1.0) - late))
            found[4] = wp.float64(by_dose * part * late)
            if part < real(1.0):
                by_place = (by_dose * strength) * out(sources, k, x, clock)
                for a in range(3):
                    found[8 + a] = wp.float64(by_place[a])
        return found

    def emitted(g: S.Grid, sources: Sources, k: int, e: Emitted, live: wp.array(dtype=real), clock: wp.array(dtype=real),
                part_out: wp.array(dtype=Numbers)):
        sum = Numbers()
        for c in range(wp.tid(), g.n[0] * g.n[1] * g.n[2], part_out.shape[0] * wp.block_dim()):
            sum += of_cell(g, sources, k, e, live, clock, c)
        for j in range(NUMBERS):
            sum[j] = total(sum[j])
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = sum

    name = f"emitted_adjoint_{carried}{'_expanding' * expanding}_{dim}d_{'_'.join(kinds)}_{types(real).name}"
    return wp.kernel(emitted, name=name, module=module, enable_backward=False, grid_stride=False)


@cache
def driven(dim: int, axis: int, kinds: tuple[str, ...], real, module):
    """Two kernels of the faces of an axis. drive, over faces: by_out, the cotangent behind the sources, becomes that before
    them. driven, over blocks of threads: parts of what the velocity and place of source k get; u: before the sources."""
    t, S, f, Sources = types(real), structs(real), functions(dim, real), tables(real)
    within, out = reach(dim, kinds, real), outward(dim, kinds, real)

    @wp.func
    def held(sources: Sources, k: int, x: t.vec3, clock: wp.array(dtype=real)):
        found = real(0.0)
        if (sources.what[k] & SPEED) != 0:
            part, strength = within(sources, k, x, clock)
            if strength > real(0.0):
                found = part
        return found

    @wp.func
    def spot(g: S.Grid, c: int):
        i = f.place(c, f.faces(g, wp.static(axis)))
        return t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(wp.static(axis))

    def drive(g: S.Grid, sources: Sources, clock: wp.array(dtype=real), by_out: wp.array(dtype=real)):
        c = wp.tid()
        x = spot(g, c)
        left = real(1.0)
        for k in range(sources.what.shape[0]):
            left = left * (real(1.0) - held(sources, k, x, clock))
        by_out[c] = left * by_out[c]

    def driven(g: S.Grid, sources: Sources, k: int, clock: wp.array(dtype=real), u: wp.array(dtype=real),
               by: wp.array(dtype=real), part_out: wp.array(dtype=Numbers)):
        sum = Numbers()
        for c in range(wp.tid(), u.shape[0], part_out.shape[0] * wp.block_dim()):
            x = spot(g, c)
            part = held(sources, k, x, clock)
            if part > real(0.0):
                now = u[c]
                for j in range(k):
                    v = sources.velocity[j]
                    now += held(sources, j, x, clock) * (v[wp.static(axis)] - now)
                later = by[c]
                for j in range(k + 1, sources.what.shape[0]):
                    later = later * (real(1.0) - held(sources, j, x, clock))
                v = sources.velocity[k]
                sum[VELOCITY + wp.static(axis)] = sum[VELOCITY + wp.static(axis)] + wp.float64(later * part)
                if part < real(1.0):
                    by_place = (later * (v[wp.static(axis)] - now)) * out(sources, k, x, clock)
                    for a in range(3):
                        sum[PLACE + a] = sum[PLACE + a] + wp.float64(by_place[a])
        for j in range(NUMBERS):
            sum[j] = total(sum[j])
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = sum

    name = f"{'xyz'[axis]}_{dim}d_{'_'.join(kinds)}_{types(real).name}"
    return (wp.kernel(drive, name=f"drive_adjoint_{name}", module=module, enable_backward=False),
            wp.kernel(driven, name=f"driven_adjoint_{name}", module=module, enable_backward=False, grid_stride=False))


@cache
def collect(module):
    """Kernel of one thread: adds the parts to row k of out."""

    def collect(part: wp.array(dtype=Numbers), k: int, out: wp.array(dtype=Numbers)):
        sum = out[k]
        for j in range(part.shape[0]):
            sum += part[j]
        out[k] = sum

    return wp.kernel(collect, name="collect_numbers", module=module, enable_backward=False)


@cache
def decay(rate: int, real, module):
    """Kernel over cells, where nothing is emitted: the cotangent before a decay."""

    def decay(live: wp.array(dtype=real), clock: wp.array(dtype=real), by_out: wp.array(dtype=real)):
        c = wp.tid()
        by_out[c] = by_out[c] * wp.exp(-live[wp.static(rate)] * clock[0])

    return wp.kernel(decay, name=f"decay_adjoint_{rate}_{types(real).name}", module=module, enable_backward=False)
