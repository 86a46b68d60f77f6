"""Eigenvectors of small symmetric matrices, in closed form (3 x 3) and by Jacobi turns (4 x 4)."""

from typing import Any

import warp as wp

SWEEPS = wp.constant(8)         # of Jacobi; 4 do for nearly all matrices, the loop ends by itself


@wp.func
def machine_epsilon(s: wp.float32):
    """Spacing of the numbers at 1."""
    return wp.float32(1.1920929e-07)


@wp.func
def machine_epsilon(s: wp.float64):  # noqa: F811 - an overload
    """Spacing of the numbers at 1."""
    return wp.float64(2.220446049250313e-16)


@wp.func
def identity_like(A: Any):
    """1 of the type of the 3 x 3 matrix A."""
    one = type(A[0, 0])(1.0)
    return wp.diag(wp.vector(one, one, one))


@wp.func
def jacobi_rotation(a: Any, b: Any, c: Any):
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
    C = B - x * identity_like(B)
    v0 = wp.cross(C[0], C[1])
    v1 = wp.cross(C[1], C[2])
    v2 = wp.cross(C[2], C[0])
    if wp.dot(v1, v1) > wp.dot(v0, v0):
        v0 = v1
    if wp.dot(v2, v2) > wp.dot(v0, v0):
        v0 = v2
    return wp.normalize(v0)


@wp.func
def eigen_three(A: Any):
    """(d, V): A = V diag(d) V^T of a symmetric 3 x 3 matrix, in no order, columns of V orthonormal.

    The lone eigenvector in closed form, the other two by one Jacobi turn in the plane across it (after Eberly 2014). Right to
    10 units of rounding of the largest entry, whatever the gaps; below 1e-30 A counts as diagonal. Half the time of Jacobi
    sweeps (CPU: 270 ns, 570).
    """
    zero = type(A[0, 0])(0.0)
    one = type(A[0, 0])(1.0)
    V = identity_like(A)
    d = wp.get_diag(A)
    size = wp.max(wp.max(wp.max(wp.abs(A[0])), wp.max(wp.abs(A[1]))), wp.max(wp.abs(A[2])))
    if size > type(one)(1.0e-30):
        B = (one / size) * A
        B = B - (wp.trace(B) / type(one)(3.0)) * V
        p = wp.ddot(B, B) / type(one)(6.0)
        if p > type(one)(0.01) * machine_epsilon(one) * machine_epsilon(one):
            B = (one / wp.sqrt(p)) * B
            v = lone_eigenvector(B)
            e = type(v)(one, zero, zero)
            if wp.abs(v[0]) > type(one)(0.6):
                e = type(v)(zero, one, zero)
            u = wp.normalize(wp.cross(v, e))
            w = wp.cross(v, u)
            Bw = B * w
            c, s = jacobi_rotation(wp.dot(u, B * u), wp.dot(w, Bw), wp.dot(u, Bw))
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
                if wp.abs(D[i, j]) > type(one)(0.25) * machine_epsilon(one) * wp.max(wp.abs(D[i, i]), wp.abs(D[j, j])):
                    c, s = jacobi_rotation(D[i, i], D[j, j], D[i, j])
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
