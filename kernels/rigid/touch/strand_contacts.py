"""Points of strands on rigid bodies: where shapes are in a substep, which may be met, and the forces of those that are met, by
the law of kernels/rods/contact.py. What bodies then do: kernels/rigid/touch/strands.py.

    k = max(STIFF m / h^2, FIRM A, min(M / h^2, A))      M: of the body, A: E A over the edge's length; what lies on a rope
                                                         sinks by g h^2 / n on n points, or by its strain, in edges

Friction is with the body that a point is deepest in. A world steps by backward Euler while a body may be met (`near`): points
that carry on the step before take two thirds of an impulse at once, and bodies would have got all of it.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.rotation import multiply, normalized, rotate
from wsim.kernels.rigid.contact import whole
from wsim.kernels.rigid.motion import double, double3, free_rotation
from wsim.kernels.rigid.touch.strands import Carried, lasting
from wsim.kernels.rods.contact import FAR, FIRM, SOFT, STIFF, Colliders, Touch, rub, touching
from wsim.kernels.rods.tables import Borne, Motion, Strands, Trial

AHEAD = wp.constant(wp.float64(2.0))     # of the ways of a point and a body in a substep, within which they count as near


@wp.struct
class Deepest:
    """The contact of a point that is deepest: shape, number among the point's, normal."""

    shape: int
    number: int
    n: wp.vec3d


@cache
def places(real, module: str):
    """Kernels over bodies, where they are and go; over shapes, with them."""
    Rig = whole(real)

    @wp.kernel(module=module, enable_backward=False)
    def place_bodies(rig: Rig, W: Carried, B: Borne):
        i = wp.tid()
        B.left[i] = wp.float64(0.0)
        B.ahead[i] = wp.float64(0.0)
        B.gain[i] = wp.float64(0.0)
        q = normalized(double(rig.now.q[i], rig.now.o[i]))
        m = wp.float64(1.0) / wp.float64(rig.b.w[i])
        x = W.begin[i] + double3(rig.now.x[i]) + double3(rig.now.e[i])
        inverse = double3(rig.b.inverse[i])
        one = wp.float64(1.0) / lasting(rig.b.spin_drag[i], W.h)
        R = wp.quat_to_matrix(q)
        W.c0[i] = x
        W.q0[i] = q
        W.c1[i] = x + double3(rig.now.p[i]) * (W.h / m)
        W.q1[i] = free_rotation(q, double3(rig.now.L[i]), inverse, W.h)
        W.m[i] = m / lasting(rig.b.drag[i], W.h)
        W.J[i] = R * wp.diag(wp.vec3d(one / inverse[0], one / inverse[1], one / inverse[2])) * wp.transpose(R)
        for j in range(2):
            W.xi[i, j] = wp.vec3d()
            W.last[i, j] = wp.vec3d()

    @wp.func
    def small_turn(a: wp.vec3d):
        """Quaternion of a rotation vector [rad]."""
        size = wp.length(a)
        half = wp.float64(0.5)
        k = half
        if size > wp.float64(1e-9):
            k = wp.sin(half * size) / size
        return wp.quatd(k * a[0], k * a[1], k * a[2], wp.cos(half * size))

    @wp.kernel(module=module, enable_backward=False)
    def pose_shapes(W: Carried):
        c = wp.tid()
        i = W.body[c]
        own = wp.transform_get_translation(W.place[c])
        turn = wp.transform_get_rotation(W.place[c])
        q = multiply(small_turn(W.xi[i, 1]), W.q1[i])
        W.pose0[c] = wp.transformd(W.c0[i] + rotate(W.q0[i], own), multiply(W.q0[i], turn))
        at = multiply(q, turn)
        x = W.c1[i] + W.xi[i, 0] + rotate(q, own)
        W.pose1[c] = wp.transformd(x, at)
        size = W.size[c]
        x = x + rotate(at, wp.vec3d(size[0], size[1], size[2]))
        W.ball[c] = wp.vec4d(x[0], x[1], x[2], size[3])

    return place_bodies, pose_shapes


@cache
def meeting(kinds: tuple[str, ...]):
    """Functions (C, S, T, W, margin, c, i, k) -> how deep a point is in a shape [m], less than -FAR where it is in another
    world or farther than a margin, and the normal; (S, W, body, i, k) -> stiffness [N/m]. kinds: of shapes, which C has as
    colliders without frames."""
    signed = touching(kinds).signed

    @wp.func
    def depth(C: Colliders, S: Strands, T: Trial, W: Carried, margin: wp.float64, c: int, i: int, k: int):
        deep = -FAR - FAR
        n = wp.vec3d()
        x = T.x[i, k] + S.origin[k]
        ball = W.ball[c]
        thick = S.radius[i, k] + C.thick[c]
        if W.world[c] == W.strand[k] and wp.length(x - wp.vec3d(ball[0], ball[1], ball[2])) < ball[3] + thick + margin:
            phi, n0, _ = signed(C, c, 0, wp.transform_point(wp.transform_inverse(W.pose1[c]), x))
            deep = thick - phi
            n = wp.transform_vector(W.pose1[c], n0)
        return deep, n

    @wp.func
    def stiffness(S: Strands, W: Carried, j: int, i: int, k: int):
        A = S.A[wp.max(i - 1, 0), k]
        hh = W.h * W.h
        return wp.max(wp.max(STIFF * S.m[i, k] / hh, FIRM * A), wp.min(W.m[j] / hh, A))

    return depth, stiffness


@cache
def nearing(kinds: tuple[str, ...], module: str):
    """Kernels over points: whether a body may be met in a substep; in a world where one may, nothing carries on the step
    before. word: 1 if there is such a world. kinds: as above."""
    depth = meeting(kinds)[0]

    @wp.kernel(module=module, enable_backward=False)
    def near_bodies(C: Colliders, S: Strands, Q: Motion, T: Trial, W: Carried, B: Borne, word: wp.array(dtype=int)):
        p = wp.tid()
        m = S.points.shape[0]
        i = p / m
        k = p - i * m
        B.many[p] = 0
        B.N[p] = wp.float64(0.0)
        B.s[p] = wp.vec3d()
        T.lift[i, k] = wp.vec3d()
        T.firm[i, k] = wp.mat33d()
        if i < S.points[k]:
            way = wp.length(T.x[i, k] - Q.x[i, k]) + S.radius[i, k]
            for c in range(W.body.shape[0]):
                j = W.body[c]
                turn = wp.quat_to_matrix(W.q1[j]) - wp.quat_to_matrix(W.q0[j])       # |(R1 - R0) r| <= |R1 - R0| |r|
                went = wp.length(W.c1[j] - W.c0[j]) + wp.sqrt(wp.ddot(turn, turn)) * W.size[c][3]
                margin = AHEAD * (way + went)
                deep, n = depth(C, S, T, W, margin, c, i, k)
                if deep > -margin:
                    wp.atomic_max(B.near, W.strand[k], 1)
                    wp.atomic_max(word, 0, 1)

    @wp.kernel(module=module, enable_backward=False)
    def anew(S: Strands, W: Carried, B: Borne, Q: Motion):
        p = wp.tid()
        m = S.points.shape[0]
        i = p / m
        k = p - i * m
        if B.near[W.strand[k]] == 1:
            Q.begun[i, k] = 0

    return near_bodies, anew


@cache
def meet(kinds: tuple[str, ...], module: str):
    """Kernel over points: contacts with bodies in the trial. full[0]: most contacts of a point, where there is no room for
    them. kinds: as above."""
    depth, stiffness = meeting(kinds)

    @wp.func
    def press(B: Borne, n: wp.vec3d, deep: wp.float64, k: wp.float64, p: int, j: int, w: wp.float64):
        """A contact more of a point, as deep in body j, smooth within w: its normal force."""
        e = wp.min(deep + w, w + w)
        slope = k * e / (w + w)
        N = slope * wp.float64(0.5) * e + k * wp.max(deep - w, wp.float64(0.0))
        number = B.many[p]
        B.many[p] = number + 1
        if number < B.body.shape[1]:
            B.body[p, number] = j
            B.f[p, number] = n * N
            B.K[p, number] = wp.outer(n, n) * slope
        return N

    @wp.func
    def rubbed(C: Colliders, S: Strands, Q: Motion, T: Trial, W: Carried, B: Borne, to: Deepest, p: int):
        """Friction of a point with the shape that it is deepest in."""
        i = p / S.points.shape[0]
        k = p - i * S.points.shape[0]
        c = to.shape
        n = to.n
        j = W.body[c]
        x = T.x[i, k] + S.origin[k]
        q = wp.transform_point(wp.transform_inverse(W.pose1[c]), x)
        slid = (T.x[i, k] - Q.x[i, k]) - (x - wp.transform_point(W.pose0[c], q))
        load = wp.min(W.load[i, k], wp.float64(2.0) * B.N[p])
        if load == wp.float64(0.0):
            blow = wp.abs(wp.dot(n, Q.v[i, k] - (W.c1[j] - W.c0[j]) / W.h)) / W.h + wp.length(S.gravity[k])
            load = wp.min(B.N[p], wp.float64(2.0) * S.m[i, k] * blow)
        t = Touch()
        t.f = B.f[p, to.number]
        t.K = B.K[p, to.number]
        t = rub(t, n, W.stick[i, k] + slid, load, stiffness(S, W, j, i, k), C.friction[c, k], wp.vec3d())
        B.f[p, to.number] = t.f
        B.K[p, to.number] = t.K
        B.s[p] = t.s

    @wp.kernel(module=module, enable_backward=False)
    def meet_bodies(C: Colliders, S: Strands, Q: Motion, T: Trial, W: Carried, B: Borne, full: wp.array(dtype=int)):
        p = wp.tid()
        i = p / S.points.shape[0]
        k = p - i * S.points.shape[0]
        f = wp.vec3d()
        K = wp.mat33d()
        B.many[p] = 0
        B.N[p] = wp.float64(0.0)
        B.s[p] = wp.vec3d()
        B.deep[p] = wp.float64(0.0)
        if i < S.points[k] and B.near[W.strand[k]] == 1:
            w = SOFT * S.radius[i, k]
            to = Deepest()
            for c in range(W.body.shape[0]):
                deep, n = depth(C, S, T, W, w, c, i, k)
                if deep > -w:
                    number = B.many[p]
                    j = W.body[c]
                    N = press(B, n, deep, stiffness(S, W, j, i, k), p, j, w)
                    if number < B.body.shape[1]:
                        B.arm[p, number] = T.x[i, k] + S.origin[k] - (W.c1[j] + W.xi[j, 0])
                    if N > B.N[p]:
                        B.N[p] = N
                        B.deep[p] = deep
                        to.n = n
                        to.shape = c
                        to.number = number
            if B.many[p] > B.body.shape[1]:
                wp.atomic_max(full, 0, B.many[p])
            elif B.N[p] > wp.float64(0.0):
                rubbed(C, S, Q, T, W, B, to, p)
            for number in range(wp.min(B.many[p], B.body.shape[1])):
                f += B.f[p, number]
                K += B.K[p, number]
        T.lift[i, k] = f
        T.firm[i, k] = K

    return meet_bodies
