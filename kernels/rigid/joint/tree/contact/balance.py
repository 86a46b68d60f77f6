"""Momentum of trees that hang from nothing, over a substep with impulses.

Impulses act where a substep begins, and what they change of generalised velocities goes to where it ends (touching.py). The
same velocities are another momentum there. So the first link, whose six motions carry the whole tree, gets what is missing:

    h = h(q_p, qd_p) + Phi(q_0) (qd - qd_0)          q_p, qd_p: the prediction; q_0: where the substep begins; Phi qd: momentum
    [m 1, -mc x; mc x, I] (v, omega) = h - h(q, qd)  of the whole tree at O

Momentum, linear and angular, is then kept to rounding, whatever touches the tree.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.contact.link_pair import point_line
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_velocities, place_tree
from wsim.kernels.rigid.joint.tree.lanes import sum_over_lanes, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.mass_matrix import link_inertia_world, tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees, vec6d


@wp.func
def hangs_from_nothing(g: int, T: Trees):
    """Whether the first link of a tree is free."""
    return T.t.joint[T.t.first_link[g]] < 0


@standalone_function
@wp.func
def tree_momentum(g: int, T: Trees):
    """(angular, linear) momentum of a tree about where O began, by the velocities qd; its links are placed."""
    move_tree_velocities(g, T)
    root = T.t.first_link[g]
    found = vec6d()
    for link in range(root + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
        v = T.V[link] + wp.cross(T.W[link], T.X[link] - T.X[root])
        L = link_inertia_world(link, T) * T.W[link]
        found += point_line(T.X[link], T.t.mass[link] * v) + vec6d(L[0], L[1], L[2], wp.float64(0.0), wp.float64(0.0),
                                                                  wp.float64(0.0))
    six = int(6)                                      # a variable: a loop over a constant is unrolled
    for c in range(six):
        found[c] = sum_over_lanes(found[c])
    tree_barrier()
    return found


@standalone_function
@wp.func
def expected_tree_momentum(g: int, T: Trees, P: Trees):
    """h of a tree that hangs from nothing, where sweeps have ended: T is where the substep begins. `mean` is scratch."""
    found = vec6d()
    if hangs_from_nothing(g, T):
        place_tree(g, P)
        found = tree_momentum(g, P)
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.mean[d] = T.qd[d]
            T.qd[d] = T.qd[d] - P.rates[d]
        tree_barrier()
        found += tree_momentum(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = T.mean[d]
        tree_barrier()
    return found


@standalone_function
@wp.func
def balance_tree_momentum(g: int, h: vec6d, T: Trees):
    """The momentum of a tree that hangs from nothing becomes h; it is placed, with its composite inertia."""
    if hangs_from_nothing(g, T):
        root = T.t.first_link[g]
        left = h - tree_momentum(g, T)
        f = wp.vec3d(left[3], left[4], left[5])
        n = wp.vec3d(left[0], left[1], left[2]) - wp.cross(T.X[root], f)                  # about O
        c = T.mc[root] / T.m[root]
        inertia = T.inertia[root] - T.m[root] * (wp.dot(c, c) * wp.identity(n=3, dtype=wp.float64) - wp.outer(c, c))
        omega = wp.inverse(inertia) * (n - wp.cross(c, f))
        v = f / T.m[root] - wp.cross(omega, c)
        for d in range(T.t.first_dof[root] + tree_lane(), T.t.first_dof[root + 1], tree_lanes()):
            way = wp.where(d < T.t.first_dof[root] + T.t.slides[root], wp.dot(T.S_v[d], v), wp.dot(T.S_w[d], omega))
            T.qd[d] = T.qd[d] + way
        tree_barrier()
