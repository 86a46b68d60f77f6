"""Forces of an implicit elastic step, their derivative along a direction, and the particles at its end.

    F' = (1 + L) F,  L = h C(v);   A = tau(F') (1 + L)^-T = P(F') F^T                 force matrix of a particle [Pa]
    m_i v_i = m_i v*_i - h V (4 / dx^2) sum_p w A (x_i - x_p)                         backward Euler: Jiang et al. 2016, ch. 10
    dF' = G F', G = dL M, M = (1 + L)^-1;  dA = U [H : (U^T G U S)] S U^T M^T

U, S = diag(s): principal axes and stretches of F'; H: second derivative of the energy in them (elastic_laws.py). Only the left
Cauchy-Green tensor of F is known, and no more is needed. A law with plastic flow is elastic within the step and flows at its
end.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.math.eigen import eigen_three
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.cpu.vectors import vector_transfers
from wsim.kernels.particles.mpm.implicit.elastic_laws import principal_function
from wsim.kernels.particles.mpm.motion import motion_functions
from wsim.kernels.particles.mpm.tables import point_tables
from wsim.kernels.particles.mpm.transfers import gather_function
from wsim.kernels.particles.mpm.walls import wall_functions

LEAST = wp.constant(0.05)          # stretches and changes of volume in a step, below which forces do not grow
WAY = wp.constant(1.0)             # cells that a particle may cross in a step
TURN = wp.constant(0.5)            # largest |h grad v|


@cache
def linear_rows(real):
    """Struct of what a particle's force depends on: see the top of this file."""
    t = types(real)

    @wp.struct
    class LinearRows:
        U: wp.array(dtype=t.mat33)
        M: wp.array(dtype=t.mat33)
        s: wp.array(dtype=t.vec3)
        D: wp.array(dtype=t.vec3)
        off: wp.array(dtype=t.vec3)
        flip: wp.array(dtype=t.vec3)
        twist: wp.array(dtype=t.vec3)

    return LinearRows


@cache
def force_functions(laws: tuple[str, ...], real) -> SimpleNamespace:
    """find_force(points, materials, p, h, C, linear) -> A, and what it depends on is kept; turn_force(linear, p, dL) -> dA."""
    t, T, Linear = types(real), point_tables(real), linear_rows(real)
    read_strain, find_principal = motion_functions(laws, real).read_strain, principal_function(laws, real)

    @wp.func
    def find_force(points: T.PointRows, materials: T.MaterialRows, p: int, h: real, C: t.mat33, linear: Linear):
        row = points.row[p]
        m = materials.numbers[row]
        one = wp.identity(n=3, dtype=real)
        K = one + h * C
        M = one
        if wp.determinant(K) > real(LEAST):
            M = wp.inverse(K)
        B = read_strain(points, p)
        d, U = eigen_three(K * B * wp.transpose(K) + h * (C + wp.transpose(C)) + (h * h) * (C * wp.transpose(C)))
        s = d
        for i in range(3):
            s[i] = wp.max(wp.sqrt(wp.max(real(1.0) + d[i], real(0.0))), real(LEAST))
        P, D, off, flip, twist = find_principal(materials.law[row], s, points.q[p], m)
        linear.U[p] = U
        linear.M[p] = M
        linear.s[p] = s
        linear.D[p] = D
        linear.off[p] = off
        linear.flip[p] = flip
        linear.twist[p] = twist
        A = (U * wp.diag(wp.cw_mul(P, s)) * wp.transpose(U)) * wp.transpose(M)
        return A + m[7] * (C + wp.transpose(C) - (real(2.0 / 3.0) * wp.trace(C)) * one)

    @wp.func
    def turn_force(linear: Linear, p: int, dL: t.mat33):
        U = linear.U[p]
        M = linear.M[p]
        s = linear.s[p]
        D = linear.D[p]
        off = linear.off[p]
        flip = linear.flip[p]
        twist = linear.twist[p]
        E = (wp.transpose(U) * (dL * M) * U) * wp.diag(s)
        half = real(0.5)
        x = half * flip[2] * (E[0, 1] + E[1, 0])
        y = half * flip[0] * (E[1, 2] + E[2, 1])
        z = half * flip[1] * (E[2, 0] + E[0, 2])
        a = half * twist[2] * (E[0, 1] - E[1, 0])
        b = half * twist[0] * (E[1, 2] - E[2, 1])
        c = half * twist[1] * (E[2, 0] - E[0, 2])
        P = t.mat33(D[0] * E[0, 0] + off[2] * E[1, 1] + off[1] * E[2, 2], x + a, z - c,
                    x - a, off[2] * E[0, 0] + D[1] * E[1, 1] + off[0] * E[2, 2], y + b,
                    z + c, y - b, off[1] * E[0, 0] + off[0] * E[1, 1] + D[2] * E[2, 2])
        return U * (P * wp.diag(s)) * wp.transpose(M * U)

    return SimpleNamespace(find_force=find_force, turn_force=turn_force)


@cache
def force_kernels(laws: tuple[str, ...], cpu: bool, real, module) -> SimpleNamespace:
    """Kernels over rows of the order: set_forces, at velocities v of nodes; multiply_forces, their change along velocities v.
    What nodes get of them is behind each other in `out`, or, on a CPU, added to `nodes`: impulses [kg m/s]."""
    t, T, Linear = types(real), point_tables(real), linear_rows(real)
    f, gather, vectors = force_functions(laws, real), gather_function(cpu, real), vector_transfers(real)

    @wp.func
    def gather_gradient(g: T.BlockGrid, points: T.PointRows, p: int, v: wp.array(dtype=t.vec4)):
        u = gather(g, g.block[p], points.i[p], points.j[p], points.k[p], points.o[p], v)
        return (real(4.0) / g.dx) * t.mat33(u[0, 1], u[0, 2], u[0, 3], u[1, 1], u[1, 2], u[1, 3], u[2, 1], u[2, 2], u[2, 3])

    @wp.func
    def give_impulse(g: T.BlockGrid, points: T.PointRows, n: int, p: int, h: real, A: t.mat33, out: T.SortedRows,
                     nodes: wp.array(dtype=t.vec4)):
        k = -real(4.0) * h * points.volume[p] / g.dx
        zero = real(0.0)
        if wp.static(cpu):
            vectors.scatter_row(g, g.block[p], points.i[p], points.j[p], points.k[p], points.o[p], t.mat44(
                zero, k * A[0, 0], k * A[0, 1], k * A[0, 2], zero, k * A[1, 0], k * A[1, 1], k * A[1, 2],
                zero, k * A[2, 0], k * A[2, 1], k * A[2, 2], zero, zero, zero, zero), nodes)
        else:
            out.x[n] = t.vec4(zero, k * A[0, 0], k * A[0, 1], k * A[0, 2])
            out.y[n] = t.vec4(zero, k * A[1, 0], k * A[1, 1], k * A[1, 2])
            out.z[n] = t.vec4(zero, k * A[2, 0], k * A[2, 1], k * A[2, 2])

    def set_forces(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, clock: wp.array(dtype=real),
                   v: wp.array(dtype=t.vec4), linear: Linear, out: T.SortedRows, nodes: wp.array(dtype=t.vec4)):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        C = gather_gradient(g, points, p, v)
        give_impulse(g, points, n, p, clock[0], f.find_force(points, materials, p, clock[0], C, linear), out, nodes)

    def multiply_forces(points: T.PointRows, materials: T.MaterialRows, g: T.BlockGrid, clock: wp.array(dtype=real),
                        v: wp.array(dtype=t.vec4), linear: Linear, out: T.SortedRows, nodes: wp.array(dtype=t.vec4)):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        C = gather_gradient(g, points, p, v)
        eta = materials.numbers[points.row[p]][7]
        A = f.turn_force(linear, p, clock[0] * C)
        A += eta * (C + wp.transpose(C) - (real(2.0 / 3.0) * wp.trace(C)) * wp.identity(n=3, dtype=real))
        give_impulse(g, points, n, p, clock[0], A, out, nodes)

    name = f"{'_'.join(laws)}_{'cpu_' * cpu}{t.name}"
    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{name}", module=module, enable_backward=False)
            for k in (set_forces, multiply_forces)}
    return SimpleNamespace(**made)


@cache
def finish_kernels(kinds: tuple[str, ...], laws: tuple[str, ...], cpu: bool, real, module) -> SimpleNamespace:
    """Kernels: finish_points over rows of the order, as `particle_kernel` of transfers.py; measure_motion over `threads` that
    take particles a stride apart: steps [1/s] that the fastest needs."""
    t, T, Colliders = types(real), point_tables(real), collider_type(real)
    f, wall, walls, gather = motion_functions(laws, real), wall_functions(kinds, real), bool(kinds), gather_function(cpu, real)

    @wp.func
    def motion_rate(speed: real, C: t.mat33, dx: real):
        return wp.max(speed / (real(WAY) * dx), wp.sqrt(wp.ddot(C, C)) / real(TURN))

    def measure_motion(points: T.PointRows, materials: T.MaterialRows, dx: real, dt: real, threads: int,
                       pace: wp.array(dtype=real)):
        most = real(0.0)
        for p in range(wp.tid(), points.row.shape[0], threads):
            speed = wp.length(points.v[p]) + dt * wp.length(materials.gravity[materials.world[points.row[p]]])
            most = wp.max(most, motion_rate(speed, points.C[p], dx))
        wp.atomic_max(pace, 0, most)

    def finish_points(g: T.BlockGrid, nodes: wp.array(dtype=t.vec4), materials: T.MaterialRows, c: Colliders,
                      clock: wp.array(dtype=real), points: T.PointRows, word: wp.array(dtype=int),
                      pace: wp.array(dtype=real)):
        n = wp.tid()
        if n >= g.used[1]:
            return
        p = g.order[n]
        i = points.i[p]
        j = points.j[p]
        k = points.k[p]
        o = points.o[p]
        u = gather(g, g.block[p], i, j, k, o, nodes)
        v = t.vec3(u[0, 0], u[1, 0], u[2, 0])
        s = real(4.0) / g.dx
        C = s * t.mat33(u[0, 1], u[0, 2], u[0, 3], u[1, 1], u[1, 2], u[1, 3], u[2, 1], u[2, 2], u[2, 3])
        h = clock[0]
        way = (h / g.dx) * v
        if wp.static(walls):
            if u[3, 0] > real(0.0):
                way, v = wall.stop_particle(c, t.vec3(real(i), real(j), real(k)) + o, way, v, clock[1], h, g.dx)
        points.v[p] = v
        points.C[p] = C
        f.deform_particle(points, materials, p, h, C, v, g.dx)
        f.shift_particle(points, p, i, j, k, o, way)
        need = motion_rate(wp.length(v), C, g.dx)
        if need > pace[1]:
            wp.atomic_max(pace, 1, need)
        limit = (1 << (g.bits + 1)) - 8                        # cells that a key has room for, to either side
        if wp.abs(i) > limit or wp.abs(j) > limit or wp.abs(k) > limit:
            word[2] = p + 1

    name = f"{'_'.join((*kinds, *laws))}_{'cpu_' * cpu}{t.name}"
    made = {k.__name__: wp.kernel(k, name=f"mpm_{k.__name__}_{name}", module=module, enable_backward=False)
            for k in (measure_motion, finish_points)}
    return SimpleNamespace(**made)
