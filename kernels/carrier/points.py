"""Points, edges, triangles and tets as carriers: a feature is a mean of up to four points. See kernels/carrier/response.py.

    id = (i, j, k, l)     numbers of the points; those of no weight may be any
    at = (b1, b2, b3)     weights of the points behind the first, which has b0 = 1 - b1 - b2 - b3: barycentric coordinates of
                          the place where the feature is touched. A point: 0. An edge: its parameter, 0, 0

    place, way, speed  sum b_k of the points'      W = sum b_k^2 w_k 1       take: point k receives b_k p, together p

The torque about any centre is that of p at the place: weights that sum to 1 keep linear and angular momentum.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.carrier.response import response
from wsim.kernels.math.real import types

CORNERS = 4


@cache
def structs(real) -> SimpleNamespace:
    """(Data, Pushed) of points; arrays of (points,). a and e may be the same array (backward Euler)."""
    t, Response = types(real), response(real)

    @wp.struct
    class Data:
        w: wp.array(dtype=t.scalar)               # inverse mass [1/kg]
        x: wp.array(dtype=t.vec3)                 # position at the start of the substep [m], from the object's origin
        v: wp.array(dtype=t.vec3)                 # velocity there [m/s]
        e: wp.array(dtype=t.vec3)                 # what d started from [m]
        a: wp.array(dtype=t.vec3)                 # anchor [m]
        d: wp.array(dtype=t.vec3)                 # displacement [m]
        by: Response
        base: int                                 # number of the first point among what all carriers move

    @wp.struct
    class Pushed:
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        e: wp.array(dtype=t.vec3)
        v: wp.array(dtype=t.vec3)

    return SimpleNamespace(Data=Data, Pushed=Pushed)


@cache
def points(real) -> SimpleNamespace:
    """The carrier."""
    t, of = types(real), structs(real)
    Data, Pushed, vec3, ids = of.Data, of.Pushed, t.vec3, wp.vec4i

    @wp.func
    def weight(at: vec3, k: int):
        """b_k."""
        b = real(1.0) - at[0] - at[1] - at[2]
        if k > 0:
            b = at[k - 1]
        return b

    @wp.func
    def place(c: Data, id: ids, at: vec3):
        """From the origin of the object [m]."""
        found = c.x[id[0]]
        first = found
        for k in range(1, CORNERS):
            if at[k - 1] != real(0.0):
                found += at[k - 1] * (c.x[id[k]] - first)
        return found

    @wp.func
    def moved(c: Data, i: int):
        """Motion of a point over the substep; a way out of an overlap, by which d and a are shifted, is none."""
        base = c.e[i]
        if c.by.memory == 0 and c.by.ahead == real(1.0):
            base = c.a[i]
        return c.by.ahead * (c.d[i] - base)

    @wp.func
    def slide(c: Data, id: ids, at: vec3):
        found = vec3()
        for k in range(CORNERS):
            b = weight(at, k)
            if b != real(0.0):
                found += b * moved(c, id[k])
        return found

    @wp.func
    def way(c: Data, id: ids, at: vec3):
        found = vec3()
        for k in range(CORNERS):
            b = weight(at, k)
            if b != real(0.0):
                i = id[k]
                found += b * (c.d[i] + (c.by.ahead - real(1.0)) * (c.d[i] - c.e[i]))
        return found

    @wp.func
    def speed(c: Data, id: ids, at: vec3):
        found = vec3()
        for k in range(CORNERS):
            b = weight(at, k)
            if b != real(0.0):
                i = id[k]
                if c.by.ahead == real(1.0):
                    found += (b / c.by.g) * (c.d[i] - c.a[i])
                else:
                    found += b * ((c.by.ahead / c.by.g) * (c.d[i] - c.e[i]) - (c.by.ahead - real(1.0)) * c.v[i])
        return found

    @wp.func
    def mass(c: Data, id: ids, at: vec3):
        w = real(0.0)
        for k in range(CORNERS):
            b = weight(at, k)
            if b != real(0.0):
                w += b * b * c.w[id[k]]
        return wp.diag(vec3(w, w, w))

    @wp.func
    def reach(c: Data):
        return c.by.ahead * c.by.c

    @wp.func
    def take(c: Data, id: ids, at: vec3, p: vec3, out: Pushed):
        for k in range(CORNERS):
            b = weight(at, k)
            if b != real(0.0):
                i = id[k]
                out.d[i] = c.d[i] + (c.by.c * b * c.w[i]) * p

    @wp.func
    def recoil(c: Data, id: ids, at: vec3, q: vec3, out: Pushed):
        """Through what `finish` (kernels/motion/points.py) makes of a or, on the way beyond, of v."""
        for k in range(CORNERS):
            b = weight(at, k)
            if b != real(0.0):
                i = id[k]
                if c.by.ahead != real(1.0):
                    out.v[i] = c.v[i] - (b * c.w[i] / (c.by.ahead - real(1.0))) * q
                else:
                    out.a[i] = c.a[i] - (c.by.g * b * c.w[i]) * q

    @wp.func
    def remember(c: Data, id: ids, at: vec3, p: vec3, q: vec3, out: Pushed):
        """Through v and e, from which `finish_bdf2` has u and s = d - e."""
        if c.by.memory != 0:
            for k in range(CORNERS):
                b = weight(at, k)
                if b != real(0.0):
                    i = id[k]
                    own = b * c.w[i]
                    out.v[i] = c.v[i] + own * (p + q)
                    out.e[i] = c.e[i] - own * ((c.by.h - c.by.c) * p + c.by.h * q)

    @wp.func
    def vertex(c: Data, id: ids, at: vec3, k: int):
        found = int(-1)
        if weight(at, k) != real(0.0):
            if c.w[id[k]] > real(0.0):
                found = c.base + id[k]
        return found

    return SimpleNamespace(name="points", Data=Data, Pushed=Pushed, place=place, slide=slide, way=way, speed=speed, mass=mass,
                           reach=reach, take=take, recoil=recoil, remember=remember, vertex=vertex)
