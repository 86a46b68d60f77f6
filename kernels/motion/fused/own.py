"""Motion of the point of a thread in frames of one launch (kernels/motion/fused/march.py), between what its block does.

    a   acceleration by the block's elements, gravity and drag     v' = v + kick a,   d' = d + drift v'
    q   velocity that damping sees, v' + ahead a                   s, r   remainders of the sums of d and v (Kahan 1965)

as `leap` of kernels/motion/explicit.py has them; x are positions where the frame begins.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.explicit import explicit_steps
from wsim.kernels.motion.load import borne_loads


@cache
def thread_points(real):
    """Struct of what a thread keeps of its point, in registers."""
    vec3 = types(real).vec3

    @wp.struct
    class Own:
        point: int               # -1: it has none
        lane: int                # number among the threads of the point
        column: int              # of its target
        moves: int               # 1: it goes where its target is
        w: real                  # inverse mass [1/kg]
        decay: real              # [1/s]
        room: real               # square of the clearance [m^2], -2 once it was not enough
        gravity: vec3            # [m/s^2]
        goal: vec3               # target at the end of the substep [m]
        x: vec3
        d: vec3
        s: vec3
        v: vec3
        r: vec3
        q: vec3
        a: vec3
        change: vec3             # of the velocity by what the point met in this substep, and in the one before [m/s]
        before: vec3
        normal: vec3             # of what threw it back in this substep, or 0
        there: int               # sizes of the block's lists: points, hinges, triangles, those whose curvature it needs,
        angles: int              # hinges at its points, and these
        flat: int
        curved: int
        bent: int
        owned: int
        tets: int
        force: int               # places of forces that the thread gathers, and of copies that it sends
        forces_end: int
        push: int
        pushes_end: int
        guest: int               # of a grid: a point that it fetches, or -1

    return Own


@cache
def own_point_functions(real):
    """Functions of `own`, which they change: `kick_own_point`, and `drift_own_point` by a substep of length `step.h`, or to its
    pin."""
    Own, Step = thread_points(real), explicit_steps(real)

    @wp.func
    def kick_own_point(own: wp.ref[Own], kick: real):
        if own.w > real(0.0):
            y = kick * own.a + own.r
            v = own.v + y
            own.r = y - (v - own.v)
            own.v = v

    @wp.func
    def drift_own_point(own: wp.ref[Own], kick: real, step: Step, sub: int):
        if own.w > real(0.0):
            kick_own_point(own, kick)
            z = step.drift * own.v + own.s
            d = own.d + z
            own.s = z - (d - own.d)
            own.d = d
            own.q = own.v + step.ahead * own.a
            if not wp.dot(d, d) <= own.room:
                own.room = real(-2.0)
        elif own.moves != 0 and (sub < 2 or step.stride != 0):
            d = own.goal - own.x
            v = (d - own.d) / step.h
            own.v = v
            own.q = v
            own.d = d

    return kick_own_point, drift_own_point


@cache
def load_bearing_function(real):
    """Function (c, own, row): gravity of a point with what a row of loads adds, as `bear` of kernels/motion/load.py."""
    t, Own, Borne = types(real), thread_points(real), borne_loads(real)

    @wp.func
    def bear_point_loads(c: Borne, own: wp.ref[Own], row: int):
        if own.point >= 0:
            k = c.place[own.point]
            if k >= 0:
                F = t.vec3()
                for e in range(c.entries.first[k], c.entries.first[k + 1]):
                    F += c.entries.share[e] * c.value[row, c.entries.load[e]]
                own.gravity = c.own[k] + own.w * F

    return bear_point_loads


@cache
def frame_end_function(real):
    """Function: writes where a point has got to. v: of the end of the frame."""
    t, Own, vectors = types(real), thread_points(real), wp.array(dtype=types(real).vec3)

    @wp.func
    def write_point_end(own: wp.ref[Own], v: t.vec3, x_out: vectors, e_out: vectors, v_out: vectors, r_out: vectors):
        i = own.point
        x = own.x + own.d
        x_out[i] = x
        e_out[i] = (own.d - (x - own.x)) + own.s
        v_out[i] = v
        r_out[i] = own.r

    return write_point_end
