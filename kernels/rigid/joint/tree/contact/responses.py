"""Responses of trees to impulses, through all joints.

    H = C^T C,  C = D^1/2 L                u = C qd           velocities in which the kinetic energy is |u|^2 / 2
    Z = C^-T J^T                           an impulse i:  u' = u + Z i,  J qd = Z^T u,  which changes by Z^T Z i

J of a link gives its spatial velocity (angular, linear at O) and has six rows; J of a row of JointTable has one. Only dofs on
the way from the link to the root stand in J, and so in Z: nothing fills in. Sweeps over contacts and limits work with u alone.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.lanes import entry_store_functions, has_many_lanes, tree_barrier, tree_lane, tree_lanes
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
def substitute_link_response(link: int, T: Trees):
    """Sets Z of link l by the factors of H. One lane."""
    t = T.t
    six = int(6)                                       # variables: a loop over a constant is unrolled
    three = int(3)
    d = t.last_dof[link]
    if d >= 0:
        row = t.first_entry[d]
        n = t.first_entry[d + 1] - row
        to = T.first_answer[link]
        for p in range(n):
            k = t.entry_dof[row + p]
            for c in range(three):
                T.answer[to + 6 * p + c] = T.S_w[k][c]
                T.answer[to + 6 * p + 3 + c] = T.S_v[k][c]
        for p in range(n):                             # L^-T, then D^-1/2
            first = t.first_entry[t.entry_dof[row + p]]
            for r in range(p + 1, n):
                for c in range(six):
                    T.answer[to + 6 * r + c] = T.answer[to + 6 * r + c] - T.H[first + r - p] * T.answer[to + 6 * p + c]
            size = wp.float64(1.0) / wp.sqrt(T.H[first])
            for c in range(six):
                T.answer[to + 6 * p + c] = size * T.answer[to + 6 * p + c]


@standalone_function
@wp.func
def multiply_response_row(link: int, p: int, T: Trees):
    """Sets row p of Z of link l, by the inverse M of the factor L. One lane."""
    t = T.t
    row = t.first_entry[t.last_dof[link]]
    w = wp.vec3d()
    v = wp.vec3d()
    for q in range(p + 1):
        k = t.entry_dof[row + q]
        part = T.M[t.first_entry[k] + p - q]
        w += part * T.S_w[k]
        v += part * T.S_v[k]
    size = wp.float64(1.0) / wp.sqrt(T.H[t.first_entry[t.entry_dof[row + p]]])
    to = T.first_answer[link] + 6 * p
    three = int(3)
    for c in range(three):
        T.answer[to + c] = size * w[c]
        T.answer[to + 3 + c] = size * v[c]


@standalone_function
@wp.func
def set_swing_row(g: int, link: int, r: int, T: Trees):
    """Sets row r of Z^T Z of link l, less what loops take. One lane."""
    t = T.t
    six = int(6)
    d = t.last_dof[link]
    found = vec6d()
    if d >= 0:
        at = T.first_answer[link]
        for _p in range(t.first_entry[d + 1] - t.first_entry[d]):
            z = T.answer[at + r]
            for c in range(six):
                found[c] = found[c] + z * T.answer[at + c]
            at += 6
    if T.loops.first_row[g + 1] > T.loops.first_row[g]:
        found -= loop_link_share(g, link, link, T)[r]
    for c in range(six):
        store_response(T.swing, link, r, c, found[c])


@standalone_function
@wp.func
def solve_tree_responses(g: int, T: Trees):
    """Sets Z and Z^T Z of the links of a tree that a contact has noted. H is factored."""
    t = T.t
    first = t.first_link[g]
    last = t.first_link[g + 1]
    if has_many_lanes():
        for row in range(T.first_answer[first] // 6 + tree_lane(), T.last_answer[g] // 6, tree_lanes()):
            link = T.answer_link[row]
            if T.met[link] == 1:
                multiply_response_row(link, row - T.first_answer[link] // 6, T)
    else:
        for link in range(first, last):
            if T.met[link] == 1:
                substitute_link_response(link, T)
    tree_barrier()
    for item in range(6 * first + tree_lane(), 6 * last, tree_lanes()):
        if T.met[item // 6] == 1:
            set_swing_row(g, item // 6, item % 6, T)
    tree_barrier()
    for link in range(first + tree_lane(), last, tree_lanes()):
        if T.met[link] == 1:
            T.met[link] = 2
    tree_barrier()


@standalone_function
@wp.func
def cross_response(k: int, link: int, wrench: vec6d, T: Trees):
    """Z_k^T Z_l w of two links of a tree: spatial velocity of link k by a wrench (torque about O, force), an impulse, on l."""
    found = vec6d()
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
            z = wp.float64(0.0)
            for c in range(six):
                z += T.answer[to + c] * wrench[c]
            for c in range(six):
                found[c] = found[c] + T.answer[at + c] * z
            p -= 1
            r -= 1
    g = T.tree_of[link]
    if T.loops.first_row[g + 1] > T.loops.first_row[g]:
        found -= loop_link_share(g, k, link, T) * wrench
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
    if T.breaks.some == 1 and tree_lane() == 0:
        force = wp.vec3d(wrench[3], wrench[4], wrench[5])
        arm = T.X[link] - T.X[T.t.first_link[T.tree_of[link]]]
        T.breaks.bear_f[link] = T.breaks.bear_f[link] + force
        T.breaks.bear_t[link] = T.breaks.bear_t[link] + wp.vec3d(wrench[0], wrench[1], wrench[2]) - wp.cross(arm, force)
    tree_barrier()
    keep_loops_of_link(T.tree_of[link], link, wrench, T)
