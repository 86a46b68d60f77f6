"""Adjoint of the forces of linear tets without damping (kernels/fem.py), by hand and gathered.

With p_k the gradients by the forces of the corners and Y = sum_k (p_k - p_0) g_k^T, K is symmetric, and so the gradients by the
corners' positions are the forces of the stress dP(F; Y): an exact product with the stiffness. P is linear in mu and lam.
"""

from functools import cache

import warp as wp

from wsim.kernels import material as materials
from wsim.kernels.fem import displaced, elements, spread, turn_of
from wsim.kernels.real import types
from wsim.kernels.spring import net


@cache
def tet_adjoint(material: str, real, module, parameters: bool):
    """Kernel over tets: at the places of the corners' forces, gradients by the corners' positions take the places of those by
    the forces; parameters: adds those by mu and lam. Arguments: tets, x, d, q, corners, by."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    (gradient, _), turn = displaced(real, real), turn_of(material, real)
    derivative = materials.corotational_product if material == "corotational" else row.derivative
    stress, vec3 = row.stress, wp.array(dtype=t.vec3)

    def back(tets: Tets, x: vec3, d: vec3, q: wp.array(dtype=t.quat), corners: vec3, by: Tets):
        c = wp.tid()
        H = gradient(tets, c, x, d)
        now = turn(H, q[c])
        G = tets.gradient[c]
        V = tets.volume[c]
        at = tets.force + 4 * c
        p0 = corners[at]
        Y = wp.outer(corners[at + 1] - p0, G[0]) + wp.outer(corners[at + 2] - p0, G[1]) + wp.outer(corners[at + 3] - p0, G[2])
        spread(at, -V * derivative(H, now, Y, tets.mu[c], tets.lam[c]), G, corners)
        if wp.static(parameters):
            by.mu[c] = by.mu[c] - V * wp.ddot(stress(H, now, real(1.0), real(0.0)), Y)
            by.lam[c] = by.lam[c] - V * wp.ddot(stress(H, now, real(0.0), real(1.0)), Y)

    name = f"tet_adjoint_{material}{'_parameters' * parameters}_{t.name}"
    return wp.kernel(back, name=name, module=module, enable_backward=False)


@cache
def take(real, module):
    """Kernel over points: adds what stands at their corners, from place `first` to `last`, to the gradients by d and, where
    there is one, by x."""
    t, Net = types(real), net(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def take(net: Net, corners: vec3, first: int, last: int, by_d: vec3, by_x: vec3):
        i = wp.tid()
        sum = t.vec3()
        for c in range(net.first[i], net.first[i + 1]):
            at = net.item[c]
            if at >= first and at < last:
                sum += corners[at]
        by_d[i] = by_d[i] + sum
        if by_x:
            by_x[i] = by_x[i] + sum

    return take
