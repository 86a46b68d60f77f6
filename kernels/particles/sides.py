"""Particles stay on their side of every shape: where the segment that one has gone in a step meets a shape, it stops SKIN cells
before it, and what is left of its way goes on along the surface.

    p, q    its places in the frame of a shape that moves, at the start and at the end of the segment
    hit     the first of all shapes, kernels/contact/collider/segment.py: h = p + s (q - p), normal n
    slide   the segment from h to h + (1 - s) (q - p) less its part into the surface, LIFT of its length away from it, at most
            SLIDES times; then the particle rests where it is on what it met last, which takes it along

An open sheet has two sides, and a particle passes beyond its rim. A wall may be as thin as it likes.
"""

# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.grid import flat_cell_index, grid_structs
from wsim.kernels.math.real import types
from wsim.kernels.particles.sort import particle_cell_function, particle_structs

SKIN = 1.0e-3            # cells; more than places are rounded by in a domain of a thousand cells
SLIDES = 6               # an edge takes two, a corner three
LIFT = 1.0e-4            # of a slide: what is left of its part into the surface is rounding, which is not to be met again


@cache
def particle_slide_function(dim: int, kinds: tuple[str, ...], real):
    """Function (shapes, a, b, start, end) -> where a particle that goes from a to b [m] between these times comes to."""
    t, S, s = types(real), moved.fluid_shape_structs(real), moved.shape_queries(dim, kinds, real)

    @wp.func
    def flat_as(shapes: S.Shapes, y: t.vec3, of: t.vec3):
        """y, in the plane of a flat grid."""
        z = y
        if wp.static(dim == 2):
            third = 3 - shapes.axes[0] - shapes.axes[1]
            z[third] = of[third]
        return z

    @wp.func(inline=False)
    def slide_along_shapes(shapes: S.Shapes, a: t.vec3, b: t.vec3, start: real, end: real):
        skin = real(SKIN) * shapes.dx
        time = start
        x = a
        to = b
        slides = int(SLIDES)                                   # a variable: the loop is compiled once
        for m in range(slides):
            part = real(1.0)
            n = t.vec3()
            shape = int(-1)
            for k in range(shapes.of.kind.shape[0]):
                s_k, n_k = s.first_hit(shapes.of, k, x, time, to, end, skin)
                if s_k < part:
                    part = s_k
                    n = n_k
                    shape = k
            if shape < 0:
                return to
            p = s.local(shapes.of, shape, x, time)
            way = s.local(shapes.of, shape, to, end) - p
            h = p + part * way
            n = wp.quat_rotate_inv(s.turned(shapes.of, shape, time + part * (end - time)), n)
            rest = (real(1.0) - part) * way
            rest = rest - wp.min(wp.dot(rest, n), real(0.0)) * n
            rest = rest + real(LIFT) * wp.length(rest) * n
            if m + 1 == slides:
                rest = t.vec3()
            time = time + part * (end - time)
            x = flat_as(shapes, s.world(shapes.of, shape, h, time), a)
            to = flat_as(shapes, s.world(shapes.of, shape, h + rest, end), a)
        return to

    return slide_along_shapes


@cache
def side_keeping_kernel(dim: int, kinds: tuple[str, ...], real, module):
    """Kernel over rows: x_out of particles that were at `before` [m] where the step began. clear: of each cell, distance [m] to
    the nearest shape (kernels/particles/walls.py)."""
    t, S, T, G = types(real), moved.fluid_shape_structs(real), particle_structs(real), grid_structs(real)
    s, along, cell = (moved.shape_queries(dim, kinds, real), particle_slide_function(dim, kinds, real),
                      particle_cell_function(dim, real))

    def keep_particle_sides(g: G.Grid, shapes: S.Shapes, clock: wp.array(dtype=real), clear: wp.array(dtype=t.vec2),
                            before: wp.array(dtype=t.vec3), particles: T.Particles, x_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if particles.id[i] >= 0:
            old = before[i]
            x = particles.x[i]
            way = x - old
            for a in range(wp.static(dim)):
                size = real(g.n[a]) * g.dx
                if g.periodic[a] != 0 and wp.abs(way[a]) > real(0.5) * size:
                    way[a] = way[a] - wp.sign(way[a]) * size
            near = clear[flat_cell_index(cell(g, old), g.n)]
            if near[0] < wp.length(way) + g.dx:
                y = along(shapes, s.spot(shapes, old / g.dx), s.spot(shapes, (old + way) / g.dx), clock[1], clock[1] + clock[0])
                for a in range(wp.static(dim)):
                    x[a] = y[a]
                    if wp.static(dim == 2):
                        x[a] = y[shapes.axes[a]]
                    size = real(g.n[a]) * g.dx
                    if g.periodic[a] != 0:
                        x[a] = x[a] - size * wp.floor(x[a] / size)
                    elif (g.outside[a] & 1) == 0:
                        x[a] = wp.max(x[a], real(SKIN) * g.dx)
                    if g.periodic[a] == 0 and (g.outside[a] & 2) == 0:
                        x[a] = wp.min(x[a], size - real(SKIN) * g.dx)
            x_out[i] = x

    return wp.kernel(keep_particle_sides, name=f"particles_keep_{s.name}", module=module, enable_backward=False)
