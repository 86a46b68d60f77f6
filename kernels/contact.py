"""Contact of points with colliders: search once a substep, projection with Coulomb friction in every iteration.

    x  position at the start of the substep [m]     n  unit normal of a contact plane
    d  displacement, the unknown [m]                C  gap, C = b + n.d >= 0 [m]
    a  anchor: velocity v = (d - a) / g             u  velocity of the surface there [m/s]
    P  accumulated push of a contact [m]: lam = n.P >= 0 along the normal, T = P - lam n across it. A point of
       mass m has received the impulse m P / g [N s], the collider its opposite

Search (after prediction). Each point tries the colliders of its object, but for those whose bounding ball it cannot
reach in this substep. A contact is kept where the gap at the predicted place is under a margin of |dq| + skin, dq the
motion relative to the collider: constraints may still move the point. A point that started too near by s0 < 0 is
carried out by the same shift of d and a, hence without velocity, by at most `recovery` h; by what is then left its
plane is moved back.

Projection (projected Gauss-Seidel on accumulated impulses, as Tonge, Benevolenski, Voroshilov 2012, in displacements):

    lam' = max(lam - C, 0)                     d += (lam' - lam) n
    T* = T - [(d - a) - g u]_t                 T' = T* where |T*| <= mu_s lam', else mu_d lam' T* / |T*|
                                               d += T' - T

so friction stops the velocity relative to the surface or slides: Coulomb's law, exact for one contact. Coefficients
are the mean of the point's and the collider's. Contacts stand in the order of the colliders and no atomic touches a
float: results are bitwise the same from run to run. Lists are built outside of any tape, hence slots are written
through a struct.
"""

# Device code: int(0) makes a variable of what would be a constant; nested ifs do not read past the first.
# ruff: noqa: UP018, SIM102, SIM300

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels import collide
from wsim.kernels.real import types

TOUCHED, SUNK = 1, 2                   # bits of a point's mark: in contact in this substep, started it in an overlap
SUNK_FROM = 0.01                       # part of the skin: overlaps under it are rounding and no reason to look deeper


@cache
def tables(real):
    """(Rows, Points): structs of what collides, written by the host before a frame, read by kernels."""
    t = types(real)

    @wp.struct
    class Rows:
        first: wp.array(dtype=int)                # rows of object o: first[o] .. first[o + 1], (objects + 1,)
        kind: wp.array(dtype=int)                 # number in collide.KINDS, (rows,)
        size: wp.array(dtype=t.vec3)              # [m], see distance; meshes: greatest depth inside, (rows,)
        mesh: wp.array(dtype=wp.uint64)           # Warp's mesh, (rows,)
        gap: wp.array(dtype=t.scalar)             # distance that the collider keeps [m], (rows,)
        friction: wp.array(dtype=t.vec2)          # static, dynamic, (rows,)
        pose: wp.array2d(dtype=t.transform)       # to the object's origin, at substep k, (substeps + 1, rows)
        step: wp.array2d(dtype=t.transform)       # translation and turn during substep k, (substeps, rows)
        ball: wp.array2d(dtype=t.vec4)            # centre, radius [m] that hold it during substep k, (substeps, rows)
        stride: wp.array2d(dtype=t.scalar)        # greatest motion in its own frame in substep k [m], (substeps, rows)
        deep: wp.array(dtype=int)                 # 1: points may have started inside of meshes, (1,)
        h: t.scalar                               # substep [s]
        skin: t.scalar                            # least margin [m]
        recovery: t.scalar                        # speed out of an overlap [m/s]

    @wp.struct
    class Points:
        object: wp.array(dtype=int)               # (points,)
        w: wp.array(dtype=t.scalar)               # inverse mass [1/kg]; 0: the point has no contacts
        reach: wp.array(dtype=t.scalar)           # distance that the point keeps [m]
        friction: wp.array(dtype=t.vec2)          # static, dynamic

    return Rows, Points


@cache
def slots(real):
    """Struct of contacts: slot j of point i stands at j * points + i."""
    t = types(real)

    @wp.struct
    class Slots:
        points: int
        capacity: int                             # slots of a point
        count: wp.array(dtype=int)                # contacts of each point, (points,)
        mark: wp.array(dtype=int)                 # bits TOUCHED, SUNK, (points,)
        row: wp.array(dtype=int)                  # (slots,)
        n: wp.array(dtype=t.vec3)                 # (slots,)
        b: wp.array(dtype=t.scalar)               # [m]
        u: wp.array(dtype=t.vec3)                 # [m/s]

    return Slots


@wp.func
def reachable(ball: Any, x: Any, bound: Any):
    """Whether a ball (centre, radius) comes within `bound` of x; not where x is no number."""
    away = x - type(x)(ball[0], ball[1], ball[2])
    return wp.dot(away, away) < (ball[3] + bound) * (ball[3] + bound)


@cache
def frames(real):
    """(inside, outside), functions that lead into the frame of a collider that goes from T0 to T1, and back.

    inside  (T0, T1, x, d) -> (q0, q1), a point that moves by d
    outside (T0, T1, step, m, p, slip) -> (n, way), a normal, and how far the surface moves that is touched at p. With
            y = R0 p and the turn (v, w) of the step, (R - 1) y = 2 w (v x y) + 2 v x (v x y), without cancellation."""
    t = types(real)

    @wp.func
    def inside(T0: t.transform, T1: t.transform, x: t.vec3, d: t.vec3):
        q0 = wp.quat_rotate_inv(wp.transform_get_rotation(T0), x - wp.transform_get_translation(T0))
        q1 = wp.quat_rotate_inv(wp.transform_get_rotation(T1), (x - wp.transform_get_translation(T1)) + d)
        return q0, q1

    @wp.func
    def outside(T0: t.transform, T1: t.transform, step: t.transform, m: t.vec3, p: t.vec3, slip: t.vec3):
        R1 = wp.transform_get_rotation(T1)
        y = wp.quat_rotate(wp.transform_get_rotation(T0), p)
        turn = wp.transform_get_rotation(step)
        v = t.vec3(turn[0], turn[1], turn[2])
        across = wp.cross(v, y)
        rigid = real(2.0) * (turn[3] * across + wp.cross(v, across)) + wp.transform_get_translation(step)
        return wp.quat_rotate(R1, m), rigid + wp.quat_rotate(R1, slip)

    return inside, outside


@cache
def search(kinds: tuple[str, ...], real, module):
    """Kernel over points: contacts of substep k.

    d_out, a_out   written where a point is carried out of an overlap       push_out   of its contacts: zeroed
    wanted_out     greatest number of contacts of a point that has no room for them, if there is one
    struck_out     (may be None) not 0 where a point is in an overlap"""
    t, name = types(real), f"search_{'_'.join(kinds)}_{types(real).name}"
    Rows, Points = tables(real)
    Slots, touch, (inside, outside) = slots(real), collide.touch(kinds, real), frames(real)
    vectors, ints = wp.array(dtype=t.vec3), wp.array(dtype=int)

    def search(c: Rows, points: Points, x: vectors, d: vectors, a: vectors, k: int, s: Slots,
               d_out: vectors, a_out: vectors, push_out: vectors, struck_out: ints, wanted_out: ints):
        i = wp.tid()
        count, mark, carried = int(0), int(0), t.vec3()
        deep = c.deep[0] | (s.mark[i] & SUNK)
        if points.w[i] > real(0.0):
            o = points.object[i]
            x0 = x[i]
            d0 = d[i]
            bound = real(2.0) * wp.length(d0) + points.reach[i] + c.skin
            for row in range(c.first[o], c.first[o + 1]):
                if not reachable(c.ball[k, row], x0, bound):
                    continue
                T0 = c.pose[k, row]
                T1 = c.pose[k + 1, row]
                q0, q1 = inside(T0, T1, x0 + carried, d0)
                margin = wp.length(q1 - q0) + c.skin + c.stride[k, row]
                r = points.reach[i] + c.gap[row]
                C, m, p, s0, slip = touch(c.kind[row], c.size[row], c.mesh[row], deep, q0, q1, r, margin)
                if C < margin:
                    n, way = outside(T0, T1, c.step[k, row], m, p, slip)
                    over = wp.max(-s0, real(0.0))
                    out = wp.min(over, c.recovery * c.h)        # of the overlap; the rest may stay for now
                    if over > real(SUNK_FROM) * c.skin:
                        mark = mark | SUNK
                    if count < s.capacity:
                        j = count * s.points + i
                        s.row[j] = row
                        s.n[j] = n
                        s.b[j] = C + over - out - wp.dot(n, d0 + carried)
                        s.u[j] = way / c.h
                        push_out[j] = t.vec3()
                    carried += out * n
                    count += 1
        if count > s.capacity:
            wp.atomic_max(wanted_out, 0, count)
        s.count[i] = wp.min(count, s.capacity)
        s.mark[i] = mark
        if wp.dot(carried, carried) > real(0.0):
            d_out[i] = d[i] + carried
            a_out[i] = a[i] + carried
        if struck_out:
            struck_out[i] = mark & SUNK

    return wp.kernel(search, name=name, module=module, enable_backward=False)


@cache
def project(real, module):
    """Kernel over points: one iteration of all contacts of a point, in order."""
    t = types(real)
    Rows, Points = tables(real)
    Slots = slots(real)

    def project(c: Rows, points: Points, s: Slots, d: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3),
                push: wp.array(dtype=t.vec3), g: real,
                d_out: wp.array(dtype=t.vec3), push_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        count = s.count[i]
        if count == 0:
            return
        d1 = d[i]
        anchor = a[i]
        touched = int(0)
        for slot in range(count):
            j = slot * s.points + i
            n = s.n[j]
            P = push[j]
            lam = wp.dot(P, n)
            T = P - lam * n
            pressed = wp.max(lam - (s.b[j] + wp.dot(n, d1)), real(0.0))
            d1 += (pressed - lam) * n
            stop = t.vec3()
            if pressed > real(0.0):
                touched = TOUCHED
                mu = real(0.5) * (points.friction[i] + c.friction[s.row[j]])
                slide = (d1 - anchor) - g * s.u[j]
                stop = T - (slide - wp.dot(slide, n) * n)
                size = wp.length(stop)
                if size > mu[0] * pressed:
                    stop = (wp.min(mu[1] * pressed, size) / size) * stop
            d1 += stop - T
            push_out[j] = pressed * n + stop
        d_out[i] = d1
        s.mark[i] = (s.mark[i] & SUNK) | touched

    return wp.kernel(project, name=f"contact_{types(real).name}", module=module, enable_backward=False)


@cache
def settle(real, module):
    """Kernel over points, after the last iteration of a multistep integrator: no history across a contact plane.

    A multistep formula takes the velocity before an impact for a part of the one after it and bounces. So along the
    normal of a contact that pushes, velocity is the step over h, n.(d - e) / h, by a new anchor, and the velocity
    before this one is the same; motion across the normal keeps its order. Two and more normals: all components."""
    t = types(real)
    Slots, vectors = slots(real), wp.array(dtype=t.vec3)

    def settle(s: Slots, push: vectors, e: vectors, d: vectors, a: vectors, v: vectors, g: real, h: real,
               a_out: vectors, v_out: vectors):
        i = wp.tid()
        if (s.mark[i] & TOUCHED) == 0:
            return
        n = t.vec3()
        pushing = int(0)
        for slot in range(s.count[i]):
            j = slot * s.points + i
            if wp.dot(push[j], s.n[j]) > real(0.0):
                n = s.n[j]
                pushing += 1
        d1 = d[i]
        w = (d1 - e[i]) / h
        da = d1 - a[i] - g * w
        dv = w - v[i]
        if pushing < 2:
            da = wp.dot(n, da) * n
            dv = wp.dot(n, dv) * n
        a_out[i] = a[i] + da
        v_out[i] = v[i] + dv

    return wp.kernel(settle, name=f"settle_{types(real).name}", module=module, enable_backward=False)


@cache
def gauge(kinds: tuple[str, ...], real, module):
    """Kernel over lanes, each taking every `lanes`-th point: how deep points are at pose k inside of the distance
    kept and of the solid itself [m], and how many are in contact. The host takes the greatest, so no atomics."""
    t, name = types(real), f"gauge_{'_'.join(kinds)}_{types(real).name}"
    Rows, Points = tables(real)
    Slots, touch = slots(real), collide.touch(kinds, real)

    def gauge(c: Rows, points: Points, s: Slots, x: wp.array(dtype=t.vec3), k: int, lanes: int,
              inside_out: wp.array(dtype=t.vec2), count_out: wp.array(dtype=int)):
        lane = wp.tid()
        kept = real(0.0)
        solid = real(0.0)
        count = int(0)
        for i in range(lane, s.points, lanes):
            if points.w[i] > real(0.0):
                count += s.mark[i] & TOUCHED
                o = points.object[i]
                x0 = x[i]
                for row in range(c.first[o], c.first[o + 1]):
                    T = c.pose[k, row]
                    q = wp.quat_rotate_inv(wp.transform_get_rotation(T), x0 - wp.transform_get_translation(T))
                    r = points.reach[i] + c.gap[row]
                    kind = c.kind[row]
                    size = c.size[row]
                    C, n, p, s0, slip = touch(kind, size, c.mesh[row], 0, q, q, r, size[0])
                    kept = wp.max(kept, -C)
                    if kind != collide.SHEET:
                        solid = wp.max(solid, -C - r)
        inside_out[lane] = t.vec2(kept, solid)
        count_out[lane] = count

    return wp.kernel(gauge, name=name, module=module, enable_backward=False)


@cache
def pose_mesh(module):
    """Kernel over the points of a deforming mesh: its shape at the end of substep k, and the way there [m]."""

    def pose_mesh(track: wp.array2d(dtype=wp.vec3f), k: int, point_out: wp.array(dtype=wp.vec3f),
                  step_out: wp.array(dtype=wp.vec3f)):
        i = wp.tid()
        end = track[k + 1, i]
        point_out[i] = end
        step_out[i] = end - track[k, i]

    return wp.kernel(pose_mesh, name="pose_mesh", module=module, enable_backward=False)
