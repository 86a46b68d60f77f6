"""How far to go along a Newton correction, of bending: what kernels/solver/line_search.py is for other energies, in two passes.

    energy     1/2 (C_t - C_0).(C_t + C_0) of the curvatures of triangles (kernels/cloth/curvature.py)
    damping    s.(r + s/2),  r and s the sums that C is, of (tau / g)^1/2 k^1/2 G.(d - a) and of the same with t p, G at d

Hinges leave k^1/2 (theta - theta_0) at d and at each step that is tried, in float64.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.constraint import TABLE, inverse
from wsim.kernels.cloth.curvature import SLOTS, curvatures
from wsim.kernels.cloth.terms import batch_of
from wsim.kernels.math.real import types
from wsim.kernels.solver.line_search import HALVINGS, Trial

FIRST = 3              # column of the whole step: those before are z at d, and r and s of damping
COLUMNS = FIRST + 1 + HALVINGS
D = types(wp.float64)


@cache
def hinges(real, module):
    """Kernel over bodies times lanes: z, r, s and z of steps of each hinge, found (hinges, COLUMNS). Arguments of `elastic`."""
    t, Batch, formula = types(real), batch_of("dihedral", real), TABLE["dihedral"].formula
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def relative(ids: wp.vec4i, x: vec3):
        X = D.mat33()
        x0 = D.vec3(x[ids[0]])
        for k in range(3):
            X[k] = D.vec3(x[ids[k + 1]]) - x0
        return X

    def hinges(trial: Trial, batch: Batch, x: vec3, d: vec3, a: vec3, p: vec3, rate: wp.float64,
               found: wp.array2d(dtype=D.scalar)):
        row = wp.tid()
        body = row // trial.lanes
        if trial.step[body] >= wp.float64(0.0):
            return
        for c in range(trial.first[body] + row - body * trial.lanes, trial.first[body + 1], trial.lanes):
            ids = batch.point[c]
            M = relative(ids, d)
            X = relative(ids, x) + M
            Y = relative(ids, p)
            rest = wp.float64(batch.rest[c])
            root = wp.sqrt(inverse(wp.float64(batch.alpha[c])))
            C, G = formula(X, rest)
            slow = root * wp.sqrt(rate * wp.float64(batch.tau[c]))
            found[c, 0] = root * C
            found[c, 1] = slow * wp.ddot(G, M - relative(ids, a))
            found[c, 2] = slow * wp.ddot(G, Y)
            part = wp.float64(1.0)
            for k in range(trial.end):
                if k >= trial.begin:
                    moved, _G = formula(X + part * Y, rest)
                    found[c, wp.static(FIRST) + k] = root * moved
                part *= wp.float64(0.5)

    return wp.kernel(hinges, name=f"trial_hinge_{t.name}", module=module, enable_backward=False)


@cache
def change(real, module):
    """Kernel over bodies times lanes: adds the change of the energy and damping of triangles, whose Trial this is."""
    Curvatures = curvatures(real)

    def change(trial: Trial, cur: Curvatures, found: wp.array2d(dtype=D.scalar)):
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
                r += found[cur.slot[s], 1] * value
                y += found[cur.slot[s], 2] * value
            part = wp.float64(1.0)
            for k in range(trial.end):
                if k >= trial.begin:
                    less = D.vec3()
                    more = D.vec3()
                    for s in range(SLOTS * c, SLOTS * c + cur.count[c]):
                        value = D.vec3(cur.value[s])
                        before = found[cur.slot[s], 0]
                        after = found[cur.slot[s], wp.static(FIRST) + k]
                        less += (after - before) * value
                        more += (after + before) * value
                    step = part * y
                    trial.change[row, k] = trial.change[row, k] + half * wp.dot(less, more) + wp.dot(step, r + half * step)
                part *= half

    return wp.kernel(change, name=f"change_curvature_{types(real).name}", module=module, enable_backward=False)
