"""Shapes of rigid bodies in a substep of strands, and whether one may be met. Forces: kernels/rigid/touch/strand_forces.py.

A world steps by backward Euler while a body may be met, or is tied to a point (`near`): points that carry on the step before
take two thirds of an impulse at once, and bodies would have got all of it.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.rotation import multiply_rotations, rotate_vector, unit_quaternion
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.motion import double_quat, double_vec3, free_rotor_step
from wsim.kernels.rigid.touch.strands import RodBodies, mean_drag_factor
from wsim.kernels.rods.contact import FAR, Colliders, strand_touch_functions
from wsim.kernels.rods.edges.edge_contact_points import EdgePlaces, edge_flank_functions
from wsim.kernels.rods.tables import RodContacts, RodMotion, RodTable, RodTrial, contact_mass, is_own_point

AHEAD = wp.constant(wp.float64(2.0))     # of the ways of a place and a body in a substep, within which they count as near

SITES = wp.constant(3)                   # of a row: a point, two places within the edge behind it


@wp.func
def small_turn(a: wp.vec3d):
    """Quaternion of a rotation vector [rad]."""
    size = wp.length(a)
    half = wp.float64(0.5)
    k = half
    if size > wp.float64(1e-9):
        k = wp.sin(half * size) / size
    return wp.quatd(k * a[0], k * a[1], k * a[2], wp.cos(half * size))


@wp.func
def trial_turn(W: RodBodies, j: int):
    """Quaternion of the principal axes of body j in the trial."""
    return multiply_rotations(small_turn(W.xi[j, 1]), W.q1[j])


@wp.func
def passes_body(W: RodBodies, i: int, k: int, edge: int, body: int):
    """True if point i, or the edge behind it, does not meet a body: it is tied to that, or the next point is."""
    if not W.tied:
        return False
    p = W.passes[i, k]
    return p[2 * edge] == body or p[2 * edge + 1] == body


@cache
def strand_body_kernels(real, module: str):
    """Kernels over bodies, where they are and go; over shapes, with them."""
    Rig = rig_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def place_strand_bodies(rig: Rig, W: RodBodies, B: RodContacts):
        i = wp.tid()
        B.left[i] = wp.float64(0.0)
        B.ahead[i] = wp.float64(0.0)
        B.gain[i] = wp.float64(0.0)
        q = unit_quaternion(double_quat(rig.now.q[i], rig.now.o[i]))
        m = wp.float64(1.0) / wp.float64(rig.b.w[i])
        x = W.begin[i] + double_vec3(rig.now.x[i]) + double_vec3(rig.now.e[i])
        inverse = double_vec3(rig.b.inverse[i])
        one = wp.float64(1.0) / mean_drag_factor(rig.b.spin_drag[i], W.h)
        R = wp.quat_to_matrix(q)
        W.c0[i] = x
        W.q0[i] = q
        W.c1[i] = x + double_vec3(rig.now.p[i]) * (W.h / m)
        W.q1[i] = free_rotor_step(q, double_vec3(rig.now.L[i]), inverse, W.h)
        W.m[i] = m / mean_drag_factor(rig.b.drag[i], W.h)
        W.J[i] = R * wp.diag(wp.vec3d(one / inverse[0], one / inverse[1], one / inverse[2])) * wp.transpose(R)
        for j in range(2):
            W.xi[i, j] = wp.vec3d()
            W.last[i, j] = wp.vec3d()

    @wp.kernel(module=module, enable_backward=False)
    def pose_shapes(W: RodBodies):
        c = wp.tid()
        i = W.body[c]
        own = wp.transform_get_translation(W.place[c])
        turn = wp.transform_get_rotation(W.place[c])
        q = trial_turn(W, i)
        W.pose0[c] = wp.transformd(W.c0[i] + rotate_vector(W.q0[i], own), multiply_rotations(W.q0[i], turn))
        at = multiply_rotations(q, turn)
        x = W.c1[i] + W.xi[i, 0] + rotate_vector(q, own)
        W.pose1[c] = wp.transformd(x, at)
        size = W.size[c]
        x = x + rotate_vector(at, wp.vec3d(size[0], size[1], size[2]))
        W.ball[c] = wp.vec4d(x[0], x[1], x[2], size[3])

    return place_strand_bodies, pose_shapes


@wp.struct
class RodSpot:
    """A place of a strand: a point (site 0), or one of two within the edge behind it (sites 1 and 2, 0 < u < 1)."""

    i: int
    k: int
    site: int
    u: wp.float64                                   # x_u = (1 - u) x_i + u x_i+1
    x: wp.vec3d                                     # [m], in the world
    way: wp.vec3d                                   # since the substep began [m]
    v: wp.vec3d                                     # where it began [m/s]
    m: wp.float64                                   # mass [kg], half of it within an edge, and half of A
    radius: wp.float64                              # [m]
    A: wp.float64                                   # stretching stiffness of its edge over that's length [N/m]


@wp.func
def strand_spot(S: RodTable, Q: RodMotion, T: RodTrial, i: int, k: int, site: int, u: wp.float64):
    s = RodSpot()
    s.i = i
    s.k = k
    s.site = site
    s.u = u
    j = wp.min(i + 1, S.points[k] - 1)
    a = wp.float64(1.0) - u
    s.x = T.x[i, k] * a + T.x[j, k] * u + S.origin[k]
    s.way = (T.x[i, k] - Q.x[i, k]) * a + (T.x[j, k] - Q.x[j, k]) * u
    s.v = Q.v[i, k] * a + Q.v[j, k] * u
    s.m = S.m[i, k] * a + contact_mass(S, j, k) * u
    s.radius = S.radius[i, k] * a + S.radius[j, k] * u
    s.A = S.A[wp.max(i - 1, 0), k]
    if site > 0:
        s.m = s.m * wp.float64(0.5)
        s.A = S.A[i, k] * wp.float64(0.5)
    return s


@cache
def strand_shape_funcs(kinds: tuple[str, ...]):
    """Functions (C, W, s, margin, c) -> how deep a place of a strand is in a shape [m], less than -FAR where it is in another
    world or farther than a margin, and the normal; (C, S, T, W, margin, c, i, k) -> `EdgePlaces` of the edge behind a point.
    kinds: of shapes, which C has as colliders without frames."""
    signed, flanks = strand_touch_functions(kinds).signed, edge_flank_functions(kinds).flanks

    @wp.func
    def spot_depth_in_shape(C: Colliders, W: RodBodies, s: RodSpot, margin: wp.float64, c: int):
        deep = -FAR - FAR
        n = wp.vec3d()
        ball = W.ball[c]
        thick = s.radius + C.thick[c]
        near = W.world[c] == W.strand[s.k] and not passes_body(W, s.i, s.k, wp.min(s.site, 1), W.body[c])
        if near and wp.length(s.x - wp.vec3d(ball[0], ball[1], ball[2])) < ball[3] + thick + margin:
            phi, n0, _ = signed(C, c, 0, wp.transform_point(wp.transform_inverse(W.pose1[c]), s.x))
            deep = thick - phi
            n = wp.transform_vector(W.pose1[c], n0)
        return deep, n

    @wp.func
    def edge_span_in_shape(C: Colliders, S: RodTable, T: RodTrial, W: RodBodies, margin: wp.float64, c: int, i: int, k: int):
        found = EdgePlaces()
        half = wp.float64(0.5)
        x0 = T.x[i, k] + S.origin[k]
        x1 = T.x[i + 1, k] + S.origin[k]
        ball = W.ball[c]
        reach = wp.max(S.radius[i, k], S.radius[i + 1, k]) + C.thick[c] + margin
        away = wp.length((x0 + x1) * half - wp.vec3d(ball[0], ball[1], ball[2])) - half * wp.length(x1 - x0)
        if W.world[c] == W.strand[k] and away < ball[3] + reach and not passes_body(W, i, k, 1, W.body[c]):
            back = wp.transform_inverse(W.pose1[c])
            found = flanks(C, c, 0, wp.transform_point(back, x0), wp.transform_point(back, x1), reach)
            found.a.n = wp.transform_vector(W.pose1[c], found.a.n)
            found.b.n = wp.transform_vector(W.pose1[c], found.b.n)
        return found

    return spot_depth_in_shape, edge_span_in_shape


@cache
def near_body_kernels(kinds: tuple[str, ...], module: str):
    """Kernels over points, and the edges behind them: whether a body may be met in a substep; in a world where one may, nothing
    carries on the step before. word: 1 if there is such a world. kinds: as above."""
    depth, span = strand_shape_funcs(kinds)

    @wp.func
    def shape_way_bound(W: RodBodies, c: int):
        """Way of a shape in the substep, at most [m]."""
        j = W.body[c]
        turn = wp.quat_to_matrix(W.q1[j]) - wp.quat_to_matrix(W.q0[j])       # |(R1 - R0) r| <= |R1 - R0| |r|
        return wp.length(W.c1[j] - W.c0[j]) + wp.sqrt(wp.ddot(turn, turn)) * W.size[c][3]

    @wp.kernel(module=module, enable_backward=False)
    def near_bodies(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, W: RodBodies, B: RodContacts,
                    word: wp.array(dtype=int)):
        p = wp.tid()
        m = S.points.shape[0]
        i = p / m
        k = p - i * m
        B.many[p] = 0
        B.push[p] = wp.vec3d()
        for site in range(SITES):
            B.N[p, site] = wp.float64(0.0)
            B.s[p, site] = wp.vec3d()
        T.lift[i, k] = wp.vec3d()
        T.firm[i, k] = wp.mat33d()
        T.bridge[i, k] = wp.mat33d()
        if i < S.points[k] and is_own_point(S, i, k):
            s = strand_spot(S, Q, T, i, k, 0, wp.float64(0.0))
            way = wp.length(s.way) + s.radius
            if W.tied:
                if W.tied[i, k] >= 0:
                    wp.atomic_max(B.near, W.strand[k], 1)
                    wp.atomic_max(word, 0, 1)
            for c in range(W.body.shape[0]):
                margin = AHEAD * (way + shape_way_bound(W, c))
                deep, n = depth(C, W, s, margin, c)
                met = deep > -margin
                if not met and i + 1 < S.points[k]:
                    far = wp.max(way, wp.length(T.x[i + 1, k] - Q.x[i + 1, k]) + S.radius[i + 1, k])
                    edge = span(C, S, T, W, AHEAD * (far + shape_way_bound(W, c)), c, i, k)
                    met = edge.a.u + edge.b.u > wp.float64(0.0)
                if met:
                    wp.atomic_max(B.near, W.strand[k], 1)
                    wp.atomic_max(word, 0, 1)

    @wp.kernel(module=module, enable_backward=False)
    def restart_near_strands(S: RodTable, W: RodBodies, B: RodContacts, Q: RodMotion):
        p = wp.tid()
        m = S.points.shape[0]
        i = p / m
        k = p - i * m
        if B.near[W.strand[k]] == 1:
            Q.begun[i, k] = 0

    return near_bodies, restart_near_strands
