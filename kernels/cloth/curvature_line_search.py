"""How far to go along a Newton correction, of bending: what kernels/solver/line_search.py is for other energies, in two passes.

    energy     1/2 (C_t - C_0).(C_t + C_0) of the curvatures of triangles (kernels/cloth/curvature.py), and of each hinge
               1/2 k q (D^2 - f^2) less that at d
    damping    s.(r + s/2),  r and s the sums that C is, of (tau / g)^1/2 k^1/2 f' G.(d - a) and of the same with t p, f' and G
               at d; and of each hinge q (1 - f'^2) times the same of (tau / g)^1/2 k^1/2 G.(d - a) and t p

Hinges add what they have without others, and leave k^1/2 f at d and at each step that is tried, in float64.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import DIHEDRAL, dihedral_constraint, inverse_or_zero
from wsim.kernels.cloth.curvature import SLOTS, folded_angle, sheet_curvatures
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types
from wsim.kernels.solver.line_search import HALVINGS, LineSearchTrial

FIRST = 3              # column of the whole step: those before are z at d, and r and s of damping
COLUMNS = FIRST + 1 + HALVINGS
D = types(wp.float64)


@cache
def hinge_searches(real):
    """Struct of hinges."""

    @wp.struct
    class Looks:
        own: wp.array(dtype=real)                    # of `Curvatures`
        found: wp.array2d(dtype=wp.float64)          # z, r, s and z of each step, (hinges, COLUMNS)

    return Looks


@cache
def hinge_search_kernel(real, module):
    """Kernel over bodies times lanes: z, r, s and z of steps of each hinge, at `found`; adds the change of what hinges have
    without others. Arguments: those of `elastic`, and `Looks`."""
    t, Batch, Looks, formula = types(real), batch_of(DIHEDRAL, real), hinge_searches(real), dihedral_constraint
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def relative_rows(ids: wp.vec4i, x: vec3):
        X = D.mat33()
        x0 = D.vec3(x[ids[0]])
        for k in range(3):
            X[k] = D.vec3(x[ids[k + 1]]) - x0
        return X

    half = wp.float64(0.5)

    def search_hinges(trial: LineSearchTrial, batch: Batch, x: vec3, d: vec3, a: vec3, p: vec3, rate: wp.float64,
                      looks: Looks):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        for c in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            ids = batch.point[c]
            M = relative_rows(ids, d)
            X = relative_rows(ids, x) + M
            Y = relative_rows(ids, p)
            rest = wp.float64(batch.rest[c])
            root = wp.sqrt(inverse_or_zero(wp.float64(batch.alpha[c])))
            own = wp.float64(looks.own[c])
            C, G = formula(X, rest)
            f, slope, lone = folded_angle(C)
            slow = root * wp.sqrt(rate * wp.float64(batch.tau[c]))
            r = slow * wp.ddot(G, M - relative_rows(ids, a))
            s = slow * wp.ddot(G, Y)
            looks.found[c, 0] = root * f
            looks.found[c, 1] = slope * r
            looks.found[c, 2] = slope * s
            part = wp.float64(1.0)
            for k in range(trial.end):
                if k >= trial.begin:
                    moved, _G = formula(X + part * Y, rest)
                    after, _slope, _lone = folded_angle(moved)
                    looks.found[c, wp.static(FIRST) + k] = root * after
                    gain = half * root * root * ((moved - C) * (moved + C) - (after - f) * (after + f))
                    lost = lone * part * s * (r + half * part * s)
                    trial.change[row, k] = trial.change[row, k] + own * (gain + lost)
                part *= wp.float64(0.5)

    return wp.kernel(search_hinges, name=f"trial_hinge_{t.name}", module=module, enable_backward=False)


@cache
def curvature_change_kernel(real, module):
    """Kernel over bodies times lanes: adds the change of the energy and damping of triangles, whose Trial this is."""
    Curvatures, Looks = sheet_curvatures(real), hinge_searches(real)

    def add_curvature_change(trial: LineSearchTrial, cur: Curvatures, looks: Looks):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        half = wp.float64(0.5)
        for c in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            r = D.vec3()
            y = D.vec3()
            for s in range(SLOTS * c, SLOTS * c + cur.count[c]):
                value = D.vec3(cur.value[s])
                r += looks.found[cur.slot[s], 1] * value
                y += looks.found[cur.slot[s], 2] * value
            part = wp.float64(1.0)
            for k in range(trial.end):
                if k >= trial.begin:
                    less = D.vec3()
                    more = D.vec3()
                    for s in range(SLOTS * c, SLOTS * c + cur.count[c]):
                        value = D.vec3(cur.value[s])
                        before = looks.found[cur.slot[s], 0]
                        after = looks.found[cur.slot[s], wp.static(FIRST) + k]
                        less += (after - before) * value
                        more += (after + before) * value
                    step = part * y
                    trial.change[row, k] = trial.change[row, k] + half * wp.dot(less, more) + wp.dot(step, r + half * step)
                part *= half

    return wp.kernel(add_curvature_change, name=f"change_curvature_{types(real).name}", module=module, enable_backward=False)
