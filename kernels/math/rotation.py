"""Rotation of a deformation gradient, and eigenvectors of small symmetric matrices.

R is the rotation that turns F most nearly: the largest tr(R^T F) over proper rotations. Then S = R^T F is symmetric, F = R S,
and of its eigenvalues (the signed stretches) no two sum below 0; at most one is negative, where det F < 0 (Irving, Teran,
Fedkiw 2004, section 5). With the quaternion q of R, tr(R^T F) = q^T K q (Horn 1987, section 4.A): on the unit sphere such a
form has one maximum (and its opposite), everything else that is stationary is a saddle or the minimum. Two ways to it:

    Newton   B = R^T F, G = tr(B) - sym(B), w = G^-1 axl(B - B^T), R <- R exp [w]x      cubic, as tr(exp [w]x S) is even in w
    Jacobi   the eigenvector of the largest eigenvalue of K; any F, also 0, flat, mirrored or half a turn away

Newton is taken from the last rotation as long as G is positive definite: it then ends in the maximum, whatever the sign of
det F. Quaternions are (x, y, z, w), unit.
"""

from typing import Any

import warp as wp

ITERATIONS = wp.constant(6)     # of Newton before Jacobi: cubic, so that what needs more does not converge
SWEEPS = wp.constant(8)         # of Jacobi; 4 do for nearly all matrices, the loop ends by itself


@wp.func
def rounding(s: wp.float32):
    """Spacing of the numbers at 1."""
    return wp.float32(1.1920929e-07)


@wp.func
def rounding(s: wp.float64):  # noqa: F811 - an overload
    """Spacing of the numbers at 1."""
    return wp.float64(2.220446049250313e-16)


@wp.func
def identity(A: Any):
    """1 of the type of the 3 x 3 matrix A."""
    one = type(A[0, 0])(1.0)
    return wp.diag(wp.vector(one, one, one))


@wp.func
def twice_axis(B: Any):
    """b with B - B^T = [b]x."""
    return wp.vector(B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1])


@wp.func
def turned(q: Any):
    """R - 1 of a unit quaternion: 2 w [v]x + 2 [v]x^2, so that a small turn keeps its digits."""
    two = type(q[0])(2.0)
    x = two * q[0]
    y = two * q[1]
    z = two * q[2]
    xx = x * q[0]
    yy = y * q[1]
    zz = z * q[2]
    xy = x * q[1]
    xz = x * q[2]
    yz = y * q[2]
    wx = x * q[3]
    wy = y * q[3]
    wz = z * q[3]
    return wp.matrix_from_rows(wp.vector(-yy - zz, xy - wz, xz + wy), wp.vector(xy + wz, -xx - zz, yz - wx),
                               wp.vector(xz - wy, yz + wx, -xx - yy))


@wp.func
def jacobi(a: Any, b: Any, c: Any):
    """cos and sin of the turn that makes [[a, c], [c, b]] diagonal, |angle| <= pi/4 (Golub, Van Loan 2013, section 8.5.2)."""
    one = type(a)(1.0)
    t = one - one
    if c != t:
        theta = (b - a) / (c + c)
        t = one / (wp.abs(theta) + wp.sqrt(one + theta * theta))
        if theta < one - one:
            t = -t
    r = one / wp.sqrt(one + t * t)
    return r, t * r


@wp.func
def lone_eigenvector(B: Any):
    """Unit eigenvector of the eigenvalue farthest from the others, of a symmetric B with tr B = 0, |B|^2 = 6.

    That is the root of largest size, sqrt(3) to 2, of x^3 - 3 x - 2 r, r = det B / 2 in [-1, 1]: Newton from a straight line
    that is off by less than 0.01. The rows of B - x are normal to the vector, and two of them are far from parallel.
    """
    one = type(B[0, 0])(1.0)
    r = type(one)(0.5) * wp.determinant(B)
    s = wp.min(wp.abs(r), one)
    x = type(one)(1.7320508075688772) + type(one)(0.2679491924311228) * s
    for _k in range(3):
        x -= (x * x * x - type(one)(3.0) * x - (s + s)) / (type(one)(3.0) * (x * x - one))
    if r < one - one:
        x = -x
    C = B - x * identity(B)
    v0 = wp.cross(C[0], C[1])
    v1 = wp.cross(C[1], C[2])
    v2 = wp.cross(C[2], C[0])
    if wp.dot(v1, v1) > wp.dot(v0, v0):
        v0 = v1
    if wp.dot(v2, v2) > wp.dot(v0, v0):
        v0 = v2
    return wp.normalize(v0)


@wp.func
def eigen(A: Any):
    """(d, V): A = V diag(d) V^T of a symmetric 3 x 3 matrix, in no order, columns of V orthonormal.

    The lone eigenvector in closed form, the other two by one Jacobi turn in the plane across it (after Eberly 2014). Right to
    10 units of rounding of the largest entry, whatever the gaps; below 1e-30 A counts as diagonal. Half the time of Jacobi
    sweeps (CPU: 270 ns, 570).
    """
    zero = type(A[0, 0])(0.0)
    one = type(A[0, 0])(1.0)
    V = identity(A)
    d = wp.get_diag(A)
    size = wp.max(wp.max(wp.max(wp.abs(A[0])), wp.max(wp.abs(A[1]))), wp.max(wp.abs(A[2])))
    if size > type(one)(1.0e-30):
        B = (one / size) * A
        B = B - (wp.trace(B) / type(one)(3.0)) * V
        p = wp.ddot(B, B) / type(one)(6.0)
        if p > type(one)(0.01) * rounding(one) * rounding(one):
            B = (one / wp.sqrt(p)) * B
            v = lone_eigenvector(B)
            e = type(v)(one, zero, zero)
            if wp.abs(v[0]) > type(one)(0.6):
                e = type(v)(zero, one, zero)
            u = wp.normalize(wp.cross(v, e))
            w = wp.cross(v, u)
            Bw = B * w
            c, s = jacobi(wp.dot(u, B * u), wp.dot(w, Bw), wp.dot(u, Bw))
            V = wp.matrix_from_cols(v, c * u - s * w, s * u + c * w)
            W = wp.transpose(V)
            d = wp.vector(wp.dot(W[0], A * W[0]), wp.dot(W[1], A * W[1]), wp.dot(W[2], A * W[2]))
    return d, V


@wp.func
def eigen_four(A: Any):
    """(D, V): A = V D V^T of a symmetric 4 x 4 matrix, eigenvalues on the diagonal of D, in no order, columns of V orthonormal.

    Cyclic Jacobi; eigenvalues right to a few units of rounding of the largest, whatever their gaps.
    """
    one = type(A[0, 0])(1.0)
    D = one * A
    unit = wp.diag(wp.vector(one, one, one, one))
    V = one * unit
    n = int(4)                                       # a variable: the loops are not unrolled, this is rarely run
    for _sweep in range(SWEEPS):
        left = int(0)
        for i in range(n - 1):
            for j in range(i + 1, n):
                if wp.abs(D[i, j]) > type(one)(0.25) * rounding(one) * wp.max(wp.abs(D[i, i]), wp.abs(D[j, j])):
                    c, s = jacobi(D[i, i], D[j, j], D[i, j])
                    J = one * unit
                    J[i, i] = c
                    J[j, j] = c
                    J[i, j] = s
                    J[j, i] = -s
                    D = wp.transpose(J) * D * J
                    V = V * J
                    left += 1
        if left == 0:
            break
    return D, V


@wp.func
def horn(F: Any):
    """K with tr(R^T F) = q^T K q for the rotation R of q = (x, y, z, w)."""
    xy = F[0, 1] + F[1, 0]
    xz = F[0, 2] + F[2, 0]
    yz = F[1, 2] + F[2, 1]
    b = twice_axis(F)
    return wp.matrix_from_rows(wp.vector(F[0, 0] - F[1, 1] - F[2, 2], xy, xz, b[0]),
                               wp.vector(xy, F[1, 1] - F[0, 0] - F[2, 2], yz, b[1]),
                               wp.vector(xz, yz, F[2, 2] - F[0, 0] - F[1, 1], b[2]),
                               wp.vector(b[0], b[1], b[2], F[0, 0] + F[1, 1] + F[2, 2]))


@wp.func
def rotation_anew(F: Any, q: Any):
    """Quaternion of the rotation of any F with |F_ij| <= 2. Where several are as good (a line, a mirror), the nearest to q.

    K has the eigenvalues s1 + s2 + s3, s1 - s2 - s3, s2 - s1 - s3, s3 - s1 - s2: the largest stands alone while s2 + s3 > 0.
    """
    D, V = eigen_four(horn(F))
    one = type(q[0])(1.0)
    most = wp.max(wp.max(D[0, 0], D[1, 1]), wp.max(D[2, 2], D[3, 3]))
    near = type(q)(one - one, one - one, one - one, one - one)
    best = type(q)(one - one, one - one, one - one, one)
    for k in range(4):
        v = type(q)(V[0, k], V[1, k], V[2, k], V[3, k])
        if D[k, k] == most:
            best = v
        if D[k, k] >= most - type(one)(16.0) * rounding(one) * most:
            near += wp.dot(q, v) * v
    r = best
    if wp.dot(near, near) > type(one)(1.0e-6):
        r = near
    return wp.normalize(r)


@wp.func
def turn_step(H: Any, q: Any, scale: Any):
    """(w, least): Newton's step [rad] at q, and the least pivot of G over its trace; < 0: no maximum near."""
    one = type(scale)(1.0)
    D = turned(q)
    X = scale * (H - D)                                    # B = R^T F = scale + R^T scale (H - D), D = R - 1
    X = X + wp.transpose(D) * X
    b = twice_axis(X)
    t = wp.trace(X) + type(scale)(3.0) * scale
    g0 = t - X[0, 0] - scale
    g10 = type(scale)(-0.5) * (X[0, 1] + X[1, 0])
    g20 = type(scale)(-0.5) * (X[0, 2] + X[2, 0])
    g21 = type(scale)(-0.5) * (X[1, 2] + X[2, 1])
    w = type(scale)(0.0) * b
    least = g0 / (t + t)
    if t > type(scale)(0.0) and g0 > type(scale)(1.0e-3) * t:
        l10 = g10 / g0
        l20 = g20 / g0
        g1 = t - X[1, 1] - scale - l10 * g10
        g21 = g21 - l20 * g10
        least = wp.min(least, g1 / (t + t))
        if g1 > type(scale)(1.0e-3) * t:
            l21 = g21 / g1
            g2 = t - X[2, 2] - scale - l20 * g20 - l21 * g21
            least = wp.min(least, g2 / (t + t))
            if g2 > type(scale)(1.0e-3) * t:
                y1 = b[1] - l10 * b[0]
                w2 = (b[2] - l20 * b[0] - l21 * y1) / g2
                w1 = y1 / g1 - l21 * w2
                w = wp.vector(b[0] / g0 - l10 * w1 - l20 * w2, w1, w2)
                return w, least
    return w, -one


@wp.func
def rotation(H: Any, warm: Any):
    """Quaternion (x, y, z, w) of the rotation of F = 1 + H, from that of a nearby F, `warm`; 0 stands for none.

    Always a proper rotation, for every finite H; of F = 0 it is `warm`. Right to 5 units of rounding times s1 / (s2 + s3), the
    condition of the problem. Measured on a CPU, float32: 65 ns where F turned less than 5 mrad since `warm` (one step), 150 ns
    with two, 1400 ns on average for random F from nothing, half of them inverted.
    """
    one = type(H[0, 0])(1.0)
    zero = type(H[0, 0])(0.0)
    q = type(warm)(zero, zero, zero, one)
    if wp.dot(warm, warm) > zero:
        q = wp.normalize(warm)
    first = q
    scale = one
    size = wp.max(wp.max(wp.max(wp.abs(H[0])), wp.max(wp.abs(H[1]))), wp.max(wp.abs(H[2])))
    if size > one:
        scale = one / size
    done = bool(False)
    most = int(ITERATIONS)                           # a variable: unrolled, this took 0.7 s of a processor to compile
    for _k in range(most):
        w, least = turn_step(H, q, scale)
        if least < zero:
            break
        half = type(one)(0.5) * w
        q = wp.normalize(q * type(warm)(half[0], half[1], half[2], one))      # an angle of 2 atan(|w| / 2)
        ww = wp.dot(w, w)
        if ww * wp.sqrt(ww) <= rounding(one) * least:                         # the next step: below |w|^3 / least
            done = True
            break
    if not done:
        F = scale * H + scale * identity(H)
        q = first
        if wp.ddot(F, F) > zero:
            q = rotation_anew(F, first)
    return q
