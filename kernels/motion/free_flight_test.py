"""Clearance: how far each point may go in a frame before a collider can be met. Frames in which none goes so far need no
contacts.

    x0   position where the frame begins [m]      T_k  pose of a collider at substep k, c_k its centre, R the radius about it
    D    distance of x0 from the collider in T_0 [m], < 0 inside; of one more than R away from its ball, the ball's
    s    max_k |c_k - c_0|,  S = max_k |R_k - R_0|       w  max_k |c_(k+1) - c_k|,  W = max_k |R_(k+1) - R_k|

A point of the collider moves by at most s + S L in the frame, L = R (of a plane, where all that counts is the turn of its
normal about x, L = 2 |x0 - c_0| + s). In the collider's own frame a straight step of the point is straight up to what the
collider moves meanwhile at the point's place, no more than V = w + W (2 |x0 - c_0| + s), as long as the point goes no further
than |x0 - c_0|, which is the most that D may be. So every place that a point, or its straight
path, has in a frame, and that is no more than

    C = min over colliders (D - s - S L - 2 V - gap - chord) - reach - 2 skin

from x0, is further from every collider than contacts look for: kernels/contact/search.py keeps a contact where the gap is under
|dq| + skin, dq <= |d| + V. Two skins, since one covers rounding. chord: what edges of sheets are nearer to sharp colliders than
their points (kernels/cloth/edge_contact/sites.py). A frame in which

    |x - x0| + 2 |d| <= C    for every point and every substep of displacement d from x

has no contact in any substep: it is the same to the bit with contacts and without. Where nothing but contacts acts within a
substep, |d| <= C for displacements d since the frame began is enough for no contact to push (kernels/motion/explicit.py,
march_cpu.py and cluster.py see to it at every substep).

s, S, w, W, or more, come with the frame (wsim/physics/contact/poses/swept_bounds.py): no pose of a substep is looked at here. A
mesh that deforms is the ball that all of its shapes are in.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.contact import mesh
from wsim.kernels.contact.collide import split_convex_and_meshes
from wsim.kernels.contact.collider.shape import convex_distance_func
from wsim.kernels.contact.mesh import SOLID
from wsim.kernels.contact.project import contact_tables, read_type, slot_type
from wsim.kernels.math.marks import owns_points, writes_all
from wsim.kernels.math.real import types

FREE = 1.0e30          # [m] of a point that has no contacts
SLACK = 1.0e-5         # of distances, that clearances are smaller by: what poses and shapes a kilometre away are rounded by
NEAR = 4               # bit of a point's mark: where the frame ended it was so near that the next one has contacts
SOON = 8               # bit of a point's mark: the same, where the frame itself had none
WIDTH = 12             # numbers of a row of `Movements.now`


@cache
def frame_movements(real):
    """Struct of how colliders move in a frame, a row each as in the table of colliders."""
    t = types(real)

    @wp.struct
    class Movements:
        ball: wp.array(dtype=t.vec4)         # centre in the collider's frame, radius [m]; < 0: it has none, (rows,)
        mesh: wp.array(dtype=wp.uint64)      # a mesh that keeps its shape, 0: another, (rows,)
        now: wp.array(dtype=real)            # T_0 (7); what D loses: constant [m], and times |x0 - c_0|; c_0, (rows * WIDTH,)
        ahead: real                          # time for which clearances should last [s]

    return Movements


@cache
def clearance_function(kinds: tuple[str, ...], real):
    """Function (c, m, row, T0, c0, deep, x) -> D - s - S L - 2 V - gap - chord of a point at x and the collider of a row, whose
    centre is at c0. deep: whether meshes may hold it from the start."""
    t, (convex, meshes), Rows, Movements = (types(real), split_convex_and_meshes(kinds), contact_tables(real)[0],
                                            frame_movements(real))
    shaped, meshed, formula, nearest = bool(convex), bool(meshes), convex_distance_func(convex), mesh.nearest_face_func(meshes)
    if meshes:
        from wsim.kernels.math.face import face_distance as face_away

    @wp.func
    def surface_distance(c: Rows, m: Movements, row: int, T0: t.transform, deep: int, x: t.vec3, D: real):
        kind = c.of.kind[row]
        q = wp.quat_rotate_inv(wp.transform_get_rotation(T0), x - wp.transform_get_translation(T0))
        if shaped:
            if kind < SOLID:
                D, n = formula(kind, c.of.size[row], q)
        if meshed:
            if kind >= SOLID and m.mesh[row] != wp.uint64(0):
                far = float(real(3.0) * m.ball[row][3])
                face, sign = nearest(kind, m.mesh[row], wp.vec3f(q), far, deep, far)
                if face >= 0:
                    dist, _p = face_away(m.mesh[row], face, wp.vec3f(q))
                    D = wp.max(D, real(sign * dist))
        return D

    @wp.func
    def collider_clearance(c: Rows, m: Movements, row: int, T0: t.transform, c0: t.vec3, deep: int, x: t.vec3):
        L = wp.length(x - c0)
        R = m.ball[row][3]
        D = L - R
        if R < real(0.0) or D < R:                            # the surface itself: a shape is rarely as its ball
            D = wp.min(surface_distance(c, m, row, T0, deep, x, D), L)
        return D - c.chord[row] - (m.now[WIDTH * row + 7] + m.now[WIDTH * row + 8] * L)

    return collider_clearance


@cache
def frame_clearance_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over points, before a frame without contacts: the clearance, and no contacts in the slots. Where colliders that go
    on as they do would leave less of it to the next frame than `ahead` [s] at the present speed, `soon` becomes 1, and the
    point has a mark: that frame would be repeated. Reads x and v."""
    t, Movements, Slots, Read, of = (types(real), frame_movements(real), slot_type(real), read_type(real),
                                     clearance_function(kinds, real))
    Rows, Points = contact_tables(real)

    def frame_clearance(c: Rows, points: Points, m: Movements, at: Read, s: Slots,
                        room_out: wp.array(dtype=real), struck_out: wp.array(dtype=real), soon_out: wp.array(dtype=int)):
        i = wp.tid()
        found = real(FREE)
        later = real(FREE)
        if points.w[i] > real(0.0):
            o = points.object[i]
            for row in range(c.first[o], c.first[o + 1]):
                r = WIDTH * row
                p = t.vec3(m.now[r], m.now[r + 1], m.now[r + 2])
                T0 = t.transform(p, t.quat(m.now[r + 3], m.now[r + 4], m.now[r + 5], m.now[r + 6]))
                c0 = t.vec3(m.now[r + 9], m.now[r + 10], m.now[r + 11])
                room = of(c, m, row, T0, c0, c.deep[0], at.x[i])
                found = wp.min(found, room)
                later = wp.min(later, room - (m.now[r + 7] - c.of.thick[row]))
            kept = points.reach[i] + real(2.0) * c.skin
            found -= kept
            later -= kept
        if later < m.ahead * wp.length(at.v[i]):
            s.mark[i] = SOON
            wp.atomic_max(soon_out, 0, 1)
        room_out[i] = found
        s.count[i] = 0
        if struck_out:
            struck_out[i] = real(0.0)

    return wp.kernel(frame_clearance, name=f"clearance_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=False)


@cache
def clearance_test_kernel(real, module):
    """Kernel over points, in a substep of a frame without contacts that displaces by d from x: `met` becomes 1 where one may go
    further than its clearance."""
    t = types(real)

    def test_free_flight(start: wp.array(dtype=t.vec3), x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3),
                         room: wp.array(dtype=real), met_out: wp.array(dtype=int)):
        i = wp.tid()
        if not wp.length(x[i] - start[i]) + real(2.0) * wp.length(d[i]) <= room[i]:
            wp.atomic_max(met_out, 0, 1)

    return owns_points(wp.kernel(test_free_flight, name=f"stray_{t.name}", module=module, enable_backward=False))


@cache
def near_contact_kernel(kinds: tuple[str, ...], real, module):
    """Kernel over points, after a frame with contacts: `met` becomes 1 where one touches, or its clearance is less than `ahead`
    [s] at its present speed; then it has a mark."""
    t, Movements, Slots, of = types(real), frame_movements(real), slot_type(real), clearance_function(kinds, real)
    Rows, Points = contact_tables(real)

    def mark_near_contacts(c: Rows, points: Points, m: Movements, x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3),
                           ahead: real, s: Slots, met_out: wp.array(dtype=int)):
        i = wp.tid()
        mark = s.mark[i]
        if mark == 0 and points.w[i] > real(0.0):
            o = points.object[i]
            need = ahead * wp.length(v[i]) + points.reach[i] + real(2.0) * c.skin
            for row in range(c.first[o], c.first[o + 1]):
                T1 = c.of.pose[c.ball.shape[0], row]
                ball = m.ball[row]
                c1 = wp.transform_point(T1, t.vec3(ball[0], ball[1], ball[2]))
                if not need <= of(c, m, row, T1, c1, 0, x[i]):
                    mark = NEAR
            s.mark[i] = mark
        if mark != 0:
            wp.atomic_max(met_out, 0, 1)

    return wp.kernel(mark_near_contacts, name=f"near_{'_'.join(kinds)}_{t.name}", module=module, enable_backward=False)


@cache
def flight_bounds(real):
    """Struct of a frame without contacts, as `bounded_leap_kernel` reads it."""

    @wp.struct
    class Bounds:
        room: wp.array(dtype=real)           # clearance [m], (points,)
        met: wp.array(dtype=int)             # becomes 1 where a point goes further

    return Bounds


@cache
def bounded_leap_kernel(real, module, flags: tuple, field=None):
    """Kernel: as `leap` of kernels/motion/explicit.py, and whether the displacement is within the clearance."""
    from wsim.kernels.cloth.spring import spring_nets
    from wsim.kernels.motion.explicit import explicit_steps, kick_drift_function, phase_spaces
    vec3, one, lanes = types(real).vec3, kick_drift_function(real, flags, field), dict(flags).get("lanes", 1)
    Net, Phase, Step, Bounds = spring_nets(real), phase_spaces(real), explicit_steps(real), flight_bounds(real)

    @writes_all
    @wp.kernel(module=module, enable_backward=False)
    def leap_within_clearance(net: Net, f: wp.array(dtype=vec3), at: Phase, step: Step, within: Bounds,
                              d_out: wp.array(dtype=vec3), v_out: wp.array(dtype=vec3), carry_out: wp.array(dtype=vec3)):
        thread = wp.tid()
        one(thread, net, f, at, step, d_out, v_out, carry_out)
        i = thread // lanes
        if thread % lanes == 0 and net.w[i] > real(0.0):
            if not wp.length(d_out[(1 - step.source) * at.x.shape[0] + i]) <= within.room[i]:
                wp.atomic_max(within.met, 0, 1)

    return leap_within_clearance
