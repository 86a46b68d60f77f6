"""Plastic flow and energy of clusters (kernels/soft/clusters/shape_matching.py has the symbols).

The deformation of a cluster is F = A (sum m r r^T)^-1 = R S S_p: S_p has flown and S is elastic (Mueller, Heidelberger,
Teschner, Gross 2005, section 4.4, where A is taken about S_p r). Where a substep ends,

    |S - 1| > yield:  S_p <- (1 + h creep (S - 1)) S_p,  scaled to det S_p = 1
    |S_p - 1| > most: S_p <- 1 + most (S_p - 1) / |S_p - 1|

in the Frobenius norm. creep [1/s] is a rate: how far a cluster flows does not depend on the substep, to first order. h creep
counts at most 1. A deformation that is inside out does not flow.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.soft.clusters import shape_matching as shape


@wp.func
def frobenius_norm(X: wp.mat33d):
    """sqrt(sum of squares)."""
    return wp.sqrt(wp.ddot(X, X))


@wp.func
def flow_shape(S: wp.mat33d, P: wp.mat33d, limits: wp.vec3d, h: wp.float64):
    """S_p behind a substep of h [s], P before it; limits: yield [1], creep [1/s], most [1]."""
    one = wp.identity(n=3, dtype=wp.float64)
    found = P
    X = S - one
    if frobenius_norm(X) > limits[0] and wp.determinant(S) > wp.float64(0.0):
        found = (one + wp.min(h * limits[1], wp.float64(1.0)) * X) * P
        found = found / wp.cbrt(wp.determinant(found))
        D = found - one
        size = frobenius_norm(D)
        if size > limits[2]:
            found = one + (limits[2] / size) * D
    return found


@cache
def cluster_flow_kernel(real, module):
    """Kernel over clusters times a block of threads: S_p behind a substep of h [s] that ends at x + d."""
    t, Clusters, Poses = types(real), shape.shape_clusters(real), shape.cluster_poses(real)
    free_place, member_mass, plastic_shape, warm_rotation, _ = shape.cluster_functions(real)

    def flow_clusters(s: Clusters, h: wp.float64, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3),
                      lam: wp.array(dtype=t.vec3), pose: Poses):
        c = wp.tid() // wp.block_dim()
        lane = wp.tid() - c * wp.block_dim()
        T = wp.mat44d()
        for j in range(s.first[c] + lane, s.first[c + 1], wp.block_dim()):
            T += shape.moment(free_place(s, j, x, d, lam), shape.double_vector(s.rest[j]), member_mass(s, j, c))
        T = shape.block_matrix_sum(T)
        P = plastic_shape(pose, c)
        q, G, shift = shape.fit_pose(T, P, warm_rotation(pose, c))
        if lane == 0 and s.limits[c][1] > wp.float64(0.0):
            c0 = wp.vec3d(T[0, 3], T[1, 3], T[2, 3]) / T[3, 3]
            b = wp.vec3d(T[3, 0], T[3, 1], T[3, 2]) / T[3, 3]
            F = (shape.upper_block(T) / T[3, 3] - wp.outer(c0, b)) * s.spread[c]
            S = wp.transpose(rotation_to_matrix(q)) * F * wp.inverse(P)
            found = flow_shape(S, P, s.limits[c], h)
            pose.flow[c] = t.mat33(real(found[0, 0]), real(found[0, 1]), real(found[0, 2]), real(found[1, 0]),
                                   real(found[1, 1]), real(found[1, 2]), real(found[2, 0]), real(found[2, 1]),
                                   real(found[2, 2]))

    return wp.kernel(flow_clusters, name=f"flow_clusters_{t.name}", module=module, enable_backward=False, grid_stride=False)


@cache
def cluster_energy_kernel(real, module):
    """Kernel over clusters times a block of threads: (0, 0, energy [J]) of each at x + e."""
    t, Clusters, Poses = types(real), shape.shape_clusters(real), shape.cluster_poses(real)
    free_place, member_mass, plastic_shape, warm_rotation, _ = shape.cluster_functions(real)

    def measure_clusters(s: Clusters, x: wp.array(dtype=t.vec3), e: wp.array(dtype=t.vec3), lam: wp.array(dtype=t.vec3),
                         pose: Poses, found: wp.array(dtype=wp.vec3d)):
        c = wp.tid() // wp.block_dim()
        lane = wp.tid() - c * wp.block_dim()
        if s.kappa[c] == wp.float64(0.0):                # rigid: it stores nothing. Its whole block goes
            if lane == 0:
                found[c] = wp.vec3d()
            return
        T = wp.mat44d()
        for j in range(s.first[c] + lane, s.first[c + 1], wp.block_dim()):
            T += shape.moment(free_place(s, j, x, e, lam), shape.double_vector(s.rest[j]), member_mass(s, j, c))
        T = shape.block_matrix_sum(T)
        q, G, shift = shape.fit_pose(T, plastic_shape(pose, c), warm_rotation(pose, c))
        sum = wp.float64(0.0)
        for j in range(s.first[c] + lane, s.first[c + 1], wp.block_dim()):
            u = free_place(s, j, x, e, lam) - (G * shape.double_vector(s.rest[j]) + shift)
            sum += member_mass(s, j, c) * wp.dot(u, u)
        T = wp.mat44d()
        T[0, 0] = sum
        T = shape.block_matrix_sum(T)
        if lane == 0:
            found[c] = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.5) * T[0, 0] / s.kappa[c])

    return wp.kernel(measure_clusters, name=f"measure_clusters_{t.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def cluster_row_kernel(module):
    """Kernel over threads of worlds: sum of the energies of the clusters that each takes. order: clusters world behind world,
    those of one from first[world] on."""

    @wp.kernel(module=module, enable_backward=False)
    def sum_cluster_rows(energies: wp.array(dtype=wp.vec3d), order: wp.array(dtype=int), first: wp.array(dtype=int),
                         sums: wp.array(dtype=wp.vec3d)):
        i = wp.tid()
        threads = sums.shape[0] // (first.shape[0] - 1)
        world = i // threads
        sum = wp.vec3d()
        for k in range(first[world] + i % threads, first[world + 1], threads):
            sum += energies[order[k]]
        sums[i] = sum

    return sum_cluster_rows
