"""Contacts of rigid clusters with colliders: each acts on the whole cluster at once.

kernels/contact/project.py moves one point at a time, as if it had its own mass alone; the projection of the cluster takes
most of that back. Here a contact at r from the centre meets the inverse mass of a rigid body there, along n,

    w(n) = 1/M + (r x n) J^-1 (r x n),    J = sum m (|r|^2 - r r^T)

and its impulse moves the cluster by dc and turns it by theta (Mueller, Macklin, Chentanez, Jeschke, Kim 2020, Detailed rigid
body simulation with extended position based dynamics, eq. 2-9). Projected Gauss-Seidel, in the words of
kernels/contact/project.py, with L = P / w [kg m] a point's push over its own inverse mass, which is g times the impulse:

    lam' = max(lam - (b + n.d) / w(n), 0)        dc += dL / M
    T*   = T - s / w(s / |s|),  s the slip       theta += J^-1 (r x dL),   |T'| <= mu lam'

SWEEPS of them follow each projection of a cluster; then x <- c + dc + exp(theta) r. Clusters with pinned points, that share
points, or that deform are left to the contacts of single points, which come next and find nothing left to do here.
The order of sums is fixed: threads list the points that touch, each of a stretch of members; the first one solves.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.project import contact_tables, is_tied_slot, read_type, slot_type
from wsim.kernels.math.real import types
from wsim.kernels.soft.clusters import shape_matching as shape

SWEEPS = 8             # over all contacts of a cluster in an iteration; a cube on its face keeps 1e-3 of its speed with 2
LEAST = 1e-12          # determinant of J over its trace cubed, below which points are in a line


@cache
def rigid_contact_table(real):
    """Struct of clusters and their contacts."""
    t = types(real)

    @wp.struct
    class RigidContacts:
        whole: wp.array(dtype=int)                # 1: rigid, without pinned and shared points, (clusters,)
        friction: wp.array(dtype=t.vec2)          # static, dynamic, (clusters,)
        listed: wp.array(dtype=int)               # members that touch, from where a thread's stretch begins, (members,)
        count: wp.array(dtype=int)                # how many of each stretch, (clusters * threads,)
        touches: wp.array(dtype=int)              # members that touch, (clusters,)
        centre: wp.array(dtype=wp.vec3d)          # now [m], (clusters,)
        mass: wp.array(dtype=wp.float64)          # M [kg], (clusters,)
        inverse: wp.array(dtype=wp.mat33d)        # J^-1 [1/(kg m^2)]; 0 of points in a line, (clusters,)

    return RigidContacts


@wp.func
def stretch_start(first: int, last: int, lane: int, threads: int):
    """First member of a thread's stretch of first .. last - 1."""
    return first + int((wp.int64(last - first) * wp.int64(lane)) / wp.int64(threads))


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
        begin = stretch_start(s.first[c], s.first[c + 1], lane, wp.block_dim())
        found = int(0)
        for j in range(begin, stretch_start(s.first[c], s.first[c + 1], lane + 1, wp.block_dim())):
            p = s.point[j]
            y = shape.double_vector(at.x[p]) + shape.double_vector(at.d[p])
            X += shape.moment(y, y, wp.float64(1.0) / wp.float64(s.w[p]))
            if slots.count[p] > 0:
                table.listed[begin + found] = j
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
            if wp.determinant(J) > wp.float64(LEAST) * size * size * size:
                table.inverse[c] = wp.inverse(J)
            table.mass[c] = M
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
def cluster_contact_func(real):
    """Function: (dc, theta) of a cluster, and its pushes, after SWEEPS sweeps of one thread."""
    t = types(real)
    Clusters, Table, Slots, Read = shape.shape_clusters(real), rigid_contact_table(real), slot_type(real), read_type(real)
    Rows, double = contact_tables(real)[0], shape.double_vector

    @wp.func
    def solve_cluster_contacts(s: Clusters, table: Table, c: Rows, slots: Slots, at: Read, g: real, k: int,
                               push_out: wp.array(dtype=t.vec3)):
        dc = wp.vec3d()
        theta = wp.vec3d()
        M = table.mass[k]
        inverse = table.inverse[k]
        for _ in range(SWEEPS):
            for lane in range(wp.block_dim()):
                begin = stretch_start(s.first[k], s.first[k + 1], lane, wp.block_dim())
                for m in range(begin, begin + table.count[k * wp.block_dim() + lane]):
                    p = s.point[table.listed[m]]
                    own = wp.float64(s.w[p])
                    r = double(at.x[p]) + double(at.d[p]) - table.centre[k]
                    for i in range(slots.count[p]):
                        j = i * slots.points + p
                        if c.of.owner[slots.row[j]] < 0 and not is_tied_slot(slots, j):
                            mu = real(0.5) * (table.friction[k] + c.of.friction[slots.row[j]])
                            L = double(push_out[j]) / own
                            d = double(at.d[p]) + dc + wp.cross(theta, r)
                            way = d - double(at.a[p]) - wp.float64(g) * double(slots.u[j])
                            n = double(slots.n[j])
                            new = rigid_contact_push(r, inverse, M, n, wp.float64(slots.b[j]) + wp.dot(n, d), way, L,
                                                     wp.vec2d(wp.float64(mu[0]), wp.float64(mu[1])))
                            dc = dc + (new - L) / M
                            theta = theta + inverse * wp.cross(r, new - L)
                            new = own * new
                            push_out[j] = t.vec3(real(new[0]), real(new[1]), real(new[2]))
        return dc, theta

    return solve_cluster_contacts


@cache
def rigid_contact_kernel(real, module):
    """Kernel over clusters times a block of threads: an iteration of contacts. g [s]: effective step."""
    t, Clusters, Table, Slots, Read = (types(real), shape.shape_clusters(real), rigid_contact_table(real), slot_type(real),
                                       read_type(real))
    Rows, solve, double = contact_tables(real)[0], cluster_contact_func(real), shape.double_vector

    def project_rigid_contacts(s: Clusters, table: Table, c: Rows, slots: Slots, at: Read, g: real,
                               d_out: wp.array(dtype=t.vec3), push_out: wp.array(dtype=t.vec3)):
        k = wp.tid() // wp.block_dim()
        lane = wp.tid() - k * wp.block_dim()
        if table.whole[k] == 0 or table.touches[k] == 0 or s.kappa[k] > wp.float64(0.0):
            return
        T = wp.mat44d()
        for j in range(s.first[k] + lane, s.first[k + 1], wp.block_dim()):
            p = s.point[j]
            y = (double(at.x[p]) + double(at.d[p])) / wp.float64(s.w[p])
            for i in range(3):
                T[0, i] += y[i]
        T = shape.block_matrix_sum(T)
        centre = wp.vec3d(T[0, 0], T[0, 1], T[0, 2]) / table.mass[k]
        T = wp.mat44d()
        if lane == 0:
            table.centre[k] = centre
            dc, theta = solve(s, table, c, slots, at, g, k, push_out)
            for i in range(3):
                T[0, i] = dc[i]
                T[1, i] = theta[i]
        T = shape.block_matrix_sum(T)
        dc = wp.vec3d(T[0, 0], T[0, 1], T[0, 2])
        theta = wp.vec3d(T[1, 0], T[1, 1], T[1, 2])
        angle = wp.length(theta)
        if angle + wp.length(dc) == wp.float64(0.0):
            return
        turn = wp.quat_from_axis_angle(wp.normalize(theta), angle)
        for j in range(s.first[k] + lane, s.first[k + 1], wp.block_dim()):
            p = s.point[j]
            d = double(at.d[p])
            r = double(at.x[p]) + d - centre
            d = d + dc + (wp.quat_rotate(turn, r) - r)
            d_out[p] = t.vec3(real(d[0]), real(d[1]), real(d[2]))

    return wp.kernel(project_rigid_contacts, name=f"project_rigid_contacts_{t.name}", module=module, enable_backward=False,
                     grid_stride=False)
