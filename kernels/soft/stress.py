"""Stress and strain of each tet, to look at: von Mises's of the Cauchy stress, and the size of the strain.

    sigma = P F^T / J        J = det F                                     (Bonet, Wood 2008, 5.45)
    von Mises = sqrt(3/2 s:s),   s = dev sym(sigma)        strain = |E|,   E = sym(R^T F) - 1

P is the elastic stress of kernels/soft/material.py: damping is not in it. A tet that is turned inside out has the stress of
|J|, and one that is flat that of |J| = FLAT, so that every number is finite. In float64.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import identity_like, polar_rotation
from wsim.kernels.soft import fem
from wsim.kernels.soft import material as materials
from wsim.kernels.soft.principal import clamp_entries, corotated_strain, symmetrised_matrix

FLAT = wp.constant(wp.float64(1.0e-3))
D = types(wp.float64)


@wp.func
def von_mises(P: D.mat33, F: D.mat33):
    """[Pa] of the first Piola-Kirchhoff stress P [Pa] at F."""
    sigma = symmetrised_matrix(P * wp.transpose(F)) / wp.max(wp.abs(wp.determinant(F)), FLAT)
    s = sigma - (wp.trace(sigma) / wp.float64(3.0)) * identity_like(F)
    return wp.sqrt(wp.float64(1.5) * wp.ddot(s, s))


@cache
def stress_point_functions(points: int, real):
    """Struct of the tets, and a function: H at evaluation point k, one a tet or four of a quadratic one."""
    t = types(real)
    if points == 1:
        gradient, Tets = fem.linear_displacement(real, wp.float64)[0], fem.elements(real)

        @wp.func
        def gradient_at_point(tets: Tets, k: int, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3)):
            return gradient(tets, k, x, d)
        return Tets, gradient_at_point
    from wsim.kernels.soft import shape10
    slopes, moved, _ = shape10.quadratic_displacement(real, wp.float64)
    Ten, gradient_of = shape10.elements(real), shape10.node_field_gradient

    @wp.func
    def at_one_of(tets: Ten, k: int, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3)):
        c = k // points
        return gradient_of(moved(tets, c, x, d), slopes(tets, c, k - points * c), tets.point.shape[1])
    return Ten, at_one_of


@cache
def von_mises_kernel(material: str, points: int, *, real, module):
    """Kernel over evaluation points, so many of each tet: (von Mises stress [Pa], |E|) at x + d, (points t,) vec2d.
    Arguments: tets, x, d, q, out."""
    t, law = types(real), materials.TABLE[material]
    (Tets, gradient), stress_of = stress_point_functions(points, real), law.stress
    vec3, quat, turns = wp.array(dtype=t.vec3), wp.array(dtype=t.quat), law.turns

    def von_mises_stress(tets: Tets, x: vec3, d: vec3, q: quat, out: wp.array(dtype=wp.vec2d)):
        k = wp.tid()
        H = gradient(tets, k, x, d)
        now = wp.normalize(D.quat(polar_rotation(t.mat33(H), q[k])))
        E = corotated_strain(H, now)
        if wp.static(not turns):
            now = D.quat(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        P = stress_of(H, now, wp.float64(tets.mu[k // points]), wp.float64(tets.lam[k // points]))
        out[k] = wp.vec2d(von_mises(P, identity_like(H) + clamp_entries(H)), wp.sqrt(wp.ddot(E, E)))

    return wp.kernel(von_mises_stress, name=f"stress_{material}_{points}_{t.name}", module=module, enable_backward=False)
