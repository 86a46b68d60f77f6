"""Contacts of links: the soft step of kernels/rigid/soft_step.py, with the response of whole trees in the place of single
bodies.

    A_ij = g_i^T D g_j,   g_i = (x_i x n, n)          x_i: point i from O; of both sides, less what both share in one tree

Velocities are those of the coordinates, as u (responses.py). Impulses of a manifold are found together along n, then friction
point by point, and go to all dofs of a tree at once, so that what hangs on a link is felt in the first sweep. All lanes of a
tree find the same impulses. Where joints leave neither side a motion along n, A_ii is 0 and the point bears nothing.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.complementarity.manifold_impulse import manifold_impulse_func
from wsim.kernels.rigid.contact import rig_type, surface_law_functions
from wsim.kernels.rigid.impulse import impulse_formulas, tangent_func
from wsim.kernels.rigid.joint.tree.lanes import (
    column_lane,
    column_lanes,
    entry_store_functions,
    row_lane,
    row_lanes,
    tree_barrier,
    tree_lane,
)
from wsim.kernels.rigid.joint.tree.responses import cross_response, link_twist, push_link
from wsim.kernels.rigid.joint.tree.tables import Trees, mat66d, vec6d
from wsim.kernels.rigid.motion import double_vec3
from wsim.kernels.rigid.soft_step import NEAR, contact_goal_functions

STUCK = wp.constant(1.0e-10)       # of a free body's response to an impulse: below it, joints hold a point in that direction


@wp.struct
class LinkPair:
    """Links of a manifold, -1: a collider; their trees, where the centres of mass are from O, and spatial velocities at O; a
    collider's at its own centre."""
    l_a: int
    l_b: int
    g_a: int
    g_b: int
    x_a: wp.vec3d
    x_b: wp.vec3d
    V_a: vec6d
    V_b: vec6d
    D_a: mat66d
    D_b: mat66d
    D_ab: mat66d                 # velocity of a by a wrench on b, 0 in different trees


@wp.func
def point_line(x: wp.vec3d, n: wp.vec3d):
    """(x x n, n): the wrench of a force n at x, and what gives the velocity along n there."""
    m = wp.cross(x, n)
    return vec6d(m[0], m[1], m[2], n[0], n[1], n[2])


@wp.func
def twist_at(V: vec6d, x: wp.vec3d):
    """Velocity of the place x from O."""
    return wp.vec3d(V[3], V[4], V[5]) + wp.cross(wp.vec3d(V[0], V[1], V[2]), x)


@cache
def link_contact_functions(real):
    """prepare, warm, solve: functions of a manifold m."""
    t, Rig, friction_of = types(real), rig_type(real), surface_law_functions(real)[0]
    formulas, (store_normal, store_tangent) = impulse_formulas(real), entry_store_functions(t.mat44, t.vec3, real)
    prepare_arms, rubbed = formulas[1], formulas[7]
    first, together, (goal, fastest) = tangent_func(real), manifold_impulse_func(real), contact_goal_functions(real)

    @wp.func
    def collider_twist(f: int, k: int, rig: Rig):
        row = k * rig.still.moving
        o = rig.still.omega[row, f - rig.b.w.shape[0]]
        v = rig.still.v[row, f - rig.b.w.shape[0]]
        return vec6d(wp.float64(o[0]), wp.float64(o[1]), wp.float64(o[2]), wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))

    @standalone_function
    @wp.func
    def read_link_pair(m: int, k: int, rig: Rig, T: Trees):
        n = rig.b.w.shape[0]
        f_a = rig.s.frame[rig.c.a[m]]
        f_b = rig.s.frame[rig.c.b[m]]
        pair = LinkPair()
        pair.l_a = -1
        pair.l_b = -1
        pair.g_a = -1
        pair.g_b = -2
        if f_a < n:
            pair.l_a = T.link_of[f_a]
            pair.g_a = T.tree_of[pair.l_a]
            pair.x_a = T.X[pair.l_a] - T.X[T.t.first_link[pair.g_a]]
            pair.V_a = link_twist(pair.l_a, T)
            pair.D_a = T.swing[pair.l_a]
        else:
            pair.V_a = collider_twist(f_a, k, rig)
        if f_b < n:
            pair.l_b = T.link_of[f_b]
            pair.g_b = T.tree_of[pair.l_b]
            pair.x_b = T.X[pair.l_b] - T.X[T.t.first_link[pair.g_b]]
            pair.V_b = link_twist(pair.l_b, T)
            pair.D_b = T.swing[pair.l_b]
        else:
            pair.V_b = collider_twist(f_b, k, rig)
        if pair.g_a == pair.g_b:
            pair.D_ab = cross_response(pair.l_a, pair.l_b, T)
        return pair

    @standalone_function
    @wp.func
    def pair_slip(pair: LinkPair, m: int, i: int, rig: Rig):
        """Velocity of a against b at point i."""
        j = 4 * m + i
        u = twist_at(pair.V_a, pair.x_a + double_vec3(rig.work.r_a[j]))
        u -= twist_at(pair.V_b, pair.x_b + double_vec3(rig.work.r_b[j]))
        return t.vec3(real(u[0]), real(u[1]), real(u[2]))

    @standalone_function
    @wp.func
    def relative_response(pair: LinkPair, a: vec6d, b: vec6d, a_by: vec6d, b_by: vec6d):
        """Change of the relative velocity along the line (a, b) by a unit impulse along the line (a_by, b_by)."""
        return (wp.dot(a, pair.D_a * a_by) + wp.dot(b, pair.D_b * b_by) - wp.dot(a, pair.D_ab * b_by)
                - wp.dot(pair.D_ab * b, a_by))

    @standalone_function
    @wp.func
    def line_response(pair: LinkPair, m: int, i: int, d: t.vec3, e: int, d_by: t.vec3, rig: Rig):
        """Change of the relative velocity along d at point i by a unit impulse along d_by at point e."""
        a = point_line(pair.x_a + double_vec3(rig.work.r_a[4 * m + i]), double_vec3(d))
        b = point_line(pair.x_b + double_vec3(rig.work.r_b[4 * m + i]), double_vec3(d))
        a_by = point_line(pair.x_a + double_vec3(rig.work.r_a[4 * m + e]), double_vec3(d_by))
        b_by = point_line(pair.x_b + double_vec3(rig.work.r_b[4 * m + e]), double_vec3(d_by))
        return real(relative_response(pair, a, b, a_by, b_by))

    @wp.func
    def drop_stuck_points(m: int, rig: Rig):
        """Points that bear nothing, since joints hold both sides along n: what presses there, a rail does."""
        A = rig.work.A[m]
        for i in range(rig.c.count[m]):
            if A[i, i] <= real(0.0):
                rig.c.push[4 * m + i] = real(0.0)
                rig.c.rub[4 * m + i] = t.vec3()

    @standalone_function
    @wp.func
    def prepare_link_manifold(m: int, k: int, rig: Rig, T: Trees):
        """Arms, gaps, A and K of a manifold. Responses of its links are there."""
        count = rig.c.count[m]
        if count > 0:
            if tree_lane() == 0:
                prepare_arms(m, k, rig)
            tree_barrier()
            pair = read_link_pair(m, k, rig, T)
            free = rig.work.A[m]
            tree_barrier()                                # all lanes have read it
            n = rig.c.n[m]
            t1 = first(n)
            t2 = wp.cross(n, t1)
            four = int(4)
            three = int(3)
            for i in range(row_lane(), four, row_lanes()):
                for e in range(column_lane(), four, column_lanes()):
                    found = wp.where(i == e, real(1.0), real(0.0))
                    if i < count and e < count:
                        found = line_response(pair, m, i, n, e, n, rig)
                        if i == e and found <= real(STUCK) * free[i, i]:
                            found = real(0.0)
                    store_normal(rig.work.A, m, i, e, found)
                if i < count:
                    for e in range(column_lane(), three, column_lanes()):
                        found = line_response(pair, m, i, wp.where(e == 2, t2, t1), i, wp.where(e == 0, t1, t2), rig)
                        if e != 1:
                            found = wp.max(found, real(STUCK) * free[i, i])
                        store_tangent(rig.work.K, 4 * m + i, e, found)
            tree_barrier()
            if tree_lane() == 0:
                drop_stuck_points(m, rig)
            tree_barrier()

    @standalone_function
    @wp.func
    def push_pair(pair: LinkPair, m: int, i: int, P: t.vec3, rig: Rig):
        """(a, b): wrenches of an impulse P on a at point i, and of -P on b."""
        j = 4 * m + i
        a = point_line(pair.x_a + double_vec3(rig.work.r_a[j]), double_vec3(P))
        b = point_line(pair.x_b + double_vec3(rig.work.r_b[j]), -double_vec3(P))
        return a, b

    @standalone_function
    @wp.func
    def feel_wrenches(pair: LinkPair, a: vec6d, b: vec6d):
        """Velocities of both links behind wrenches on both."""
        out = pair
        out.V_a = pair.V_a + pair.D_a * a + pair.D_ab * b
        out.V_b = pair.V_b + pair.D_b * b + wp.transpose(pair.D_ab) * a
        return out

    @standalone_function
    @wp.func
    def give_wrenches(pair: LinkPair, a: vec6d, b: vec6d, T: Trees):
        tree_barrier()                                    # all lanes have read velocities
        if pair.l_a >= 0:
            push_link(pair.l_a, a, T)
        if pair.l_b >= 0:
            push_link(pair.l_b, b, T)

    @standalone_function
    @wp.func
    def warm_link_manifold(m: int, k: int, h: real, rig: Rig, T: Trees):
        count = rig.c.count[m]
        if count > 0:
            pair = read_link_pair(m, k, rig, T)
            n = rig.c.n[m]
            turn = real(0.5) * h * real(wp.dot(double_vec3(n), wp.vec3d(pair.V_a[0] + pair.V_b[0], pair.V_a[1] + pair.V_b[1],
                                                                       pair.V_a[2] + pair.V_b[2])))
            a = vec6d()
            b = vec6d()
            for i in range(count):
                j = 4 * m + i
                rub = rig.c.rub[j] - wp.dot(n, rig.c.rub[j]) * n
                rub = (real(1.0) - real(0.5) * turn * turn) * rub + turn * wp.cross(n, rub)
                tree_barrier()                            # all lanes have read it
                if tree_lane() == 0:
                    rig.c.rub[j] = rub
                more_a, more_b = push_pair(pair, m, i, rig.c.push[j] * n + rub, rig)
                a += more_a
                b += more_b
            give_wrenches(pair, a, b, T)

    @standalone_function
    @wp.func
    def solve_link_manifold(m: int, k: int, h: real, biased: int, rig: Rig, T: Trees):
        count = rig.c.count[m]
        if count > 0:
            pair = read_link_pair(m, k, rig, T)
            n = rig.c.n[m]
            most = fastest(m, rig)
            A = rig.work.A[m]
            wanted = t.vec4()
            soft = t.vec4()
            close = t.vec4()
            before = t.vec4()
            acts = wp.vec4i()
            for i in range(4):
                if i < count:
                    before[i] = rig.c.push[4 * m + i]
                    wants = goal(rig.work.now[4 * m + i], before[i], h, most, biased)
                    soft[i] = wants[2]
                    close[i] = wp.where(wants[2] == real(0.0), real(NEAR), real(0.0))
                    if wants[0] > real(0.0) and A[i, i] > real(0.0):
                        acts[i] = 1
                        wanted[i] = -(wp.dot(n, pair_slip(pair, m, i, rig)) + wants[1])
            more = together(A, before, wanted, soft, close, acts)
            a = vec6d()
            b = vec6d()
            tree_barrier()
            for i in range(4):
                if i < count:
                    if tree_lane() == 0:
                        rig.c.push[4 * m + i] = before[i] + more[i]
                    more_a, more_b = push_pair(pair, m, i, more[i] * n, rig)
                    a += more_a
                    b += more_b
            tree_barrier()
            pair = feel_wrenches(pair, a, b)
            for i in range(count):
                j = 4 * m + i
                rub = rubbed(rig.c.rub[j], pair_slip(pair, m, i, rig), n, rig.work.K[j], rig.c.push[j], friction_of(m, rig))
                more_a, more_b = push_pair(pair, m, i, rub - rig.c.rub[j], rig)
                pair = feel_wrenches(pair, more_a, more_b)
                a += more_a
                b += more_b
                tree_barrier()
                if tree_lane() == 0:
                    rig.c.rub[j] = rub
            give_wrenches(pair, a, b, T)

    @wp.func
    def mark_met_links(m: int, rig: Rig, T: Trees):
        """Notes that the links of a manifold need responses. One lane."""
        if rig.c.count[m] > 0:
            f = rig.s.frame[rig.c.a[m]]
            g = rig.s.frame[rig.c.b[m]]
            if f < rig.b.w.shape[0]:
                T.met[T.link_of[f]] = 1
            if g < rig.b.w.shape[0]:
                T.met[T.link_of[g]] = 1

    return SimpleNamespace(mark=mark_met_links, prepare=prepare_link_manifold, warm=warm_link_manifold,
                           solve=solve_link_manifold)
