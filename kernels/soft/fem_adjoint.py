"""Adjoint of the forces of tets and of pressure (kernels/soft/fem.py, fem10.py, pressure.py), by hand and gathered.

With p_k the gradients by the forces of the nodes, Y = sum_k (p_k - p_0) n_k^T at each point of a tet: sum p_k.f_k = -V P : Y.
The stiffness is symmetric, and so the gradients by the nodes' positions are the forces of the stress dP(F; Y). Of the damping
tau F h(e), e = sym(F^T dF), h(e) = 2 mu e + lam tr e, they are those of

    by positions   tau (Y h(e) + dF h(s)),  s = sym(F^T Y)          by velocities   tau F h(s)

P is linear in mu, lam and tau. With Q and R those stresses, of positions and of velocities, the gradients by the edges at rest
r_k, which F, Y, dF and V are made of (dV = V sum_k g_k.dr_k, dg_j = -sum_k (g_j.dr_k) g_k), are

    V (F^T Q + Y^T P + dF^T R - P : Y) g_k

Of a pressure, f = p/6 (b - a) x (c - a) at each corner, with g the sum of the three gradients:

    by b   p/6 (c - a) x g,      by c   p/6 g x (b - a),      by a   minus both
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.cloth.corner_gradients import adjoint_works, corner_reader
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import identity_like
from wsim.kernels.soft import fem, pressure, shape10
from wsim.kernels.soft import material as materials
from wsim.kernels.soft.fem import turn_of
from wsim.kernels.soft.fem10 import spread_node_forces as spread_ten
from wsim.kernels.soft.material import hooke_stress
from wsim.kernels.soft.principal import clamp_entries, symmetrised_matrix
from wsim.kernels.soft.shape10 import NODES, POINTS


@wp.func
def damped_product(F: Any, dF: Any, Y: Any, mu: Any, lam: Any):
    """By F and by dF of Y : F h(sym(F^T dF))."""
    S = hooke_stress(symmetrised_matrix(wp.transpose(F) * Y), mu, lam)
    return Y * hooke_stress(symmetrised_matrix(wp.transpose(F) * dF), mu, lam) + dF * S, F * S


@cache
def tet_product_functions(material: str, real, damped: bool):
    """Functions of one point of a tet, of (H, q, dF, Y) and of (mu, lam, tau): the stresses Q and R that stand for positions
    and for velocities; and, of Q and R too, Y : P by mu, lam and tau with what gives the gradients by the edges at rest."""
    row = materials.TABLE[material]
    derivative = materials.corotational_product if material == "corotational" else row.derivative
    stress, M, quat, vec3 = row.stress, types(real).mat33, types(real).quat, types(real).vec3

    @wp.func
    def by_motion(H: M, q: quat, dF: M, Y: M, mu: real, lam: real, tau: real):
        Q = derivative(H, q, Y, mu, lam)
        R = M()
        if wp.static(damped):
            A, B = damped_product(identity_like(H) + clamp_entries(H), dF, Y, mu, lam)
            Q = Q + tau * A
            R = tau * B
        return Q, R

    @wp.func
    def by_parameters(H: M, q: quat, dF: M, Y: M, k: vec3, Q: M, R: M):
        F = identity_like(H) + clamp_entries(H)
        A = stress(H, q, real(1.0), real(0.0))
        B = stress(H, q, real(0.0), real(1.0))
        P = k[0] * A + k[1] * B
        m = wp.ddot(A, Y)
        n = wp.ddot(B, Y)
        r = real(0.0)
        K = wp.transpose(F) * Q
        if wp.static(damped):                            # Y : F h(e) = mu a + lam b
            e, s = symmetrised_matrix(wp.transpose(F) * dF), symmetrised_matrix(wp.transpose(F) * Y)
            a = real(2.0) * wp.ddot(e, s)
            b = wp.trace(e) * wp.trace(s)
            P = P + k[2] * (F * hooke_stress(e, k[0], k[1]))
            m += k[2] * a
            n += k[2] * b
            r = k[0] * a + k[1] * b
            K = K + wp.transpose(dF) * R
        return vec3(m, n, r), K + wp.transpose(Y) * P - (k[0] * m + k[1] * n) * identity_like(H)

    return by_motion, by_parameters


@wp.func
def add_tet_gradients(by: Any, c: int, s: Any, V: Any, K: Any, G: Any):
    """Adds gradients by mu, lam and tau of tet c, and by its edges at rest, V K g_k."""
    by.mu[c] = by.mu[c] + s[0]
    by.lam[c] = by.lam[c] + s[1]
    by.tau[c] = by.tau[c] + s[2]
    by.edge[c] = by.edge[c] + V * (G * wp.transpose(K))


@cache
def linear_adjoint_kernel(material: str, damped: bool, real, module, parameters: bool, direct: bool):
    """Kernel over tets of four nodes: at the places of the nodes' forces the gradients by their positions, and those by their
    velocities at `rates`; direct: of p, else of what stands at those places; parameters: adds by mu, lam, tau, edges.
    Arguments: tets, x, d, v, q, work, by."""
    t, Tets = types(real), fem.elements(real)
    (gradient, change), turn = fem.linear_displacement(real, real), turn_of(material, real)
    by_motion, by_parameters = tet_product_functions(material, real, damped)
    vec3, Work, by_force = wp.array(dtype=t.vec3), adjoint_works(real), corner_reader(real, direct)

    def linear_tet_adjoint(tets: Tets, x: vec3, d: vec3, v: vec3, q: wp.array(dtype=t.quat), w: Work, by: Tets):
        c = wp.tid()
        H = gradient(tets, c, x, d)
        now = turn(H, q[c])
        dF = t.mat33()
        tau = real(0.0)
        if wp.static(damped):
            dF = change(tets, c, v)
            tau = tets.tau[c]
        G = tets.gradient[c]
        V = -tets.volume[c]
        at = tets.force + 4 * c
        n = tets.point[c]
        p0 = by_force(w, n[0], at)
        Y = (wp.outer(by_force(w, n[1], at + 1) - p0, G[0]) + wp.outer(by_force(w, n[2], at + 2) - p0, G[1])
             + wp.outer(by_force(w, n[3], at + 3) - p0, G[2]))
        mu = tets.mu[c]
        lam = tets.lam[c]
        Q, R = by_motion(H, now, dF, Y, mu, lam, tau)
        fem.spread_corner_forces(at, V * Q, G, w.corners)
        if wp.static(damped):
            fem.spread_corner_forces(at, V * R, G, w.rates)
        if wp.static(parameters):
            moduli, K = by_parameters(H, now, dF, Y, t.vec3(mu, lam, tau), Q, R)
            add_tet_gradients(by, c, V * moduli, -V, K, G)

    return _soft_adjoint_kernel(linear_tet_adjoint, "tet", material, damped, real, module, parameters, direct)


@cache
def quadratic_adjoint_kernel(material: str, damped: bool, real, module, parameters: bool, direct: bool):
    """As `linear_adjoint_kernel`, of ten nodes."""
    t, Tets, turn = types(real), shape10.elements(real), turn_of(material, real)
    (slopes, moved, change), turns = shape10.quadratic_displacement(real, real), materials.TABLE[material].needs_rotation
    by_motion, by_parameters = tet_product_functions(material, real, damped)
    vec3, ten, Work, by_force = (wp.array(dtype=t.vec3), wp.types.matrix((NODES, 3), real), adjoint_works(real),
                                 corner_reader(real, direct))

    def quadratic_tet_adjoint(tets: Tets, x: vec3, d: vec3, v: vec3, q: wp.array(dtype=t.quat), work: Work, by: Tets):
        c = wp.tid()
        u = moved(tets, c, x, d)
        nodes = tets.point.shape[1]
        at = tets.force + nodes * c
        y = ten()
        w = ten()
        f = ten()
        r = ten()
        moduli = t.vec3()
        K = t.mat33()
        mu = tets.mu[c]
        lam = tets.lam[c]
        tau = real(0.0)
        y0 = by_force(work, tets.point[c, 0], at)
        for k in range(1, nodes):
            y[k] = by_force(work, tets.point[c, k], at + k) - y0
        if wp.static(damped):
            w = change(tets, c, v)
            tau = tets.tau[c]
        points = int(POINTS)
        for a in range(points):
            N = slopes(tets, c, a)
            H = shape10.node_field_gradient(u, N, nodes)
            Y = shape10.node_field_gradient(y, N, nodes)
            dF = shape10.node_field_gradient(w, N, nodes)
            now = t.quat(real(0.0), real(0.0), real(0.0), real(1.0))
            if wp.static(turns):
                now = turn(H, q[4 * c + a])
            Q, R = by_motion(H, now, dF, Y, mu, lam, tau)
            for k in range(nodes):
                f[k] += Q * N[k]
                r[k] += R * N[k]
            if wp.static(parameters):
                more, edges = by_parameters(H, now, dF, Y, t.vec3(mu, lam, tau), Q, R)
                moduli += more
                K += edges
        V = real(-0.25) * tets.volume[c]
        spread_ten(at, nodes, V, f, work.corners)
        if wp.static(damped):
            spread_ten(at, nodes, V, r, work.rates)
        if wp.static(parameters):
            add_tet_gradients(by, c, V * moduli, -V, K, tets.gradient[c])

    return _soft_adjoint_kernel(quadratic_tet_adjoint, "ten", material, damped, real, module, parameters, direct)


@cache
def pressure_adjoint_kernel(real, module, parameters: bool, direct: bool):
    """As `linear_adjoint_kernel`, of triangles under pressure. Arguments: triangles, x, d, work, by."""
    t, Triangles = types(real), pressure.pressure_tables(real)
    vec3, Work, by_force = wp.array(dtype=t.vec3), adjoint_works(real), corner_reader(real, direct)

    def pressure_force_adjoint(tri: Triangles, x: vec3, d: vec3, w: Work, by: Triangles):
        c = wp.tid()
        p = tri.point[c]
        u = (x[p[1]] - x[p[0]]) + (d[p[1]] - d[p[0]])
        v = (x[p[2]] - x[p[0]]) + (d[p[2]] - d[p[0]])
        at = tri.force + 3 * c
        g = (by_force(w, p[0], at) + by_force(w, p[1], at + 1) + by_force(w, p[2], at + 2)) / real(6.0)
        b = tri.pressure[c] * wp.cross(v, g)
        e = tri.pressure[c] * wp.cross(g, u)
        w.corners[at] = -(b + e)
        w.corners[at + 1] = b
        w.corners[at + 2] = e
        if wp.static(parameters):
            by.pressure[c] = by.pressure[c] + wp.dot(g, wp.cross(u, v))

    return _soft_adjoint_kernel(pressure_force_adjoint, "pressed", "", False, real, module, parameters, direct)


def _soft_adjoint_kernel(function, kind: str, material: str, damped: bool, real, module, parameters: bool, direct: bool):
    """Two kernels of one name would be one."""
    name = "_".join(["adjoint", kind, material, *["damped"] * damped, *["parameters"] * parameters, *["direct"] * direct,
                     types(real).name])
    return wp.kernel(function, name=name, module=module, enable_backward=False)
