"""Factors of the joint-space inertia matrix of a tree by many lanes (lanes.py), which wait for each other seldom.

    H = L^T D L,    M = L^-1,    H^-1 = M D^-1 M^T

Rows of dofs that are equally far from the root are found at once, the farthest first, entry by entry:

    D_a L_ab = H_ab - sum of L_ia D_i L_ib over the dofs i behind a,        b on the way from a to the root

M has the entries of L. Each of its rows stands by itself, so that systems with H are two products in the place of
substitutions, where each dof waits for the one before. (Featherstone 2005, as mass_matrix.py, which goes dof by dof.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.tables import Trees, tree_dofs


@standalone_function
@wp.func
def eliminated_entry(a: int, p: int, T: Trees):
    """D_a L_ab of entry p of row a. Rows behind a are factors."""
    t = T.t
    depth = t.first_entry[a + 1] - t.first_entry[a]
    y = T.H[t.first_entry[a] + p]
    row = t.first_entry[a + 1]
    for i in range(a + 1, t.dof_end[a]):
        end = t.first_entry[i + 1]
        y -= T.H[end - depth] * T.H[row] * T.H[end - depth + p]
        row = end
    return y


@standalone_function
@wp.func
def factor_by_levels(g: int, T: Trees):
    """H becomes L and D, in place."""
    t = T.t
    for level in range(t.first_step[g], t.first_step[g + 1]):
        for slot in range(t.step_start[level] + tree_lane(), t.step_start[level + 1], tree_lanes()):
            e = t.step_entry[slot]
            a = t.entry_row[e]
            T.H[e] = eliminated_entry(a, e - t.first_entry[a], T)
        tree_barrier()
        for slot in range(t.step_start[level] + tree_lane(), t.step_start[level + 1], tree_lanes()):
            e = t.step_entry[slot]
            row = t.first_entry[t.entry_row[e]]
            if e > row:
                T.H[e] = T.H[e] / T.H[row]
        tree_barrier()


@standalone_function
@wp.func
def invert_factor_row(i: int, T: Trees):
    """Row i of M, from M L = 1 along the way to the root. One lane."""
    t = T.t
    row = t.first_entry[i]
    n = t.first_entry[i + 1] - row
    T.M[row] = wp.float64(1.0)
    for p in range(1, n):
        y = wp.float64(0.0)
        for q in range(p):
            y -= T.M[row + q] * T.H[t.first_entry[t.entry_dof[row + q]] + p - q]
        T.M[row + p] = y


@standalone_function
@wp.func
def invert_tree_factor(g: int, T: Trees):
    """Sets M. H is factored."""
    dofs = tree_dofs(g, T)
    for i in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        invert_factor_row(i, T)
    tree_barrier()


@standalone_function
@wp.func
def multiply_inverse_factor(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x becomes M x, in place: the last dofs first, since each takes those on its way to the root."""
    t = T.t
    dofs = tree_dofs(g, T)
    last = dofs[1]
    while last > dofs[0]:
        i = last - 1 - tree_lane()
        y = wp.float64(0.0)
        if i >= dofs[0]:
            for e in range(t.first_entry[i], t.first_entry[i + 1]):
                y += T.M[e] * x[t.entry_dof[e]]
        tree_barrier()                                    # all lanes have read x
        if i >= dofs[0]:
            x[i] = y
        last -= tree_lanes()
        tree_barrier()


@standalone_function
@wp.func
def solve_by_inverse_factor(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x becomes H^-1 x, in place."""
    t = T.t
    dofs = tree_dofs(g, T)
    first = dofs[0]
    while first < dofs[1]:
        k = first + tree_lane()
        y = wp.float64(0.0)
        if k < dofs[1]:
            depth = t.first_entry[k + 1] - t.first_entry[k]
            for i in range(k, t.dof_end[k]):
                y += T.M[t.first_entry[i + 1] - depth] * x[i]
            y = y / T.H[t.first_entry[k]]
        tree_barrier()
        if k < dofs[1]:
            x[k] = y
        first += tree_lanes()
        tree_barrier()
    multiply_inverse_factor(g, x, T)
