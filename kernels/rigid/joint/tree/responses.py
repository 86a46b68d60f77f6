"""Responses of links to wrenches, through all joints of their tree.

    J_l      spatial velocity (angular, linear at O) of link l by generalised velocities: columns S of the dofs on its way to
    the root
    Y_l      H^-1 J_l^T, (dofs of the tree, 6)
    D_kl     J_k Y_l, spatial velocity of link k by a wrench (torque about O, force) on link l, an impulse each
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees, mat66d, vec6d


@standalone_function
@wp.func
def last_link_dof(link: int, T: Trees):
    """Last dof that moves link l, or -1."""
    k = link
    found = int(-1)
    while k >= 0 and found < 0:
        if T.t.first_dof[k + 1] > T.t.first_dof[k]:
            found = T.t.first_dof[k + 1] - 1
        k = T.t.parent[k]
    return found


@standalone_function
@wp.func
def link_twist(link: int, T: Trees):
    """Spatial velocity of link l by qd."""
    w = wp.vec3d()
    v = wp.vec3d()
    d = last_link_dof(link, T)
    while d >= 0:
        w += T.qd[d] * T.S_w[d]
        v += T.qd[d] * T.S_v[d]
        d = T.t.dof_parent[d]
    return vec6d(w[0], w[1], w[2], v[0], v[1], v[2])


@standalone_function
@wp.func
def solve_link_responses(g: int, link: int, T: Trees):
    """Sets Y and D of link l of tree g. H is factored."""
    t = T.t
    dofs = tree_dofs(g, T)
    n = dofs[1] - dofs[0]
    to = T.first_answer[link]
    six = int(6)                                       # a variable: a loop over a constant is unrolled
    three = int(3)
    for e in range(six * n):
        T.answer[to + e] = wp.float64(0.0)
    d = last_link_dof(link, T)
    while d >= 0:
        for c in range(three):
            T.answer[to + 6 * (d - dofs[0]) + c] = T.S_w[d][c]
            T.answer[to + 6 * (d - dofs[0]) + 3 + c] = T.S_v[d][c]
        d = t.dof_parent[d]
    for back in range(n):                              # as solve_tree_matrix, six right sides at a time
        k = n - 1 - back
        i = t.dof_parent[dofs[0] + k]
        for e in range(t.first_entry[dofs[0] + k] + 1, t.first_entry[dofs[0] + k + 1]):
            for c in range(six):
                at = to + 6 * (i - dofs[0]) + c
                T.answer[at] = T.answer[at] - T.H[e] * T.answer[to + 6 * k + c]
            i = t.dof_parent[i]
    for k in range(n):
        row = t.first_entry[dofs[0] + k]
        for c in range(six):
            y = T.answer[to + 6 * k + c] / T.H[row]
            i = t.dof_parent[dofs[0] + k]
            for e in range(row + 1, t.first_entry[dofs[0] + k + 1]):
                y -= T.H[e] * T.answer[to + 6 * (i - dofs[0]) + c]
                i = t.dof_parent[i]
            T.answer[to + 6 * k + c] = y
    T.swing[link] = cross_response(g, link, link, T)
    T.met[link] = 1


@standalone_function
@wp.func
def cross_response(g: int, k: int, link: int, T: Trees):
    """D_kl of two links of tree g. Y of link l is there."""
    found = mat66d()
    six = int(6)
    three = int(3)
    first = tree_dofs(g, T)[0]
    d = last_link_dof(k, T)
    while d >= 0:
        row = T.first_answer[link] + 6 * (d - first)
        for c in range(six):
            y = T.answer[row + c]
            for r in range(three):
                found[r, c] = found[r, c] + T.S_w[d][r] * y
                found[3 + r, c] = found[3 + r, c] + T.S_v[d][r] * y
        d = T.t.dof_parent[d]
    return found


@standalone_function
@wp.func
def push_link(g: int, link: int, wrench: vec6d, T: Trees):
    """qd += Y_l wrench, an impulse [N m s], [N s] about O on link l of tree g."""
    dofs = tree_dofs(g, T)
    six = int(6)
    for d in range(dofs[0], dofs[1]):
        row = T.first_answer[link] + 6 * (d - dofs[0])
        more = wp.float64(0.0)
        for c in range(six):
            more += T.answer[row + c] * wrench[c]
        T.qd[d] = T.qd[d] + more
