"""Angular momentum that backward Euler takes from bodies, given back to their velocities.

Backward Euler evaluates forces at the end of a substep, x' = x + h v', v' = v~ + h f / m with v~ the predicted velocity.
Forces without torque about x' still change the angular momentum: sum m x' x v' = sum m x x v~ + h sum m v' x v~. A body that
spins by omega loses (h omega)^2 / 2 of it in each substep. What it has lost is known, whatever forces and contacts acted:

    L = h sum m (v' - V') x (v* - V*),     I = sum m (|r|^2 - r r^T),     omega = I^-1 (-L),     v' <- v' + omega x r

V the velocity of the centre, r the place from it. v* = v' - w lam / h is the velocity without the clusters: with it, contacts
have the torque that they have where the substep begins, as between free points, and two bodies that meet keep what they have
together. Rigid clusters that colliders move as a whole have v* = v~: such contacts act where the substep ends. The linear
momentum stays. Bodies with pinned points are left alone, and those of points in a line. Sums are in float64 in a fixed
order: chunks of a body, then its chunks.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.soft.clusters.shape_matching import block_matrix_sum, double_vector


@cache
def spin_sums(real):
    """Struct of the points of bodies, body behind body, and the sums over each chunk."""
    t = types(real)

    @wp.struct
    class SpinSums:
        point: wp.array(dtype=int)                # places in the arrays of points, (members,)
        chunk: wp.array(dtype=int)                # members of a chunk: chunk[k] .. chunk[k + 1], (chunks + 1,)
        first: wp.array(dtype=int)                # chunks of a body: first[b] .. first[b + 1], (bodies + 1,)
        owner: wp.array(dtype=int)                # body of each member, (members,)
        w: wp.array(dtype=t.scalar)               # inverse masses [1/kg], (points,)
        before: wp.array(dtype=t.vec3)            # v* [m/s], (members,)
        entry: wp.array(dtype=int)                # entries of a member: entry[j] .. entry[j + 1], (members + 1,)
        held: wp.array(dtype=int)                 # its places in the clusters' members, (entries,)
        whole: wp.array(dtype=int)                # 1: v* = v~, (bodies,)
        sums: wp.array2d(dtype=wp.mat44d)         # of each chunk, (2, chunks)
        centre: wp.array(dtype=wp.vec3d)          # of each body [m], (bodies,)
        omega: wp.array(dtype=wp.vec3d)           # of each body [rad/s], (bodies,)

    return SpinSums


@wp.func
def four(v: Any, last: wp.float64):
    """(v, last)."""
    return wp.vec4d(v[0], v[1], v[2], last)


@cache
def predicted_velocity_kernel(real, module):
    """Kernel over members: v~ = (d - a) / h, of the prediction d."""
    t, Sums = types(real), spin_sums(real)

    @wp.kernel(module=module, enable_backward=False)
    def keep_predicted_velocity(b: Sums, d: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3), h: real,
                                v_out: wp.array(dtype=t.vec3)):
        j = wp.tid()
        p = b.point[j]
        v_out[j] = (d[p] - a[p]) / h

    return keep_predicted_velocity


@cache
def free_velocity_kernel(real, module):
    """Kernel over members: v* of those that are not moved as a whole; lam [kg m], of the clusters' members."""
    t, Sums = types(real), spin_sums(real)

    @wp.kernel(module=module, enable_backward=False)
    def find_free_velocity(b: Sums, v: wp.array(dtype=t.vec3), lam: wp.array(dtype=t.vec3), h: real,
                           v_out: wp.array(dtype=t.vec3)):
        j = wp.tid()
        if b.whole[b.owner[j]] == 0:
            p = b.point[j]
            held = t.vec3()
            for e in range(b.entry[j], b.entry[j + 1]):
                held += lam[b.held[e]]
            v_out[j] = v[p] - (b.w[p] / h) * held

    return find_free_velocity


@cache
def chunk_spin_kernel(real, module):
    """Kernel over chunks times a block of threads: sums of m (x, 1) (x, 1)^T, and of m (v', 1) (v~, 1)^T with the centre's row:
    (sum m v' v~^T, sum m v'; sum m v~, pinned points)."""
    t, Sums = types(real), spin_sums(real)

    def sum_chunk_spin(b: Sums, x: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3)):
        k = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        one = wp.float64(1.0)
        X = wp.mat44d()
        V = wp.mat44d()
        for j in range(b.chunk[k] + lane, b.chunk[k + 1], wp.block_dim()):
            p = b.point[j]
            w = wp.float64(b.w[p])
            if w > wp.float64(0.0):
                y = double_vector(x[p])
                X += wp.outer(four(y, one) / w, four(y, one))
                V += wp.outer(four(double_vector(v[p]), one) / w, four(double_vector(b.before[j]), one))
            else:
                V[3, 3] = V[3, 3] - wp.float64(1.0e300)
        X = block_matrix_sum(X)
        V = block_matrix_sum(V)
        if lane == 0:
            b.sums[0, k] = X
            b.sums[1, k] = V

    return wp.kernel(sum_chunk_spin, name=f"sum_chunk_spin_{t.name}", module=module, enable_backward=False, grid_stride=False)


@wp.func
def lost_spin(X: wp.mat44d, V: wp.mat44d, h: wp.float64):
    """(centre, omega) from the sums of a body; omega = 0 where a point is pinned, or all are in a line."""
    zero = wp.float64(0.0)
    M = X[3, 3]
    omega = wp.vec3d()
    centre = wp.vec3d()
    if M > zero:
        centre = wp.vec3d(X[0, 3], X[1, 3], X[2, 3]) / M
        S = wp.mat33d(X[0, 0], X[0, 1], X[0, 2], X[1, 0], X[1, 1], X[1, 2], X[2, 0], X[2, 1], X[2, 2]) / M - wp.outer(centre,
                                                                                                                centre)
        size = wp.trace(S)
        J = size * wp.identity(n=3, dtype=wp.float64) - S
        a = wp.vec3d(V[0, 3], V[1, 3], V[2, 3]) / M
        b = wp.vec3d(V[3, 0], V[3, 1], V[3, 2]) / M
        W = wp.mat33d(V[0, 0], V[0, 1], V[0, 2], V[1, 0], V[1, 1], V[1, 2], V[2, 0], V[2, 1], V[2, 2]) / M - wp.outer(a, b)
        if V[3, 3] > zero and wp.determinant(J) > wp.float64(1.0e-9) * size * size * size:
            omega = wp.inverse(J) * (-h * wp.vec3d(W[1, 2] - W[2, 1], W[2, 0] - W[0, 2], W[0, 1] - W[1, 0]))
    return centre, omega


@cache
def body_spin_kernel(real, module):
    """Kernel over bodies times a block of threads: centre and omega of each. h: the substep [s]."""
    Sums = spin_sums(real)

    def find_lost_spin(b: Sums, h: wp.float64):
        body = wp.tid() // wp.block_dim()
        lane = wp.tid() % wp.block_dim()
        X = wp.mat44d()
        V = wp.mat44d()
        for k in range(b.first[body] + lane, b.first[body + 1], wp.block_dim()):
            X += b.sums[0, k]
            V += b.sums[1, k]
        X = block_matrix_sum(X)
        V = block_matrix_sum(V)
        centre, omega = lost_spin(X, V, h)
        if lane == 0:
            b.centre[body] = centre
            b.omega[body] = omega

    return wp.kernel(find_lost_spin, name=f"find_lost_spin_{types(real).name}", module=module, enable_backward=False,
                     grid_stride=False)


@cache
def spin_return_kernel(real, module):
    """Kernel over members: v' + omega x r."""
    t, Sums = types(real), spin_sums(real)

    @wp.kernel(module=module, enable_backward=False)
    def give_back_spin(b: Sums, x: wp.array(dtype=t.vec3), v_out: wp.array(dtype=t.vec3)):
        j = wp.tid()
        p = b.point[j]
        body = b.owner[j]
        u = double_vector(v_out[p]) + wp.cross(b.omega[body], double_vector(x[p]) - b.centre[body])
        v_out[p] = t.vec3(real(u[0]), real(u[1]), real(u[2]))

    return give_back_spin
