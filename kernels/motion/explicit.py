"""Explicit integration of points under springs and element forces, gathered: one launch a substep, no atomics.

    v' = v + kick (f/m + g - k v~),    d' = d + drift v'            kicks and drifts (`leapfrog_kernel`; see
    wsim/scene/integrator.py) Runge-Kutta's stages: kernels/motion/runge_kutta.py

    x   position at the start of the frame [m], which stays; d displacement since then [m]: the position is x + d
    v~  velocity that damping sees: v itself, or leapfrog's prediction v + h a_before / 2 (see `ExplicitStep.ahead`)

Neighbours read what the launch before has written: `d` holds four rows of n points, displacements and velocities v~, each
twice, and a launch goes from one copy to the other. Sums of v and d keep their rounding remainder (Kahan 1965) in `carry`:
a 32 x 32 cloth with 256 substeps a frame errs by 5.5e-8 m in float32 after 0.25 s, by 1.4e-8 m in float64.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.spring import acceleration_function, spring_nets
from wsim.kernels.math.marks import owns_points, writes_all
from wsim.kernels.math.real import has_adjoint, types
from wsim.kernels.motion.points import point_states

ALIKE = 0.25           # of what others change in a substep, by which two in a row may differ and still be one lasting force


@cache
def explicit_steps(real):
    """Struct of one launch: coefficients [s], and which copies of d are read and written (0 or 1)."""

    @wp.struct
    class ExplicitStep:
        kick: real
        later: real          # kick of the substeps after the first, where a launch takes several
        drift: real
        ahead: real          # v~ = v' + ahead a
        h: real              # of the substep, for the velocity of pins
        source: int
        row: int             # of `target`
        stride: int          # rows of `target` a substep: 0 or 1
        count: int           # substeps of a launch that takes several
        close: real          # kick after them, without a drift

    return ExplicitStep


@cache
def phase_spaces(real):
    """Struct of positions and velocities, as a launch reads them."""
    vec3 = types(real).vec3

    @wp.struct
    class PhaseSpace:
        x: wp.array(dtype=vec3)      # (n,)
        d: wp.array(dtype=vec3)      # two copies of d, two of v~, (4 n,)
        v: wp.array(dtype=vec3)      # (n,)
        carry: wp.array(dtype=vec3)  # remainders of v and of d, (2 n,)
        own: wp.array(dtype=vec3)    # of stages: displacement where the substep began, h sum b v, h sum b a so far, (3 n,)

    return PhaseSpace


@cache
def kick_drift_function(real, flags: tuple, field=None):
    """Function: kick and drift of the point of a thread."""
    t, lanes = types(real), dict(flags).get("lanes", 1)
    vec3, Net, Phase, Step = t.vec3, spring_nets(real), phase_spaces(real), explicit_steps(real)
    force = acceleration_function(real, **dict(flags), field=field)

    @wp.func
    def kick_and_drift(thread: int, net: Net, f: wp.array(dtype=vec3), at: Phase, step: Step,
                       d_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3), carry_out: wp.array(dtype=vec3)):
        i = thread // lanes
        lane = thread % lanes
        n = at.x.shape[0]
        into = 1 - step.source
        d0 = at.d[step.source * n + i]
        v0 = at.v[i]
        w = net.w[i]
        rest = at.carry[i]
        slip = at.carry[n + i]
        a = force(net, f, at.x, at.d, i, lane, step.source)         # of pinned points too: nothing waits for w
        if lane > 0:
            return
        if w > real(0.0):
            y = step.kick * a + rest
            v1 = v0 + y
            carry_out[i] = y - (v1 - v0)
            v_out[i] = v1
            z = step.drift * v1 + slip
            d1 = d0 + z
            carry_out[n + i] = z - (d1 - d0)
            d_out[into * n + i] = d1
            d_out[(2 + into) * n + i] = v1 + step.ahead * a
        else:
            d1 = d0
            if step.drift > real(0.0) and net.pin[i] >= 0:
                d1 = net.target[step.row, net.pin[i]] - at.x[i]
            v1 = (d1 - d0) / step.h
            d_out[into * n + i] = d1
            d_out[(2 + into) * n + i] = v1
            if step.drift == real(0.0):
                v1 = v0
            v_out[i] = v1

    return kick_and_drift


@cache
def leapfrog_kernel(real, module, flags: tuple, field=None):
    """Kernel over the lanes of the points: a kick, then a drift; from copy `source` of d to the other. flags: items of what
    `acceleration_function` takes."""
    vec3, one = types(real).vec3, kick_drift_function(real, flags, field)
    Net, Phase, Step = spring_nets(real), phase_spaces(real), explicit_steps(real)

    @writes_all
    @wp.kernel(module=module, enable_backward=False)
    def leapfrog_step(net: Net, f: wp.array(dtype=vec3), at: Phase, step: Step,
                      d_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3), carry_out: wp.array(dtype=vec3)):
        one(wp.tid(), net, f, at, step, d_out, v_out, carry_out)

    return leapfrog_step


@cache
def explicit_begin_kernel(real, module):
    """Kernel: copy `source` of d is e and v, and the sums start; r is the remainder of v."""
    vec3 = types(real).vec3

    @writes_all
    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def begin_explicit_frame(e: wp.array(dtype=vec3), v: wp.array(dtype=vec3), r: wp.array(dtype=vec3), source: int,
                             d_out: wp.array(dtype=vec3), carry_out: wp.array(dtype=vec3), own_out: wp.array(dtype=vec3)):
        i = wp.tid()
        n = e.shape[0]
        d_out[source * n + i] = e[i]
        d_out[(2 + source) * n + i] = v[i]
        carry_out[i] = r[i]
        carry_out[n + i] = vec3()
        if own_out:
            own_out[i] = e[i]
            own_out[n + i] = vec3()
            own_out[2 * n + i] = vec3()

    return begin_explicit_frame


@cache
def position_commit_kernel(real, module):
    """Kernel: the position becomes x + d of copy `source`, with its remainder."""
    vec3 = types(real).vec3

    @writes_all
    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def commit_positions(d: wp.array(dtype=vec3), carry: wp.array(dtype=vec3), x: wp.array(dtype=vec3), source: int,
                         x_out: wp.array(dtype=vec3), e_out: wp.array(dtype=vec3), r_out: wp.array(dtype=vec3)):
        i = wp.tid()
        n = x.shape[0]
        x0 = x[i]
        step = d[source * n + i]
        x1 = x0 + step
        x_out[i] = x1
        e_out[i] = (step - (x1 - x0)) + carry[n + i]
        r_out[i] = carry[i]

    return commit_positions


@cache
def velocity_correction_kernel(real, module):
    """Kernel: what wind, contacts and hard constraints did to the displacement d since it was predicted is a change of
    velocity, too, but for what the anchor a has moved (a way out of an overlap is no motion):

        v' = v + ((d - a) - (d~ - e)) / h,  x' = x + d;   copy `source` of the pair holds d~ and then the remainder
    """
    vec3, PointState, Step = types(real).vec3, point_states(real), explicit_steps(real)

    @owns_points
    @writes_all
    @wp.kernel(module=module, enable_backward=False)
    def correct_velocity(at: PointState, pair: wp.array(dtype=vec3), step: Step,
                         x_out: wp.array(dtype=vec3), e_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3),
                         pair_out: wp.array(dtype=vec3), change_out: wp.array(dtype=vec3)):
        i = wp.tid()
        n = at.x.shape[0]
        own = step.source * n + i
        rate = (2 + step.source) * n + i
        moved = at.d[i]
        change = ((moved - at.a[i]) - (pair[own] - at.e[i])) / step.h
        x0 = at.x[i]
        x1 = x0 + moved
        rest = moved - (x1 - x0)
        x_out[i] = x1
        e_out[i] = rest
        v_out[i] = at.v[i] + change
        pair_out[own] = rest
        pair_out[rate] = pair[rate] + change
        change_out[i] = change

    return correct_velocity


@cache
def resting_kick_kernel(real, module):
    """Kernel: leapfrog's last half kick knows no contact forces and would push what rests into what it rests on. Others
    changed the velocity by c in the last substep; of the kick v - before, what they would take back, along -c, is left out,
    up to `share` of |c| (1/2, as the kick is half a one): an impact is not repeated. What goes on is no impact: where the
    substep before was changed alike (`earlier`), to a part ALIKE of c, all of the share belongs to the kick (order 2)."""
    vec3, alike = types(real).vec3, real(ALIKE)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def settle_resting_kick(before: wp.array(dtype=vec3), change: wp.array(dtype=vec3), earlier: wp.array(dtype=vec3),
                            v: wp.array(dtype=vec3), share: real, v_out: wp.array(dtype=vec3)):
        i = wp.tid()
        size = wp.length(change[i])
        if size > real(0.0):
            c = change[i] / size
            back = wp.max(-wp.dot(v[i] - before[i], c), real(0.0))
            part = wp.min(back, share * size)
            if wp.length(change[i] - earlier[i]) < alike * size:
                part = share * size
            v_out[i] = v[i] + part * c

    return settle_resting_kick
