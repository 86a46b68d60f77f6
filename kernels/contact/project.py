"""Projection of contacts between points and colliders with Coulomb friction, in every iteration.

    d  displacement, the unknown [m]                n  unit normal of a contact plane
    a  anchor: velocity v = (d - a) / g [m/s]       C  gap, C = b + n.d >= 0 [m]
    e  what d started from [m]                      u  velocity of the surface there [m/s]
    P  accumulated push of a contact [m]: lam = n.P >= 0 along the normal, T = P - lam n across it. A point of
       mass m has received the impulse m P / g [N s], the collider its opposite

Projected Gauss-Seidel on accumulated impulses (as Tonge, Benevolenski, Voroshilov 2012), in displacements:

    lam' = max(lam - C, 0)                     d += (lam' - lam) n
    T* = T - [(d - a) - g u]_t                 T' = T* where |T*| <= mu_s lam', else mu_d lam' T* / |T*|
                                               d += T' - T

so friction stops the velocity relative to the surface or slides: Coulomb's law, exact for one contact. u is the mean over the
substep, and BDF2's velocity that at its end: on a surface that accelerates by A what sticks creeps back by A h / 2, though no
force errs. Coefficients
are the mean of the point's and the collider's. A point's contacts are taken in the order of the colliders and no
atomic touches a float: results are bitwise the same from run to run. kernels/contact/search.py finds the contacts.
Rigid bodies come first: they have the momentum that their stars have foreseen (kernels/rigid/touch/body_point_solve.py). Were
colliders first, a body would get what they push a heavy point by, and a light one would be thrown.

A width w > 0 moves the hard contact back by w, and puts a potential in front of it that knows no substep (E:
wsim/physics/contact/barrier.py):

    U = m E z^3,  z = 1 - C / w  in 0 < C < w,  so that  lam' = max(A z^2, what C >= 0 wants),  A = 3 E g^2 / w

C is counted from the hard contact: what just touches has C = w and no energy.

U has two continuous derivatives where it begins. Explicit integrators take z where the substep began, C0 = b + n.(a + g u), as
their other forces (leapfrog: order 2; the others order 1 in it); implicit ones where it ends, with c = C - lam the gap without
this contact:  A z^2 / w + z = 1 - c / w,  z = 2 q / (1 + sqrt(1 + 4 A q / w)),  q = 1 - c / w. As w goes to 0 a point at rest
is where hard contacts hold it, and one that falls is thrown back with all of its speed (restitution 1), but for what the
integrator damps.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type, first_body_slot
from wsim.kernels.math.marks import kernel_over_cores, owns_points
from wsim.kernels.math.real import has_adjoint, types

HELD = 1e-3            # of a width: gaps so small are those of the hard contact behind it
TOUCHED, SUNK = 1, 2                   # bits of a point's mark: in contact in this substep, started it in an overlap


@cache
def contact_tables(real):
    """(Rows, Points): structs of what collides, written by the host before a frame, read by kernels. Rows: those of the table
    of colliders (kernels/contact/collider/colliders.py), and how a point finds its own among them."""
    t, Colliders = types(real), collider_type(real)

    @wp.struct
    class CollisionRows:
        of: Colliders                             # moments are the ends of substeps; places count from the object's origin
        first: wp.array(dtype=int)                # rows of object o: first[o] .. first[o + 1], (objects + 1,)
        ball: wp.array2d(dtype=t.vec4)            # centre, radius [m] that hold it during substep k, (substeps, rows)
        chord: wp.array(dtype=t.scalar)           # how much nearer than points their edges may touch it [m], (rows,)
        stride: wp.array2d(dtype=t.scalar)        # greatest motion in its own frame in substep k [m], (substeps, rows)
        deep: wp.array(dtype=int)                 # 1: points may have started inside of meshes, (1,)
        tree: wp.uint64                           # Warp's tree of balls in this substep; 0: each row is tried
        root: wp.array(dtype=int)                 # its node above the balls of an object, (objects,)
        leaf: wp.array(dtype=int)                 # row of each ball in it, (balls,)
        endless: wp.array(dtype=int)              # rows without a ball, ascending
        start: wp.array(dtype=int)                # those of object o: start[o] .. start[o + 1], (objects + 1,)
        h: t.scalar                               # substep [s]
        skin: t.scalar                            # least margin [m]
        recovery: t.scalar                        # speed out of an overlap [m/s]
        width: t.scalar                           # [m]; 0: hard
        energy: t.scalar                          # E [m^2/s^2]
        lead: int                                 # 1: the potential pushes by the gap where a substep begins

    @wp.struct
    class CollidingPoints:
        object: wp.array(dtype=int)               # (points,)
        w: wp.array(dtype=t.scalar)               # inverse mass [1/kg]; 0: the point has no contacts
        reach: wp.array(dtype=t.scalar)           # distance that the point keeps [m]
        friction: wp.array(dtype=t.vec2)          # static, dynamic
        # lists of candidates (kernels/contact/candidates.py), where there are some:
        every: int                                # substeps of a list
        slot: wp.array(dtype=int)                 # number among the meshes of its object, -1: convex, (rows,)
        room: int                                 # faces that a list has room for
        wanted: wp.array(dtype=int)               # most faces near a point that has no room for them, if there is one, (1,)
        count: wp.array(dtype=int)                # faces of a list; more than `room`: it has none, (slots * points,)
        place: wp.array(dtype=wp.vec3f)           # q [m], (slots * points,)
        radius: wp.array(dtype=float)             # R [m]; < 0: there is no list, (slots * points,)
        face: wp.array(dtype=int)                 # face j of slot s and point i at (s * room + j) * points + i
        far: wp.array(dtype=float)                # D, less what the mesh may move [m]

    return CollisionRows, CollidingPoints


@cache
def slot_type(real):
    """Struct of contacts: slot j of point i stands at j * points + i."""
    t = types(real)

    @wp.struct
    class ContactSlots:
        points: int
        capacity: int                             # slots of a point
        count: wp.array(dtype=int)                # contacts of each point, (points,)
        wanted: wp.array(dtype=int)               # most contacts of a point that has no room for them, if there is one, (1,)
        mark: wp.array(dtype=int)                 # bits TOUCHED, SUNK, (points,)
        row: wp.array(dtype=int)                  # (slots,)
        n: wp.array(dtype=t.vec3)                 # (slots,)
        b: wp.array(dtype=t.scalar)               # [m]
        u: wp.array(dtype=t.vec3)                 # [m/s]
        tie: wp.array(dtype=int)                  # 1, 2, 3 of a tie to a body (kernels/rigid/touch/point_ties), else 0, or none
        site: wp.array(dtype=int)                 # of those behind the point's own (kernels/cloth/edge_contact), where some are

    return ContactSlots


@wp.func
def is_tied_slot(s: Any, j: int):
    """True of a plane that pulls, too."""
    if s.tie:
        return s.tie[j] > 0
    return False


@cache
def read_type(real):
    """Struct of what a launch reads of points and of slots; arrays that a kernel does not read stay empty."""
    t = types(real)

    @wp.struct
    class ContactState:
        x: wp.array(dtype=t.vec3)                 # position at the start of the substep [m], (points,)
        v: wp.array(dtype=t.vec3)                 # velocity before it [m/s]
        e: wp.array(dtype=t.vec3)
        d: wp.array(dtype=t.vec3)
        a: wp.array(dtype=t.vec3)
        push: wp.array(dtype=t.vec3)              # P of each slot
        k: int                                    # substep
        now: wp.array(dtype=int)                  # as `wsim.kernels.math.real.substep_number` has it

    return ContactState


@cache
def plane_projection_func(real):
    """Function: d and P after one contact, and how hard it presses (lam'); gu: g times u; soft: `softness_func`."""
    t = types(real)
    vec3, vec2 = t.vec3, t.vec2

    @wp.func
    def barrier_push(soft: vec3, C0: real, c: real):
        """A z^2, see above."""
        q = real(1.0) - C0 / soft[0]
        if soft[2] == real(0.0):
            q = wp.max(real(1.0) - c / soft[0], real(0.0))
            q = real(2.0) * q / (real(1.0) + wp.sqrt(real(1.0) + real(4.0) * q * soft[1] / soft[0]))
        z = wp.clamp(q, real(0.0), real(1.0))
        return soft[1] * z * z

    @wp.func
    def project_plane_contact(n: vec3, b: real, a: vec3, gu: vec3, P: vec3, d: vec3, mu: vec2, soft: vec3):
        lam = wp.dot(P, n)
        T = P - lam * n
        pressed = lam - (b + wp.dot(n, d))
        if soft[0] > real(0.0):
            pressed = wp.max(pressed, barrier_push(soft, b + wp.dot(n, a + gu), -pressed))
        pressed = wp.max(pressed, real(0.0))
        moved = d + (pressed - lam) * n
        stop = vec3()
        if pressed > real(0.0):
            slide = (moved - a) - gu
            onward = T - (slide - wp.dot(slide, n) * n)
            size = wp.length(onward)
            share = real(1.0)
            if size > mu[0] * pressed:
                share = wp.min(mu[1] * pressed, size) / size
            stop = share * onward
        return moved + (stop - T), pressed * n + stop, pressed

    return project_plane_contact


@cache
def softness_func(real):
    """Function: width, A [m] and lead of a launch with the effective step g, as a vector."""
    t = types(real)
    Rows, _ = contact_tables(real)

    @wp.func
    def barrier_softness(c: Rows, g: real):
        A = real(0.0)
        if c.width > real(0.0):
            A = real(3.0) * c.energy * g * g / c.width
        return t.vec3(c.width, A, real(c.lead))

    return barrier_softness


@cache
def point_projection_func(real):
    """Function (c, points, s, i, g, at: rows d and a, push, push_out) -> d of point i after one iteration of its contacts, in
    order; writes pushes and the point's mark."""
    t = types(real)
    (Rows, Points), Slots, meet, soften = (contact_tables(real), slot_type(real), plane_projection_func(real),
                                           softness_func(real))

    @wp.func
    def project_point_contacts(c: Rows, points: Points, s: Slots, i: int, g: real, at: wp.types.matrix((2, 3), real),
                               push: wp.array(dtype=t.vec3), push_out: wp.array(dtype=t.vec3)):
        d1 = at[0]
        a = at[1]
        soft = soften(c, g)
        touched = int(0)
        many = s.count[i]
        first = first_body_slot(c, s, i)
        for turn in range(many):
            j = ((first + turn) % many) * s.points + i
            n = s.n[j]
            mu = real(0.5) * (points.friction[i] + c.of.friction[s.row[j]])
            pressed = real(0.0)
            if is_tied_slot(s, j):
                P = push[j] - (s.b[j] + wp.dot(n, d1)) * n
                d1 += P - push[j]
                pressed = wp.length(P)
            else:
                d1, P, pressed = meet(n, s.b[j], a, g * s.u[j], push[j], d1, mu, soft)
            if pressed > real(0.0):
                touched = TOUCHED
            push_out[j] = P
        s.mark[i] = (s.mark[i] & SUNK) | touched
        return d1

    return project_point_contacts


@cache
def contact_projection_kernel(real, module):
    """Kernel over points: one iteration of all contacts of a point, in order. Reads d, a, push."""
    t = types(real)
    (Rows, Points), Slots, Read, one = contact_tables(real), slot_type(real), read_type(real), point_projection_func(real)

    def project_all_contacts(c: Rows, points: Points, s: Slots, at: Read, g: real,
                             d_out: wp.array(dtype=t.vec3), push_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if s.count[i] > 0:
            d_out[i] = one(c, points, s, i, g, wp.matrix_from_rows(at.d[i], at.a[i]), at.push, push_out)

    return owns_points(kernel_over_cores(project_all_contacts, f"contact_{types(real).name}", module))


@cache
def contact_velocity_kernel(real, module):
    """Kernel over points, after the last iteration of a multistep integrator: no history across a contact plane.

    A multistep formula takes the velocity before an impact for a part of the one after it and bounces. So along the
    normal of a contact that pushes, velocity is the step over h, n.(d - e) / h, by a new anchor, and the velocity
    before this one is the same; motion across the normal keeps its order. Two and more normals: all components.
    Reads v, e, d, a, push."""
    t = types(real)
    (Rows, _), Slots, Read, vectors = contact_tables(real), slot_type(real), read_type(real), wp.array(dtype=t.vec3)

    @wp.func
    def pushing_contact_slots(c: Rows, s: Slots, push: vectors, i: int, d: t.vec3):
        """(slot of the last contact that pushes, how many do); a potential alone leaves the history as it is."""
        last = int(0)
        count = int(0)
        for slot in range(s.count[i]):
            j = slot * s.points + i
            if (is_tied_slot(s, j) or wp.dot(push[j], s.n[j]) > real(0.0)) and (c.width == real(0.0)
                                                       or s.b[j] + wp.dot(s.n[j], d) < real(HELD) * c.width):
                last = j
                count += 1
        return last, count

    def settle_contact_velocity(c: Rows, s: Slots, at: Read, g: real, a_out: vectors, v_out: vectors):
        i = wp.tid()
        j, count = pushing_contact_slots(c, s, at.push, i, at.d[i])
        if count == 0:
            return
        n = s.n[j]
        a0 = at.a[i]
        v0 = at.v[i]
        d1 = at.d[i]
        w = (d1 - at.e[i]) / c.h
        da = d1 - a0 - g * w
        dv = w - v0
        if count < 2:
            da = wp.dot(n, da) * n
            dv = wp.dot(n, dv) * n
        a_out[i] = a0 + da
        v_out[i] = v0 + dv

    return wp.kernel(settle_contact_velocity, name=f"settle_{types(real).name}", module=module,
                     enable_backward=has_adjoint(module))
