"""Strain and stiffness in the frame of the stretches, shared by all isotropic materials.

F = 1 + H is the deformation gradient, q the quaternion (x, y, z, w) of its rotation R (kernels/math/rotation.py), S = R^T F = 1
+ E = V diag(s) V^T. An energy of the stretches s alone, with p = dPsi/ds, has the stiffness (Teran et al. 2005, section 6;
Smith, de Goes, Kim 2019, section 4), with M = V^T R^T dF V,

    dP = R V N V^T,   N_ii = sum_j A_ij M_jj,   A_ij = d^2Psi / ds_i ds_j
    N_ij = (f + t)/2 M_ij + (f - t)/2 M_ji,     f = (p_i - p_j) / (s_i - s_j),   t = (p_i + p_j) / (s_i + s_j)

The f (flip), the t (twist) and the eigenvalues of A are those of dP; clamped at 0 they leave its positive part. Each material
divides f and t out by hand: s_i - s_j divides nothing. It hands over V, A and B, with f above the diagonal and t below.
"""

from typing import Any

import warp as wp

from wsim.kernels.math.eigen import eigen_three
from wsim.kernels.math.rotation import matrix_minus_identity

LARGEST = wp.constant(1.0e6)      # of |H_ij| and |J - 1|: lam J^2 of float32 ends at 3e38


@wp.func
def clamp_entries(H: Any):
    """H with every entry clamped to +-LARGEST. By rows: the adjoint of an entry that is written over counts it twice."""
    m = type(H[0, 0])(LARGEST)
    most = type(H[0])(m, m, m)
    return wp.matrix_from_rows(wp.max(wp.min(H[0], most), -most), wp.max(wp.min(H[1], most), -most),
                               wp.max(wp.min(H[2], most), -most))


@wp.func
def symmetrised_matrix(A: Any):
    """(A + A^T) / 2."""
    return type(A[0, 0])(0.5) * (A + wp.transpose(A))


@wp.func
def unrotate_matrix(q: Any, A: Any):
    """R^T A."""
    return A + wp.transpose(matrix_minus_identity(q)) * A


@wp.func
def rotate_matrix(q: Any, A: Any):
    """R A."""
    return A + matrix_minus_identity(q) * A


@wp.func
def corotated_strain(H: Any, q: Any):
    """E = sym(R^T F) - 1 = sym(R^T (H - D)); a q that is off by w [rad] is wrong by w |E| in E, not by w."""
    return symmetrised_matrix(unrotate_matrix(q, clamp_entries(H) - matrix_minus_identity(q)))


@wp.func
def positive_part(A: Any):
    """Symmetric A with its negative eigenvalues set to 0, the nearest positive matrix (Higham 1988)."""
    o = type(A[0, 0])(0.0)
    P = type(o)(1.0) * A
    if not (A[0, 0] > o and A[0, 0] * A[1, 1] > A[0, 1] * A[1, 0] and wp.determinant(A) > o):
        d, V = eigen_three(A)
        P = V * wp.diag(wp.vector(wp.max(d[0], o), wp.max(d[1], o), wp.max(d[2], o))) * wp.transpose(V)
    return P


@wp.func
def off_diagonal(f: Any, t: Any):
    """B of the positive part: f_k above the diagonal and t_k below it, of the pairs (1, 2), (2, 0), (0, 1)."""
    o = type(f[0])(0.0)
    return wp.matrix_from_rows(wp.vector(o, wp.max(f[2], o), wp.max(f[1], o)), wp.vector(wp.max(t[2], o), o, wp.max(f[0], o)),
                               wp.vector(wp.max(t[1], o), wp.max(t[0], o), o))


@wp.func
def stress_response(q: Any, V: Any, A: Any, B: Any, dF: Any):
    """dP [Pa] of the stiffness V, A, B [Pa] of `spectrum` in the frame of q."""
    M = wp.transpose(V) * unrotate_matrix(q, dF) * V
    m = A * wp.get_diag(M)
    half = type(m[0])(0.5)
    N = wp.diag(m)
    for i in range(3):
        for j in range(i + 1, 3):
            f = half * B[i, j] * (M[i, j] + M[j, i])
            t = half * B[j, i] * (M[i, j] - M[j, i])
            N[i, j] = f + t
            N[j, i] = f - t
    return rotate_matrix(q, V * N * wp.transpose(V))
