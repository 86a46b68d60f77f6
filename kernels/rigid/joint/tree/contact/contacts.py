"""Contacts of links: the soft step of kernels/rigid/soft_step.py, with the response of whole trees in the place of single
bodies.

    V' = V + D w,   w = (x x d, d)          D: of both links, and of one by the other where they are of one tree
    A, K, slip_by_push, slip_by_rub         velocities at the points of a manifold by impulses at them, along n and its tangents

Velocities are those of the coordinates, as u (responses.py). Impulses of a manifold are found together along n, then friction
point by point, and go to all dofs of a tree at once, so that what hangs on a link is felt in the first sweep. All lanes of a
tree find the same impulses. Where joints leave neither side a motion along n, A_ii is 0 and the point bears nothing.

What overlaps is pushed apart with no more energy than free trees of masses m_a and m_b would take (L: see soft_step.py):

    bias = max(rate gap, -sqrt(2 g L) sqrt(min(A_ii / (1 / m_a + 1 / m_b), 1)))

The bias of soft_step.py alone has a point near a hinge turn the link the faster the nearer it is, without bound.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.complementarity.manifold_impulse import manifold_impulse_func
from wsim.kernels.rigid.contact import rig_type, surface_law_functions
from wsim.kernels.rigid.impulse import impulse_formulas, tangent_func
from wsim.kernels.rigid.joint.tree.contact.link_pair import link_pair_functions
from wsim.kernels.rigid.joint.tree.lanes import entry_store_functions, tree_barrier, tree_lane
from wsim.kernels.rigid.joint.tree.tables import Trees, vec6d
from wsim.kernels.rigid.motion import double_vec3
from wsim.kernels.rigid.soft_step import NEAR, contact_goal_functions

STUCK = wp.constant(1.0e-6)        # of the response of free trees along n: below it, joints hold a point, which bears nothing
HELD = wp.constant(1.0e-10)        # of the response of free bodies to friction: the least
COLUMNS = wp.constant(12)          # of a manifold: impulses at each point along n and two tangents


@cache
def link_contact_functions(real, moving: bool = False, soft_model: bool = False):
    """mark, arms, prepare, end, warm, solve, residual: functions of a manifold m. moving: what some trees hang from moves;
    soft_model: contacts give way as in soft_model.py."""
    t, Rig, friction_of = types(real), rig_type(real), surface_law_functions(real)[0]
    formulas, (store_normal, store_tangent) = impulse_formulas(real), entry_store_functions(t.mat44, t.vec3, real)
    store_rub = entry_store_functions(t.mat22, t.vec3, real)[0]
    prepare_arms, rubbed, links = formulas[1], formulas[7], link_pair_functions(real, moving)
    find_link_pair, read_link_pair, pair_slip = links.find, links.read, links.slip
    changed_velocities, push_pair, give_wrenches = links.change, links.push, links.give
    first, together, (goal, fastest) = tangent_func(real), manifold_impulse_func(real), contact_goal_functions(real)

    @wp.func
    def inverse_tree_mass(f: int, rig: Rig, T: Trees):
        """1 / mass of the tree of a frame; 0 of a collider."""
        w = real(0.0)
        if f < rig.b.w.shape[0]:
            w = real(wp.float64(1.0) / T.m[T.t.first_link[T.tree_of[T.link_of[f]]]])
        return w

    @wp.func
    def inverse_mass_of_trees(m: int, rig: Rig, T: Trees):
        """1 / m_a + 1 / m_b."""
        return (inverse_tree_mass(rig.s.frame[rig.c.a[m]], rig, T) + inverse_tree_mass(rig.s.frame[rig.c.b[m]], rig, T))

    @standalone_function
    @wp.func
    def prepare_column(m: int, column: int, rig: Rig, T: Trees):
        """What an impulse at a point of a manifold changes, along n (column % 3 = 0) or a tangent. One lane."""
        i = column // 3
        way = column % 3
        count = rig.c.count[m]
        if i < count:
            n = rig.c.n[m]
            t1 = first(n)
            t2 = wp.cross(n, t1)
            d = wp.where(way == 0, n, wp.where(way == 1, t1, t2))
            pair = changed_velocities(find_link_pair(m, rig, T), m, i, d, rig, T)
            start = int(0)
            if way > 0:
                start = i                                 # friction is found point by point: later ones feel it
            for e in range(start, count):
                u = pair_slip(pair, m, e, rig)
                if way == 0:
                    found = wp.dot(n, u)
                    if e == i and found <= real(STUCK) * inverse_mass_of_trees(m, rig, T):
                        found = real(0.0)
                    store_normal(rig.work.A, m, e, i, found)
                    rig.work.slip_by_push[16 * m + 4 * e + i] = t.vec2(wp.dot(t1, u), wp.dot(t2, u))
                elif e > i:
                    store_rub(rig.work.slip_by_rub, 6 * m + (e * (e - 1)) // 2 + i, 0, way - 1, wp.dot(t1, u))
                    store_rub(rig.work.slip_by_rub, 6 * m + (e * (e - 1)) // 2 + i, 1, way - 1, wp.dot(t2, u))
                elif way == 1:
                    store_tangent(rig.work.K, 4 * m + i, 0, wp.max(wp.dot(t1, u), real(HELD) * rig.work.K[4 * m + i][0]))
                    store_tangent(rig.work.K, 4 * m + i, 1, wp.dot(t2, u))
                else:
                    store_tangent(rig.work.K, 4 * m + i, 2, wp.max(wp.dot(t2, u), real(HELD) * rig.work.K[4 * m + i][2]))

    @wp.func
    def drop_stuck_points(m: int, rig: Rig):
        """Points that bear nothing, since joints hold both sides along n: what presses there, a rail does. One lane."""
        A = rig.work.A[m]
        for i in range(rig.c.count[m]):
            if A[i, i] <= real(0.0):
                rig.c.push[4 * m + i] = real(0.0)
                rig.c.rub[4 * m + i] = t.vec3()

    @standalone_function
    @wp.func
    def warm_link_manifold(m: int, k: int, h: real, rig: Rig, T: Trees):
        pair = read_link_pair(m, k, rig, T)
        n = rig.c.n[m]
        turn = real(0.5) * h * real(wp.dot(double_vec3(n), wp.vec3d(pair.V_a[0] + pair.V_b[0], pair.V_a[1] + pair.V_b[1],
                                                                   pair.V_a[2] + pair.V_b[2])))
        a = vec6d()
        b = vec6d()
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            rub = rig.c.rub[j] - wp.dot(n, rig.c.rub[j]) * n
            rub = (real(1.0) - real(0.5) * turn * turn) * rub + turn * wp.cross(n, rub)
            more_a, more_b = push_pair(pair, m, i, rig.c.push[j] * n + rub, rig)
            a += more_a
            b += more_b
            tree_barrier()                                # all lanes have read it
            if tree_lane() == 0:
                rig.c.rub[j] = rub
        give_wrenches(pair, a, b, T)

    @wp.func
    def separation_speed(m: int, rig: Rig, T: Trees):
        """(greatest speed of free shapes, 1 / m_a + 1 / m_b)."""
        return t.vec2(fastest(m, rig), inverse_mass_of_trees(m, rig, T))

    @wp.func
    def point_speed(most: t.vec2, response: real):
        """Greatest speed at which a point of this response is pushed apart."""
        return most[0] * wp.sqrt(wp.min(response / most[1], real(1.0)))

    @wp.func
    def point_wants(j: int, push: real, h: real, most: real, biased: int, rig: Rig):
        """(1 where it acts, bias, part of A_ii that its impulse gives way by) of point j."""
        if wp.static(soft_model):
            acts = wp.where(rig.work.now[j] < real(0.0), real(1.0), real(0.0))
            wants = t.vec3(acts, -rig.work.goal[j], rig.work.hit[j])
        else:
            wants = goal(rig.work.now[j], push, h, most, biased)
        return wants

    @wp.func
    def point_friction(j: int, u: t.vec3, n: t.vec3, push: real, mu: t.vec2, rig: Rig):
        """(friction impulse of point j, which slips at u; its mean response)."""
        K = rig.work.K[j]
        was = rig.c.rub[j]
        slip = u
        if wp.static(soft_model):
            soft = rig.work.when[j]
            K = t.vec3(K[0] + soft, K[1], K[2] + soft)
            slip = u - rig.work.scrape[j] + soft * was
        return rubbed(was, slip, n, K, push, mu), real(0.5) * (K[0] + K[2])

    @standalone_function
    @wp.func
    def normal_impulses(m: int, h: real, biased: int, u: t.vec4, before: t.vec4, rig: Rig, T: Trees):
        """Changes of the impulses along n of a manifold, whose points part at u."""
        A = rig.work.A[m]
        most = separation_speed(m, rig, T)
        wanted = t.vec4()
        soft = t.vec4()
        close = t.vec4()
        acts = wp.vec4i()
        for i in range(4):
            if i < rig.c.count[m]:
                wants = point_wants(4 * m + i, before[i], h, point_speed(most, A[i, i]), biased, rig)
                soft[i] = wants[2]
                close[i] = wp.where(wants[2] == real(0.0), real(NEAR), real(0.0))
                if wants[0] > real(0.0) and A[i, i] > real(0.0):
                    acts[i] = 1
                    wanted[i] = -(u[i] + wants[1])
        return together(A, before, wanted, soft, close, acts)

    @standalone_function
    @wp.func
    def solve_link_manifold(m: int, k: int, h: real, biased: int, rig: Rig, T: Trees):
        count = rig.c.count[m]
        pair = read_link_pair(m, k, rig, T)
        n = rig.c.n[m]
        t1 = first(n)
        t2 = wp.cross(n, t1)
        before = t.vec4()
        u = t.vec4()
        u1 = t.vec4()
        u2 = t.vec4()
        for i in range(4):
            if i < count:
                slip = pair_slip(pair, m, i, rig)
                before[i] = rig.c.push[4 * m + i]
                u[i] = wp.dot(n, slip)
                u1[i] = wp.dot(t1, slip)
                u2[i] = wp.dot(t2, slip)
        more = normal_impulses(m, h, biased, u, before, rig, T)
        a = vec6d()
        b = vec6d()
        tree_barrier()                                    # all lanes have read impulses
        for i in range(4):
            if i < count:
                j = 4 * m + i
                for e in range(4):
                    if e < count:
                        by = rig.work.slip_by_push[16 * m + 4 * i + e]
                        u1[i] = u1[i] + more[e] * by[0]
                        u2[i] = u2[i] + more[e] * by[1]
                rub, _ = point_friction(j, u1[i] * t1 + u2[i] * t2, n, before[i] + more[i], friction_of(m, rig), rig)
                d = rub - rig.c.rub[j]
                for e in range(4):
                    if e > i and e < count:
                        K = rig.work.slip_by_rub[6 * m + (e * (e - 1)) // 2 + i]
                        u1[e] = u1[e] + K[0, 0] * wp.dot(t1, d) + K[0, 1] * wp.dot(t2, d)
                        u2[e] = u2[e] + K[1, 0] * wp.dot(t1, d) + K[1, 1] * wp.dot(t2, d)
                more_a, more_b = push_pair(pair, m, i, more[i] * n + d, rig)
                a += more_a
                b += more_b
                tree_barrier()
                if tree_lane() == 0:
                    rig.c.push[j] = before[i] + more[i]
                    rig.c.rub[j] = rub
        give_wrenches(pair, a, b, T)

    @standalone_function
    @wp.func
    def link_manifold_residual(m: int, k: int, h: real, biased: int, rig: Rig, T: Trees):
        """What points would change if each were solved by itself [m/s], at most (complementarity/converged.py)."""
        found = real(0.0)
        pair = read_link_pair(m, k, rig, T)
        n = rig.c.n[m]
        A = rig.work.A[m]
        most = separation_speed(m, rig, T)
        for i in range(rig.c.count[m]):
            j = 4 * m + i
            push = rig.c.push[j]
            u = pair_slip(pair, m, i, rig)
            wants = point_wants(j, push, h, point_speed(most, A[i, i]), biased, rig)
            bears = A[i, i] * push
            if wants[0] > real(0.0) and A[i, i] > real(0.0):
                found = wp.max(found, wp.abs(wp.min(bears, wp.dot(n, u) + wants[1] + wants[2] * bears)))
            rub, response = point_friction(j, u, n, push, friction_of(m, rig), rig)
            found = wp.max(found, response * wp.length(rub - rig.c.rub[j]))
        return found

    @wp.func
    def mark_met_links(m: int, rig: Rig, T: Trees):
        """Notes that the links of a manifold need responses. One lane."""
        f = rig.s.frame[rig.c.a[m]]
        g = rig.s.frame[rig.c.b[m]]
        if f < rig.b.w.shape[0]:
            if T.met[T.link_of[f]] == 0:
                T.met[T.link_of[f]] = 1
        if g < rig.b.w.shape[0]:
            if T.met[T.link_of[g]] == 0:
                T.met[T.link_of[g]] = 1

    return SimpleNamespace(mark=mark_met_links, arms=prepare_arms, prepare=prepare_column, end=drop_stuck_points,
                           warm=warm_link_manifold, solve=solve_link_manifold, residual=link_manifold_residual)
