"""Quadratic tetrahedra: forces of ten nodes, blocks of the stiffness, energy. As kernels/soft/fem.py, at four points of a tet.

    f_k = -V/4 sum_a P_a n_ak,   f_0 = -(f_1 + .. + f_9)          A_kl = V/4 sum_a dP/dF_a contracted with n_ak and n_al

n_ak gradients of the shape functions at point a (kernels/soft/shape10.py), P_a and dP_a of kernels/soft/material.py at F_a,
each point with a rotation of its own; dP its positive part. With C_mn, dP/dF contracted with the axes m and n of the rest
shape,

    A_kl = sum_a sum_m n_akm (sum_n n_aln C_amn)

Where the solution is smooth displacements converge by third order, stresses by second. Damping and rounding as in fem.py.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.hessian import elements_of
from wsim.kernels.math.marks import writes_all
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import identity_like, polar_rotation
from wsim.kernels.soft import material as materials
from wsim.kernels.soft.fem import D, rate_block, rate_stress, stretch_block, symmetric_halves, turn_of
from wsim.kernels.soft.principal import clamp_entries, corotated_strain, rotate_matrix
from wsim.kernels.soft.shape10 import NODES, POINTS, elements, node_field_gradient, quadratic_displacement
from wsim.kernels.solver.line_search import LineSearchTrial


@wp.func
def contract_blocks(n: Any, C: Any):
    """sum_m n_m C_m of three blocks that stand under each other in C, (9, 3)."""
    return wp.matrix_from_rows(n[0] * C[0] + n[1] * C[3] + n[2] * C[6], n[0] * C[1] + n[1] * C[4] + n[2] * C[7],
                               n[0] * C[2] + n[1] * C[5] + n[2] * C[8])


@wp.func
def spread_node_forces(at: int, n: int, part: Any, f: Any, f_out: Any):
    """Rows of f times `part` to the nodes from place `at` on; the first node gets minus the sum of the others."""
    sum = type(f[0])()
    for i in range(1, n):
        f_out[at + i] = part * f[i]
        sum += part * f[i]
    f_out[at] = -sum


@cache
def forces(material: str, damped: bool, *, real, module):
    """Kernel over tets: forces [N] of node k of tet c at `force` + 10 c + k, and quaternions of the rotations of its points,
    (4 t,). The kernel's arguments are those of `fem.forces`: tets, x, d, v, q, f_out, q_out."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    (slopes, moved, change), stress = quadratic_displacement(real, real), row.stress
    turn, turns = turn_of(material, real), row.needs_rotation
    vec3, quat, ten = wp.array(dtype=t.vec3), wp.array(dtype=t.quat), wp.types.matrix((NODES, 3), real)

    def quadratic_tet_forces(tets: Tets, x: vec3, d: vec3, v: vec3, q: quat, f_out: vec3, q_out: quat):
        c = wp.tid()
        mu = tets.mu[c]
        lam = tets.lam[c]
        f = ten()
        u = moved(tets, c, x, d)
        nodes = tets.point.shape[1]
        points = int(POINTS)
        for a in range(points):
            N = slopes(tets, c, a)
            H = node_field_gradient(u, N, nodes)
            now = t.quat(real(0.0), real(0.0), real(0.0), real(1.0))
            if wp.static(turns):
                now = turn(H, q[4 * c + a])
                q_out[4 * c + a] = now
            P = stress(H, now, mu, lam)
            if wp.static(damped):
                P += tets.tau[c] * rate_stress(identity_like(H) + clamp_entries(H),
                                               node_field_gradient(change(tets, c, v), N, nodes), mu, lam)
            for k in range(nodes):
                f[k] += P * N[k]
        spread_node_forces(tets.force + 10 * c, nodes, real(-0.25) * tets.volume[c], f, f_out)

    name = f"quadratic_forces_{material}{'_damped' * damped}_{t.name}"
    return writes_all(wp.kernel(quadratic_tet_forces, name=name, module=module, enable_backward=False))


@cache
def linearise(material: str, damped: bool, *, real, module):
    """Kernel over tets: forces as `forces` has them, and the blocks A_01, A_02 .. A_09, A_12 .. A_89 [N/m] of tet c from
    `block` + 45 c on. `rate` 1/g: what the damping is multiplied by."""
    t, Tets, Elements, row = types(real), elements(real), elements_of(real), materials.TABLE[material]
    (slopes, moved, change), turn, stress, spectrum = (quadratic_displacement(real, real), turn_of(material, real), row.stress,
                                                       row.spectrum)
    vec3, quat, ten = wp.array(dtype=t.vec3), wp.array(dtype=t.quat), wp.types.matrix((NODES, 3), real)
    all_axes, one_axis = wp.types.matrix((27, 3), real), wp.types.matrix((9, 3), real)

    def linearise_quadratic_tets(tets: Tets, x: vec3, d: vec3, a: vec3, q: quat, rate: real, q_out: quat, out: Elements):
        c = wp.tid()
        mu = tets.mu[c]
        lam = tets.lam[c]
        part = real(0.25) * tets.volume[c]
        s = rate * tets.tau[c]
        f = ten()
        u = moved(tets, c, x, d)
        C = all_axes()
        Cn = one_axis()
        axes = wp.identity(n=3, dtype=real)
        three = int(3)
        points = int(POINTS)
        nodes = tets.point.shape[1]
        for e in range(points):
            N = slopes(tets, c, e)
            H = node_field_gradient(u, N, nodes)
            now = turn(H, q[4 * c + e])
            q_out[4 * c + e] = now
            P = stress(H, now, mu, lam)
            V, A, B = spectrum(H, now, mu, lam)
            S, T = symmetric_halves(B)
            U = rotate_matrix(now, V)
            F = identity_like(H) + clamp_entries(H)
            for m in range(three):
                for n in range(three):
                    K = part * (U * stretch_block(A, S, T, V[m], V[n]) * wp.transpose(U))
                    if wp.static(damped):
                        K += (s * part) * (F * rate_block(axes[m], axes[n], mu, lam) * wp.transpose(F))
                    for r in range(3):
                        C[9 * n + 3 * m + r] = K[r]
            if wp.static(damped):
                P += s * rate_stress(F, node_field_gradient(change(tets, c, d) - change(tets, c, a), N, nodes), mu, lam)
            for k in range(nodes):
                f[k] += P * N[k]
            for j in range(1, nodes):
                for k in range(three * three):
                    Cn[k] = N[j, 0] * C[k] + N[j, 1] * C[9 + k] + N[j, 2] * C[18 + k]
                for i in range(j):
                    K = contract_blocks(N[i], Cn)
                    at = tets.block + 45 * c + i * (17 - i) // 2 + j - 1
                    if e > 0:
                        K += out.block[at]
                    out.block[at] = K
        spread_node_forces(tets.force + 10 * c, nodes, -part, f, out.force)
    return wp.kernel(linearise_quadratic_tets, name=f"quadratic_linearise_{material}{'_damped' * damped}_{t.name}",
                     module=module, enable_backward=False)


@cache
def energy_change(material: str, damped: bool, *, real, module):
    """Kernel over bodies times lanes: adds the change of energy and damping along p to a `LineSearchTrial`; see
    `fem.energy_change`."""
    t, Tets, energy = types(real), elements(real), materials.TABLE[material].energy
    slopes, moved, change = quadratic_displacement(real, wp.float64)
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    def quadratic_energy_change(trial: LineSearchTrial, tets: Tets, x: vec3, d: vec3, a: vec3, p: vec3, q: quat,
                                rate: wp.float64):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        lane = row - body * trial.lanes
        nodes = tets.point.shape[1]
        none = D.quat(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        for k in range(4 * trial.first[body] + lane, 4 * trial.first[body + 1], trial.lanes):
            c = k // 4
            N = slopes(tets, c, k - 4 * c)
            H = node_field_gradient(moved(tets, c, x, d), N, nodes)
            Y = node_field_gradient(change(tets, c, p), N, nodes)
            mu = wp.float64(tets.mu[c])
            lam = wp.float64(tets.lam[c])
            volume = wp.float64(0.25) * wp.float64(tets.volume[c])
            before = wp.float64(0.0)
            slope = wp.float64(0.0)
            curve = wp.float64(0.0)
            if wp.static(damped):
                P = rate_stress(identity_like(H) + clamp_entries(H), Y, mu, lam)
                s = rate * wp.float64(tets.tau[c])
                slope = s * wp.ddot(P, node_field_gradient(change(tets, c, d) - change(tets, c, a), N, nodes))
                curve = wp.float64(0.5) * s * wp.ddot(P, Y)
            part = wp.float64(0.0)
            for j in range(trial.begin, trial.end + 1):      # first where it is now, then every trial: compiled once
                psi = energy(H + part * Y, none, mu, lam)
                if j == trial.begin:
                    before = psi
                    part = wp.float64(1.0) / wp.float64(1 << trial.begin)
                else:
                    more = volume * ((psi - before) + part * (slope + part * curve))
                    trial.change[row, j - 1] = trial.change[row, j - 1] + more
                    part *= wp.float64(0.5)

    name = f"quadratic_change_{material}{'_damped' * damped}_{t.name}"
    return wp.kernel(quadratic_energy_change, name=name, module=module, enable_backward=False)


@cache
def statistics(material: str, *, real, module):
    """Kernel over any number of threads: as `fem.statistics`, of all points of the tets."""
    t, Tets, row = types(real), elements(real), materials.TABLE[material]
    (slopes, moved, _), energy = quadratic_displacement(real, wp.float64), row.energy
    vec3, quat = wp.array(dtype=t.vec3), wp.array(dtype=t.quat)

    def quadratic_statistics(tets: Tets, count: int, worlds: int, x: vec3, d: vec3, q: quat, out: wp.array(dtype=wp.vec3d)):
        lanes = out.shape[0] // worlds
        world = wp.tid() // lanes
        each = count // worlds
        most = wp.float64(0.0)
        squares = wp.float64(0.0)
        stored = wp.float64(0.0)
        for k in range(4 * world * each + wp.tid() % lanes, 4 * (world + 1) * each, lanes):
            c = k // 4
            H = node_field_gradient(moved(tets, c, x, d), slopes(tets, c, k - 4 * c), tets.point.shape[1])
            now = wp.normalize(D.quat(polar_rotation(t.mat33(H), q[k])))
            E = corotated_strain(H, now)
            ee = wp.ddot(E, E)
            volume = wp.float64(0.25) * wp.float64(tets.volume[c])
            most = wp.max(most, wp.sqrt(ee))
            squares += ee * volume
            stored += volume * energy(H, now, wp.float64(tets.mu[c]), wp.float64(tets.lam[c]))
        out[wp.tid()] = wp.vec3d(most, squares, stored)

    return wp.kernel(quadratic_statistics, name=f"quadratic_statistics_{material}_{t.name}", module=module,
                     enable_backward=False)
