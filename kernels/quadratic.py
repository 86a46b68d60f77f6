"""Quadratic tetrahedra, straight at rest: forces of ten nodes, blocks of the stiffness, energy. fem.py, at four points a tet.

    H_a = sum_k u_k n_ak^T,   u_k = (x_k - x_0) - r_k + (d_k - d_0)           F_a = 1 + H_a                   (a = 0 .. 3)
    f_k = -V/4 sum_a P_a n_ak,   f_0 = -(f_1 + .. + f_9)          A_kl = V/4 sum_a dP/dF_a contracted with n_ak and n_al

Nodes are four corners, then the middles of 01, 12, 02, 03, 13, 23. n_ak [1/m] is the gradient of node k's shape function at
point a (Zienkiewicz, Taylor, Zhu 2013, 6.2): with barycentric coordinates L and their gradients g, constant since edges are
straight at rest,

    corner i: L_i (2 L_i - 1), gradient (4 L_i - 1) g_i         middle of i, j: 4 L_i L_j, gradient 4 (L_i g_j + L_j g_i)

Point a has L_a = (5 + 3 sqrt 5)/20, others (5 - sqrt 5)/20, and a quarter of the volume (Hammer, Stroud 1956): exact to degree
2, so small strain is integrated exactly. Four points see all 24 ways to strain; none costs nothing. Each point has a
rotation of its own. Displacements converge by third order, stresses by second; materials, damping and rounding as in fem.py.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels import material as materials
from wsim.kernels.descent import Trial
from wsim.kernels.fem import D, halves, rate_block, rate_stress, stretch_block
from wsim.kernels.fem import _turn as turn_of
from wsim.kernels.real import types
from wsim.kernels.rotation import identity, rotation
from wsim.kernels.stretch import forth, held, strain
from wsim.kernels.tangent import elements_of

NEAR = wp.constant(0.5854101966249685)      # L_a of point a
FAR = wp.constant(0.1381966011250105)       # its other three
NODES, POINTS, PAIRS = 10, 4, 45            # of a tet


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


@cache
def displaced(real, kept):
    """Functions, in precision `kept`, of tet c, (10, 3) each: u_k of x + d; those of a vector over points; n_ak of point a.
    Loops go by variables: unrolled, they would take seconds more to compile."""
    t, k, Tets = types(real), types(kept), elements(real)
    ten, vec3 = wp.types.matrix((NODES, 3), kept), wp.array(dtype=t.vec3)

    @wp.func
    def moved(tets: Tets, c: int, x: vec3, d: vec3):
        edge = k.mat33(tets.edge[c])
        r = wp.matrix_from_rows(k.vec3(), edge[0], edge[1], edge[2])
        first = tets.point[c, 0]
        x0 = k.vec3(x[first])
        d0 = k.vec3(d[first])
        u = ten()
        n = int(NODES)
        for i in range(1, n):
            p = tets.point[c, i]
            at = kept(0.5) * (r[first_end(i)] + r[second_end(i)])
            u[i] = ((k.vec3(x[p]) - x0) - at) + (k.vec3(d[p]) - d0)
        return u

    @wp.func
    def change(tets: Tets, c: int, v: vec3):
        v0 = k.vec3(v[tets.point[c, 0]])
        u = ten()
        n = int(NODES)
        for i in range(1, n):
            u[i] = k.vec3(v[tets.point[c, i]]) - v0
        return u

    @wp.func
    def slopes(tets: Tets, c: int, a: int):
        G = k.mat33(tets.gradient[c])
        g = wp.matrix_from_rows(-(G[0] + G[1] + G[2]), G[0], G[1], G[2])
        L = k.vec4(kept(FAR), kept(FAR), kept(FAR), kept(FAR))
        L[a] = kept(NEAR)
        N = ten()
        n = int(NODES)
        for m in range(n):
            i = first_end(m)
            j = second_end(m)
            N[m] = kept(4.0) * (L[i] * g[j] + L[j] * g[i])
            if i == j:
                N[m] = (kept(4.0) * L[i] - kept(1.0)) * g[i]
        return N

    return moved, change, slopes


@wp.func
def spread(at: int, f: Any, f_out: Any):
    """Rows of f to the nodes from place `at` on; the first node gets minus the sum of the others."""
    n = int(NODES)
    sum = type(f[0])()
    for i in range(1, n):
        f_out[at + i] = f[i]
        sum += f[i]
    f_out[at] = -sum


@cache
def forces(material: str, damped: bool, *, real, module):
    """Kernel over tets: forces [N] of node k of tet c at `force` + 10 c + k, and quaternions of the rotations of its points,
    (4 t,). The kernel's arguments are those of `fem.forces`: tets, x, d, v, q, f_out, q_out."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    (moved, change, slopes), stress = displaced(real, real), row.stress
    turn, turns = turn_of(material, real), row.needs_rotation
    vec3, quat, ten = wp.array(dtype=t.vec3), wp.array(dtype=t.quat), wp.types.matrix((NODES, 3), real)

    def forces(tets: Tets, x: vec3, d: vec3, v: vec3, q: quat, f_out: vec3, q_out: quat):
        c = wp.tid()
        u = moved(tets, c, x, d)
        mu = tets.mu[c]
        lam = tets.lam[c]
        f = ten()
        points = int(POINTS)
        for a in range(points):
            N = slopes(tets, c, a)
            H = wp.transpose(u) * N
            now = t.quat(real(0.0), real(0.0), real(0.0), real(1.0))
            if wp.static(turns):
                now = turn(H, q[4 * c + a])
                q_out[4 * c + a] = now
            P = stress(H, now, mu, lam)
            if wp.static(damped):
                dF = wp.transpose(change(tets, c, v)) * N
                P += tets.tau[c] * rate_stress(identity(H) + held(H), dF, mu, lam)
            f -= N * (real(0.25) * tets.volume[c] * wp.transpose(P))
        spread(tets.force + 10 * c, f, f_out)

    name = f"quadratic_forces_{material}{'_damped' * damped}_{t.name}"
    return wp.kernel(forces, name=name, module=module, enable_backward=False)


@cache
def linearise(material: str, damped: bool, *, real, module):
    """Kernel over tets: forces as `forces` has them, and the blocks A_01, A_02 .. A_09, A_12 .. A_89 [N/m] of tet c from
    `block` + 45 c on. `rate` 1/g: what the damping is multiplied by."""
    t, Tets, Elements, row = types(real), elements(real), elements_of(real), materials.TABLE[material]
    moved, change, slopes = displaced(real, real)
    stress, spectrum, turn = row.stress, row.spectrum, turn_of(material, real)
    vec3, quat, ten = wp.array(dtype=t.vec3), wp.array(dtype=t.quat), wp.types.matrix((NODES, 3), real)

    def linearise(tets: Tets, x: vec3, d: vec3, a: vec3, q: quat, rate: real, q_out: quat, out: Elements):
        c = wp.tid()
        u = moved(tets, c, x, d)
        mu = tets.mu[c]
        lam = tets.lam[c]
        part = real(0.25) * tets.volume[c]
        s = rate * tets.tau[c]
        f = ten()
        points = int(POINTS)
        nodes = int(NODES)
        for e in range(points):
            N = slopes(tets, c, e)
            H = wp.transpose(u) * N
            now = turn(H, q[4 * c + e])
            q_out[4 * c + e] = now
            P = stress(H, now, mu, lam)
            V, A, B = spectrum(H, now, mu, lam)
            Y = N * V
            S, T = halves(B)
            U = forth(now, V)
            F = identity(H) + held(H)
            if wp.static(damped):
                dF = wp.transpose(change(tets, c, d) - change(tets, c, a)) * N
                P += s * rate_stress(F, dF, mu, lam)
            f -= N * (part * wp.transpose(P))
            at = tets.block + 45 * c
            for i in range(nodes):
                for j in range(i + 1, nodes):
                    K = part * (U * stretch_block(A, S, T, Y[i], Y[j]) * wp.transpose(U))
                    if wp.static(damped):
                        K += (s * part) * (F * rate_block(N[i], N[j], mu, lam) * wp.transpose(F))
                    if e > 0:
                        K += out.block[at]
                    out.block[at] = K
                    at += 1
        spread(tets.force + 10 * c, f, out.force)

    name = f"quadratic_linearise_{material}{'_damped' * damped}_{t.name}"
    return wp.kernel(linearise, name=name, module=module, enable_backward=False)


@cache
def energy_change(material: str, damped: bool, *, real, module):
    """Kernel over bodies times lanes: adds the change of energy and damping along p to a `Trial`; see `fem.energy_change`."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    (moved, change, slopes), energy = displaced(real, wp.float64), row.energy
    turn, turns = turn_of(material, real), row.needs_rotation
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    @wp.func
    def density(H: D.mat33, q: t.quat, mu: wp.float64, lam: wp.float64):
        now = q
        if wp.static(turns):
            now = turn(t.mat33(H), q)
        return energy(H, wp.normalize(D.quat(now)), mu, lam), now

    def energy_change(trial: Trial, tets: Tets, x: vec3, d: vec3, a: vec3, p: vec3, q: quat, rate: wp.float64):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        lane = row - body * trial.lanes
        for k in range(4 * trial.first[body] + lane, 4 * trial.first[body + 1], trial.lanes):
            c = k // 4
            N = slopes(tets, c, k - 4 * c)
            H = wp.transpose(moved(tets, c, x, d)) * N
            Y = wp.transpose(change(tets, c, p)) * N
            mu = wp.float64(tets.mu[c])
            lam = wp.float64(tets.lam[c])
            volume = wp.float64(0.25) * wp.float64(tets.volume[c])
            before = wp.float64(0.0)
            now = q[k]
            slope = wp.float64(0.0)
            curve = wp.float64(0.0)
            if wp.static(damped):
                P = rate_stress(identity(H) + held(H), Y, mu, lam)
                s = rate * wp.float64(tets.tau[c])
                slope = s * wp.ddot(P, wp.transpose(change(tets, c, d) - change(tets, c, a)) * N)
                curve = wp.float64(0.5) * s * wp.ddot(P, Y)
            part = wp.float64(0.0)
            for j in range(trial.begin, trial.end + 1):      # first where it is now, then every trial: compiled once
                psi, now = density(H + part * Y, now, mu, lam)
                if j == trial.begin:
                    before = psi
                    part = wp.float64(1.0) / wp.float64(1 << trial.begin)
                else:
                    more = volume * ((psi - before) + part * (slope + part * curve))
                    trial.change[row, j - 1] = trial.change[row, j - 1] + more
                    part *= wp.float64(0.5)

    name = f"quadratic_change_{material}{'_damped' * damped}_{t.name}"
    return wp.kernel(energy_change, name=name, module=module, enable_backward=False)


@cache
def statistics(material: str, *, real, module):
    """Kernel over any number of threads: as `fem.statistics`, of all points of the tets."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    (moved, _, slopes), energy = displaced(real, wp.float64), row.energy
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    def statistics(tets: Tets, count: int, x: vec3, d: vec3, q: quat, out: wp.array(dtype=wp.vec3d)):
        most = wp.float64(0.0)
        squares = wp.float64(0.0)
        stored = wp.float64(0.0)
        for k in range(wp.tid(), 4 * count, out.shape[0]):
            c = k // 4
            H = wp.transpose(moved(tets, c, x, d)) * slopes(tets, c, k - 4 * c)
            now = wp.normalize(D.quat(rotation(t.mat33(H), q[k])))
            E = strain(H, now)
            ee = wp.ddot(E, E)
            volume = wp.float64(0.25) * wp.float64(tets.volume[c])
            most = wp.max(most, wp.sqrt(ee))
            squares += ee * volume
            stored += volume * energy(H, now, wp.float64(tets.mu[c]), wp.float64(tets.lam[c]))
        out[wp.tid()] = wp.vec3d(most, squares, stored)

    return wp.kernel(statistics, name=f"quadratic_statistics_{material}_{t.name}", module=module, enable_backward=False)
