"""Recursive Newton-Euler: the generalised forces that a tree needs to move without qdd, against weight and outer forces.

    a_c = A_v + A_w x r + W x v_c,  v_c = V + W x r,  r from O to the centre of mass
    F = m (a_c - g) - f,   N_c = I A_w + W x I W - n,   N = N_c + r x F          of each link, then summed from the leaves
    C_i = S_i . (N, F)

f, n: outer force [N] and torque about the centre [N m]. (Luh, Walker, Paul 1980; Featherstone 2008, section 5.3.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.mass_matrix import link_inertia_world
from wsim.kernels.rigid.joint.tree.tables import Trees


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
def sum_tree_wrenches(g: int, T: Trees):
    """tau -= C: wrenches of links summed from the leaves, along the joints' motion."""
    t = T.t
    first = t.first_link[g]
    last = t.first_link[g + 1]
    for back in range(last - first):
        link = last - 1 - back
        for i in range(t.first_dof[link], t.first_dof[link + 1]):
            T.tau[i] = T.tau[i] - wp.dot(T.S_w[i], T.N[link]) - wp.dot(T.S_v[i], T.F[link])
        p = t.parent[link]
        if p >= 0:
            T.N[p] = T.N[p] + T.N[link]
            T.F[p] = T.F[p] + T.F[link]
