"""Shape matching: clusters of points that are pulled to their rest shape, turned and moved to where it fits best (Mueller,
Heidelberger, Teschner, Gross 2005), as an XPBD constraint (Macklin, Mueller, Chentanez 2016), all points of a cluster at once.

    E = k / 2 sum_i m_i |x_i - g_i|^2         g_i = c + R S_p (r_i - b)        k [1/s^2], kappa = 1 / k; 0: rigid
    c = sum m x / M                           b = sum m r / M                   r: rest places, S_p: what has flown (plasticity)
    A = sum m (x - c) (S_p (r - b))^T         R: the rotation with the largest tr(R^T A)

R and c make E least, so the force on a point is -k m_i (x_i - g_i), whatever R and c do: forces have no sum and no torque. To
second order E = k / 2 |P u|^2 in u = sqrt(m) dx, with P the projector on all that is no rigid motion: a free cluster has
six frequencies 0, all others are sqrt(k). Multipliers are lam_i = -h^2 k m_i (x_i - g_i) [kg m], so that x_i = y_i + w_i lam_i
for y, the places without the cluster. Moving y towards g changes neither c nor R, so one projection solves a cluster exactly:

    y_i = x_i - w_i lam_i,  fit c, R to y,  lam_i <- m_i beta (g_i - y_i),  x_i = y_i + w_i lam_i,  beta = 1 / (1 + kappa / h^2)

Clusters that share points take turns, colour by colour (block Gauss-Seidel). At its fixed point that is backward Euler for the
sum of all E, however many iterations or substeps led there. With beta for the same m_i in all points of a cluster a projection
keeps momentum, and the torque of lam is 0 about the places that it leads to.

The rotation: `polar_rotation` of kernels/math/rotation.py, warm started from the one before. It finds what the iteration of
Mueller, Bender, Chentanez, Macklin 2016 (A robust method to extract the rotational part of deformations) finds, in fewer steps,
and from any start: flat and inverted clusters too. Points in a line have no best rotation; `check` refuses them.

Moments are sums of 4 x 4 matrices, (y, 1) (S_p r, 1)^T m: in float64, in a fixed order. A pinned point (w = 0) has the mass
`heavy` there, so that the shape goes through it. Two ways: `cluster_projection_kernel`, a block of threads a cluster (on a CPU
one thread); or three launches, in which many blocks share a cluster: `chunk_moment_kernel`, `cluster_fit_kernel`,
`member_projection_kernel`.

Plastic flow, which changes S_p, and energies: kernels/soft/clusters/flow.py.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import polar_rotation, rotation_to_matrix

CHUNK = 1024           # members of a cluster that a block sums, where blocks share a cluster


@cache
def shape_clusters(real):
    """Struct of the clusters; members stand cluster behind cluster. Reads only."""
    t = types(real)

    @wp.struct
    class ShapeClusters:
        first: wp.array(dtype=int)                # members of a cluster: first[c] .. first[c + 1], (clusters + 1,)
        point: wp.array(dtype=int)                # place of each member in the arrays of points, (members,)
        owner: wp.array(dtype=int)                # its cluster, (members,)
        rest: wp.array(dtype=t.vec3)              # rest place from the centre of the cluster [m], (members,)
        w: wp.array(dtype=t.scalar)               # inverse masses [1/kg], (points,)
        heavy: wp.array(dtype=wp.float64)         # mass that a pinned point counts [kg], (clusters,)
        kappa: wp.array(dtype=wp.float64)         # 1 / k [s^2], 0: rigid, (clusters,)
        limits: wp.array(dtype=wp.vec3d)          # yield [1], creep [1/s], most [1], (clusters,); empty: nothing flows
        spread: wp.array(dtype=wp.mat33d)         # (sum m r r^T / M)^-1 at rest [1/m^2], (clusters,); empty: nothing flows

    return ShapeClusters


@cache
def cluster_poses(real):
    """Struct of how clusters lie: what changes."""
    t = types(real)

    @wp.struct
    class ClusterPoses:
        q: wp.array(dtype=t.quat)                 # rotation (x, y, z, w), (clusters,)
        flow: wp.array(dtype=t.mat33)             # S_p, (clusters,); empty: nothing flows
        turn: wp.array(dtype=wp.mat33d)           # R S_p, (clusters,)
        shift: wp.array(dtype=wp.vec3d)           # c - R S_p b [m]: g = turn r + shift, (clusters,)

    return ClusterPoses


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ double part[32][16];
    const unsigned lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    __syncthreads();
    for (int c = 0; c < 16; ++c) {
        double sum = T.data[c / 4][c % 4];
        for (unsigned k = 16; k > 0; k >>= 1) sum += __shfl_xor_sync(0xffffffffu, sum, k);
        if (lane == 0) part[warp][c] = sum;
    }
    __syncthreads();
    for (int c = 0; c < 16; ++c) {
        double sum = 0.0;
        for (unsigned k = 0; k < warps; ++k) sum += part[k][c];
        T.data[c / 4][c % 4] = sum;
    }
#endif
    return T;
""")
def block_matrix_sum(T: wp.mat44d) -> wp.mat44d:
    """Sum over the threads of a block, the same in each; they meet here, and every one must come. Blocks of whole warps."""
    ...


@wp.func
def double_vector(v: Any):
    """v in float64."""
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def moment(y: wp.vec3d, r: wp.vec3d, m: wp.float64):
    """m (y, 1) (r, 1)^T."""
    one = wp.float64(1.0)
    a = m * wp.vec4d(y[0], y[1], y[2], one)
    return wp.outer(a, wp.vec4d(r[0], r[1], r[2], one))


@wp.func
def fit_rotation(A: wp.mat33d, warm: wp.quatd):
    """Quaternion of the rotation with the largest tr(R^T A); `warm` where A is 0."""
    most = wp.max(wp.max(wp.max(wp.abs(A[0])), wp.max(wp.abs(A[1]))), wp.max(wp.abs(A[2])))
    q = warm
    if most > wp.float64(0.0):
        q = polar_rotation(A / most - wp.identity(n=3, dtype=wp.float64), warm)
    return q


@wp.func
def upper_block(T: wp.mat44d):
    """The first three rows and columns."""
    return wp.mat33d(T[0, 0], T[0, 1], T[0, 2], T[1, 0], T[1, 1], T[1, 2], T[2, 0], T[2, 1], T[2, 2])


@wp.func
def fit_pose(T: wp.mat44d, F: wp.mat33d, warm: wp.quatd):
    """(q, R F, c - R F b) of the moments T of places and rest places; F: S_p."""
    M = T[3, 3]
    c = wp.vec3d(T[0, 3], T[1, 3], T[2, 3]) / M
    b = wp.vec3d(T[3, 0], T[3, 1], T[3, 2]) / M
    A = upper_block(T) / M - wp.outer(c, b)
    q = fit_rotation(A * wp.transpose(F), warm)
    G = rotation_to_matrix(q) * F
    return q, G, c - G * b


@cache
def cluster_functions(real):
    """Functions: place of a member without its cluster, its mass, S_p and the last rotation of a cluster, projection of a
    member."""
    t, Clusters, Poses = types(real), shape_clusters(real), cluster_poses(real)

    @wp.func
    def free_place(s: Clusters, j: int, x: wp.array(dtype=t.vec3), d: wp.array(dtype=t.vec3), lam: wp.array(dtype=t.vec3)):
        p = s.point[j]
        y = double_vector(x[p]) + double_vector(d[p])
        if lam:
            y -= wp.float64(s.w[p]) * double_vector(lam[j])
        return y

    @wp.func
    def member_mass(s: Clusters, j: int, c: int):
        w = s.w[s.point[j]]
        m = s.heavy[c]
        if w > real(0.0):
            m = wp.float64(1.0) / wp.float64(w)
        return m

    @wp.func
    def plastic_shape(pose: Poses, c: int):
        F = wp.identity(n=3, dtype=wp.float64)
        if pose.flow:
            f = pose.flow[c]
            F = wp.mat33d(wp.float64(f[0, 0]), wp.float64(f[0, 1]), wp.float64(f[0, 2]), wp.float64(f[1, 0]),
                          wp.float64(f[1, 1]), wp.float64(f[1, 2]), wp.float64(f[2, 0]), wp.float64(f[2, 1]),
                          wp.float64(f[2, 2]))
        return F

    @wp.func
    def warm_rotation(pose: Poses, c: int):
        q = pose.q[c]
        return wp.quatd(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2]), wp.float64(q[3]))

    @wp.func
    def project_member(s: Clusters, j: int, G: wp.mat33d, shift: wp.vec3d, beta: wp.float64, x: wp.array(dtype=t.vec3),
                       d_out: wp.array(dtype=t.vec3), lam_out: wp.array(dtype=t.vec3)):
        p = s.point[j]
        w = wp.float64(s.w[p])
        if w > wp.float64(0.0):
            before = w * double_vector(lam_out[j])
            d = double_vector(d_out[p])
            y = (double_vector(x[p]) + d) - before
            pull = beta * ((G * double_vector(s.rest[j]) + shift) - y)
            new = (d - before) + pull
            d_out[p] = t.vec3(real(new[0]), real(new[1]), real(new[2]))
            pull = pull / w
            lam_out[j] = t.vec3(real(pull[0]), real(pull[1]), real(pull[2]))

    return free_place, member_mass, plastic_shape, warm_rotation, project_member


@wp.func
def projection_part(kappa: wp.float64, rate: wp.float64):
    """beta."""
    return wp.float64(1.0) / (wp.float64(1.0) + kappa * rate * rate)


@cache
def cluster_projection_kernel(real, module):
    """Kernel over the clusters of a colour, from `begin` on, times a block of threads: projects each. rate: 1 / h [1/s]."""
    t, Clusters, Poses = types(real), shape_clusters(real), cluster_poses(real)
    free_place, member_mass, plastic_shape, warm_rotation, project_member = cluster_functions(real)

    def project_clusters(s: Clusters, begin: int, rate: wp.float64, x: wp.array(dtype=t.vec3), lam: wp.array(dtype=t.vec3),
                         d_out: wp.array(dtype=t.vec3), pose: Poses):
        k = wp.tid() // wp.block_dim()
        lane = wp.tid() - k * wp.block_dim()
        c = begin + k
        T = wp.mat44d()
        for j in range(s.first[c] + lane, s.first[c + 1], wp.block_dim()):
            T += moment(free_place(s, j, x, d_out, lam), double_vector(s.rest[j]), member_mass(s, j, c))
        T = block_matrix_sum(T)
        q, G, shift = fit_pose(T, plastic_shape(pose, c), warm_rotation(pose, c))
        beta = projection_part(s.kappa[c], rate)
        for j in range(s.first[c] + lane, s.first[c + 1], wp.block_dim()):
            project_member(s, j, G, shift, beta, x, d_out, lam)
        if lane == 0:
            pose.q[c] = t.quat(real(q[0]), real(q[1]), real(q[2]), real(q[3]))

    return wp.kernel(project_clusters, name=f"project_clusters_{t.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def chunk_moment_kernel(real, module):
    """Kernel over the chunks of a colour, from `begin` on, times a block of threads: moments of the members chunk[k] ..
    chunk[k + 1] - 1."""
    t, Clusters = types(real), shape_clusters(real)
    free_place, member_mass = cluster_functions(real)[:2]

    def sum_chunk_moments(s: Clusters, chunk: wp.array(dtype=int), begin: int, x: wp.array(dtype=t.vec3),
                          d: wp.array(dtype=t.vec3), lam: wp.array(dtype=t.vec3), moments: wp.array(dtype=wp.mat44d)):
        k = begin + wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        T = wp.mat44d()
        for j in range(chunk[k] + lane, chunk[k + 1], wp.block_dim()):
            T += moment(free_place(s, j, x, d, lam), double_vector(s.rest[j]), member_mass(s, j, s.owner[j]))
        T = block_matrix_sum(T)
        if lane == 0:
            moments[k] = T

    return wp.kernel(sum_chunk_moments, name=f"sum_chunk_moments_{t.name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def cluster_fit_kernel(real, module):
    """Kernel over the clusters of a colour, from `begin` on, times a block of threads: pose of each from the moments of its
    chunks, first[c] .. first[c + 1] - 1."""
    t, Poses = types(real), cluster_poses(real)
    plastic_shape, warm_rotation = cluster_functions(real)[2:4]

    def fit_clusters(begin: int, first: wp.array(dtype=int), moments: wp.array(dtype=wp.mat44d), pose: Poses):
        c = begin + wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        T = wp.mat44d()
        for i in range(first[c] + lane, first[c + 1], wp.block_dim()):
            T += moments[i]
        T = block_matrix_sum(T)
        q, G, shift = fit_pose(T, plastic_shape(pose, c), warm_rotation(pose, c))
        if lane == 0:
            pose.q[c] = t.quat(real(q[0]), real(q[1]), real(q[2]), real(q[3]))
            pose.turn[c] = G
            pose.shift[c] = shift

    return wp.kernel(fit_clusters, name=f"fit_clusters_{t.name}", module=module, enable_backward=False, grid_stride=False)


@cache
def member_projection_kernel(real, module):
    """Kernel over the members of a colour, from `begin` on: projects each by the pose of its cluster."""
    t, Clusters, Poses = types(real), shape_clusters(real), cluster_poses(real)
    project_member = cluster_functions(real)[4]

    def project_members(s: Clusters, begin: int, rate: wp.float64, x: wp.array(dtype=t.vec3), lam: wp.array(dtype=t.vec3),
                        d_out: wp.array(dtype=t.vec3), pose: Poses):
        j = begin + wp.tid()
        c = s.owner[j]
        project_member(s, j, pose.turn[c], pose.shift[c], projection_part(s.kappa[c], rate), x, d_out, lam)

    return wp.kernel(project_members, name=f"project_members_{t.name}", module=module, enable_backward=False)
