"""Sums over the neighbours of a fluid's particle: density, its slope, pushes, and velocities that pairs exchange.

    V W(r) / S = a q^3,   V W'(r) / S = -(3 a / H) q^2,   q = 1 - r / H,   a = 15 / (8 pi S)          see density.py

A place and a number of a particle stand in one vector of four, so that a neighbour is one read. Sums run in the order of the
list. A CPU takes eight particles together (packets/sums.py).
"""

from functools import cache
from math import pi
from types import SimpleNamespace
from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.position_based.grains import pair_normal_func
from wsim.kernels.position_based.neighbours import neighbour_structs

REACHED = 2.0          # H over d
LATTICE = 1.2359       # S, of the cubic lattice
WEIGHT = 15.0 / (8.0 * pi * LATTICE)      # a
SLOPE = -3.0 * WEIGHT
NEAREST = 0.1          # of d: distance below which pairs part, however thin the fluid
FEW = 0.93             # 1 / c of flow.py
RUB = -SLOPE * LATTICE / FEW              # of flow.py
MOST_RUBBED = 0.1      # of a difference of velocity, by viscosity, of one pair a substep: what nearly meets is not thrown


@wp.func
def kernel_weight(r: Any, H: Any):
    """V W(r) / S, for V = (H / 2)^3."""
    q = wp.max(type(r)(1.0) - r / H, type(r)(0.0))
    return type(r)(WEIGHT) * q * q * q


@wp.func
def kernel_slope(r: Any, H: Any):
    """V W'(r) / S [1/m]."""
    q = wp.max(type(r)(1.0) - r / H, type(r)(0.0))
    return type(r)(SLOPE) * q * q / H


READ = """
#if defined(__CUDA_ARCH__)
    {read}
#else
    return at.data[k];
#endif
"""
READS = {wp.float32: "const float4 p = ((const float4*)at.data)[k]; return wp::vec_t<4, float>(p.x, p.y, p.z, p.w);",
         wp.float64: "const double2 p = ((const double2*)at.data)[2 * k], q = ((const double2*)at.data)[2 * k + 1]; "
                     "return wp::vec_t<4, double>(p.x, p.y, q.x, q.y);"}
ROOT = """
#if defined(__CUDA_ARCH__)
    return {root}(square);
#else
    const {real} one = 1;
    return one / wp::sqrt(square);
#endif
"""


@cache
def device_reads(real) -> SimpleNamespace:
    """place(at, k): the four numbers of a place in one read, where Warp has four; inverse_root(square): 1 / sqrt, on a GPU by
    its instruction (2 units in the last place), where a root and a division take ten times as many."""
    t = types(real)
    name, root = ("float", "rsqrtf") if real is wp.float32 else ("double", "rsqrt")

    @wp.func_native(READ.format(read=READS[real]))
    def read_place(at: wp.array(dtype=t.vec4), k: int) -> t.vec4: ...

    @wp.func_native(ROOT.format(root=root, real=name))
    def inverse_root(square: real) -> real: ...

    return SimpleNamespace(place=read_place, inverse_root=inverse_root)


@cache
def pair_sums(real) -> SimpleNamespace:
    """Functions of a place k, for places `at` (vectors of four) and lists:

    density(at, lists, k, d)       (sum_j V W_ij / S with that of itself, sum_j G_ij, sum_j |G_ij|^2)
    push(at, lists, k, d)          (sum_j (c_i + c_j) G_ij, sum_j (NEAREST d - r) e of what is nearer), c: the fourth number
    flow(y, v, lists, k, d, h)     sum_j of flow.py; fourth numbers: mu / rho of y, s of v
    """
    t, N, normal, reads = types(real), neighbour_structs(real), pair_normal_func(real), device_reads(real)
    places, place, inverse_root = wp.array(dtype=t.vec4), reads.place, reads.inverse_root

    @wp.func
    def pair_direction(way: t.vec3, square: real, i: int, j: int):
        if square > real(0.0):
            over = inverse_root(square)
            return over * way, square * over
        e, r = normal(way, i, j)
        return e, r

    @wp.func
    def density_of_pairs(at: places, lists: N.PairLists, k: int, d: real):
        H = real(REACHED) * d
        one = real(1.0) / H
        own = place(at, k)
        weight = real(1.0)
        G = t.vec3()
        square = real(0.0)
        for s in range(lists.count[k]):
            j = lists.other[s * lists.size + k]
            far = own - place(at, j)
            way = t.vec3(far[0], far[1], far[2])
            rr = wp.length_sq(way)
            if rr < H * H:
                e, r = pair_direction(way, rr, k, j)
                q = real(1.0) - r * one
                qq = q * q
                weight += qq * q
                G += qq * e
                square += qq * qq
        slope = real(SLOPE) * one
        return real(WEIGHT) * weight, slope * G, slope * slope * square

    @wp.func
    def push_of_pairs(at: places, lists: N.PairLists, k: int, d: real):
        H = real(REACHED) * d
        one = real(1.0) / H
        own = place(at, k)
        move = t.vec3()
        apart = t.vec3()
        for s in range(lists.count[k]):
            j = lists.other[s * lists.size + k]
            far = place(at, j)
            way = t.vec3(own[0] - far[0], own[1] - far[1], own[2] - far[2])
            rr = wp.length_sq(way)
            if rr < H * H:
                e, r = pair_direction(way, rr, k, j)
                q = real(1.0) - r * one
                move += ((own[3] + far[3]) * q * q) * e
                apart += wp.max(real(NEAREST) * d - r, real(0.0)) * e
        return (real(SLOPE) * one) * move, apart

    @wp.func
    def flow_of_pairs(y: places, v: places, lists: N.PairLists, k: int, d: real, h: real):
        H = real(REACHED) * d
        one = real(1.0) / H
        own = place(y, k)
        u = place(v, k)
        given = t.vec3()
        for s in range(lists.count[k]):
            j = lists.other[s * lists.size + k]
            far = place(y, j)
            way = t.vec3(own[0] - far[0], own[1] - far[1], own[2] - far[2])
            rr = wp.length_sq(way)
            if rr < H * H and rr > real(0.0):
                other = place(v, j)
                over = inverse_root(rr)
                r = rr * over
                q = real(1.0) - r * one
                rubbed = real(RUB) * h * (own[3] + far[3]) * one * q * q * over
                lack = t.vec3(other[0] - u[0], other[1] - u[1], other[2] - u[2])
                part = real(1.5) * real(WEIGHT) * (u[3] + other[3]) * q * q * q * wp.dot(lack, way) * over * over
                given += wp.min(rubbed, real(MOST_RUBBED)) * lack + part * way
        return given

    return SimpleNamespace(density=density_of_pairs, push=push_of_pairs, flow=flow_of_pairs)
