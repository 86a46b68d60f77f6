"""Linear tetrahedra: forces of corners, blocks of the stiffness, energy. Points gather what belongs to them: no atomics.

    H = sum_k ((x_k - x_0) - r_k + (d_k - d_0)) g_k^T,  k = 1, 2, 3        F = 1 + H       (Sifakis, Barbic 2012, 4.2)
    f_k = -V P g_k,   f_0 = -(f_1 + f_2 + f_3)            A_kl = V dP/dF contracted with g_k and g_l

x + d positions [m], r_k edges at rest from corner 0 [m], g_k [1/m] gradients of the barycentric coordinates, V volume at rest
[m^3]; P and dP of kernels/soft/material.py, dP its positive part, so A is never negative. All corner forces of a tet sum to
zero to the last bit but one: f_0 is made of the others. Differences of x come first: far from the origin nothing is lost.

Damping, tau [s]: P += tau F (2 mu e + lam tr e), e = sym(F^T dF/dt) the rate of Green's strain, dF/dt from (d - a) / g, a the
anchor. It leaves rigid motion alone, is positive, and is that of Kelvin and Voigt, tau K v, at rest.

With dF = a g_l^T in the frame W = R V of the stretches, b = W^T a, h = V^T g_l, g = V^T g_k, the stiffness of principal.py is

    V W (A o g h^T + T o h g^T + diag(S (g o h))) W^T,     S, T = (f +- t)/2 off the diagonal, o entry by entry
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.hessian import elements_of
from wsim.kernels.math.marks import writes_all
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import identity_like, polar_rotation
from wsim.kernels.soft import material as materials
from wsim.kernels.soft.material import hooke_stress
from wsim.kernels.soft.principal import clamp_entries, corotated_strain, rotate_matrix, symmetrised_matrix
from wsim.kernels.solver.line_search import LineSearchTrial

D = types(wp.float64)


@cache
def elements(real):
    """Struct of the tets: reads only."""
    t = types(real)

    @wp.struct
    class LinearTets:
        point: wp.array(dtype=wp.vec4i)          # (t,)
        edge: wp.array(dtype=t.mat33)            # rows r_1, r_2, r_3 [m], (t,)
        gradient: wp.array(dtype=t.mat33)        # rows g_1, g_2, g_3 [1/m], (t,)
        volume: wp.array(dtype=real)             # [m^3], (t,)
        mu: wp.array(dtype=real)                 # [Pa], (t,)
        lam: wp.array(dtype=real)                # [Pa], (t,)
        tau: wp.array(dtype=real)                # [s], (t,)
        force: int                               # place of the first corner's force
        block: int                               # place of the first tet's blocks

    return LinearTets


@cache
def linear_displacement(real, kept):
    """Functions, in precision `kept`, of tet c: H of x + d, and the gradient of a vector over points."""
    t, k, Tets = types(real), types(kept), elements(real)

    @wp.func
    def displacement_gradient(tets: Tets, c: int, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3)):
        p = tets.point[c]
        r = tets.edge[c]
        x0 = k.vec3(x[p[0]])
        d0 = k.vec3(d[p[0]])
        u = k.mat33()
        for i in range(3):
            u[i] = ((k.vec3(x[p[i + 1]]) - x0) - k.vec3(r[i])) + (k.vec3(d[p[i + 1]]) - d0)
        return wp.transpose(u) * k.mat33(tets.gradient[c])

    @wp.func
    def gradient_of_vector(tets: Tets, c: int, v: wp.array(dtype=t.vec3)):
        p = tets.point[c]
        v0 = k.vec3(v[p[0]])
        u = k.mat33()
        for i in range(3):
            u[i] = k.vec3(v[p[i + 1]]) - v0
        return wp.transpose(u) * k.mat33(tets.gradient[c])

    return displacement_gradient, gradient_of_vector


@wp.func
def rate_stress(F: Any, dF: Any, mu: Any, lam: Any):
    """F (2 mu e + lam tr e), e = sym(F^T dF)."""
    return F * hooke_stress(symmetrised_matrix(wp.transpose(F) * dF), mu, lam)


@wp.func
def rate_block(g: Any, h: Any, mu: Any, lam: Any):
    """M of the block F M F^T of `rate_stress`: mu g.h + mu h g^T + lam g h^T."""
    m = mu * wp.dot(g, h)
    return wp.diag(wp.vector(m, m, m)) + mu * wp.outer(h, g) + lam * wp.outer(g, h)


@wp.func
def symmetric_halves(B: Any):
    """S, T: (f + t)/2 and (f - t)/2 of each pair, 0 on the diagonal; f stands above it in B, t below."""
    half = type(B[0, 0])(0.5)
    S = half * (B + wp.transpose(B))
    T = half * (B - wp.transpose(B))
    for i in range(3):
        for j in range(i):
            T[i, j] = T[j, i]
    return S, T


@wp.func
def spread_corner_forces(at: int, Q: Any, G: Any, f_out: Any):
    """Q g_k to the corners 1, 2, 3 from place `at` on, minus their sum to corner 0."""
    f1 = Q * G[0]
    f2 = Q * G[1]
    f3 = Q * G[2]
    f_out[at] = -(f1 + f2 + f3)
    f_out[at + 1] = f1
    f_out[at + 2] = f2
    f_out[at + 3] = f3


@wp.func
def stretch_block(A: Any, S: Any, T: Any, g: Any, h: Any):
    """A o g h^T + T o h g^T + diag(S (g o h))."""
    return wp.cw_mul(A, wp.outer(g, h)) + wp.cw_mul(T, wp.outer(h, g)) + wp.diag(S * wp.cw_mul(g, h))


@cache
def turn_of(material: str, real):
    """Function: quaternion of the rotation at H, or (0, 0, 0, 1) where the material never turns."""
    t, turns = types(real), materials.TABLE[material].turns

    @wp.func
    def identity_rotation(H: t.mat33, q: t.quat):
        return t.quat(real(0.0), real(0.0), real(0.0), real(1.0))

    @wp.func
    def follow_rotation(H: t.mat33, q: t.quat):
        return polar_rotation(H, q)

    return follow_rotation if turns else identity_rotation


@cache
def tet_force_function(material: str, damped: bool, real):
    """Function of tet c: what `forces` does for it."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    (gradient, change), stress, turn, turns = (linear_displacement(real, real), row.stress, turn_of(material, real),
                                               row.needs_rotation)
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    @wp.func
    def tet_force(tets: Tets, c: int, x: vec3, d: vec3, v: vec3, q: quat, f_out: vec3, q_out: quat):
        H = gradient(tets, c, x, d)
        now = t.quat(real(0.0), real(0.0), real(0.0), real(1.0))
        if wp.static(turns):
            now = turn(H, q[c])
            q_out[c] = now
        P = stress(H, now, tets.mu[c], tets.lam[c])
        if wp.static(damped):
            P += tets.tau[c] * rate_stress(identity_like(H) + clamp_entries(H), change(tets, c, v), tets.mu[c], tets.lam[c])
        spread_corner_forces(tets.force + 4 * c, -tets.volume[c] * P, tets.gradient[c], f_out)

    return tet_force


@cache
def forces(material: str, damped: bool, *, real, module):
    """Kernel over tets: forces [N] of corner k of tet c at `tet_force_function` + 4 c + k, and quaternions of their rotations,
    (t,).

    The kernel's arguments: tets, x, d, v (velocities [m/s]), q (of a nearby state; zeros stand for none), f_out, q_out."""
    t, Tets, one = types(real), elements(real), tet_force_function(material, damped, real)
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    def tet_forces(tets: Tets, x: vec3, d: vec3, v: vec3, q: quat, f_out: vec3, q_out: quat):
        one(tets, wp.tid(), x, d, v, q, f_out, q_out)

    name = f"fem_forces_{material}{'_damped' * damped}_{t.name}"
    return writes_all(wp.kernel(tet_forces, name=name, module=module, enable_backward=False))


@cache
def linearise(material: str, damped: bool, *, real, module):
    """Kernel over tets: forces as `forces` has them, and the blocks A_01, A_02, A_03, A_12, A_13, A_23 [N/m] of tet c from
    `block` + 6 c on. `rate` 1/g: what the damping is multiplied by."""
    t, Tets, Elements, row = types(real), elements(real), elements_of(real), materials.TABLE[material]
    gradient, change = linear_displacement(real, real)
    stress, spectrum, turn = row.stress, row.spectrum, turn_of(material, real)
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    def linearise_tets(tets: Tets, x: vec3, d: vec3, a: vec3, q: quat, rate: real, q_out: quat, out: Elements):
        c = wp.tid()
        H = gradient(tets, c, x, d)
        mu = tets.mu[c]
        lam = tets.lam[c]
        now = turn(H, q[c])
        q_out[c] = now
        P = stress(H, now, mu, lam)
        G = tets.gradient[c]
        V, A, B = spectrum(H, now, mu, lam)
        Y = G * V
        S, T = symmetric_halves(B)
        U = tets.volume[c] * rotate_matrix(now, V)
        W = wp.transpose(rotate_matrix(now, V))
        F = identity_like(H) + clamp_entries(H)
        s = rate * tets.tau[c]
        if wp.static(damped):
            P += s * rate_stress(F, change(tets, c, d) - change(tets, c, a), mu, lam)
        spread_corner_forces(tets.force + 4 * c, -tets.volume[c] * P, G, out.force)
        at = tets.block + 6 * c
        three = int(3)                                    # a variable: nine blocks unrolled take a second more to compile
        for j in range(three):
            sum = t.mat33()
            for i in range(three):
                K = U * stretch_block(A, S, T, Y[i], Y[j]) * W
                if wp.static(damped):
                    K += (s * tets.volume[c]) * (F * rate_block(G[i], G[j], mu, lam) * wp.transpose(F))
                sum += K
                if i < j:
                    out.block[at + 2 + i + j] = K         # A_12, A_13, A_23
            out.block[at + j] = -sum                      # A_0j

    name = f"fem_linearise_{material}{'_damped' * damped}_{t.name}"
    return wp.kernel(linearise_tets, name=name, module=module, enable_backward=False)


@cache
def energy_change(material: str, damped: bool, *, real, module):
    """Kernel over bodies times lanes: adds the change of energy and damping along p to a `LineSearchTrial`; see
    kernels/solver/line_search.py. In float64; no energy needs a rotation, q is not read."""
    t, Tets, energy = types(real), elements(real), materials.TABLE[material].energy
    gradient, change = linear_displacement(real, wp.float64)
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    def tet_energy_change(trial: LineSearchTrial, tets: Tets, x: vec3, d: vec3, a: vec3, p: vec3, q: quat, rate: wp.float64):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        none = D.quat(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        for c in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            H = gradient(tets, c, x, d)
            Y = change(tets, c, p)
            mu = wp.float64(tets.mu[c])
            lam = wp.float64(tets.lam[c])
            volume = wp.float64(tets.volume[c])
            before = wp.float64(0.0)
            slope = wp.float64(0.0)
            curve = wp.float64(0.0)
            if wp.static(damped):
                F = identity_like(H) + clamp_entries(H)
                P = rate_stress(F, Y, mu, lam)
                s = rate * wp.float64(tets.tau[c])
                slope = s * wp.ddot(P, change(tets, c, d) - change(tets, c, a))
                curve = wp.float64(0.5) * s * wp.ddot(P, Y)
            part = wp.float64(0.0)
            for j in range(trial.begin, trial.end + 1):      # first where it is now, then every trial: compiled once
                psi = energy(H + part * Y, none, mu, lam)
                k = j - 1
                if j == trial.begin:
                    before = psi
                    part = wp.float64(1.0) / wp.float64(1 << trial.begin)
                else:
                    trial.change[row, k] = trial.change[row, k] + volume * ((psi - before) + part * (slope + part * curve))
                    part *= wp.float64(0.5)

    name = f"fem_change_{material}{'_damped' * damped}_{t.name}"
    return wp.kernel(tet_energy_change, name=name, module=module, enable_backward=False)


@cache
def statistics(material: str, *, real, module):
    """Kernel over any number of threads: of each one's share of the tets the largest |E|, E = sym(R^T F) - 1, the sum of
    |E|^2 V [m^3], and the energy [J], (threads,) vec3d, as many threads for each world. Arguments: tets, count,
    worlds, x, d, q, out."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    (gradient, _), energy = linear_displacement(real, wp.float64), row.energy
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    def tet_statistics(tets: Tets, count: int, worlds: int, x: vec3, d: vec3, q: quat, out: wp.array(dtype=wp.vec3d)):
        lanes = out.shape[0] // worlds
        world = wp.tid() // lanes
        each = count // worlds
        most = wp.float64(0.0)
        squares = wp.float64(0.0)
        stored = wp.float64(0.0)
        for c in range(world * each + wp.tid() % lanes, (world + 1) * each, lanes):
            H = gradient(tets, c, x, d)
            now = wp.normalize(D.quat(polar_rotation(t.mat33(H), q[c])))
            E = corotated_strain(H, now)
            ee = wp.ddot(E, E)
            volume = wp.float64(tets.volume[c])
            most = wp.max(most, wp.sqrt(ee))
            squares += ee * volume
            stored += volume * energy(H, now, wp.float64(tets.mu[c]), wp.float64(tets.lam[c]))
        out[wp.tid()] = wp.vec3d(most, squares, stored)

    return wp.kernel(tet_statistics, name=f"fem_statistics_{material}_{t.name}", module=module, enable_backward=False)
