"""Shape functions of quadratic tetrahedra that are straight at rest: gradients of a field of nodes at four points of a tet.

    H_a = sum_k u_k n_ak^T,   u_k = (x_k - x_0) - r_k + (d_k - d_0)           F_a = 1 + H_a                   (a = 0 .. 3)

Nodes are four corners, then the middles of 01, 12, 02, 03, 13, 23. n_ak [1/m] is the gradient of node k's shape function at
point a (Zienkiewicz, Taylor, Zhu 2013, 6.2): with barycentric coordinates L and their gradients g, constant since edges are
straight at rest,

    corner i: L_i (2 L_i - 1), gradient (4 L_i - 1) g_i         middle of i, j: 4 L_i L_j, gradient 4 (L_i g_j + L_j g_i)

Point a has L_a = (5 + 3 sqrt 5)/20, others (5 - sqrt 5)/20, and a quarter of the volume (Hammer, Stroud 1956): exact to degree
2, so that small strain is integrated exactly. Four points see all 24 ways to strain: none costs nothing.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.real import types

NEAR = wp.constant(0.5854101966249685)      # L_a of point a
FAR = wp.constant(0.1381966011250105)       # its other three
NODES, POINTS = 10, 4                       # of a tet


@cache
def elements(real):
    """Struct of the tets: reads only."""
    t = types(real)

    @wp.struct
    class QuadraticTets:
        point: wp.array2d(dtype=int)             # (t, 10)
        edge: wp.array(dtype=t.mat33)            # rows r_1, r_2, r_3 [m], (t,)
        gradient: wp.array(dtype=t.mat33)        # rows g_1, g_2, g_3 [1/m], (t,)
        volume: wp.array(dtype=real)             # [m^3], (t,)
        mu: wp.array(dtype=real)                 # [Pa], (t,)
        lam: wp.array(dtype=real)                # [Pa], (t,)
        tau: wp.array(dtype=real)                # [s], (t,)
        force: int                               # place of the first node's force
        block: int                               # place of the first tet's blocks

    return QuadraticTets


@wp.func
def first_end(k: int):
    """The corner that node k is, or the first of the two that it lies between."""
    i = k
    if k > 6:
        i = k - 7
    elif k > 3:
        i = k - 4
    return i


@wp.func
def second_end(k: int):
    """As `first_end`, the second; of a corner the same."""
    j = k
    if k > 6:
        j = 3
    elif k > 3:
        j = (k - 3) % 3
    return j


@wp.func
def node_field_gradient(u: Any, N: Any, n: int):
    """sum_k u_k n_k^T over the n rows of both. A number that the compiler knows would be unrolled, at seconds of its time."""
    H = wp.outer(u[0], N[0])
    for k in range(1, n):
        H += wp.outer(u[k], N[k])
    return H


@cache
def quadratic_displacement(real, kept):
    """Functions, in precision `kept`, of tet c, (10, 3) each: n_ak of point a; u_k of x + d; a vector over points, less that of
    the first node. See `node_field_gradient`."""
    t, k, Tets = types(real), types(kept), elements(real)
    ten, vec3 = wp.types.matrix((NODES, 3), kept), wp.array(dtype=t.vec3)

    @wp.func
    def node_displacements(tets: Tets, c: int, x: vec3, d: vec3):
        edge = k.mat33(tets.edge[c])
        r = wp.matrix_from_rows(k.vec3(), edge[0], edge[1], edge[2])
        first = tets.point[c, 0]
        x0 = k.vec3(x[first])
        d0 = k.vec3(d[first])
        u = ten()
        n = tets.point.shape[1]
        for i in range(1, n):
            p = tets.point[c, i]
            at = kept(0.5) * (r[first_end(i)] + r[second_end(i)])
            u[i] = ((k.vec3(x[p]) - x0) - at) + (k.vec3(d[p]) - d0)
        return u

    @wp.func
    def node_vector_change(tets: Tets, c: int, v: vec3):
        v0 = k.vec3(v[tets.point[c, 0]])
        u = ten()
        n = tets.point.shape[1]
        for i in range(1, n):
            u[i] = k.vec3(v[tets.point[c, i]]) - v0
        return u

    @wp.func
    def quadratic_shape_gradients(tets: Tets, c: int, a: int):
        G = k.mat33(tets.gradient[c])
        g = wp.matrix_from_rows(-(G[0] + G[1] + G[2]), G[0], G[1], G[2])
        L = k.vec4(kept(FAR), kept(FAR), kept(FAR), kept(FAR))
        L[a] = kept(NEAR)
        N = ten()
        n = tets.point.shape[1]
        for m in range(n):
            i = first_end(m)
            j = second_end(m)
            N[m] = kept(4.0) * (L[i] * g[j] + L[j] * g[i])
            if i == j:
                N[m] = (kept(4.0) * L[i] - kept(1.0)) * g[i]
        return N

    return quadratic_shape_gradients, node_displacements, node_vector_change
