"""Rigid bodies and kinematic ones as carriers: a feature is a place on a body. See kernels/carrier/response.py.

A body in a substep: its centre goes by d, it turns by the rotation vector t [rad], so that a place with the arm r goes by

    way = d + exp([t]x) r - r                     speed = ((d - a) + (t - b) x r) / g          a, b  anchors
    W   = w 1 - [r]x J [r]x,   J = R I^-1 R^T     the inverse inertia in the world
    take: d += c w p,  t += c J (r x p)           recoil: a -= g w q,  b -= g J (r x q)

id = (body, ., ., .), at = r: from its centre to where it is touched, in the world at the start of the substep [m]. A pair keeps
angular momentum where both features have one place; where they are apart by s, an impulse P makes the moment s x P, none along
s. W is that of the start of the substep: of a body that turns far in one the response is of first order in |t|, and sweeps
converge as they do for any other nonlinearity; momentum is kept all the same.

A kinematic body (`kinematic`) goes from pose T0 to T1 whatever pushes it: id = (row, ...), at = the place in its own frame [m];
W = 0 and it is no vertex of a colouring.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.carrier.response import response
from wsim.kernels.contact.search import frames
from wsim.kernels.math.real import types


@cache
def structs(real) -> SimpleNamespace:
    """(Data, Pushed) of bodies, arrays of (bodies,); Poses of kinematic ones."""
    t, Response = types(real), response(real)

    @wp.struct
    class Data:
        w: wp.array(dtype=t.scalar)               # inverse mass [1/kg]
        inverse: wp.array(dtype=t.mat33)          # I^-1 in the body's frame [1/(kg m^2)]
        x: wp.array(dtype=t.vec3)                 # centre at the start of the substep, from the object's origin [m]
        q: wp.array(dtype=t.quat)                 # orientation there (x, y, z, w)
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        turn: wp.array(dtype=t.vec3)              # t
        twist: wp.array(dtype=t.vec3)             # b
        by: Response                              # of an integrator without memory that solves for the end: ahead 1, memory 0
        base: int                                 # number of the first body among what all carriers move

    @wp.struct
    class Pushed:
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        turn: wp.array(dtype=t.vec3)
        twist: wp.array(dtype=t.vec3)

    @wp.struct
    class Poses:
        pose: wp.array2d(dtype=t.transform)       # to the object's origin at substep k, (substeps + 1, rows)
        step: wp.array2d(dtype=t.transform)       # translation and turn during substep k, (substeps, rows)
        k: int
        h: real                                   # [s]

    @wp.struct
    class Still:
        none: int

    return SimpleNamespace(Data=Data, Pushed=Pushed, Poses=Poses, Still=Still)


@cache
def turned(real):
    """Function: exp([t]x) r - r, without cancellation."""
    vec3 = types(real).vec3

    @wp.func
    def turned(t: vec3, r: vec3):
        square = wp.dot(t, t)
        across = wp.cross(t, r)
        sine = real(1.0) - square / real(6.0)             # sin |t| / |t|, and (1 - cos |t|) / |t|^2: 1e-14 off at 1e-3
        cosine = real(0.5) - square / real(24.0)
        if square > real(1.0e-6):
            size = wp.sqrt(square)
            sine = wp.sin(size) / size
            half = wp.sin(real(0.5) * size)
            cosine = real(2.0) * half * half / square
        return sine * across + cosine * wp.cross(t, across)

    return turned


@cache
def body(real) -> SimpleNamespace:
    """The carrier of rigid bodies."""
    t, of, rotate = types(real), structs(real), turned(real)
    Data, Pushed, vec3, ids = of.Data, of.Pushed, t.vec3, wp.vec4i

    @wp.func
    def inertia(c: Data, i: int):
        """J."""
        R = wp.quat_to_matrix(c.q[i])
        return R * c.inverse[i] * wp.transpose(R)

    @wp.func
    def place(c: Data, id: ids, at: vec3):
        return c.x[id[0]] + at

    @wp.func
    def slide(c: Data, id: ids, at: vec3):
        i = id[0]
        return (c.d[i] - c.a[i]) + rotate(c.turn[i] - c.twist[i], at)

    @wp.func
    def way(c: Data, id: ids, at: vec3):
        i = id[0]
        return c.d[i] + rotate(c.turn[i], at)

    @wp.func
    def speed(c: Data, id: ids, at: vec3):
        i = id[0]
        return (real(1.0) / c.by.g) * ((c.d[i] - c.a[i]) + wp.cross(c.turn[i] - c.twist[i], at))

    @wp.func
    def mass(c: Data, id: ids, at: vec3):
        i = id[0]
        X = wp.skew(at)
        w = c.w[i]
        return wp.diag(vec3(w, w, w)) - X * inertia(c, i) * X

    @wp.func
    def reach(c: Data):
        return c.by.c

    @wp.func
    def take(c: Data, id: ids, at: vec3, p: vec3, out: Pushed):
        i = id[0]
        out.d[i] = c.d[i] + (c.by.c * c.w[i]) * p
        out.turn[i] = c.turn[i] + c.by.c * (inertia(c, i) * wp.cross(at, p))

    @wp.func
    def recoil(c: Data, id: ids, at: vec3, q: vec3, out: Pushed):
        i = id[0]
        out.a[i] = c.a[i] - (c.by.g * c.w[i]) * q
        out.twist[i] = c.twist[i] - c.by.g * (inertia(c, i) * wp.cross(at, q))

    @wp.func
    def remember(c: Data, id: ids, at: vec3, p: vec3, q: vec3, out: Pushed):
        pass

    @wp.func
    def vertex(c: Data, id: ids, at: vec3, k: int):
        found = int(-1)
        if k == 0 and c.w[id[0]] > real(0.0):
            found = c.base + id[0]
        return found

    return SimpleNamespace(name="body", Data=Data, Pushed=Pushed, place=place, slide=slide, way=way, speed=speed, mass=mass,
                           reach=reach, take=take, recoil=recoil, remember=remember, vertex=vertex)


@cache
def kinematic(real) -> SimpleNamespace:
    """The carrier of what moves by its poses."""
    t, of, outside = types(real), structs(real), frames(real)[1]
    Data, Pushed, vec3, ids = of.Poses, of.Still, t.vec3, wp.vec4i

    @wp.func
    def place(c: Data, id: ids, at: vec3):
        return wp.transform_point(c.pose[c.k, id[0]], at)

    @wp.func
    def way(c: Data, id: ids, at: vec3):
        row = id[0]
        _, found = outside(c.pose[c.k, row], c.pose[c.k + 1, row], c.step[c.k, row], vec3(), at, vec3())
        return found

    @wp.func
    def speed(c: Data, id: ids, at: vec3):
        return (real(1.0) / c.h) * way(c, id, at)

    @wp.func
    def mass(c: Data, id: ids, at: vec3):
        return wp.diag(vec3())

    @wp.func
    def reach(c: Data):
        return real(0.0)

    @wp.func
    def take(c: Data, id: ids, at: vec3, p: vec3, out: Pushed):
        pass

    @wp.func
    def recoil(c: Data, id: ids, at: vec3, q: vec3, out: Pushed):
        pass

    @wp.func
    def remember(c: Data, id: ids, at: vec3, p: vec3, q: vec3, out: Pushed):
        pass

    @wp.func
    def vertex(c: Data, id: ids, at: vec3, k: int):
        return int(-1)

    return SimpleNamespace(name="kinematic", Data=Data, Pushed=Pushed, place=place, slide=way, way=way, speed=speed, mass=mass,
                           reach=reach, take=take, recoil=recoil, remember=remember, vertex=vertex)
