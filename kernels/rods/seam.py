"""Closed strands: rings of n points are open ones of n + 2, whose last two are copies of the first two.

    x_n = x_0,  x_n+1 = x_1,  angle_n = angle_0    J z = 0: the copy of an edge goes along with it, so that every point of the
                                                   ring bends and twists between two edges, and none is its seam
    M z = r - J^T lam,  lam = (J M^-1 J^T)^-1 J M^-1 r     M: blocks of the open strand, factored (kernels/rods/eliminate.py)

J has 7 rows. The copies have GHOST of the mass, no tension between them, and touch nothing: all they do is to carry the frame
of the first edge to the last bend. With t = L^-1 J^T of the factors M = L D L^T, J M^-1 J^T is the sum of t^T D^-1 t, one walk
along the strand; the correction is one more solve. A solve costs three of an open strand, and is as exact.

(Constraints by the Schur complement: Nocedal, Wright 2006, section 16.2. Conjugate gradients in the null space of J, with the
residual freed of J^T lam: Gould, Hribar, Nocedal 2001.)
"""

import warp as wp

from wsim.kernels.rods.tables import RodMotion, RodTable, RodTrial

GHOST = 1e-3              # of a point's mass, and of an edge's inertia about itself, that its copy has; 1e-6 lost digits


@wp.struct
class SeamForces:
    """lam of both pairs of copies: three of a point [N], one of its edge [N m]; the last one's is 0."""

    a: wp.vec4d
    b: wp.vec4d


@wp.func
def seam_sign(at: int, i: int, own: int):
    """Part of a row of J at point i: 1 of point `at` of a strand of `own` points, -1 of its copy."""
    found = wp.float64(0.0)
    if i == at:
        found = wp.float64(1.0)
    if i == at + own:
        found = wp.float64(-1.0)
    return found


@wp.func
def without_angle(z: wp.vec4d):
    return wp.vec4d(z[0], z[1], z[2], wp.float64(0.0))


@wp.func
def factor_seam(S: RodTable, T: RodTrial, k: int):
    """T.seam = P, X, H: what solves with J M^-1 J^T, whose blocks are A, B; B^T, C: P = A^-1, X = P B, H = (C - B^T X)^-1."""
    own = S.own[k]
    zero = wp.mat44d()
    one = wp.identity(n=4, dtype=wp.float64)
    place = wp.diag(wp.vec4d(wp.float64(1.0), wp.float64(1.0), wp.float64(1.0), wp.float64(0.0)))
    a1 = zero
    a2 = zero
    b1 = zero
    b2 = zero
    A = zero
    B = zero
    C = wp.diag(wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0)))
    for i in range(S.points[k]):
        a = one * seam_sign(0, i, own)
        b = place * seam_sign(1, i, own)
        if i > 0:
            L = wp.transpose(T.near[i - 1, k])
            a = a - L * a1
            b = b - L * b1
        if i > 1:
            L = wp.transpose(T.far[i - 2, k])
            a = a - L * a2
            b = b - L * b2
        D = T.pivot[i, k]
        Da = D * a
        Db = D * b
        A = A + wp.transpose(a) * Da
        B = B + wp.transpose(a) * Db
        C = C + wp.transpose(b) * Db
        a2 = a1
        a1 = a
        b2 = b1
        b1 = b
    P = wp.inverse((A + wp.transpose(A)) * wp.float64(0.5))
    X = P * B
    T.seam[k, 0] = P
    T.seam[k, 1] = X
    T.seam[k, 2] = wp.inverse(C - wp.transpose(B) * X)


@wp.func
def close_seam(S: RodTable, T: RodTrial, k: int):
    """T.z = M^-1 r made z of the ring; lam; the greatest correction of a point [m]."""
    own = S.own[k]
    f = SeamForces()
    ga = T.z[0, k] - T.z[own, k]
    gb = without_angle(T.z[1, k] - T.z[own + 1, k])
    P = T.seam[k, 0]
    X = T.seam[k, 1]
    f.b = T.seam[k, 2] * (gb - wp.transpose(X) * ga)
    f.a = P * ga - X * f.b
    n = S.points[k]
    t1 = wp.vec4d()
    t2 = wp.vec4d()
    for i in range(n):
        t = f.a * seam_sign(0, i, own) + f.b * seam_sign(1, i, own)
        if i > 0:
            t = t - wp.transpose(T.near[i - 1, k]) * t1
        if i > 1:
            t = t - wp.transpose(T.far[i - 2, k]) * t2
        T.slack[i, k] = T.pivot[i, k] * t
        t2 = t1
        t1 = t
    z1 = wp.vec4d()
    z2 = wp.vec4d()
    most = wp.float64(0.0)
    for j in range(n):
        i = n - 1 - j
        z = T.slack[i, k] - T.near[i, k] * z1 - T.far[i, k] * z2
        z2 = z1
        z1 = z
        move = T.z[i, k] - z
        T.z[i, k] = move
        most = wp.max(most, wp.length(wp.vec3d(move[0], move[1], move[2])))
    T.z[own, k] = T.z[0, k]
    last = T.z[1, k]
    T.z[own + 1, k] = wp.vec4d(last[0], last[1], last[2], T.z[own + 1, k][3])
    return f, most


@wp.func
def free_of_seam(S: RodTable, r: wp.array2d(dtype=wp.vec4d), f: SeamForces, k: int):
    """Takes J^T lam off a right-hand side."""
    own = S.own[k]
    r[0, k] = r[0, k] - f.a
    r[1, k] = r[1, k] - f.b
    r[own, k] = r[own, k] + f.a
    r[own + 1, k] = r[own + 1, k] + f.b


@wp.func
def copy_ring_point(Q: RodMotion, i: int, j: int, k: int):
    """Point i, a copy of point j, with what the edge behind it has."""
    Q.x[i, k] = Q.x[j, k]
    Q.v[i, k] = Q.v[j, k]
    Q.s[i, k] = Q.s[j, k]
    Q.u[i, k] = Q.u[j, k]
    Q.begun[i, k] = Q.begun[j, k]
    if j == 0:
        Q.d[i, k] = Q.d[j, k]
        Q.w[i, k] = Q.w[j, k]
        Q.phi[j, k] = Q.phi[i, k]                        # the twist at a first point is that of its copy: it is written so


@wp.func
def copy_ring_start(S: RodTable, Q: RodMotion, k: int):
    """Both copies of a strand, where a substep has ended."""
    if S.own[k] < S.points[k]:
        for j in range(wp.static(2)):
            copy_ring_point(Q, S.own[k] + j, j, k)
