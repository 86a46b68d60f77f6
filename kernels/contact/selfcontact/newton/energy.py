"""Products of the Jacobian of contact rows with a vector, and what psi changes by along a step. Equations:
kernels/contact/selfcontact/newton/law.py."""

from functools import cache

import warp as wp

from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.newton.law import AHEAD, MOST, UNITS, contact_row_funcs, law_type, row_sum_func
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states
from wsim.kernels.solver.line_search import LineSearchTrial


@cache
def row_product_kernel(real, module):
    """Kernel over rows: sums of the product of their Jacobian with z."""
    t, Surfaces, Pairs, State, Laws = (types(real), pairs.surface_type(real), pairs.pair_type(real), point_states(real),
                                       law_type(real))
    (friction, levers, beside, share, _, _), add = contact_row_funcs(real), row_sum_func(real)
    points = wp.types.matrix((4, 3), real)

    @wp.kernel(module=module, enable_backward=False)
    def multiply_rows(s: Surfaces, at: State, near_at: wp.array(dtype=Pairs), threads: int, z: wp.array(dtype=t.vec3),
                      law: Laws):
        near = near_at[0]
        j = wp.tid()
        while j < near.rows[0]:
            rho = near.rho[j]
            if rho >= real(0.0):
                ids = near.four[j]
                b = near.swept[4 * j + pairs.B]
                there = near.swept[4 * j + pairs.NORMAL]
                n = t.vec3(there[0], there[1], there[2])
                r, D, K = levers(s, at, ids, b)
                d = points()
                for k in range(4):
                    if ids[k] < law.points and s.w[ids[k]] > real(0.0):
                        d[k] = z[ids[k]]
                u = beside(r, D, K, b, d)
                C = wp.dot(u, n)
                q = C * n
                if friction(s, ids, b)[0] > real(0.0):
                    across = u - C * n
                    if rho < real(1.0):
                        T = near.force[j] - wp.dot(near.force[j], n) * n
                        size = wp.dot(T, T)
                        if size > real(0.0):
                            across -= (wp.dot(across, T) / size) * T
                    q += rho * across
                q = (law.rate * near.stiff[j]) * q
                for k in range(4):
                    if ids[k] < law.points:
                        add(law, ids[k], share(r, D, K, b, q, k))
            j += threads

    return multiply_rows


@cache
def psi_change_kernel(real, module):
    """Kernel over rows: sums of what psi changes by along y, for the parts of a step that a line search looks at; and which
    rows that do not push would behind the whole step."""
    t, Surfaces, Pairs, State, Laws = (types(real), pairs.surface_type(real), pairs.pair_type(real), point_states(real),
                                       law_type(real))
    (friction, levers, beside, _, lacking, _) = contact_row_funcs(real)
    points = wp.types.matrix((4, 3), real)
    double = wp.float64

    @wp.func
    def augmented_energy(n: wp.vec3d, P: wp.vec3d, c: double):
        """2 k psi of P - k u."""
        lam = wp.dot(P, n)
        x = wp.length(P - lam * n)
        e = wp.max(lam, double(0.0)) * wp.max(lam, double(0.0))
        return e + wp.where(x <= c, x * x, c * (double(2.0) * x - c))

    @wp.kernel(module=module, enable_backward=False)
    def change_rows(s: Surfaces, at: State, near_at: wp.array(dtype=Pairs), begin: int, end: int, threads: int,
                    y: wp.array(dtype=t.vec3), law: Laws):
        near = near_at[0]
        j = wp.tid()
        while j < near.rows[0]:
            ids = near.four[j]
            unit = law.unit[s.world[ids[0]]]
            if near.stiff[j] > real(0.0) and unit > double(0.0):
                b = near.swept[4 * j + pairs.B]
                there = near.swept[4 * j + pairs.NORMAL]
                pushed = near.swept[4 * j + pairs.PUSH]
                n = wp.vec3d(t.vec3(there[0], there[1], there[2]))
                r, D, K = levers(s, at, ids, b)
                d = points()
                for k in range(4):
                    if ids[k] < law.points:
                        d[k] = law.ahead * y[ids[k]]
                stiff = double(near.stiff[j])
                P = wp.vec3d(t.vec3(pushed[0], pushed[1], pushed[2])) - stiff * wp.vec3d(lacking(s, at, near, law, j, r, D, K))
                way = stiff * wp.vec3d(beside(r, D, K, b, d))
                kept = near.force[j]
                c = double(wp.length(kept - wp.dot(kept, t.vec3(n)) * t.vec3(n)))
                if friction(s, ids, b)[0] > real(0.0) and near.rho[j] == real(1.0):
                    c = wp.max(c, double(friction(s, ids, b)[0] * wp.dot(kept, t.vec3(n))))
                if begin == 0 and near.rho[j] < real(0.0):
                    near.rho[j] = wp.where(wp.dot(P - way, n) > double(0.0), real(AHEAD), real(-1.0))
                before = augmented_energy(n, P, c)
                size = double(law.rate / (law.ahead * law.ahead)) / (double(2.0) * stiff * unit)
                part = double(1.0)
                for m in range(end):
                    if m >= begin:
                        gain = wp.clamp(size * (augmented_energy(n, P - part * way, c) - before), double(-MOST), double(MOST))
                        wp.atomic_add(law.change, s.world[ids[0]], m, wp.int64(double(UNITS) * gain))
                    part *= double(0.5)
            j += threads

    return change_rows


@cache
def world_change_kernel(real, module):
    """Kernel over worlds times parts of a step: the sums of `psi_change_kernel` go to the first lane of the world's first
    system."""
    Laws = law_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def tell_change(law: Laws, trial: LineSearchTrial, systems: int):
        world, m = wp.tid()
        row = world * systems * trial.lanes
        if m >= trial.begin and m < trial.end and trial.step[world * systems] < wp.float64(0.0):
            trial.change[row, m] = trial.change[row, m] + law.unit[world] * wp.float64(law.change[world, m]) / wp.float64(UNITS)
        law.change[world, m] = wp.int64(0)

    return tell_change
