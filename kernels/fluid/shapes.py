"""Shapes in a fluid, which move within a frame: rows of the table of colliders (kernels/contact/collider/table.py) on a grid.

Places are relative to the low corner of the domain, along the world's axes. Of a flat fluid the grid's axes are two of those.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider import table
from wsim.kernels.math.real import types


@cache
def fluid_shape_structs(real) -> SimpleNamespace:
    Colliders = table.collider_type(real)

    @wp.struct
    class FluidShapes:
        of: Colliders                      # `thick` is added all around, so that a wall is not thinner than the grid tells
        thin: wp.array(dtype=int)          # 1: a wall of which the nodes of the grid cannot tell (kernels/particles/walls.py)
        axes: wp.vec3i                     # of the world, of each axis of the grid
        dx: real                           # [m] edge of a cell

    return SimpleNamespace(Shapes=FluidShapes)


@cache
def shape_queries(dim: int, kinds: tuple[str, ...], real) -> SimpleNamespace:
    """spot(shapes, x) -> place [m] of x cells; rate(shapes, k, y, t) -> velocity of shape k at a place, t [s] after the frame
    began, along the axes of the grid; and what the table answers of `shapes.of`."""
    t, S, ask = types(real), fluid_shape_structs(real), table.collider_queries(kinds, real)

    @wp.func
    def cell_position(shapes: S.Shapes, x: t.vec3):
        y = shapes.dx * x
        if wp.static(dim == 2):
            y = t.vec3(real(0.5) * shapes.dx, real(0.5) * shapes.dx, real(0.5) * shapes.dx)
            y[shapes.axes[0]] = shapes.dx * x[0]
            y[shapes.axes[1]] = shapes.dx * x[1]
        return y

    @wp.func
    def shape_velocity(shapes: S.Shapes, k: int, y: t.vec3, time: real):
        v = ask.rate(shapes.of, k, y, time)
        if wp.static(dim == 2):
            return t.vec3(v[shapes.axes[0]], v[shapes.axes[1]], real(0.0))
        return v

    return SimpleNamespace(spot=cell_position, name=f"{dim}d_{'_'.join(kinds)}_{t.name}",
                           **{**vars(ask), "rate": shape_velocity})
