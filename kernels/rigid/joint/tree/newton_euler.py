"""Recursive Newton-Euler: the generalised forces that a tree needs to move without qdd, against weight and outer forces.

    a_c = A_v + A_w x r + W x v_c,  v_c = V + W x r,  r from O to the centre of mass
    F = m (a_c - g) - f,   N_c = I A_w + W x I W - n,   N = N_c + r x F          of each link, then summed from the leaves
    C_i = S_i . (N, F)

f, n: outer force [N] and torque about the centre [N m]. (Luh, Walker, Paul 1980; Featherstone 2008, section 5.3.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.mass_matrix import link_inertia_world, tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees


@wp.func
def bounded_decay(c: wp.float64, h: wp.float64):
    """A rate of decay that a step of h [s] can take: c where it is small, else (1 - exp(-c h)) / h."""
    found = c
    if c * h > wp.float64(0.5):
        found = (wp.float64(1.0) - wp.exp(-c * h)) / h
    return found


@standalone_function
@wp.func
def link_inertial_wrench(link: int, root: int, T: Trees):
    """Sets N, F of one link: the wrench about O that its own motion takes."""
    r = T.X[link] - T.X[root]
    w = T.W[link]
    a = T.A_v[link] + wp.cross(T.A_w[link], r) + wp.cross(w, T.V[link] + wp.cross(w, r))
    K = link_inertia_world(link, T)
    force = T.t.mass[link] * a
    T.F[link] = force
    T.N[link] = K * T.A_w[link] + wp.cross(w, K * w) + wp.cross(r, force)


@standalone_function
@wp.func
def gather_tree_wrenches(g: int, T: Trees):
    """N, F of each link and of all behind it, summed from the leaves."""
    t = T.t
    levels = t.first_level[g + 1] - t.first_level[g]
    for back in range(levels):
        level = t.first_level[g + 1] - 1 - back
        for slot in range(t.level_start[level] + tree_lane(), t.level_start[level + 1], tree_lanes()):
            p = t.by_level[slot]
            if t.first_child[p + 1] > t.first_child[p]:
                torque = T.N[p]
                force = T.F[p]
                for e in range(t.first_child[p], t.first_child[p + 1]):
                    torque += T.N[t.child[e]]
                    force += T.F[t.child[e]]
                T.N[p] = torque
                T.F[p] = force
        tree_barrier()


@standalone_function
@wp.func
def sum_tree_wrenches(g: int, T: Trees):
    """tau -= C: wrenches of links summed from the leaves, along the joints' motion."""
    t = T.t
    gather_tree_wrenches(g, T)
    dofs = tree_dofs(g, T)
    for i in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        link = t.dof_link[i]
        T.tau[i] = T.tau[i] - wp.dot(T.S_w[i], T.N[link]) - wp.dot(T.S_v[i], T.F[link])
    tree_barrier()
