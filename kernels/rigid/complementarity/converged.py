"""Substeps whose sweeps go on until contacts are solved: the converged mode, by which the others are measured.

The residual is what each contact would still change if it were solved by itself, as a velocity [m/s]:

    normal     |min(A_ii P_i, u_i + bias + soft A_ii P_i)|          0 where one of both is 0 and none is negative
    friction   (K_11 + K_22) / 2 |Coulomb(rub, u) - rub|            0 where it sticks within the cone, or slips on it along u

(the natural map of a complementarity problem: Cottle, Pang, Stone 1992, section 1.5). It is looked at after every EACH sweeps,
of those with bias and of those without; they end under the tolerance, or after MOST. Impacts know their time
(impact_time.py beside this). What sticks by a static friction larger than the dynamic one may slip by the other in each second
sweep: then nothing is under the tolerance.
"""

from collections.abc import Callable, Sequence

import warp as wp

from wsim.kernels.rigid.contact import rig_type, surface_law_functions
from wsim.kernels.rigid.impulse import impulse_formulas
from wsim.kernels.rigid.kinds import ConstraintKind, at_once_func
from wsim.kernels.rigid.passes import constraint_walks, over_bodies
from wsim.kernels.rigid.soft_step import contact_goal_functions

EACH, MOST = wp.constant(4), wp.constant(4000)
FINE = 1.0e-12             # part of the speed to which the sweeps of an impact go


def contact_residual_func(real):
    """Function of a contact m: its residual goes into `residual`."""
    Rig, (goal, fastest), friction_of = rig_type(real), contact_goal_functions(real), surface_law_functions(real)[0]
    _, _, begun, _, _, _, slip, rubbed = impulse_formulas(real)

    @wp.func
    def contact_residual(m: int, k: int, h: real, biased: int, rig: Rig):
        count = rig.c.count[m]
        if count > 0:
            two = begun(m, k, rig)
            n = rig.c.n[m]
            mu = friction_of(m, rig)
            A = rig.work.A[m]
            most = real(0.0)
            for i in range(4):
                if i < count:
                    j = 4 * m + i
                    push = rig.c.push[j]
                    u = slip(two, j, rig)
                    wants = goal(rig.work.now[j], push, h, fastest(m, rig), biased)
                    if wants[0] > real(0.0):
                        bears = A[i, i] * push
                        most = wp.max(most, wp.abs(wp.min(bears, wp.dot(n, u) + wants[1] + wants[2] * bears)))
                    K = rig.work.K[j]
                    more = rubbed(rig.c.rub[j], u, n, K, push, mu) - rig.c.rub[j]
                    most = wp.max(most, real(0.5) * (K[0] + K[2]) * wp.length(more))
            wp.atomic_max(rig.work.residual, 0, most)

    return contact_residual


def converged_sweep_func(kinds: Sequence[ConstraintKind], real, meet: Callable, solve):
    """Function of all threads: sweeps until the residual is met."""
    Rig, look = rig_type(real), at_once_func(kinds[-1], contact_residual_func(real), real)

    @wp.func
    def residual_left(i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        """Residual of all contacts, for all threads."""
        meet()
        if i == 0:
            rig.work.residual[0] = real(0.0)
        meet()
        look(i, threads, k, h, biased, rig)
        meet()
        return rig.work.residual[0]

    @wp.func
    def sweep_until_converged(i: int, threads: int, k: int, h: real, biased: int, tolerance: real, rig: Rig):
        miss = real(0.0)
        for sweep in range(int(MOST)):
            solve(i, threads, k, h, biased, rig)
            if sweep % EACH == EACH - 1:
                miss = residual_left(i, threads, k, h, biased, rig)
                if miss <= tolerance:
                    break
        meet()
        if i == 0:
            rig.work.residual[1] = wp.max(rig.work.residual[1], miss)

    return sweep_until_converged


def converged_step_kernel(kinds: Sequence[ConstraintKind], real, module, meet: Callable, threads: int = 0, cluster: int = 0,
                          bouncing: bool = False):
    """Kernel as `wsim.kernels.rigid.passes.body_substep_kernel`, of which steps[2] is not read. tolerance [m/s];
    work.residual[1] becomes the largest residual that was left."""
    Rig, w = rig_type(real), constraint_walks(kinds, real, meet, bouncing, met=FINE, timed=True)
    begun, placed, ended = over_bodies(real)
    prepare, warm, thrown = w.prepare, w.warm, w.thrown
    solved = converged_sweep_func(kinds, real, meet, w.solve)

    def rigid_converged(steps: wp.vec3i, h: real, threads: int, tolerance: real, rig: Rig):
        i = wp.tid()
        if steps[0] == 0:
            placed(i, threads, 0, rig)
        meet()
        rounds = int(2)                                      # with bias and without; no literal, which Warp would unroll
        for k in range(steps[0] - 1, steps[1]):              # each pass at one place, see kernels/rigid/passes.py
            if k >= steps[0]:
                thrown(i, threads, k, h, rig)
                begun(i, threads, h, rig)
                meet()
                warm(i, threads, k, h, 1, rig)
            for relaxed in range(rounds):
                if relaxed == 1:
                    if k >= steps[0]:
                        ended(i, threads, k, h, rig)
                        meet()
                    if k >= steps[0] or k < 0:
                        prepare(i, threads, k + 1, h, 0, rig)
                    meet()
                if k >= steps[0]:
                    solved(i, threads, k, h, 1 - relaxed, tolerance, rig)
                    meet()

    more = {"launch_bounds": threads} if threads else {}
    return wp.kernel(rigid_converged, name="rigid_converged", module=module, enable_backward=False, grid_stride=False,
                     **more, **({"cluster_dim": cluster} if cluster else {}))
