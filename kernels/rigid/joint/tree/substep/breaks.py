"""Joints of trees that may break: reaction of each in a substep, and the freedom of links behind what broke.

The joint of such a link has six dofs: three slides, then hinges or a ball. Those that it locks have the axis 0 and armature
1. So they have S = 0 and a row of H that is the identity, and stay at 0. When it breaks, all six get their axes, and hinges
become a ball; the link's motion stays.

    F = sum over the links behind of (p' - p - P) / h - f          p: momentum of a link, P: impulse of its contacts and strings
    N = sum of (L' - L - P_L) / h - n + (x - o) x F                o: origin of the joint's frame b, at the mean place

is what a joint gave in the mean of the substep: F, N over `breaking` of JointTable break it. This is the momentum balance of
all behind it, so that weight, drives, limits and blows count. x: the mean of both places of a centre of mass. What turns in a
substep makes N err by that angle times the arm and F; along dofs that nothing drives, limits or rubs, joints give nothing.

(Featherstone 2008, section 5.3: the wrench that a joint transmits.)
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import rotate_vector
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tables import FREE, NONE
from wsim.kernels.rigid.joint.tree.actuator_forces import is_actuated
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_velocities, turn_about_unit_axis
from wsim.kernels.rigid.joint.tree.lanes import any_lane, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.strings import has_strings, string_ends
from wsim.kernels.rigid.joint.tree.mass_matrix import link_inertia_world
from wsim.kernels.rigid.joint.tree.newton_euler import bounded_decay, gather_tree_wrenches
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.motion import body_structs, double_vec3

HALF = wp.constant(wp.float64(0.5))


@standalone_function
@wp.func
def set_break_dofs(link: int, T: Trees):
    """Axes, armature, friction of the dofs of a link as its joint is whole or broken. One lane."""
    gone = T.breaks.broken[T.t.joint[link]]
    T.t.ball[link] = wp.max(gone, T.breaks.ball[link])
    six = int(6)
    for k in range(six):
        d = T.t.first_dof[link] + k
        axis = T.breaks.axis[d]
        armature = T.breaks.armature[d]
        friction = T.breaks.friction[d]
        if gone == 1:
            axis = wp.vec3d()
            axis[k % 3] = wp.float64(1.0)
            armature = wp.float64(0.0)
            friction = wp.float64(0.0)
        T.t.axis[d] = axis
        T.t.armature[d] = armature
        T.t.friction[d] = friction


@standalone_function
@wp.func
def set_break_tables(g: int, T: Trees):
    """Tables of a tree as its joints are whole or broken now."""
    if T.breaks.some == 1:
        for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            if T.breaks.may[link] == 1:
                set_break_dofs(link, T)
        tree_barrier()


@standalone_function
@wp.func
def free_broken_link(link: int, T: Trees):
    """Six free dofs of a link, with its place and motion now. One lane."""
    if T.t.ball[link] == 0:
        d = T.t.first_dof[link] + 3
        c = T.t.first_coordinate[link] + 3
        Q = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        w = wp.vec3d()
        three = int(3)
        for k in range(three):
            w += T.qd[d + k] * rotate_vector(Q, T.t.axis[d + k])
            Q = Q * turn_about_unit_axis(T.t.axis[d + k], T.q[c + k])
        w = rotate_vector(wp.quat_inverse(Q), w)
        for k in range(three):
            T.qd[d + k] = w[k]
            T.q[c + k] = Q[k]
        T.q[c + 3] = Q[3]
    set_break_dofs(link, T)


@wp.func
def joint_origin(link: int, T: Trees):
    """Origin of frame b of the joint of link l."""
    return T.X[link] + rotate_vector(T.Q[link], T.t.at_b[link])


@wp.func
def link_momentum(link: int, root: int, T: Trees):
    """Momentum [kg m/s] of a link."""
    return T.t.mass[link] * (T.V[link] + wp.cross(T.W[link], T.X[link] - T.X[root]))


@standalone_function
@wp.func
def note_break_start(g: int, T: Trees):
    """A substep begins: places and momenta of the links, which are placed."""
    move_tree_velocities(g, T)
    for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
        T.breaks.x[link] = T.X[link]
        T.breaks.o[link] = joint_origin(link, T)
        T.breaks.p[link] = link_momentum(link, T.t.first_link[g], T)
        T.breaks.L[link] = link_inertia_world(link, T) * T.W[link]
        T.breaks.bear_f[link] = wp.vec3d()
        T.breaks.bear_t[link] = wp.vec3d()
    tree_barrier()


@standalone_function
@wp.func
def is_passive_dof(link: int, d: int, T: Trees, J: Linked):
    """Whether the joint of a link gives nothing along dof d."""
    j = T.t.joint[link]
    r = T.t.row[d]
    free = J.t.kind[j, r] == FREE and J.t.drive[j, r] == NONE and T.t.friction[d] == wp.float64(0.0)
    if J.t.actuated == 1:
        if is_actuated(j, r, J):
            free = False
    return free


@standalone_function
@wp.func
def joint_reaction(link: int, T: Trees, J: Linked):
    """(torque about the joint's origin, force) by N, F of a link and all behind it, without what lies along passive dofs."""
    force = T.F[link]
    torque = T.N[link] - wp.cross(HALF * (joint_origin(link, T) + T.breaks.o[link]), force)
    d = T.t.first_dof[link]
    three = int(3)
    given = int(0)
    for k in range(three):
        if is_passive_dof(link, d + k, T, J):
            force -= wp.dot(force, T.S_v[d + k]) * T.S_v[d + k]
        if is_passive_dof(link, d + 3 + k, T, J):
            if T.t.ball[link] == 0:
                torque -= wp.dot(torque, T.S_w[d + 3 + k]) * T.S_w[d + 3 + k]
        else:
            given = 1
    if given == 0:
        torque = wp.vec3d()
    return torque, force


@standalone_function
@wp.func
def add_string_wrenches(g: int, h: wp.float64, T: Trees):
    """N, F of links less what strings gave in a substep of h [s]. One lane."""
    if tree_lane() == 0:
        for s in range(T.strings.first_row[g], T.strings.first_row[g + 1]):
            ends = string_ends(s, T)
            force = (T.strings.sum[s] + T.strings.push[s]) / h * T.strings.n[s]
            a = T.strings.a[s]
            b = T.strings.b[s]
            if a >= 0:
                T.F[a] = T.F[a] + force
                T.N[a] = T.N[a] + wp.cross(ends.p_a, force)
            if b >= 0:
                T.F[b] = T.F[b] - force
                T.N[b] = T.N[b] - wp.cross(ends.p_b, force)
    tree_barrier()


@standalone_function
@wp.func
def break_tree_strings(g: int, h: wp.float64, T: Trees, J: Linked):
    """Strings of a tree that break in a substep of h [s]."""
    for s in range(T.strings.first_row[g] + tree_lane(), T.strings.first_row[g + 1], tree_lanes()):
        j = T.strings.joint[s]
        if wp.abs(T.strings.sum[s] + T.strings.push[s]) > h * J.t.breaking[j][0]:
            T.breaks.broken[j] = 1
            T.strings.response[s] = wp.float64(0.0)
    tree_barrier()


@cache
def tree_break_functions(real):
    """end: function of a tree behind a substep. body: of a link."""
    Bodies, _ = body_structs(real)

    @standalone_function
    @wp.func
    def set_mean_wrench(link: int, root: int, h: wp.float64, b: Bodies, T: Trees):
        """N about where the tree began, and F: what joints gave a link in the mean."""
        i = T.t.body[link]
        p = link_momentum(link, root, T)
        L = link_inertia_world(link, T) * T.W[link]
        drag = bounded_decay(wp.float64(b.drag[i]), h)
        spin_drag = bounded_decay(wp.float64(b.spin_drag[i]), h)
        force = (p - T.breaks.p[link] - T.breaks.bear_f[link]) / h - double_vec3(b.push[i])
        torque = (L - T.breaks.L[link] - T.breaks.bear_t[link]) / h - double_vec3(b.torque[i])
        force += HALF * drag * (p + T.breaks.p[link])
        torque += HALF * spin_drag * (L + T.breaks.L[link])
        T.F[link] = force
        T.N[link] = torque + wp.cross(HALF * (T.X[link] + T.breaks.x[link]), force)

    @standalone_function
    @wp.func
    def end_break_substep(g: int, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """Joints of a tree that break in this substep; it is placed. Returns 1 if one did: then it is to be placed again."""
        root = T.t.first_link[g]
        move_tree_velocities(g, T)
        for link in range(root + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            set_mean_wrench(link, root, h, b, T)
        tree_barrier()
        if has_strings(g, T):
            add_string_wrenches(g, h, T)
            break_tree_strings(g, h, T, J)
        gather_tree_wrenches(g, T)
        found = int(0)
        for link in range(root + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            if T.breaks.may[link] == 1:
                j = T.t.joint[link]
                torque, force = joint_reaction(link, T, J)
                over = wp.length(force) > J.t.breaking[j][0] or wp.length(torque) > J.t.breaking[j][1]
                if over and T.breaks.broken[j] == 0:
                    T.breaks.broken[j] = 1
                    free_broken_link(link, T)
                    found = 1
        tree_barrier()
        note_break_start(g, T)
        return any_lane(found)

    return SimpleNamespace(end=end_break_substep)
