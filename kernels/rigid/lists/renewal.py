"""When the manifold of a pair is made again, and for which poses.

Need. A manifold is kept while its bodies have moved against each other by less than a part of the smaller one's size L,

    |d_a - d_b| + theta_a s_a + theta_b s_b <= part L             d, theta: displacement and turn since it was made

with s the distance from the centre of mass to the farthest end of the shape, without the radius of a ball, whose turn moves
nothing. The part is STALE, and FINE where a shape is round, whose contact wanders as it rolls.

Time of impact. Where bodies come nearer by more than BRIEF L within a substep, the manifold is that of the poses at the time of
their impact, so that a ball leaves along the right normal, and one that passes by is not touched. The distance of convex shapes
that do not turn is a convex function of time; Newton's method from now on,

    t <- t - gap(t) / gap'(t),   gap' = n . (v_a + omega_a x r - v_b - omega_b x r)

approaches the first root from below (conservative advancement: Mirtich 1996). It ends at a root, where they part, or where the
substep has ended. The plane at the last t is one that these motions do not cross before.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.shape import CAPSULE, CONE, CYLINDER, SPHERE
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.lists.rows import posed_pair_type

STALE, FINE = wp.constant(1.0e-3), wp.constant(1.0e-5)       # part of L: more, a tilting box slides off its old corners
BRIEF = wp.constant(0.005)             # of L: how much nearer bodies may come in a substep without the time of impact
STEPS = wp.constant(12)                # of Newton's method, at most; a grazing impact halves what is left in each
TOUCHES = wp.constant(1.0e-5)          # of L: a root
MARGIN = wp.constant(0.01)             # part of both balls within which points are kept, however slow
LATER = wp.constant(1.05)              # of a substep: what touches later is left to the next one


@cache
def manifold_need_func(real):
    """Function (m, k, rig) -> whether the manifold of row m is to be made again where substep k begins."""
    t, Rig = types(real), rig_type(real)

    @wp.func
    def shape_is_rolling(kind: int):
        return kind == SPHERE or kind == CAPSULE or kind == CYLINDER or kind == CONE

    @wp.func
    def frame_pose(f: int, k: int, rig: Rig):
        n = rig.b.w.shape[0]
        x = t.vec3()
        q = t.quat()
        if f < n:
            x = rig.now.x[f]
            q = rig.now.q[f]
        else:
            x = rig.still.x[k * rig.still.moving, f - n]
            q = rig.still.q[k * rig.still.moving, f - n]
        return x, q

    @wp.func
    def turned_by(q: t.quat, since: t.quat):
        """Angle between two orientations, or more; small ones to second order."""
        d = q - since
        if wp.dot(q, since) < real(0.0):
            d = q + since
        return real(2.0) * wp.length(d)

    @wp.func
    def surface_turn_arm(shape: int, L: real, rig: Rig):
        """Distance over which a turn moves the surface of a shape; of what has no end, L."""
        s = wp.length(wp.transform_get_translation(rig.s.place[shape]))
        if rig.s.ball[shape] < real(0.0):
            s += L
        elif rig.s.kind[shape] != SPHERE:
            s += rig.s.ball[shape]
        return s

    @wp.func(inline=False)
    def manifold_is_stale(m: int, k: int, rig: Rig):
        a = rig.c.a[m]
        b = rig.c.b[m]
        L = rig.s.ball[a]
        if L < real(0.0) or (rig.s.ball[b] > real(0.0) and rig.s.ball[b] < L):
            L = rig.s.ball[b]
        part = real(STALE)
        if shape_is_rolling(rig.s.kind[a]) or shape_is_rolling(rig.s.kind[b]):
            part = real(FINE)
        x_a, q_a = frame_pose(rig.s.frame[a], k, rig)
        x_b, q_b = frame_pose(rig.s.frame[b], k, rig)
        moved = wp.length((x_a - rig.c.from_a[m]) - (x_b - rig.c.from_b[m]))
        moved += (turned_by(q_a, rig.c.turn_a[m]) * surface_turn_arm(a, L, rig) + turned_by(q_b, rig.c.turn_b[m])
                  * surface_turn_arm(b, L, rig))
        return moved > part * L

    return manifold_is_stale


@cache
def twist_functions(real) -> SimpleNamespace:
    """Twist: velocities of both frames of a row. twist(m, k, h, rig) -> Twist; advanced(posed, twist, time, m, rig) -> Posed
    that much later; hurried(twist, h, m, rig) -> whether the time of impact is asked for; margin(twist, h, m, posed, rig) ->
    gap up to which points are kept; closing(n, x, twist, posed) -> rate at which a gap grows."""
    t, Rig, Posed = types(real), rig_type(real), posed_pair_type(real)[0]

    @wp.struct
    class PairTwist:
        v_a: t.vec3
        v_b: t.vec3
        o_a: t.vec3
        o_b: t.vec3

    @wp.func
    def mean_frame_velocity(f: int, k: int, h: real, rig: Rig):
        """Of a frame, in the mean of the substep if nothing touches it."""
        n = rig.b.w.shape[0]
        v = t.vec3()
        o = t.vec3()
        if f < n:
            v = rig.b.w[f] * (rig.now.p[f] + (real(0.5) * h) * rig.b.push[f])
            q = rig.now.q[f]
            o = wp.quat_rotate(q, wp.cw_mul(rig.b.inverse[f], wp.quat_rotate_inv(q, rig.now.L[f])))
        else:
            v = rig.still.v[k * rig.still.moving, f - n]
            o = rig.still.omega[k * rig.still.moving, f - n]
        return v, o

    @wp.func(inline=False)
    def pair_twist(m: int, k: int, h: real, rig: Rig):
        v_a, o_a = mean_frame_velocity(rig.s.frame[rig.c.a[m]], k, h, rig)
        v_b, o_b = mean_frame_velocity(rig.s.frame[rig.c.b[m]], k, h, rig)
        both = PairTwist()
        both.v_a = v_a
        both.o_a = o_a
        both.v_b = v_b
        both.o_b = o_b
        return both

    @wp.func
    def turn_for_time(q: t.quat, o: t.vec3, time: real):
        out = q
        angle = time * wp.length(o)
        if angle > real(0.0):
            out = wp.normalize(wp.quat_from_axis_angle(wp.normalize(o), angle) * q)
        return out

    @wp.func(inline=False)
    def advance_posed_pair(p: Posed, both: PairTwist, time: real, m: int, rig: Rig):
        out = p
        if time > real(0.0):
            out.q_a = turn_for_time(p.q_a, both.o_a, time)
            out.q_b = turn_for_time(p.q_b, both.o_b, time)
            out.x_b = p.x_b + time * (both.v_b - both.v_a)
            out.from_a = p.from_a + time * both.v_a
            out.from_b = p.from_b + time * both.v_b
            out.pose_a = t.transform(t.vec3(), out.q_a) * rig.s.place[rig.c.a[m]]
            out.pose_b = t.transform(out.x_b, out.q_b) * rig.s.place[rig.c.b[m]]
        return out

    @wp.func
    def shape_turn_extent(shape: int, rig: Rig):
        return wp.length(wp.transform_get_translation(rig.s.place[shape])) + wp.max(rig.s.ball[shape], real(0.0))

    @wp.func
    def smaller_shape_size(m: int, rig: Rig):
        """L: the smaller size of what has an end."""
        a = rig.s.ball[rig.c.a[m]]
        b = rig.s.ball[rig.c.b[m]]
        L = wp.min(a, b)
        if L < real(0.0):
            L = wp.max(a, b)
        return L

    @wp.func
    def approach_in_substep(both: PairTwist, h: real, m: int, rig: Rig):
        """How much nearer the shapes of row m may come in a substep [m]."""
        speed = wp.length(both.v_a - both.v_b) + wp.length(both.o_a) * shape_turn_extent(rig.c.a[m], rig)
        speed += wp.length(both.o_b) * shape_turn_extent(rig.c.b[m], rig)
        return h * speed

    @wp.func
    def asks_time_of_impact(both: PairTwist, h: real, m: int, rig: Rig):
        return approach_in_substep(both, h, m, rig) > real(BRIEF) * smaller_shape_size(m, rig)

    @wp.func
    def kept_gap_margin(both: PairTwist, h: real, m: int, posed: Posed, rig: Rig):
        """Gap up to which points are kept [m]: what the next substeps can close before the manifold is made again."""
        near = posed.margin
        if h > real(0.0):
            balls = wp.max(rig.s.ball[rig.c.a[m]], real(0.0)) + wp.max(rig.s.ball[rig.c.b[m]], real(0.0))
            if rig.s.frame[rig.c.b[m]] >= rig.b.w.shape[0]:
                balls = wp.max(rig.s.ball[rig.c.a[m]], real(0.0))
            near = wp.min(near, real(MARGIN) * balls + real(2.0) * approach_in_substep(both, h, m, rig))
        return near

    @wp.func
    def closing_speed(n: t.vec3, x: t.vec3, both: PairTwist, p: Posed):
        return wp.dot(n, both.v_a + wp.cross(both.o_a, x) - both.v_b - wp.cross(both.o_b, x - p.x_b))

    return SimpleNamespace(Twist=PairTwist, twist=pair_twist, advanced=advance_posed_pair, hurried=asks_time_of_impact,
                           margin=kept_gap_margin, closing=closing_speed, size=smaller_shape_size)
