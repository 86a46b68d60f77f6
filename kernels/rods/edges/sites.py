"""Places of an edge in all colliders, as forces on its two points (kernels/rods/edges/inside.py)."""

from typing import Any

import warp as wp

from wsim.kernels.rods.contact import Side


@wp.struct
class Inside:
    """Forces of colliders on both points of an edge, and their stiffness: of each, and between them."""

    f0: wp.vec3d
    f1: wp.vec3d
    K0: wp.mat33d
    K1: wp.mat33d
    K: wp.mat33d


@wp.func
def spread(to: Inside, f: wp.vec3d, K: wp.mat33d, u: wp.float64):
    """`to` with a force at a place of the edge, and its stiffness."""
    v = wp.float64(1.0) - u
    to.f0 = to.f0 + f * v
    to.f1 = to.f1 + f * u
    to.K0 = to.K0 + K * (v * v)
    to.K1 = to.K1 + K * (u * u)
    to.K = to.K + K * (u * v)
    return to


@wp.func
def roll(to: Inside, n: wp.vec3d, d: wp.vec3d, y: wp.float64, N: wp.float64, slope: wp.float64):
    """`to` with what a normal force N gives as its place moves along the edge d."""
    length = wp.length(d)
    t = d * (slope / length)
    a0 = t * (wp.float64(1.0) - y) - n
    a1 = t * y + n
    k = N / (slope * length)
    to.K0 = to.K0 + wp.outer(a0, a0) * k
    to.K1 = to.K1 + wp.outer(a1, a1) * k
    to.K = to.K + wp.outer(a0, a1) * k
    return to


@wp.func
def between(u: wp.float64, a: Any, b: Any):
    """What is a at a point and b at the next, numbers or vectors, at the part u of the edge."""
    return a + (b - a) * u


@wp.func
def beneath(phi: wp.float64, ends: wp.float64, r: wp.float64, w: wp.float64):
    """e of a place of an edge [m]. ends: least distance of its points; r: what is kept from the collider [m]."""
    return r - phi - w - wp.max(-w, r - ends)


@wp.struct
class Site:
    """One of both places of an edge in all colliders: the deepest one, its normal force [N], y and the slope of s. more: what
    its friction goes by besides N [N], that of the other place in its collider where two colliders have a site each."""

    side: Side
    N: wp.float64
    more: wp.float64
    y: wp.float64
    slope: wp.float64


@wp.struct
class Pair:
    """The two colliders that press an edge most, with what [N], and where on it."""

    first: int
    second: int
    most: wp.float64
    less: wp.float64
    y: wp.float64
    z: wp.float64


@wp.func
def paired(to: Pair, c: int, N: wp.float64, y: wp.float64):
    """The pair behind one collider more."""
    if N > to.most:
        to.second = to.first
        to.less = to.most
        to.z = to.y
        to.first = c
        to.most = N
        to.y = y
    elif N > to.less:
        to.second = c
        to.less = N
        to.z = y
    return to


@wp.struct
class Edge:
    """The edge behind point i of strand k in the substep at, hh: h^2 [s^2], from x0 to x1 in the world [m]; reach: within which
    it meets anything [m]; had: T.edge; ends: least distance of its points [m]."""

    i: int
    k: int
    at: int
    hh: wp.float64
    x0: wp.vec3d
    x1: wp.vec3d
    reach: wp.float64
    had: int
    ends: wp.float64


@wp.struct
class Faced:
    """An edge in all colliders: forces, both sites, the two colliders that press it most, and what T.edge will be."""

    to: Inside
    first: Site
    second: Site
    pair: Pair
    now: int
