"""Stages of explicit Runge-Kutta steps of points, of low storage: one launch a stage, forces gathered as in explicit.py.

    d_s = d + c h v_(s-1),  v_s = v + c h a_(s-1),  a_s = a(d_s, v_s);     d' = d + h sum b v_s,   v' = v + h sum b a_s

Prescribed points are where their curves are at the time of each stage, so that what hangs on them keeps the order of the method
(Hairer, Norsett, Wanner 1993, Solving Ordinary Differential Equations I, II.1); what damps sees their velocities to order 2.
Symbols and copies of d: kernels/motion/explicit.py; c and b: wsim/scene/integrator.py.
"""

from functools import cache

import warp as wp

from wsim.kernels.cloth.spring import acceleration_function, spring_nets
from wsim.kernels.math.real import has_adjoint, types
from wsim.kernels.motion.explicit import phase_spaces


@cache
def stage_parts(real):
    """Struct of one stage of a Runge-Kutta step."""

    @wp.struct
    class StagePart:
        c: real              # [s] c h of the next stage
        b: real              # [s] b h of this one
        h: real
        source: int
        row: int             # of `target`: of the next stage, and
        end: int             # of the end of the substep
        curved: int          # 1: the row before the last is of the middle
        last: int

    return StagePart


@cache
def _stage_pin_function(real):
    """Function: displacement of pinned point i at the next stage, and its velocity: of the parabola through its places where
    the substep begins, in its middle and at its end, if there are three, else the mean one."""
    vec3, Net, Part = types(real).vec3, spring_nets(real), stage_parts(real)

    @wp.func
    def pinned_stage_point(i: int, net: Net, x: wp.array(dtype=vec3), base: vec3, part: Part):
        d1 = base
        V = vec3()
        p = net.pin[i]
        if p >= 0:
            d1 = net.target[part.row, p] - x[i]
            end = net.target[part.end, p] - x[i]
            V = (end - base) / part.h
            if part.curved != 0 and part.row == part.end:
                V += real(2.0) * ((end + base) - real(2.0) * (net.target[part.end - 1, p] - x[i])) / part.h
        return d1, V

    return pinned_stage_point


@cache
def rk_step(real, module, flags: tuple, field=None):
    """Kernel over the lanes of the points: one stage of a Runge-Kutta step."""
    t, Net, Phase, Part, lanes = (types(real), spring_nets(real), phase_spaces(real), stage_parts(real),
                                  dict(flags).get("lanes", 1))
    vec3, force = t.vec3, acceleration_function(real, **dict(flags), field=field)
    pinned = _stage_pin_function(real)

    @wp.kernel(module=module, enable_backward=has_adjoint(module))
    def runge_kutta_stage(net: Net, f: wp.array(dtype=vec3), at: Phase, part: Part,
                          d_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3), carry_out: wp.array(dtype=vec3),
                          own_out: wp.array(dtype=vec3)):
        i = wp.tid() // lanes
        lane = wp.tid() % lanes
        n = at.x.shape[0]
        into = 1 - part.source
        free = net.w[i] > real(0.0)
        base = at.own[i]
        V = at.d[(2 + part.source) * n + i]
        v1 = at.v[i]
        a = vec3()
        if free:
            a = force(net, f, at.x, at.d, i, lane, part.source)
        d1 = base + part.c * V
        Q = v1 + part.c * a
        moved = at.own[n + i] + part.b * V
        gained = at.own[2 * n + i] + part.b * a
        if not free:
            d1, Q = pinned(i, net, at.x, base, part)
        if lane == 0:
            if part.last != 0:
                if free:
                    y = gained + at.carry[i]
                    Q = v1 + y
                    carry_out[i] = y - (Q - v1)
                    z = moved + at.carry[n + i]
                    d1 = base + z
                    carry_out[n + i] = z - (d1 - base)
                own_out[i] = d1
                moved = vec3()
                gained = vec3()
                v_out[i] = Q
            own_out[n + i] = moved
            own_out[2 * n + i] = gained
            d_out[into * n + i] = d1
            d_out[(2 + into) * n + i] = Q

    return runge_kutta_stage
