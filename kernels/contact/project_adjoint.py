"""Adjoint of the projection of contacts (kernels/contact/project.py), point by point; that of their search:
kernels/contact/search_adjoint.py.

Lists are frozen: which contacts a point has, and in which order, is found anew by the same search of the same arrays. Where a
list, a branch of friction or the side of a shape would change, the motion has a kink, and there is no derivative. With D and Q
the gradients by d and P after a projection, those by all that it has read are those of s = D.d' + Q.P', which Warp
differentiates.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.project import contact_tables, plane_projection_func, read_type, slot_type, softness_func
from wsim.kernels.math.real import types


@cache
def gradient_type(real):
    """Struct of gradients. d_out, push_out, a_out: by what was written; the others are added to; n, b, u of contacts in the
    order of the slots; friction, gap, motion of row r of the colliders of a point's object at r * points + i."""
    t = types(real)

    @wp.struct
    class ProjectionGradients:
        d_out: wp.array(dtype=t.vec3)
        a_out: wp.array(dtype=t.vec3)
        push_out: wp.array(dtype=t.vec3)
        x: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        push: wp.array(dtype=t.vec3)
        n: wp.array(dtype=t.vec3)
        b: wp.array(dtype=t.scalar)
        u: wp.array(dtype=t.vec3)
        friction: wp.array(dtype=t.vec2)         # by the mean of the point's and the collider's
        gap: wp.array(dtype=t.scalar)            # by the distance kept [1/m]
        # by shift [1/m] and turn [1/rad] of the collider where a frame begins and ends
        motion: wp.array(dtype=motion_gradient_type(real))

    return ProjectionGradients


@cache
def motion_gradient_type(real):
    """Matrix: rows shift and turn at the begin of a frame, shift and turn at its end."""
    return wp.types.matrix((4, 3), real)


@cache
def projection_cotangent_func(real):
    """Function that Warp differentiates: s of a contact."""
    t, meet = types(real), plane_projection_func(real)
    vec3 = t.vec3

    @wp.func
    def projection_cotangent(n: vec3, gap: t.vec4, w: vec3, P: vec3, d: vec3, mu: t.vec2, D: vec3, Q: vec3):
        moved, push, pressed = meet(n, gap[0], w, vec3(), P, d, mu, vec3(gap[1], gap[2], gap[3]))
        return wp.dot(D, moved) + wp.dot(Q, push)

    return projection_cotangent


@cache
def compile_projection_gradient(real, module) -> None:
    """A kernel that never runs: see kernels/solver/xpbd_vjp.py."""
    t, pushed = types(real), projection_cotangent_func(real)
    vec3 = t.vec3

    def call_projection_gradient(b: real, out: wp.array(dtype=real)):
        o = vec3()
        out[0] = pushed(o, t.vec4(b, b, b, b), o, o, o, t.vec2(), o, o)

    wp.kernel(call_projection_gradient, name=f"need_contact_{t.name}", module=module, enable_backward=True)


@cache
def project_adjoint(real, module):
    """Kernel over points: the adjoint of an iteration; takes the gradients by what it has written away. Arguments: rows,
    points, slots, what was read (d, a, push), gradients, g."""
    t, pushed, meet, soften = types(real), projection_cotangent_func(real), plane_projection_func(real), softness_func(real)
    (Rows, Points), Slots, Read, Grads = contact_tables(real), slot_type(real), read_type(real), gradient_type(real)

    @wp.func
    def contact_friction_mean(c: Rows, points: Points, s: Slots, i: int, j: int):
        return real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])

    def projection_adjoint_step(c: Rows, points: Points, s: Slots, at: Read, o: Grads, g: real):
        i = wp.tid()
        count = s.count[i]
        if count == 0:
            return
        a = at.a[i]
        D = o.d_out[i]
        by_a = t.vec3()
        soft = soften(c, g)
        for back in range(count):
            last = count - 1 - back
            d = at.d[i]
            for slot in range(last):
                j = slot * s.points + i
                d, P, _pressed = meet(s.n[j], s.b[j], a, g * s.u[j], at.push[j], d, contact_friction_mean(c, points, s, i, j),
                                      soft)
            j = last * s.points + i
            gap = t.vec4(s.b[j], soft[0], soft[1], soft[2])
            gn, gb, gw, gP, gd, gmu, _D, _Q = wp.grad(pushed)(
                s.n[j], gap, a + g * s.u[j], at.push[j], d, contact_friction_mean(c, points, s, i, j), D, o.push_out[j])
            o.n[j] = o.n[j] + gn
            o.b[j] = o.b[j] + gb[0]
            o.u[j] = o.u[j] + g * gw
            o.push[j] = o.push[j] + gP
            o.push_out[j] = t.vec3()
            place = (s.row[j] - c.first[points.object[i]]) * s.points + i
            o.friction[place] = o.friction[place] + gmu
            by_a += gw
            D = gd
        o.d_out[i] = t.vec3()
        o.d[i] = o.d[i] + D
        o.a[i] = o.a[i] + by_a

    compile_projection_gradient(real, module)
    return wp.kernel(projection_adjoint_step, name=f"adjoint_contact_{t.name}", module=module, enable_backward=False)
