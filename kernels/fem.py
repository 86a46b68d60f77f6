"""Linear tetrahedra: displacement gradient, forces of corners, products with the stiffness. Points gather the corners' parts.

    H = sum_k (u_k - u_0) g_k^T,  k = 1, 2, 3      f_k = -V P g_k,   f_0 = -(f_1 + f_2 + f_3)      (Sifakis, Barbic 2012, 4.2)
    (K v)_k = V dP(sum_l (v_l - v_0) g_l^T) g_k

u displacement from rest [m]; g_k [1/m] the rows of Dm^-1 at rest, gradients of the barycentric coordinates; V volume at rest
[m^3]; P and dP from kernels/material.py: dP is the positive part of the stiffness, so K is symmetric and never negative. All
corner forces of a tet sum to zero to the last bit but one: f_0 is made of the others.
"""

from functools import cache

import warp as wp

from wsim.kernels import material as materials
from wsim.kernels.real import types
from wsim.kernels.rotation import rotation
from wsim.kernels.stretch import response


@cache
def elements(real):
    """Struct of the tets: reads only."""
    t = types(real)

    @wp.struct
    class Tets:
        point: wp.array(dtype=wp.vec4i)          # (t,)
        gradient: wp.array(dtype=t.mat33)        # rows g_1, g_2, g_3 [1/m], (t,)
        volume: wp.array(dtype=real)             # [m^3], (t,)
        mu: wp.array(dtype=real)                 # [Pa], (t,)
        lam: wp.array(dtype=real)                # [Pa], (t,)

    return Tets


@cache
def tangents(material: str, real):
    """Struct of what `product` reads of a state: the rotation, and T of corotational or V, A, B of the others."""
    t = types(real)

    @wp.struct
    class Short:
        q: wp.array(dtype=t.quat)                # quaternion (x, y, z, w), (t,)
        T: wp.array(dtype=t.mat33)               # [Pa], (t,)

    @wp.struct
    class Whole:
        q: wp.array(dtype=t.quat)
        V: wp.array(dtype=t.mat33)
        A: wp.array(dtype=t.mat33)               # [Pa]
        B: wp.array(dtype=t.mat33)               # [Pa]

    return Short if material == "corotational" else Whole


@cache
def _gradient(real):
    """Function: sum_k (a_k - a_0) g_k^T of tet c for a vector a over points."""
    t, Tets = types(real), elements(real)

    @wp.func
    def gradient(tets: Tets, c: int, a: wp.array(dtype=t.vec3)):
        p = tets.point[c]
        a0 = a[p[0]]
        D = wp.matrix_from_cols(a[p[1]] - a0, a[p[2]] - a0, a[p[3]] - a0)
        return D * tets.gradient[c]

    return gradient


@cache
def _spread(real):
    """Function: scale P g_k to the corners 1, 2, 3 of tet c, and minus their sum to corner 0."""
    t, Tets = types(real), elements(real)

    @wp.func
    def spread(tets: Tets, c: int, P: t.mat33, scale: real, f_out: wp.array(dtype=t.vec3)):
        G = tets.gradient[c]
        Q = (scale * tets.volume[c]) * P
        f1 = Q * G[0]
        f2 = Q * G[1]
        f3 = Q * G[2]
        f_out[4 * c] = -(f1 + f2 + f3)
        f_out[4 * c + 1] = f1
        f_out[4 * c + 2] = f2
        f_out[4 * c + 3] = f3

    return spread


@cache
def forces(material: str, *, real, module):
    """Kernel over tets: forces [N] of corner k of tet c at 4 c + k, (4 t,), and the quaternions of their rotations, (t,).

    The kernel's arguments: tets, u, q (the quaternions of a nearby state; zeros stand for none), f_out, q_out."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    gradient, spread, stress, turns = _gradient(real), _spread(real), row.stress, row.needs_rotation

    def forces(tets: Tets, u: wp.array(dtype=t.vec3), q: wp.array(dtype=t.quat), f_out: wp.array(dtype=t.vec3),
               q_out: wp.array(dtype=t.quat)):
        c = wp.tid()
        H = gradient(tets, c, u)
        turn = t.quat(real(0.0), real(0.0), real(0.0), real(1.0))
        if wp.static(turns):
            turn = rotation(H, q[c])
            q_out[c] = turn
        spread(tets, c, stress(H, turn, tets.mu[c], tets.lam[c]), real(-1.0), f_out)

    return wp.kernel(forces, name=f"fem_forces_{material}_{t.name}", module=module, enable_backward=False)


@cache
def energies(material: str, *, real, module):
    """Kernel over tets: energy [J] of each, (t,) float64. Arguments: tets, u, q (see `forces`), energy_out."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    gradient, energy, turns = _gradient(real), row.energy, row.needs_rotation

    def energies(tets: Tets, u: wp.array(dtype=t.vec3), q: wp.array(dtype=t.quat), energy_out: wp.array(dtype=wp.float64)):
        c = wp.tid()
        H = gradient(tets, c, u)
        turn = t.quat(real(0.0), real(0.0), real(0.0), real(1.0))
        if wp.static(turns):
            turn = rotation(H, q[c])
        energy_out[c] = wp.float64(tets.volume[c]) * wp.float64(energy(H, turn, tets.mu[c], tets.lam[c]))

    return wp.kernel(energies, name=f"fem_energies_{material}_{t.name}", module=module, enable_backward=False)


@cache
def tangent(material: str, *, real, module):
    """Kernel over tets: `tangents` at u. Arguments: tets, u, q (see `forces`), tangent_out."""
    t, Tets, Tangent, row = types(real), elements(real), tangents(material, real), materials.TABLE[material]
    gradient, spectrum, twist, turns = _gradient(real), row.spectrum, materials.twist, row.turns
    short = material == "corotational"

    def tangent(tets: Tets, u: wp.array(dtype=t.vec3), q: wp.array(dtype=t.quat), tangent_out: Tangent):
        c = wp.tid()
        H = gradient(tets, c, u)
        turn = t.quat(real(0.0), real(0.0), real(0.0), real(1.0))
        if wp.static(turns):
            turn = rotation(H, q[c])
        tangent_out.q[c] = turn
        if wp.static(short):
            tangent_out.T[c] = twist(H, turn, tets.mu[c], tets.lam[c], real(0.0))
        else:
            V, A, B = spectrum(H, turn, tets.mu[c], tets.lam[c])
            tangent_out.V[c] = V
            tangent_out.A[c] = A
            tangent_out.B[c] = B

    return wp.kernel(tangent, name=f"fem_tangent_{material}_{t.name}", module=module, enable_backward=False)


@cache
def product(material: str, *, real, module):
    """Kernel over tets: parts of K v at their corners, (4 t,), in units of v times N/m. Arguments: tets, tangent, v, f_out."""
    t, Tets, Tangent = types(real), elements(real), tangents(material, real)
    gradient, spread, corotational = _gradient(real), _spread(real), materials.corotational_response
    short = material == "corotational"

    def product(tets: Tets, tangent: Tangent, v: wp.array(dtype=t.vec3), f_out: wp.array(dtype=t.vec3)):
        c = wp.tid()
        dF = gradient(tets, c, v)
        q = tangent.q[c]
        if wp.static(short):
            P = corotational(q, tangent.T[c], dF, tets.mu[c], tets.lam[c])
        else:
            P = response(q, tangent.V[c], tangent.A[c], tangent.B[c], dF)
        spread(tets, c, P, real(1.0), f_out)

    return wp.kernel(product, name=f"fem_product_{material}_{t.name}", module=module, enable_backward=False)


@cache
def gather(*, real, module):
    """Kernel over points: the sum of the corners' parts. Arguments: start (points + 1,) and item, places 4 c + k of each
    point's corners as `wsim.tetra.tets.corners` has them; f, sum_out."""
    t = types(real)

    def gather(start: wp.array(dtype=int), item: wp.array(dtype=int), f: wp.array(dtype=t.vec3),
               sum_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        total = t.vec3()
        for k in range(start[i], start[i + 1]):
            total += f[item[k]]
        sum_out[i] = total

    return wp.kernel(gather, name=f"fem_gather_{t.name}", module=module, enable_backward=False)
