"""Adjoint of the velocities that sources hold, kernels/fluid/sources.py: u' = u + p (v - u) of one source after the other,

    u = (1 - p) u',    v += p u',    p = (v - u) u'

with a bar over each but p, u and v in the factors, from the last source to the first.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid.adjoint.covering import NUMBERS, PLACE, VELOCITY, Numbers, coverage_slope_function
from wsim.kernels.fluid.grid import grid_functions, grid_structs
from wsim.kernels.fluid.sources import SPEED, source_reach_function, source_tables
from wsim.kernels.math.real import types
from wsim.kernels.solver.pcg import block_sum


@cache
def driven_adjoint_kernels(dim: int, axis: int, kinds: tuple[str, ...], real, module):
    """Two kernels of the faces of an axis. drive, over faces: by_out, the cotangent behind the sources, becomes that before
    them. driven, over blocks of threads: parts of what the velocity and place of source k get; u: before the sources."""
    t, S, f, Sources = types(real), grid_structs(real), grid_functions(dim, real), source_tables(real)
    within, out = source_reach_function(dim, kinds, real), coverage_slope_function(dim, kinds, real)

    @wp.func
    def source_held_part(sources: Sources, k: int, x: t.vec3, clock: wp.array(dtype=real)):
        found = real(0.0)
        if (sources.what[k] & SPEED) != 0:
            part, strength = within(sources, k, x, clock)
            if strength > real(0.0):
                found = part
        return found

    @wp.func
    def driven_face_position(g: S.Grid, c: int):
        i = f.place(c, f.faces(g, wp.static(axis)))
        return t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(wp.static(axis))

    def drive_faces_adjoint(g: S.Grid, sources: Sources, clock: wp.array(dtype=real), by_out: wp.array(dtype=real)):
        c = wp.tid()
        x = driven_face_position(g, c)
        left = real(1.0)
        for k in range(sources.what.shape[0]):
            left = left * (real(1.0) - source_held_part(sources, k, x, clock))
        by_out[c] = left * by_out[c]

    def source_velocity_parts(g: S.Grid, sources: Sources, k: int, clock: wp.array(dtype=real), u: wp.array(dtype=real),
                              by: wp.array(dtype=real), part_out: wp.array(dtype=Numbers)):
        sum = Numbers()
        for c in range(wp.tid(), u.shape[0], part_out.shape[0] * wp.block_dim()):
            x = driven_face_position(g, c)
            part = source_held_part(sources, k, x, clock)
            if part > real(0.0):
                now = u[c]
                for j in range(k):
                    v = sources.velocity[j]
                    now += source_held_part(sources, j, x, clock) * (v[wp.static(axis)] - now)
                later = by[c]
                for j in range(k + 1, sources.what.shape[0]):
                    later = later * (real(1.0) - source_held_part(sources, j, x, clock))
                v = sources.velocity[k]
                sum[VELOCITY + wp.static(axis)] = sum[VELOCITY + wp.static(axis)] + wp.float64(later * part)
                if part < real(1.0):
                    by_place = (later * (v[wp.static(axis)] - now)) * out(sources, k, x, clock)
                    for a in range(3):
                        sum[PLACE + a] = sum[PLACE + a] + wp.float64(by_place[a])
        for j in range(NUMBERS):
            sum[j] = block_sum(sum[j])
        if wp.tid() % wp.block_dim() == 0:
            part_out[wp.tid() // wp.block_dim()] = sum

    name = f"{'xyz'[axis]}_{dim}d_{'_'.join(kinds)}_{types(real).name}"
    return (wp.kernel(drive_faces_adjoint, name=f"drive_adjoint_{name}", module=module, enable_backward=False),
            wp.kernel(source_velocity_parts, name=f"driven_adjoint_{name}", module=module, enable_backward=False,
                      grid_stride=False))
