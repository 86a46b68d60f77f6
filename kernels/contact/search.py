"""Search for contacts between points and colliders, once a substep, after prediction.

    x  position at the start of the substep [m]     d  predicted displacement [m]      a  anchor: v = (d - a) / g

Each point tries the colliders of its object, but for those whose bounding ball it cannot reach in this substep. A
contact is kept where the gap at the predicted place is under a margin of |dq| + skin, dq the motion relative to the
collider: constraints may still move the point. A point that started too near by s0 < 0 is carried out by the same
shift of d and a, hence without velocity, by at most `recovery` h; by what is then left its plane is moved back.

Contacts stand in the order of the colliders, so results are bitwise the same from run to run. Slots are a struct, of which a
tape keeps no versions: the search is run once more before its adjoint (kernels/contact/search_adjoint.py).
"""

# Device code: int(0) makes a variable of what would be a constant; `not a < b` is true where a is no number.
# ruff: noqa: UP018, SIM102

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact import collide
from wsim.kernels.contact.project import SUNK, read, slots, tables
from wsim.kernels.math.real import types

SUNK_FROM = 0.01       # part of the skin: overlaps under it are rounding and no reason to look deeper


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
    """Kernel over points: contacts of substep k. Reads x, d, a.

    d_out, a_out   written where a point is carried out of an overlap       push_out   of its contacts: zeroed
    struck_out     (may be None) not 0 where a point is in an overlap"""
    t, name = types(real), f"search_{'_'.join(kinds)}_{types(real).name}"
    Rows, Points = tables(real)
    Slots, Read, touch, (inside, outside) = slots(real), read(real), collide.touch(kinds, real), frames(real)
    vectors = wp.array(dtype=t.vec3)

    def search(c: Rows, points: Points, at: Read, s: Slots, d_out: vectors, a_out: vectors, push_out: vectors,
               struck_out: wp.array(dtype=real)):
        i = wp.tid()
        k = at.k
        count, mark, carried = int(0), int(0), t.vec3()
        deep = c.deep[0] | (s.mark[i] & SUNK)
        if points.w[i] > real(0.0):
            o = points.object[i]
            x0 = at.x[i]
            d0 = at.d[i]
            bound = real(2.0) * wp.length(d0) + points.reach[i] + c.skin
            for row in range(c.first[o], c.first[o + 1]):
                if not reachable(c.ball[k, row], x0, bound):
                    continue
                T0 = c.pose[k, row]
                T1 = c.pose[k + 1, row]
                q0, q1 = inside(T0, T1, x0 + carried, d0)
                margin = wp.length(q1 - q0) + c.skin + c.stride[k, row]
                r = points.reach[i] + c.gap[row] - c.width           # the hard contact behind a potential
                C, m, p, s0, slip = touch(c.kind[row], c.size[row], c.mesh[row], deep, q0, q1, r,
                                           t.vec2(margin, c.width))
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
            wp.atomic_max(s.wanted, 0, count)
        s.count[i] = wp.min(count, s.capacity)
        s.mark[i] = mark
        if wp.dot(carried, carried) > real(0.0):
            d_out[i] = at.d[i] + carried
            a_out[i] = at.a[i] + carried
        if struck_out:
            struck_out[i] = real(mark & SUNK)

    return wp.kernel(search, name=name, module=module, enable_backward=False)


@wp.func_native("""
    typedef void (*Refit)(wp::uint64);
    ((Refit)function)(mesh);
""")
def call(function: wp.uint64, mesh: wp.uint64): ...


@cache
def refit(module):
    """Kernel of one thread, on a CPU: `function` is the address of Warp's refit of a mesh, which a CPU's graph leaves out."""

    def refit(function: wp.uint64, mesh: wp.uint64):
        call(function, mesh)

    return wp.kernel(refit, name="refit_mesh", module=module, enable_backward=False)


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
