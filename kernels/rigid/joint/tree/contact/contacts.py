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
from wsim.kernels.rigid.joint.tree.contact.link_pair import LinkPair, link_pair_functions, point_line
from wsim.kernels.rigid.joint.tree.lanes import (
    column_lane,
    column_lanes,
    entry_store_functions,
    row_lane,
    row_lanes,
    tree_barrier,
    tree_lane,
)
from wsim.kernels.rigid.joint.tree.tables import Trees, vec6d
from wsim.kernels.rigid.motion import double_vec3
from wsim.kernels.rigid.soft_step import NEAR, contact_goal_functions

STUCK = wp.constant(1.0e-10)       # of a free body's response to an impulse: below it, joints hold a point in that direction


@cache
def link_contact_functions(real, moving: bool = False):
    """prepare, warm, solve: functions of a manifold m. moving: what some trees hang from moves."""
    t, Rig, friction_of = types(real), rig_type(real), surface_law_functions(real)[0]
    formulas, (store_normal, store_tangent) = impulse_formulas(real), entry_store_functions(t.mat44, t.vec3, real)
    prepare_arms, rubbed = formulas[1], formulas[7]
    links = link_pair_functions(real, moving)
    read_link_pair, pair_slip, push_pair, feel_wrenches, give_wrenches = (links.read, links.slip, links.push, links.feel,
                                                                          links.give)
    first, together, (goal, fastest) = tangent_func(real), manifold_impulse_func(real), contact_goal_functions(real)

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
