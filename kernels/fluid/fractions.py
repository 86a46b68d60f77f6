"""Openings of faces: which part of each is outside of all obstacles (Batty, Bertails, Bridson 2007; Ng, Min, Gibou 2009).

    node      least signed distance phi of all obstacles [m]
    face      of an edge between two nodes a / (a - b); of a square the mean of four triangles about its middle, phi linear in
              each: the part below 0 of a triangle with one corner below is a^2 / ((a - b) (a - c))

An opening below LEAST is closed: it would bind its cell to nothing.
"""

from functools import cache

import warp as wp

from wsim.kernels.fluid import shapes as moved
from wsim.kernels.fluid.grid import flat_cell_index, grid_functions, grid_structs
from wsim.kernels.math.real import types

LEAST = 1e-3


@cache
def node_distance_kernel(dim: int, kinds: tuple[str, ...], real, module):
    """Kernel over nodes: phi_out [m], at the end of the step: clock[1] is where it begins, clock[0] its length [s]."""
    t, S, f, s = types(real), moved.fluid_shape_structs(real), grid_functions(dim, real), moved.shape_queries(dim, kinds, real)

    def node_signed_distance(shape: wp.vec3i, shapes: S.Shapes, clock: wp.array(dtype=real), phi_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, shape)
        y = s.spot(shapes, t.vec3(real(i[0]), real(i[1]), real(i[2])))
        time = clock[0] + clock[1]
        phi = real(1.0e9)
        for k in range(shapes.of.kind.shape[0]):
            if shapes.thin[k] == 0:
                phi = wp.min(phi, s.signed(shapes.of, k, y, time))
        phi_out[c] = phi

    return wp.kernel(node_signed_distance, name=f"nodes_{s.name}", module=module, enable_backward=False)


@cache
def open_fractions(real):
    """(edge, triangle): functions of phi at corners -> part of it above 0."""

    @wp.func
    def open_edge_fraction(a: real, b: real):
        part = real(1.0)
        if a < real(0.0) and b < real(0.0):
            part = real(0.0)
        elif a < real(0.0) or b < real(0.0):
            part = wp.max(a, b) / (wp.max(a, b) - wp.min(a, b))
        return part

    @wp.func
    def open_triangle_fraction(a: real, b: real, c: real):
        least = wp.min(a, wp.min(b, c))
        most = wp.max(a, wp.max(b, c))
        middle = wp.max(wp.min(a, b), wp.min(wp.max(a, b), c))
        part = real(1.0)
        if most <= real(0.0):
            part = real(0.0)
        elif least < real(0.0):
            if middle > real(0.0):
                part = real(1.0) - least * least / ((middle - least) * (most - least))
            else:
                part = most * most / ((most - least) * (most - middle))
        return part

    return open_edge_fraction, open_triangle_fraction


@cache
def face_opening_kernel(dim: int, axis: int, real, module):
    """Kernel over the faces of an axis: open_out of phi at the nodes."""
    S, f = grid_structs(real), grid_functions(dim, real)
    edge, triangle = open_fractions(real)
    one, two = ((1, 2), (0, 2), (0, 1))[axis]
    other = 1 - axis

    def compute_face_openings(g: S.Grid, shape: wp.vec3i, phi: wp.array(dtype=real), open_out: wp.array(dtype=real)):
        c = wp.tid()
        i = f.place(c, f.faces(g, wp.static(axis)))
        part = real(0.0)
        a = phi[flat_cell_index(i, shape)]
        if wp.static(dim == 2):
            i[wp.static(other)] = i[wp.static(other)] + 1
            part = edge(a, phi[flat_cell_index(i, shape)])
        else:
            i[wp.static(one)] = i[wp.static(one)] + 1
            b = phi[flat_cell_index(i, shape)]
            i[wp.static(two)] = i[wp.static(two)] + 1
            d = phi[flat_cell_index(i, shape)]
            i[wp.static(one)] = i[wp.static(one)] - 1
            e = phi[flat_cell_index(i, shape)]
            m = real(0.25) * (a + b + d + e)
            part = real(0.25) * (triangle(a, b, m) + triangle(b, d, m) + triangle(d, e, m) + triangle(e, a, m))
        open_out[c] = wp.where(part < real(LEAST), real(0.0), part)

    return wp.kernel(compute_face_openings, name=f"openings_{'xyz'[axis]}_{f.name}", module=module, enable_backward=False)


@cache
def cover_velocity_kernel(dim: int, axis: int, kinds: tuple[str, ...], bodies: bool, real, module):
    """Kernel over the faces of an axis: velocity across it of the obstacle that is nearest to its middle, at the step's end;
    with rigid bodies among them which of those it is, -1: none."""
    t, G, S, f = types(real), grid_structs(real), moved.fluid_shape_structs(real), grid_functions(dim, real)
    s = moved.shape_queries(dim, kinds, real)

    def find_cover_velocity(g: G.Grid, shapes: S.Shapes, clock: wp.array(dtype=real), rate_out: wp.array(dtype=real),
                            body_out: wp.array(dtype=int)):
        c = wp.tid()
        i = f.place(c, f.faces(g, wp.static(axis)))
        y = s.spot(shapes, t.vec3(real(i[0]), real(i[1]), real(i[2])) + f.offset(wp.static(axis)))
        time = clock[0] + clock[1]
        nearest = real(1.0e9)
        v = t.vec3()
        body = int(-1)
        for k in range(shapes.of.kind.shape[0]):
            phi = s.signed(shapes.of, k, y, time)
            if phi < nearest:
                nearest = phi
                v = s.rate(shapes, k, y, time)
                if wp.static(bodies):
                    body = shapes.of.owner[k]
        rate_out[c] = v[wp.static(axis)]
        if wp.static(bodies):
            body_out[c] = body

    return wp.kernel(find_cover_velocity, name=f"covers_{'xyz'[axis]}{'_bodies' * bodies}_{s.name}", module=module,
                     enable_backward=False)
