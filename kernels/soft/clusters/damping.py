"""Damping of clusters: velocities go towards those of the rigid motion of the cluster (Mueller, Heidelberger, Hennix, Ratcliff
2007, Position based dynamics, section 3.5), which has the momentum and the angular momentum of its points:

    V = sum m v / M,    omega = J^-1 sum m r x v,    v <- u + (v - u) / (1 + h k tau),    u = V + omega x r

tau [s] is the relaxation time: the damping force on a point is -k tau m (v - u), taken implicitly behind the elastic forces
(splitting, order 1). A mode of frequency sqrt(k) has the damping ratio sqrt(k) tau / 2. Neither momentum changes. Clusters that
share points take turns.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.soft.clusters import shape_matching as shape


@wp.func
def rigid_motion(X: wp.mat44d, V: wp.mat44d):
    """(centre, velocity there, omega) of sums m (x, 1) (x, 1)^T and m (v, 1) (x, 1)^T; omega = 0 of points in a line."""
    M = X[3, 3]
    centre = wp.vec3d(X[0, 3], X[1, 3], X[2, 3]) / M
    u = wp.vec3d(V[0, 3], V[1, 3], V[2, 3]) / M
    S = shape.upper_block(X) / M - wp.outer(centre, centre)
    W = shape.upper_block(V) / M - wp.outer(u, centre)
    size = wp.trace(S)
    J = size * wp.identity(n=3, dtype=wp.float64) - S
    omega = wp.vec3d()
    if wp.determinant(J) > wp.float64(1.0e-9) * size * size * size:
        omega = wp.inverse(J) * wp.vec3d(W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1])
    return centre, u, omega


@cache
def cluster_damping_kernel(real, module):
    """Kernel over the clusters of a colour, from `begin` on, times a block of threads: damps each. h: the substep [s]; tau: of
    each cluster [s]. A rigid cluster is left alone."""
    t, Clusters = types(real), shape.shape_clusters(real)
    member_mass = shape.cluster_functions(real)[1]

    def damp_clusters(s: Clusters, begin: int, h: wp.float64, tau: wp.array(dtype=wp.float64), x: wp.array(dtype=t.vec3),
                      v_out: wp.array(dtype=t.vec3)):
        c = begin + wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        one = wp.float64(1.0)
        if s.kappa[c] == wp.float64(0.0) or tau[c] <= wp.float64(0.0):         # its whole block goes
            return
        X = wp.mat44d()
        V = wp.mat44d()
        for j in range(s.first[c] + lane, s.first[c + 1], wp.block_dim()):
            y = shape.double_vector(x[s.point[j]])
            m = member_mass(s, j, c)
            X += shape.moment(y, y, m)
            V += shape.moment(shape.double_vector(v_out[s.point[j]]), y, m)
        X = shape.block_matrix_sum(X)
        V = shape.block_matrix_sum(V)
        centre, mean, omega = rigid_motion(X, V)
        keep = one / (one + h * tau[c] / s.kappa[c])
        for j in range(s.first[c] + lane, s.first[c + 1], wp.block_dim()):
            p = s.point[j]
            if s.w[p] > real(0.0):
                u = mean + wp.cross(omega, shape.double_vector(x[p]) - centre)
                u = u + keep * (shape.double_vector(v_out[p]) - u)
                v_out[p] = t.vec3(real(u[0]), real(u[1]), real(u[2]))

    return wp.kernel(damp_clusters, name=f"damp_clusters_{t.name}", module=module, enable_backward=False, grid_stride=False)
