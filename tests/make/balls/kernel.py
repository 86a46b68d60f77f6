"""Balls as a carrier (wsim/kernels/carrier/response.py): x' = x + d, v = (d - a) / h, W = w 1; and their search."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.carrier.pairs import appending, key, lists
from wsim.kernels.math.real import types
from wsim.physics.carrier.carriers import OWN, POINT


@cache
def structs(real):
    t = types(real)

    @wp.struct
    class Balls:
        w: wp.array(dtype=real)
        radius: wp.array(dtype=real)
        friction: wp.array(dtype=t.vec2)
        restitution: wp.array(dtype=real)
        x: wp.array(dtype=t.vec3)                 # [m] in the world
        v: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        h: real
        base: int

    @wp.struct
    class Moved:
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)

    @wp.struct
    class Cloth:
        x: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        v: wp.array(dtype=t.vec3)
        object: wp.array(dtype=int)
        origin: wp.array(dtype=t.vec3)            # of each object [m]
        reach: wp.array(dtype=real)

    return SimpleNamespace(Balls=Balls, Moved=Moved, Cloth=Cloth)


@cache
def balls(real):
    """The carrier."""
    vec3, ids, of = types(real).vec3, wp.vec4i, structs(real)
    Balls, Moved = of.Balls, of.Moved

    @wp.func
    def slide(c: Balls, id: ids, at: vec3):
        return c.d[id[0]] - c.a[id[0]]

    @wp.func
    def way(c: Balls, id: ids, at: vec3):
        return c.d[id[0]]

    @wp.func
    def speed(c: Balls, id: ids, at: vec3):
        return (c.d[id[0]] - c.a[id[0]]) / c.h

    @wp.func
    def mass(c: Balls, id: ids, at: vec3):
        w = c.w[id[0]]
        return wp.diag(vec3(w, w, w))

    @wp.func
    def reach(c: Balls):
        return c.h

    @wp.func
    def take(c: Balls, id: ids, at: vec3, p: vec3, out: Moved):
        out.d[id[0]] = c.d[id[0]] + (c.h * c.w[id[0]]) * p

    @wp.func
    def recoil(c: Balls, id: ids, at: vec3, q: vec3, out: Moved):
        out.a[id[0]] = c.a[id[0]] - (c.h * c.w[id[0]]) * q

    @wp.func
    def remember(c: Balls, id: ids, at: vec3, p: vec3, q: vec3, out: Moved):
        pass

    @wp.func
    def vertex(c: Balls, id: ids, at: vec3, k: int):
        return wp.where(k == 0, c.base + id[0], -1)

    return SimpleNamespace(name="balls", Data=Balls, Pushed=Moved, slide=slide, way=way, speed=speed, mass=mass, reach=reach,
                           take=take, recoil=recoil, remember=remember, vertex=vertex)


@cache
def fly(real, module):
    vec3 = types(real).vec3

    def fly_balls(c: structs(real).Balls, out: structs(real).Moved):
        i = wp.tid()
        out.d[i] = c.h * c.v[i]
        out.a[i] = vec3()

    return wp.kernel(fly_balls, name="fly_balls", module=module, enable_backward=False)


@cache
def land(real, module):
    vectors = wp.array(dtype=types(real).vec3)

    def land_balls(c: structs(real).Balls, x_out: vectors, v_out: vectors):
        i = wp.tid()
        x_out[i] = c.x[i] + c.d[i]
        v_out[i] = (c.d[i] - c.a[i]) / c.h

    return wp.kernel(land_balls, name="land_balls", module=module, enable_backward=False)


@cache
def meet(real, module):
    """Kernel over points and balls: a pair where they come within a margin of what they go in this substep."""
    of, Pairs, (add, put) = structs(real), lists(real), appending(real)
    vec2, vec3 = types(real).vec2, types(real).vec3

    def meet_balls(cloth: of.Cloth, c: of.Balls, pairs: Pairs):
        i, k = wp.tid()
        o = cloth.object[i]
        away = (cloth.x[i] - c.x[k]) + cloth.origin[o]
        size = wp.length(away)
        gap = size - c.radius[k] - cloth.reach[i]
        if gap < real(2.0) * wp.length(cloth.d[i] - c.d[k]):
            n = away / size
            row = add(pairs, 0, key(POINT, o, i), key(OWN, 0, k))
            if row >= 0:
                put(pairs, row, wp.vec4i(i), vec3(), wp.vec4i(k), vec3(), n, gap)
                pairs.friction[row] = c.friction[k]
                pairs.bounce[row] = vec2(c.restitution[k], wp.dot(n, cloth.v[i] - c.v[k]))

    return wp.kernel(meet_balls, name="meet_balls", module=module, enable_backward=False)
