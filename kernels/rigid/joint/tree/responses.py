"""Responses of trees to impulses, through all joints.

    H = C^T C,  C = D^1/2 L                u = C qd           velocities in which the kinetic energy is |u|^2 / 2
    Z = C^-T J^T                           an impulse i:  u' = u + Z i,  J qd = Z^T u,  which changes by Z^T Z i

J of a link gives its spatial velocity (angular, linear at O) and has six rows; J of a row of JointTable has one. Only dofs on
the way from the link to the root stand in J, and so in Z: nothing fills in. Sweeps over contacts and limits work with u alone.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.lanes import (
    column_lane,
    column_lanes,
    entry_store_functions,
    row_lane,
    row_lanes,
    tree_barrier,
    tree_lane,
    tree_lanes,
)
from wsim.kernels.rigid.joint.tree.loops.impulses import keep_loops_of_link, loop_link_share
from wsim.kernels.rigid.joint.tree.mass_matrix import solve_lower_factor, tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees, mat66d, vec6d

store_response = entry_store_functions(mat66d, vec6d, wp.float64)[0]


@standalone_function
@wp.func
def open_tree_sweeps(g: int, T: Trees):
    """u = C qd. H is factored."""
    t = T.t
    dofs = tree_dofs(g, T)
    for k in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        row = t.first_entry[k]
        y = T.qd[k]
        for e in range(row + 1, t.first_entry[k + 1]):
            y += T.H[e] * T.qd[t.entry_dof[e]]
        T.u[k] = wp.sqrt(T.H[row]) * y
    tree_barrier()


@standalone_function
@wp.func
def close_tree_sweeps(g: int, T: Trees):
    """qd = C^-1 u."""
    dofs = tree_dofs(g, T)
    for k in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        T.qd[k] = T.u[k] / wp.sqrt(T.H[T.t.first_entry[k]])
    tree_barrier()
    solve_lower_factor(g, T.qd, T)


@standalone_function
@wp.func
def link_twist(link: int, T: Trees):
    """Spatial velocity of link l, Z^T u."""
    found = vec6d()
    d = T.t.last_dof[link]
    if d >= 0:
        six = int(6)
        row = T.t.first_entry[d]
        at = T.first_answer[link]
        for p in range(T.t.first_entry[d + 1] - row):
            u = T.u[T.t.entry_dof[row + p]]
            for c in range(six):
                found[c] = found[c] + T.answer[at + c] * u
            at += 6
    return found


@standalone_function
@wp.func
def solve_link_responses(link: int, T: Trees):
    """Sets Z and Z^T Z of link l. H is factored."""
    t = T.t
    six = int(6)                                       # variables: a loop over a constant is unrolled
    three = int(3)
    d = t.last_dof[link]
    n = int(0)
    to = T.first_answer[link]
    if d >= 0:
        row = t.first_entry[d]
        n = t.first_entry[d + 1] - row
        for p in range(tree_lane(), n, tree_lanes()):
            k = t.entry_dof[row + p]
            for c in range(three):
                T.answer[to + 6 * p + c] = T.S_w[k][c]
                T.answer[to + 6 * p + 3 + c] = T.S_v[k][c]
        tree_barrier()
        for p in range(n - 1):                         # L^-T, then D^-1/2
            first = t.first_entry[t.entry_dof[row + p]]
            for r in range(p + 1 + row_lane(), n, row_lanes()):
                for c in range(column_lane(), six, column_lanes()):
                    T.answer[to + 6 * r + c] = T.answer[to + 6 * r + c] - T.H[first + r - p] * T.answer[to + 6 * p + c]
            tree_barrier()
        for p in range(tree_lane(), n, tree_lanes()):
            size = wp.float64(1.0) / wp.sqrt(T.H[t.first_entry[t.entry_dof[row + p]]])
            for c in range(six):
                T.answer[to + 6 * p + c] = size * T.answer[to + 6 * p + c]
        tree_barrier()
    for item in range(tree_lane(), six * six, tree_lanes()):
        r = item // 6
        c = item % 6
        y = wp.float64(0.0)
        for p in range(n):
            y += T.answer[to + 6 * p + r] * T.answer[to + 6 * p + c]
        store_response(T.swing, link, r, c, y)
    tree_barrier()
    g = T.tree_of[link]
    if T.loops.first_row[g + 1] > T.loops.first_row[g]:
        less = loop_link_share(g, link, link, T)
        for item in range(tree_lane(), six * six, tree_lanes()):
            left = T.swing[link][item // 6, item % 6] - less[item // 6, item % 6]
            store_response(T.swing, link, item // 6, item % 6, left)
        tree_barrier()


@standalone_function
@wp.func
def cross_response(k: int, link: int, T: Trees):
    """Z_k^T Z_l of two links of a tree: spatial velocity of link k by a wrench (torque about O, force), an impulse, on l."""
    found = mat66d()
    t = T.t
    six = int(6)
    d = t.last_dof[k]
    f = t.last_dof[link]
    if d >= 0 and f >= 0:
        p = t.first_entry[d + 1] - 1
        r = t.first_entry[f + 1] - 1
        while p >= t.first_entry[d] and r >= t.first_entry[f] and t.entry_dof[p] == t.entry_dof[r]:     # from the root on
            at = T.first_answer[k] + 6 * (p - t.first_entry[d])
            to = T.first_answer[link] + 6 * (r - t.first_entry[f])
            for i in range(six):
                for c in range(six):
                    found[i, c] = found[i, c] + T.answer[at + i] * T.answer[to + c]
            p -= 1
            r -= 1
    g = T.tree_of[link]
    if T.loops.first_row[g + 1] > T.loops.first_row[g]:
        found -= loop_link_share(g, k, link, T)
    return found


@standalone_function
@wp.func
def push_link(link: int, wrench: vec6d, T: Trees):
    """u += Z_l wrench, an impulse [N m s], [N s] about O on link l."""
    d = T.t.last_dof[link]
    if d >= 0:
        six = int(6)
        row = T.t.first_entry[d]
        for p in range(tree_lane(), T.t.first_entry[d + 1] - row, tree_lanes()):
            at = T.first_answer[link] + 6 * p
            more = wp.float64(0.0)
            for c in range(six):
                more += T.answer[at + c] * wrench[c]
            k = T.t.entry_dof[row + p]
            T.u[k] = T.u[k] + more
    tree_barrier()
    keep_loops_of_link(T.tree_of[link], link, wrench, T)
