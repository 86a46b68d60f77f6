"""Sides of sheets that move: a particle that a step has brought through one is put back to where it came from.

    side    sign of (q - p) . n of what is nearest to q, p + v t its place t after the frame began: before and behind the step

The openings of faces keep the flow out (kernels/fluid/fractions.py), and signed distances have no side of a sheet; this tells
them apart as long as a step goes less far than the sheet is thick or a fold is wide. Beyond a rim nothing is on a side.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.mesh import SHEET
from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.grid import structs
from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import tables

STEEP = 0.8              # cosine between q - p and n from which on q is on a side


@cache
def aside(dim: int, kinds: tuple[str, ...], real):
    """Function (shapes, k, y, time) -> signed way [m] of a place from sheet k, 0 beyond its rim; place and normal there."""
    t, S, s = types(real), moved.structs(real), moved.functions(dim, kinds, real)

    @wp.func
    def aside(shapes: S.Shapes, k: int, y: t.vec3, time: real):
        r = y - shapes.place[k] - time * shapes.speed[k]
        turn = s.turned(shapes, k, time)
        q = wp.vec3f(wp.quat_rotate_inv(turn, r))
        way = s.shifted(shapes.mesh[k], q, time)
        near = wp.mesh_query_point_no_sign(shapes.mesh[k], q - way, float(1.0e9))
        d = real(0.0)
        p = t.vec3()
        n = t.vec3()
        if near.result:
            at = wp.mesh_eval_position(shapes.mesh[k], near.face, near.u, near.v) + way
            normal = wp.mesh_eval_face_normal(shapes.mesh[k], near.face)
            along = wp.dot(q - at, normal)
            if wp.abs(along) > float(STEEP) * wp.length(q - at):
                d = real(along)
            p = y - wp.quat_rotate(turn, t.vec3(q - at))
            n = wp.quat_rotate(turn, t.vec3(normal))
        return d, p, n

    return aside


@cache
def keep(dim: int, kinds: tuple[str, ...], real, module):
    """Kernel over rows: x_out of particles that were at `before` [m] where the step began."""
    t, S, T, G = types(real), moved.structs(real), tables(real), structs(real)
    s, way = moved.functions(dim, kinds, real), aside(dim, kinds, real)

    def keep(g: G.Grid, shapes: S.Shapes, clock: wp.array(dtype=real), before: wp.array(dtype=t.vec3), particles: T.Particles,
             x_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if particles.id[i] >= 0:
            x = particles.x[i]
            old = s.spot(shapes, before[i] / g.dx)
            for k in range(shapes.kind.shape[0]):
                if shapes.kind[k] == SHEET:
                    y = s.spot(shapes, x / g.dx)
                    first, none, no = way(shapes, k, old, clock[1])
                    last, p, n = way(shapes, k, y, clock[1] + clock[0])
                    if first * last < real(0.0):
                        to = p + (wp.sign(first) * shapes.thick[k]) * n
                        for a in range(wp.static(dim)):
                            x[a] = wp.clamp(to[shapes.axes[a]], real(1.0e-3) * g.dx, (real(g.n[a]) - real(1.0e-3)) * g.dx)
            x_out[i] = x

    return wp.kernel(keep, name=f"particles_keep_{s.name}", module=module, enable_backward=False)
