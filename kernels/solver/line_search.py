"""How far to go along a Newton correction p: what Phi (kernels/solver/newton.py) changes by from d to d + t p, at several t at
once.

    inertia    own (t y.p + t^2 |p|^2 / 2),  y = d - b
    energy     1/2 (C_t - C_0) alpha^-1 (C_t + C_0)
    bending    kernels/cloth/curvature_line_search.py
    damping    (tau / g) (t r s + t^2 s^2 / 2) / alpha,  r = G.(d - a), s = G.p, with G at d: what the force there comes from

In float64 from the bits that d and p have, in differences, so that near the solution, where Phi hardly changes, the sign is
right in float32 too. The full step is taken where it brings FULL of what the quadratic model of Phi promises; else
halved ones are tried together and the best is taken; where none goes down, the body stays where it is
(Nocedal, Wright 2006, section 3.1). Each body decides for itself.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import Constraint, inverse_or_zero, membrane_constraint
from wsim.kernels.cloth.hessian import plane_stiffness
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.block import BLOCK
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_constants
from wsim.kernels.solver.newton import UNIT, newton_structs
from wsim.kernels.solver.pcg import block_sum

FULL = 0.05            # of f.y / 2: Newton's step brings all of it on a quadratic, none where it has jumped over the minimum
HALVINGS = 8           # steps 1/2 ... 1/256
ROUNDED = 4.0          # units of rounding of its place that a point may be off; what flies freely has 2 at most
D = types(wp.float64)


@wp.struct
class LineSearchTrial:
    """Which step each lane of each body looks at, and what it finds."""

    first: wp.array(dtype=int)                   # points of a body, or elements of one kind, (bodies + 1,)
    lanes: int                                   # of a body
    begin: int                                   # steps 2^-begin ... 2^-(end - 1)
    end: int
    step: wp.array(dtype=wp.float64)             # t of each body; < 0: undecided, (bodies,)
    change: wp.array2d(dtype=wp.float64)         # of Phi [J], (bodies lanes, 1 + HALVINGS)


@cache
def inertia_change_kernel(real, module):
    """Kernel over bodies times lanes: writes the change of the inertia's part."""
    t, s = types(real), newton_structs(real)

    @wp.kernel(module=module, enable_backward=False)
    def inertia_change(trial: LineSearchTrial, A: s.Matrix, d: wp.array(dtype=t.vec3), b: wp.array(dtype=t.vec3),
                       p: wp.array(dtype=t.vec3)):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        slope = wp.float64(0.0)
        curve = wp.float64(0.0)
        for i in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            own = wp.float64(A.own[i])
            pi = D.vec3(p[i])
            slope += own * wp.dot(D.vec3(d[i]) - D.vec3(b[i]), pi)
            curve += own * wp.dot(pi, pi)
        part = wp.float64(1.0)
        for k in range(trial.end):
            if k >= trial.begin:
                trial.change[row, k] = part * (slope + wp.float64(0.5) * part * curve)
            part *= wp.float64(0.5)

    return inertia_change


@wp.func
def stored_row(C: wp.float64, alpha: wp.float64, before: wp.float64, gamma: wp.float64, r: wp.float64, s: wp.float64):
    return inverse_or_zero(alpha) * (wp.float64(0.5) * (C - before) * (C + before) + gamma * s * (r + wp.float64(0.5) * s))


@cache
def elastic_change_kernel(constraint: Constraint, real, module):
    """Kernel over bodies times lanes: adds the change of the energy and damping of springs or triangles."""
    t, Batch = types(real), batch_of(constraint, real)
    n, formula, block = constraint.points - 1, constraint.formula, constraint.rows == 3
    rows = wp.types.matrix((n, 3), wp.float64)
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def relative_positions(ids: wp.types.vector(n + 1, int), x: vec3):
        X = rows()
        x0 = D.vec3(x[ids[0]])
        for k in range(n):
            X[k] = D.vec3(x[ids[k + 1]]) - x0
        return X

    @wp.func
    def change_row(batch: Batch, c: int, X: rows, V: rows, p: rows, rate: wp.float64, part: wp.float64):
        rest = wp.float64(batch.rest[c])
        C0, G = formula(X, rest)
        C, H = formula(X + part * p, rest)
        r = wp.float64(0.0)
        s = wp.float64(0.0)
        for k in range(n):
            r += wp.dot(G[k], V[k])
            s += part * wp.dot(G[k], p[k])
        return stored_row(C, wp.float64(batch.alpha[c]), C0, rate * wp.float64(batch.tau[c]), r, s)

    @wp.func
    def change_block(batch: Batch, c: int, X: rows, V: rows, p: rows, rate: wp.float64, part: wp.float64):
        B = D.mat22(batch.rest[c])
        C0, G1, G2 = membrane_constraint(X, B)
        C, H1, H2 = membrane_constraint(X + part * p, B)
        S = plane_stiffness(D.vec4(batch.alpha[c]))
        r = G1 * V[0] + G2 * V[1]
        s = part * (G1 * p[0] + G2 * p[1])
        half = wp.float64(0.5)
        return half * wp.dot(C - C0, S * (C + C0)) + rate * wp.float64(batch.tau[c]) * wp.dot(s, S * (r + half * s))

    change = change_block if block else change_row

    def elastic_change(trial: LineSearchTrial, batch: Batch, x: vec3, d: vec3, a: vec3, p: vec3, rate: wp.float64):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        for c in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            ids = batch.point[c]
            M = relative_positions(ids, d)
            X = relative_positions(ids, x) + M
            V = M - relative_positions(ids, a)
            Y = relative_positions(ids, p)
            part = wp.float64(1.0)
            for k in range(trial.end):
                if k >= trial.begin:
                    trial.change[row, k] = trial.change[row, k] + change(batch, c, X, V, Y, rate, part)
                part *= wp.float64(0.5)

    return wp.kernel(elastic_change, name=f"change_{constraint.name}_{t.name}", module=module, enable_backward=False)


@cache
def step_choice_kernel(real, module):
    """Kernel over bodies times a block of threads: the step of each body that has none yet."""

    def choose_step_length(trial: LineSearchTrial, drop: wp.array(dtype=wp.float64), step_out: wp.array(dtype=wp.float64)):
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() - body * wp.block_dim()
        if step_out[body] >= wp.float64(0.0):            # the same for every thread of the block
            return
        best = wp.float64(0.0)
        step = wp.float64(0.0)
        part = wp.float64(1.0)
        for k in range(trial.end):
            sum = wp.float64(0.0)
            for row in range(body * trial.lanes + lane, (body + 1) * trial.lanes, wp.block_dim()):
                sum += trial.change[row, k]
            sum = block_sum(sum)
            if sum < best:
                best = sum
                step = part
            part *= wp.float64(0.5)
        if trial.end == 1 and not best <= wp.float64(-0.5 * FULL) * drop[body]:
            step = wp.float64(-1.0)
        if lane == 0:
            step_out[body] = step

    return wp.kernel(choose_step_length, name=f"choose_{types(real).name}", module=module, enable_backward=False,
                     grid_stride=False, launch_bounds=BLOCK)


@cache
def line_step_kernel(real, module):
    """Kernel over points: d goes its body's step along p. object (points,): body of a point."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def move_along_correction(object: wp.array(dtype=int), step: wp.array(dtype=wp.float64), p: wp.array(dtype=t.vec3),
                              d: wp.array(dtype=t.vec3), d_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        part = step[object[i]]
        if part > wp.float64(0.0):                       # 0 times a p that is no number would be none either
            d_out[i] = d[i] + real(part) * p[i]

    return move_along_correction


@cache
def newton_residual_kernel(real, module):
    """Kernel over bodies times a block of threads: |f| over the size of own (d - b) and of the weights, root mean squares.

    1 where nothing was solved and elasticity matters, 0 where d is the solution. A body without any force: 0.
    """
    t, s, Constants = types(real), newton_structs(real), point_constants(real)

    def newton_residual(c: Constants, A: s.Matrix, first: wp.array(dtype=int), f: wp.array(dtype=t.vec3),
                        d: wp.array(dtype=t.vec3), b: wp.array(dtype=t.vec3), part_out: wp.array(dtype=real)):
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() - body * wp.block_dim()
        above = wp.float64(0.0)
        below = wp.float64(0.0)
        for i in range(first[body] + lane, first[body + 1], wp.block_dim()):
            if c.w[i] > real(0.0):
                above += wp.float64(wp.length_sq(f[i]))
                below += wp.float64(wp.length_sq(A.own[i] * (d[i] - b[i]))) + wp.float64(
                    wp.length_sq(c.gravity[c.object[i]]) / (c.w[i] * c.w[i]))
        above = block_sum(above)
        below = block_sum(below)
        if lane == 0:
            part_out[body] = real(wp.sqrt(above * inverse_or_zero(below)))

    return wp.kernel(newton_residual, name=f"left_{t.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=BLOCK)


@cache
def rounding_test_kernel(real, module):
    """Kernel over bodies times a block of threads: the residual of a body is 0 where each |f| <= own e, e being ROUNDED units
    of rounding of the point's place: as the matrix is own and what stiffness adds, f would then move no body by more than e in
    the norm of its masses. And where a body flies: it has no weight, no point has left its way b, or would go on by f beside
    others that stay, by more than e of its place and the mean size of all places. There forces of elements are those of places
    that are rounded, those of neighbours, too, and own (d - b), which f is compared with, is rounding."""
    t, s, Constants, unit = types(real), newton_structs(real), point_constants(real), real(ROUNDED * UNIT[real])

    def clear_rounded_residual(c: Constants, A: s.Matrix, first: wp.array(dtype=int), f: wp.array(dtype=t.vec3),
                               x: wp.array(dtype=t.vec3),
                               d: wp.array(dtype=t.vec3), b: wp.array(dtype=t.vec3), part_out: wp.array(dtype=real)):
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() - body * wp.block_dim()
        count = wp.float64(0.0)
        size = wp.float64(0.0)
        for i in range(first[body] + lane, first[body + 1], wp.block_dim()):
            size += wp.float64(wp.length(x[i]))
        mean = real(block_sum(size)) / real(wp.max(first[body + 1] - first[body], 1))
        for i in range(first[body] + lane, first[body + 1], wp.block_dim()):
            most = unit * (wp.length(x[i]) + wp.length(d[i]))
            if c.w[i] > real(0.0) and not wp.length(f[i]) <= A.own[i] * most:
                wide = most + unit * mean
                flies = wp.length(d[i] - b[i]) <= wide and wp.length(A.P[i] * f[i]) <= wide
                if not flies or wp.length_sq(c.gravity[c.object[i]]) > real(0.0):
                    count += wp.float64(1.0)
        count = block_sum(count)
        if lane == 0 and count == wp.float64(0.0):
            part_out[body] = real(0.0)

    return wp.kernel(clear_rounded_residual, name=f"rounded_{t.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=BLOCK)


@cache
def unmet_residual_kernel(real, module):
    """Kernel over bodies: status[each + body] becomes at least the residual, in percent, where that is above 1."""

    @wp.kernel(module=module, enable_backward=False)
    def report_unmet_residual(residual: wp.array(dtype=real), each: int, status: wp.array(dtype=int)):
        body = wp.tid()
        if not residual[body] <= real(1.0):
            status[each + body] = wp.max(status[each + body], int(wp.min(real(100.0) * residual[body], real(1.0e9))))

    return report_unmet_residual
