"""Contacts of rigid clusters with colliders: each acts on the whole cluster at once.

kernels/contact/project.py moves one point at a time, as if it had its own mass alone; the projection of the cluster takes
most of that back. Here a contact at r from the centre meets the inverse mass of a rigid body there, along n,

    w(n) = 1/M + (r x n) J^-1 (r x n),    J = sum m (|r|^2 - r r^T)

and its impulse moves the cluster by dc and turns it by theta (Mueller, Macklin, Chentanez, Jeschke, Kim 2020, Detailed rigid
body simulation with extended position based dynamics, eq. 2-9). Projected relaxation, in the words of
kernels/contact/project.py, with L = P / w [kg m] a point's push over its own inverse mass, which is g times the impulse:

    lam' = max(lam - (b + n.d) / w(n), 0)        dc += dL / M
    T*   = T - s / w(s / |s|),  s the slip       theta += J^-1 (r x dL),   |T'| <= mu lam'

One contact at a time, that which is farthest from its solution (Southwell 1946): a face that lies has hundreds of contacts, of
which the corners bear. All threads of a block look for it, each at its own contacts; all know what it does, and the first one
writes it. PICKS of them, or until one moves by LEAST of the farthest in the substep, follow each projection of a cluster; then
x <- c + dc + exp(theta) r. Clusters with pinned points, that share points, or that deform are left to the contacts of single
points, which come next and find little left to do here. The order of sums is fixed.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.contact.project import contact_tables, is_tied_slot, read_type, slot_type
from wsim.kernels.math.real import types
from wsim.kernels.soft.clusters import shape_matching as shape

PICKS = 32             # contacts that act in an iteration, at most
LEAST = 1e-2            # of the farthest that one has moved a point in the substep; 1e-3 takes three times as long, for the
#                        same paths
LINE = 1e-12           # determinant of J over its trace cubed, below which points are in a line


@cache
def rigid_contact_table(real):
    """Struct of clusters and their contacts."""
    t = types(real)

    @wp.struct
    class RigidContacts:
        whole: wp.array(dtype=int)                # 1: rigid, without pinned and shared points, (clusters,)
        friction: wp.array(dtype=t.vec2)          # static, dynamic, (clusters,)
        listed: wp.array(dtype=int)               # members that touch, the n-th of thread l at n threads + l, (members,)
        count: wp.array(dtype=int)                # how many of each thread, (clusters * threads,)
        touches: wp.array(dtype=int)              # members that touch, (clusters,)
        way: wp.array(dtype=wp.float64)           # farthest that a contact has moved a point in this substep [m], (clusters,)
        mass: wp.array(dtype=wp.float64)          # M [kg], (clusters,)
        inverse: wp.array(dtype=wp.mat33d)        # J^-1 [1/(kg m^2)]; 0 of points in a line, (clusters,)

    return RigidContacts


@wp.struct
class ClusterMotion:
    """What a cluster has done in an iteration, about its centre."""
    cluster: int
    M: wp.float64                                 # [kg]
    inverse: wp.mat33d                            # J^-1
    centre: wp.vec3d                              # [m]
    dc: wp.vec3d                                  # [m]
    theta: wp.vec3d                               # [rad]


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __shared__ float merits[32];
    __shared__ int numbers[32];
    const unsigned lane = threadIdx.x & 31, warp = threadIdx.x >> 5, warps = blockDim.x >> 5;
    __syncthreads();
    for (unsigned k = 16; k > 0; k >>= 1) {
        const float other = __shfl_xor_sync(0xffffffffu, merit, k);
        const int theirs = __shfl_xor_sync(0xffffffffu, number, k);
        if (other > merit || (other == merit && theirs < number)) { merit = other; number = theirs; }
    }
    if (lane == 0) { merits[warp] = merit; numbers[warp] = number; }
    __syncthreads();
    for (unsigned k = 0; k < warps; ++k)
        if (merits[k] > merit || (merits[k] == merit && numbers[k] < number)) { merit = merits[k]; number = numbers[k]; }
#endif
    return merit > 0.0f ? number : -1;
""")
def block_best_number(merit: float, number: int) -> int:
    """Number of the largest merit in a block, the least of several, -1 where none is above 0; the same in each thread."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
    return 0;
""")
def wait_for_block() -> int:
    """0, when all threads of a block have come."""
    ...


@cache
def touching_member_kernel(real, module):
    """Kernel over clusters times a block of threads: members that have contacts, and J^-1 at x + d."""
    t, Clusters, Table, Slots, Read = (types(real), shape.shape_clusters(real), rigid_contact_table(real), slot_type(real),
                                       read_type(real))

    def list_touching_members(s: Clusters, slots: Slots, at: Read, table: Table):
        c = wp.tid() // wp.block_dim()
        lane = wp.tid() - c * wp.block_dim()
        if table.whole[c] == 0 or s.kappa[c] > wp.float64(0.0):           # its whole block goes
            return
        X = wp.mat44d()
        found = int(0)
        for j in range(s.first[c] + lane, s.first[c + 1], wp.block_dim()):
            p = s.point[j]
            y = shape.double_vector(at.x[p]) + shape.double_vector(at.d[p])
            X += shape.moment(y, y, wp.float64(1.0) / wp.float64(s.w[p]))
            if slots.count[p] > 0:
                table.listed[s.first[c] + found * wp.block_dim() + lane] = j
                found += 1
        table.count[c * wp.block_dim() + lane] = found
        X = shape.block_matrix_sum(X)
        T = wp.mat44d()
        T[0, 0] = wp.float64(found)
        T = shape.block_matrix_sum(T)
        if lane == 0:
            M = X[3, 3]
            centre = wp.vec3d(X[0, 3], X[1, 3], X[2, 3]) / M
            S = shape.upper_block(X) - M * wp.outer(centre, centre)
            size = wp.trace(S)
            J = size * wp.identity(n=3, dtype=wp.float64) - S
            table.inverse[c] = wp.mat33d()
            if wp.determinant(J) > wp.float64(LINE) * size * size * size:
                table.inverse[c] = wp.inverse(J)
            table.mass[c] = M
            table.way[c] = wp.float64(0.0)
            table.touches[c] = int(T[0, 0])

    return wp.kernel(list_touching_members, name=f"list_touching_members_{t.name}", module=module, enable_backward=False,
                     grid_stride=False)


@wp.func
def point_compliance(r: wp.vec3d, n: wp.vec3d, M: wp.float64, inverse: wp.mat33d):
    """w(n) [1/kg]."""
    arm = wp.cross(r, n)
    return wp.float64(1.0) / M + wp.dot(arm, inverse * arm)


@wp.func
def rigid_contact_push(r: wp.vec3d, inverse: wp.mat33d, M: wp.float64, n: wp.vec3d, C: wp.float64, way: wp.vec3d, L: wp.vec3d,
                       mu: wp.vec2d):
    """L' of a contact with the gap C [m], where the surface has been passed by `way` [m], d - a - g u."""
    lam = wp.dot(L, n)
    pressed = wp.max(lam - C / point_compliance(r, n, M, inverse), wp.float64(0.0))
    change = (pressed - lam) * n
    slip = way + change / M + wp.cross(inverse * wp.cross(r, change), r)
    slip = slip - wp.dot(slip, n) * n
    size = wp.length(slip)
    T = L - lam * n
    if size > wp.float64(0.0):
        T = T - slip / point_compliance(r, slip / size, M, inverse)
    size = wp.length(T)
    if size > mu[0] * pressed:
        T = T * (wp.min(mu[1] * pressed, size) / size)
    return pressed * n + T


@cache
def cluster_contact_funcs(real):
    """Functions: dL of contact j [kg m]; of thread `lane`, the number of the contact that moves its point farthest of those of
    the whole block, -1: none does."""
    Clusters, Table, Slots, Read = shape.shape_clusters(real), rigid_contact_table(real), slot_type(real), read_type(real)
    Rows, double = contact_tables(real)[0], shape.double_vector

    @wp.func
    def contact_change(s: Clusters, c: Rows, slots: Slots, at: Read, g: real, now: ClusterMotion, own_friction: Any, j: int):
        p = j % slots.points
        r = double(at.x[p]) + double(at.d[p]) - now.centre
        mu = real(0.5) * (own_friction + c.of.friction[slots.row[j]])
        L = double(at.push[j]) / wp.float64(s.w[p])
        d = double(at.d[p]) + now.dc + wp.cross(now.theta, r)
        way = d - double(at.a[p]) - wp.float64(g) * double(slots.u[j])
        n = double(slots.n[j])
        C = wp.float64(slots.b[j]) + wp.dot(n, d)
        return rigid_contact_push(r, now.inverse, now.M, n, C, way, L, wp.vec2d(wp.float64(mu[0]), wp.float64(mu[1]))) - L

    @wp.func
    def contact_way(at: Read, slots: Slots, now: ClusterMotion, change: wp.vec3d, j: int):
        """How far a change moves its point [m]."""
        p = j % slots.points
        r = double(at.x[p]) + double(at.d[p]) - now.centre
        return wp.length(change / now.M + wp.cross(now.inverse * wp.cross(r, change), r))

    @wp.func
    def farthest_contact(s: Clusters, table: Table, c: Rows, slots: Slots, at: Read, g: real, now: ClusterMotion, lane: int):
        k = now.cluster
        most = float(0.0)
        best = int(-1)
        for m in range(table.count[k * wp.block_dim() + lane]):
            p = s.point[table.listed[s.first[k] + m * wp.block_dim() + lane]]
            for i in range(slots.count[p]):
                j = i * slots.points + p
                if c.of.owner[slots.row[j]] < 0 and not is_tied_slot(slots, j):
                    change = contact_change(s, c, slots, at, g, now, table.friction[k], j)
                    way = float(contact_way(at, slots, now, change, j))
                    if way > most:
                        most = way
                        best = j
        return block_best_number(most, best)

    @wp.func
    def begin_motion(table: Table, k: int, sum: wp.mat44d):
        now = ClusterMotion()
        now.cluster = k
        now.M = table.mass[k]
        now.inverse = table.inverse[k]
        now.centre = wp.vec3d(sum[0, 3], sum[1, 3], sum[2, 3]) / now.M
        return now

    return contact_change, contact_way, farthest_contact, begin_motion


@cache
def rigid_contact_kernel(real, module):
    """Kernel over clusters times a block of threads: an iteration of contacts. g [s]: effective step."""
    t, Clusters, Table, Slots, Read = (types(real), shape.shape_clusters(real), rigid_contact_table(real), slot_type(real),
                                       read_type(real))
    Rows, double, funcs = contact_tables(real)[0], shape.double_vector, cluster_contact_funcs(real)
    change_of, way_of, farthest, begin = funcs

    def project_rigid_contacts(s: Clusters, table: Table, c: Rows, slots: Slots, at: Read, g: real,
                               d_out: wp.array(dtype=t.vec3), push_out: wp.array(dtype=t.vec3)):
        k = wp.tid() // wp.block_dim()
        lane = wp.tid() - k * wp.block_dim()
        if table.whole[k] == 0 or table.touches[k] == 0 or s.kappa[k] > wp.float64(0.0):
            return
        T = wp.mat44d()
        for j in range(s.first[k] + lane, s.first[k + 1], wp.block_dim()):
            p = s.point[j]
            T += shape.moment(double(at.x[p]) + double(at.d[p]), wp.vec3d(), wp.float64(1.0) / wp.float64(s.w[p]))
        T = shape.block_matrix_sum(T)
        now = begin(table, k, T)
        first = table.way[k]
        picks = int(0)
        while picks < PICKS:
            picks += 1
            j = farthest(s, table, c, slots, at, g, now, lane)
            if j < 0:
                picks = PICKS
            else:
                change = change_of(s, c, slots, at, g, now, table.friction[k], j)
                way = way_of(at, slots, now, change, j)
                p = j % slots.points
                push = double(at.push[j]) + wp.float64(s.w[p]) * change
                first = wp.max(first, way)
                if way < wp.float64(LEAST) * first:
                    picks = PICKS
                picks += wait_for_block()
                if lane == 0:
                    push_out[j] = t.vec3(real(push[0]), real(push[1]), real(push[2]))
                picks += wait_for_block()
                now.dc = now.dc + change / now.M
                now.theta = now.theta + now.inverse * wp.cross(double(at.x[p]) + double(at.d[p]) - now.centre, change)
        if lane == 0:
            table.way[k] = first
        angle = wp.length(now.theta)
        if angle + wp.length(now.dc) == wp.float64(0.0):
            return
        turn = wp.quat_from_axis_angle(wp.normalize(now.theta), angle)
        for j in range(s.first[k] + lane, s.first[k + 1], wp.block_dim()):
            p = s.point[j]
            r = double(at.x[p]) + double(at.d[p]) - now.centre
            d = double(at.d[p]) + now.dc + (wp.quat_rotate(turn, r) - r)
            d_out[p] = t.vec3(real(d[0]), real(d[1]), real(d[2]))

    return wp.kernel(project_rigid_contacts, name=f"project_rigid_contacts_{t.name}", module=module, enable_backward=False,
                     grid_stride=False)
