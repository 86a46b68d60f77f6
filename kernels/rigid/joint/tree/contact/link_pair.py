"""Both links of a manifold: their velocities, what an impulse changes of them, and impulses at its points (contacts.py)."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.joint.tree.contact.responses import cross_response, link_twist, push_link
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier
from wsim.kernels.rigid.joint.tree.substep.bases import link_base_twist
from wsim.kernels.rigid.joint.tree.tables import Trees, vec6d
from wsim.kernels.rigid.motion import double_vec3


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
def link_pair_functions(real, moving: bool = False):
    """find, read, slip, change, push, give: functions of a manifold's links. moving: what some trees hang from moves."""
    t, Rig = types(real), rig_type(real)

    @wp.func
    def collider_twist(f: int, k: int, rig: Rig):
        row = k * rig.still.moving
        o = rig.still.omega[row, f - rig.b.w.shape[0]]
        v = rig.still.v[row, f - rig.b.w.shape[0]]
        return vec6d(wp.float64(o[0]), wp.float64(o[1]), wp.float64(o[2]), wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))

    @standalone_function
    @wp.func
    def find_link_pair(m: int, rig: Rig, T: Trees):
        """Links and places alone."""
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
        if f_b < n:
            pair.l_b = T.link_of[f_b]
            pair.g_b = T.tree_of[pair.l_b]
            pair.x_b = T.X[pair.l_b] - T.X[T.t.first_link[pair.g_b]]
        return pair

    @standalone_function
    @wp.func
    def read_link_pair(m: int, k: int, rig: Rig, T: Trees):
        pair = find_link_pair(m, rig, T)
        if pair.l_a >= 0:
            pair.V_a = link_twist(pair.l_a, T)
            if wp.static(moving):
                pair.V_a += link_base_twist(pair.l_a, T.t.first_link[pair.g_a], T)
        else:
            pair.V_a = collider_twist(rig.s.frame[rig.c.a[m]], k, rig)
        if pair.l_b >= 0:
            pair.V_b = link_twist(pair.l_b, T)
            if wp.static(moving):
                pair.V_b += link_base_twist(pair.l_b, T.t.first_link[pair.g_b], T)
        else:
            pair.V_b = collider_twist(rig.s.frame[rig.c.b[m]], k, rig)
        return pair

    @wp.func
    def pair_slip(pair: LinkPair, m: int, i: int, rig: Rig):
        """Velocity of a against b at point i."""
        j = 4 * m + i
        u = twist_at(pair.V_a, pair.x_a + double_vec3(rig.work.r_a[j]))
        u -= twist_at(pair.V_b, pair.x_b + double_vec3(rig.work.r_b[j]))
        return t.vec3(real(u[0]), real(u[1]), real(u[2]))

    @standalone_function
    @wp.func
    def changed_velocities(found: LinkPair, m: int, i: int, d: t.vec3, rig: Rig, T: Trees):
        """Velocities of both links that an impulse d on a at point i, and -d on b, gives them."""
        pair = found
        on_a = point_line(pair.x_a + double_vec3(rig.work.r_a[4 * m + i]), double_vec3(d))
        on_b = point_line(pair.x_b + double_vec3(rig.work.r_b[4 * m + i]), -double_vec3(d))
        pair.V_a = vec6d()
        pair.V_b = vec6d()
        if pair.l_a >= 0:
            pair.V_a = T.swing[pair.l_a] * on_a
        if pair.l_b >= 0:
            pair.V_b = T.swing[pair.l_b] * on_b
        if pair.g_a == pair.g_b:
            pair.V_a = pair.V_a + cross_response(pair.l_a, pair.l_b, on_b, T)
            pair.V_b = pair.V_b + cross_response(pair.l_b, pair.l_a, on_a, T)
        return pair

    @wp.func
    def push_pair(pair: LinkPair, m: int, i: int, P: t.vec3, rig: Rig):
        """(a, b): wrenches of an impulse P on a at point i, and of -P on b."""
        j = 4 * m + i
        a = point_line(pair.x_a + double_vec3(rig.work.r_a[j]), double_vec3(P))
        b = point_line(pair.x_b + double_vec3(rig.work.r_b[j]), -double_vec3(P))
        return a, b

    @standalone_function
    @wp.func
    def give_wrenches(pair: LinkPair, a: vec6d, b: vec6d, T: Trees):
        tree_barrier()                                    # all lanes have read velocities
        if pair.l_a >= 0:
            push_link(pair.l_a, a, T)
        if pair.l_b >= 0:
            push_link(pair.l_b, b, T)

    return SimpleNamespace(find=find_link_pair, read=read_link_pair, slip=pair_slip, change=changed_velocities, push=push_pair,
                           give=give_wrenches)
