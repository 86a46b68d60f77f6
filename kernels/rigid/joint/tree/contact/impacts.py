"""Impacts of links (kernels/rigid/impact.py), with the response of whole trees, and limits that a blow meets.

    u = sqrt(u_n^2 + 2 a gap),  a = -(u_n' - u_n) / h           u_n': as the tree goes on without contacts for a step of h
    u' = sqrt(e^2 u^2 - 2 a gap)

so that a ball that hangs on a joint falls as the joint lets it. A blow goes to all dofs of a tree at once. What it changes is
the velocity where the substep begins.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type, surface_law_functions
from wsim.kernels.rigid.impact import MET, REST, SOONER, STILL
from wsim.kernels.rigid.impulse import impulse_formulas
from wsim.kernels.rigid.joint.tree.contact.link_pair import LinkPair, link_pair_functions
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.lists.core import CORE
from wsim.kernels.rigid.soft_step import contact_goal_functions

MARK, STRIKE = wp.constant(0), wp.constant(1)                # of a world's flags: something is thrown; a sweep missed its goal


@cache
def link_impact_functions(real, moving: bool):
    """note, lean, mark, strike: functions of a manifold m of world w."""
    t, Rig, (friction_of, restitution_of) = types(real), rig_type(real), surface_law_functions(real)
    links, rubbed, fastest = link_pair_functions(real, moving), impulse_formulas(real)[7], contact_goal_functions(real)[1]
    read, slip, push, give = links.read, links.slip, links.push, links.give

    @standalone_function
    @wp.func
    def note_approach(m: int, k: int, rig: Rig, T: Trees):
        """`goal`: u_n where the substep begins."""
        if restitution_of(m, rig) > real(0.0):
            pair = read(m, k, rig, T)
            for i in range(rig.c.count[m]):
                rig.work.goal[4 * m + i] = wp.dot(rig.c.n[m], slip(pair, m, i, rig))
            tree_barrier()

    @standalone_function
    @wp.func
    def note_acceleration(m: int, k: int, h: real, rig: Rig, T: Trees):
        """`when`: a, by the velocities that the tree ends with; h a: of a substep."""
        if restitution_of(m, rig) > real(0.0):
            pair = read(m, k, rig, T)
            for i in range(rig.c.count[m]):
                rig.work.when[4 * m + i] = (rig.work.goal[4 * m + i] - wp.dot(rig.c.n[m], slip(pair, m, i, rig))) / h
            tree_barrier()

    @standalone_function
    @wp.func
    def mark_link_impact(m: int, w: int, k: int, h: real, rig: Rig, T: Trees):
        """Points of manifold m that are thrown back in this round, and their goals."""
        e = restitution_of(m, rig)
        if e > real(0.0) and rig.c.count[m] > 0:
            pair = read(m, k, rig, T)
            n = rig.c.n[m]
            A = rig.work.A[m]
            for i in range(rig.c.count[m]):
                j = 4 * m + i
                u = wp.dot(n, slip(pair, m, i, rig))
                a = rig.work.when[j]
                gap = wp.max(rig.work.now[j], real(0.0))
                speed = wp.sqrt(wp.max(u * u + real(2.0) * a * gap, real(0.0)))
                touches = gap + real(SOONER) * h * (u - h * wp.max(a, real(0.0))) < real(0.0)
                goal = real(-1.0)
                if A[i, i] > real(0.0) and rig.c.key[j] != CORE and u < real(0.0) and touches:
                    if speed > real(REST) * h * wp.abs(a) and speed > real(STILL) * fastest(m, rig):
                        goal = wp.sqrt(wp.max(e * e * speed * speed - real(2.0) * a * gap, real(0.0)))
                        T.flags[2 * w + MARK] = 1
                if tree_lane() == 0:
                    rig.work.goal[j] = goal
                    rig.work.hit[j] = real(0.0)
                    rig.work.scrape[j] = t.vec3()
            tree_barrier()

    @wp.func
    def push_point(pair: LinkPair, m: int, i: int, P: t.vec3, k: int, rig: Rig, T: Trees):
        """An impulse at point i; the links behind it."""
        a, b = push(pair, m, i, P, rig)
        give(pair, a, b, T)
        return read(m, k, rig, T)

    @standalone_function
    @wp.func
    def strike_link_manifold(m: int, w: int, k: int, rig: Rig, T: Trees):
        """One sweep over the marked points of manifold m."""
        if restitution_of(m, rig) > real(0.0):
            pair = read(m, k, rig, T)
            n = rig.c.n[m]
            A = rig.work.A[m]
            for i in range(rig.c.count[m]):
                j = 4 * m + i
                if rig.work.goal[j] >= real(0.0):
                    before = rig.work.hit[j]
                    hit = wp.max(before + (rig.work.goal[j] - wp.dot(n, slip(pair, m, i, rig))) / A[i, i], real(0.0))
                    pair = push_point(pair, m, i, (hit - before) * n, k, rig, T)
                    was = rig.work.scrape[j]
                    rub = rubbed(was, slip(pair, m, i, rig), n, rig.work.K[j], hit, friction_of(m, rig))
                    pair = push_point(pair, m, i, rub - was, k, rig, T)
                    if wp.abs(hit - before) >= real(MET) * wp.max(hit, real(1.0e-30)):
                        T.flags[2 * w + STRIKE] = 1
                    tree_barrier()
                    if tree_lane() == 0:
                        rig.work.hit[j] = hit
                        rig.work.scrape[j] = rub
                    tree_barrier()

    return SimpleNamespace(note=note_approach, lean=note_acceleration, mark=mark_link_impact, strike=strike_link_manifold)
