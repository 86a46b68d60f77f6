"""Impulses of limits and contacts on trees with loops: Z i becomes (1 - Q Q^T) Z i (basis.py, responses.py)."""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.basis import loop_combination
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees, mat66d, vec6d


@wp.func
def loop_basis_row(g: int, k: int, T: Trees):
    """Row whose place has the k-th column of Q."""
    first = T.loops.first_row[g]
    return first + T.loops.order[first + k]


@standalone_function
@wp.func
def loop_column_part(g: int, k: int, d: int, last: int, T: Trees):
    """Q_k . Z of the column of row d, whose last dof is `last`. One lane."""
    at = T.loops.first_value[loop_basis_row(g, k, T)] - tree_dofs(g, T)[0]
    row = T.t.first_entry[last]
    found = wp.float64(0.0)
    for p in range(T.t.first_entry[last + 1] - row):
        found += T.loops.Q[at + T.t.entry_dof[row + p]] * T.column[T.first_column[d] + p]
    return found


@standalone_function
@wp.func
def loop_column_share(g: int, d: int, last: int, T: Trees):
    """|Q^T Z|^2 of the column of row d: what loops take of its response. One lane."""
    found = wp.float64(0.0)
    for k in range(T.loops.rank[g]):
        part = loop_column_part(g, k, d, last, T)
        found += part * part
    return found


@standalone_function
@wp.func
def loop_link_part(g: int, k: int, link: int, T: Trees):
    """Q_k^T Z of a link."""
    found = vec6d()
    d = T.t.last_dof[link]
    if d >= 0:
        six = int(6)
        at = T.loops.first_value[loop_basis_row(g, k, T)] - tree_dofs(g, T)[0]
        row = T.t.first_entry[d]
        for p in range(T.t.first_entry[d + 1] - row):
            q = T.loops.Q[at + T.t.entry_dof[row + p]]
            for c in range(six):
                found[c] = found[c] + q * T.answer[T.first_answer[link] + 6 * p + c]
    return found


@standalone_function
@wp.func
def loop_link_share(g: int, k: int, link: int, T: Trees):
    """Z_k^T Q Q^T Z_l of two links: what loops take of their response."""
    found = mat66d()
    for i in range(T.loops.rank[g]):
        found += wp.outer(loop_link_part(g, i, k, T), loop_link_part(g, i, link, T))
    return found


@standalone_function
@wp.func
def take_loop_impulse(g: int, T: Trees):
    """u -= Q z."""
    dofs = tree_dofs(g, T)
    tree_barrier()
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        T.u[d] = T.u[d] - loop_combination(g, d - dofs[0], T)
    tree_barrier()


@standalone_function
@wp.func
def keep_loops_of_row(g: int, d: int, last: int, impulse: wp.float64, T: Trees):
    """Takes from u what an impulse on row d would part in loops."""
    if T.loops.first_row[g + 1] > T.loops.first_row[g]:
        for k in range(tree_lane(), T.loops.rank[g], tree_lanes()):
            T.loops.z[loop_basis_row(g, k, T)] = impulse * loop_column_part(g, k, d, last, T)
        take_loop_impulse(g, T)


@standalone_function
@wp.func
def keep_loops_of_link(g: int, link: int, wrench: vec6d, T: Trees):
    """Takes from u what a wrench on a link would part in loops."""
    if T.loops.first_row[g + 1] > T.loops.first_row[g]:
        for k in range(tree_lane(), T.loops.rank[g], tree_lanes()):
            T.loops.z[loop_basis_row(g, k, T)] = wp.dot(loop_link_part(g, k, link, T), wrench)
        take_loop_impulse(g, T)
