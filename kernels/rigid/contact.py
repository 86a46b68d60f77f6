"""Tables of rigid contact, and the formulas of one manifold: gaps, effective mass, impulses.

A manifold has a normal n from B to A, fixed until it is renewed, and up to four points. A point has a core in the frame of
each body, which turns with it, a rim and a skin, which do not. Of a sphere the core is its centre and the skin its radius; of
the side and the rim of a cylinder or a cone the core is on the axis z and the rim is the distance from there, so that rolling
moves no contact.

    e   = (n - (n.z) z) / |n - (n.z) z|                                        across the axis, in the plane of n and z
    p_a = R_a c_a - e_a rim_a,   p_b = R_b c_b + e_b rim_b                     from the centres of mass
    r_a = p_a - n s_a,           r_b = p_b + n s_b                             places from the centres of mass
    gap = gap_0 + n . (d_a - d_b + (p_a - p_a0) - (p_b - p_b0))                d: displacement since the manifold was made
    u   = v_a + omega_a x r_a - (v_b + omega_b x r_b)                          velocity of A against B

Frames: dynamic bodies come first, then colliders, which have no inverse mass and whose poses and velocities are tables.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.motion import body_structs as bodies

POINTS = wp.constant(4)


@cache
def rigid_contact_structs(real):
    """(Shapes, Still, Contacts, Work). Lengths in [m]."""
    t = types(real)

    @wp.struct
    class RigidShapes:
        """Of bodies and colliders, (shapes,)."""
        frame: wp.array(dtype=int)             # bodies, then colliders
        kind: wp.array(dtype=int)
        row: wp.array(dtype=int)               # of a hull in its tables
        size: wp.array(dtype=t.vec3)
        place: wp.array(dtype=t.transform)     # to the frame: of a body its centre of mass and principal axes
        ball: wp.array(dtype=real)             # radius of a ball about the shape's origin that holds it; < 0: it has no end
        skin: wp.array(dtype=real)             # radius of what is round
        core: wp.array(dtype=t.vec4)           # centre in the shape's frame and radius of a ball well inside it
        friction: wp.array(dtype=t.vec2)       # static, dynamic; (shapes + (worlds - 1) stills,), see `surface_law_functions`
        restitution: wp.array(dtype=real)      # likewise
        still: int                             # first shape of a collider that stands: those are in all worlds
        world: wp.array(dtype=int)             # -1: all
        origin: wp.array(dtype=wp.vec3d)       # of the frames, (bodies + colliders,), world

    @wp.struct
    class RigidColliders:
        """Colliders, [row, collider]; rows are substeps where `moving`, else one."""
        moving: int
        x: wp.array2d(dtype=t.vec3)            # from the collider's origin
        q: wp.array2d(dtype=t.quat)
        v: wp.array2d(dtype=t.vec3)
        omega: wp.array2d(dtype=t.vec3)

    @wp.struct
    class ManifoldTable:
        """Manifolds, (room,), and points, (4 room,)."""
        a: wp.array(dtype=int)                 # shapes; -1: no manifold
        b: wp.array(dtype=int)
        count: wp.array(dtype=int)
        colour: wp.array(dtype=int)            # -1: none yet
        key: wp.array(dtype=int)               # of a point
        n: wp.array(dtype=t.vec3)
        skin: wp.array(dtype=t.vec2)
        from_a: wp.array(dtype=t.vec3)         # poses of the frames for which the manifold was made
        from_b: wp.array(dtype=t.vec3)
        turn_a: wp.array(dtype=t.quat)
        turn_b: wp.array(dtype=t.quat)
        core_a: wp.array(dtype=t.vec3)         # in the frames
        core_b: wp.array(dtype=t.vec3)
        rim: wp.array(dtype=t.vec2)            # of a, of b; 0: nothing that rolls about an axis
        first_a: wp.array(dtype=t.vec3)        # p as the manifold was made
        first_b: wp.array(dtype=t.vec3)
        gap: wp.array(dtype=real)
        push: wp.array(dtype=real)             # impulse along n in a substep [N s]
        rub: wp.array(dtype=t.vec3)            # across n
        drift: wp.array(dtype=t.vec3)          # [m], see kernels/rigid/complementarity/drift.py

    @wp.struct
    class SubstepWork:
        """Of a substep: frames of all bodies (bodies + colliders,), and points."""
        g: wp.array(dtype=real)                # [m/s^2], of the weight, (worlds,)
        center: wp.array(dtype=wp.vec3d)       # of shapes, world
        span: wp.array(dtype=t.vec2)           # of shapes: radius of the ball, < 0 without end; how far it may go
        from_x: wp.array(dtype=t.vec3)         # where bodies were when pairs were listed
        from_q: wp.array(dtype=t.quat)
        way: wp.array(dtype=real)              # of bodies [m]: how far a shape may go before the list is no longer whole
        slack: wp.array(dtype=real)            # of bodies [m]: part of it that does not depend on the speed
        arm: wp.array(dtype=real)              # of bodies [m]: from the centre of mass to the farthest end of a shape
        strayed: wp.array(dtype=int)           # (1 + worlds,): 1 once a body of any has gone, or will go, beyond its way
        spread: wp.array(dtype=t.mat33)        # I^-1, world
        turn: wp.array(dtype=t.mat33)          # R
        p0: wp.array(dtype=t.vec3)             # momenta before the substep's forces
        L0: wp.array(dtype=t.vec3)
        touched: wp.array(dtype=int)
        given: wp.array(dtype=wp.float64)      # to bodies: work of colliders that move, in the frame [J]
        renewed: wp.array(dtype=int)           # of manifolds: 1 if it was made in this substep, 2 if it is to be left out
        listed: wp.array(dtype=int)            # (1,): how many manifolds there are, those that found no room with them
        order: wp.array(dtype=int)             # manifolds by colour
        starts: wp.array(dtype=int)            # of colours in `order`, and the end
        colours: wp.array(dtype=int)           # (1,): how many
        flags: wp.array(dtype=int)             # (2 + 2 worlds,): what one thread says to all, see kernels/rigid/impact.py
        node: wp.array(dtype=int)              # of bodies: the body whose colours it shares, which joins all of its tree
        taken: wp.array(dtype=wp.int64)        # of bodies: colours of their manifolds, a bit each
        place: wp.array(dtype=int)             # of colours: where the next manifold goes
        first: wp.array(dtype=int)             # of bodies: rank of the manifold that may take a colour
        calm: wp.array(dtype=real)             # of bodies [s], see kernels/rigid/graph/sleep.py
        asleep: wp.array(dtype=int)            # 1: passes leave the body as it is
        label: wp.array(dtype=int)             # first body of its island
        roused: wp.array(dtype=int)            # 1: the island is awake that has this body first
        awake: wp.array(dtype=int)             # (1,): whether some body is
        r_a: wp.array(dtype=t.vec3)
        r_b: wp.array(dtype=t.vec3)
        now: wp.array(dtype=real)              # gap
        K: wp.array(dtype=t.vec3)              # across n, see kernels/rigid/impulse.py
        A: wp.array(dtype=t.mat44)             # along n, of manifolds
        slip_by_push: wp.array(dtype=t.vec2)   # of trees, (16 room,), of points i, e: slip of i by an impulse along n at e
        slip_by_rub: wp.array(dtype=t.mat22)     # (6 room,), of e < i: slip of i by an impulse along the tangents at e
        goal: wp.array(dtype=real)             # velocity along n behind an impact; < 0: none
        hit: wp.array(dtype=real)              # impulses of it
        when: wp.array(dtype=real)             # [s] from now until then
        scrape: wp.array(dtype=t.vec3)
        residual: wp.array(dtype=real)         # (2,): now, and what was left [m/s], see kernels/rigid/complementarity

    return RigidShapes, RigidColliders, ManifoldTable, SubstepWork


@cache
def rig_type(real):
    """Struct of all that a launch needs: s, b, now, still, c, work."""
    Shapes, Still, Contacts, Work = rigid_contact_structs(real)
    Bodies, Moving = bodies(real)

    @wp.struct
    class RigidTables:
        s: Shapes
        b: Bodies
        now: Moving
        still: Still
        c: Contacts
        work: Work

    return RigidTables


@cache
def rim_axis_functions(real):
    """Functions (axis, across) for a shape that is round about its z axis. axis(shape, R, rig): z in the world, R the rotation
    of the shape's frame; across(z, n): unit vector e from the axis along n; 0 where n is parallel to z."""
    t, Rig = types(real), rig_type(real)

    @wp.func
    def shape_world_axis(shape: int, R: t.mat33, rig: Rig):
        return R * wp.quat_rotate(wp.transform_get_rotation(rig.s.place[shape]), t.vec3(real(0.0), real(0.0), real(1.0)))

    @wp.func
    def unit_across_axis(z: t.vec3, n: t.vec3):
        return wp.normalize(n - wp.dot(n, z) * z)

    return shape_world_axis, unit_across_axis


@cache
def surface_law_functions(real):
    """Functions of friction and restitution of a manifold m. Those of a collider that stands are in the first world's row of
    its shape, and of every further world behind all shapes."""
    Rig = rig_type(real)

    @wp.func
    def surface_row(one: int, other: int, rig: Rig):
        """Row of shape `one` as it meets shape `other`."""
        world = rig.s.world[other]
        count = rig.s.world.shape[0]
        row = one
        if one >= rig.s.still and world > 0:
            row = count + (world - 1) * (count - rig.s.still) + one - rig.s.still
        return row

    @wp.func
    def friction_of(m: int, rig: Rig):
        """Static and dynamic: the mean of both shapes."""
        a = surface_row(rig.c.a[m], rig.c.b[m], rig)
        b = surface_row(rig.c.b[m], rig.c.a[m], rig)
        return real(0.5) * (rig.s.friction[a] + rig.s.friction[b])

    @wp.func
    def restitution_of(m: int, rig: Rig):
        """The larger of both shapes."""
        a = surface_row(rig.c.a[m], rig.c.b[m], rig)
        b = surface_row(rig.c.b[m], rig.c.a[m], rig)
        return wp.max(rig.s.restitution[a], rig.s.restitution[b])

    return friction_of, restitution_of


@cache
def manifold_count_func(real):
    """Function: how many manifolds there are in the list."""
    Rig = rig_type(real)

    @wp.func
    def count_listed_manifolds(rig: Rig):
        return wp.min(rig.work.listed[0], rig.c.a.shape[0])

    return count_listed_manifolds


@cache
def first_manifold_func(real):
    """Function: place of the first manifold whose shape a is of world w or a later one. The list is sorted by shape a, and so
    by worlds."""
    Rig, count = rig_type(real), manifold_count_func(real)

    @standalone_function
    @wp.func
    def first_manifold_of_world(w: int, rig: Rig):
        low = int(0)
        high = count(rig)
        while low < high:
            middle = (low + high) // 2
            if rig.s.world[rig.c.a[middle]] < w:
                low = middle + 1
            else:
                high = middle
        return low

    return first_manifold_of_world
