"""Joint-space inertia matrix of a tree by composite rigid bodies, its factors, and systems with it.

    I_l^c = I_l + sum of I^c of its children,   H_ij = S_j . I^c_i S_i     for j on the way from i to the root
    H = L^T D L,  L_ij != 0 for j on the way from i to the root alone: nothing fills in

(Featherstone 2008, section 6.2; Featherstone 2005, Efficient factorization of the joint-space inertia matrix for branched
kinematic trees.) A row of H holds the dof itself, then those on its way to the root. After `factor_tree_matrix` the first is D,
the others are L.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.joint.tree.lanes import (
    column_lane,
    column_lanes,
    row_lane,
    row_lanes,
    tree_barrier,
    tree_lane,
    tree_lanes,
)
from wsim.kernels.rigid.joint.tree.tables import Trees


@standalone_function
@wp.func
def link_inertia_world(link: int, T: Trees):
    """Inertia of a link about its centre of mass, in axes of the world [kg m^2]."""
    R = rotation_to_matrix(T.Q[link])
    return R * wp.diag(T.t.moments[link]) * wp.transpose(R)


@standalone_function
@wp.func
def sum_composite_inertias(g: int, T: Trees):
    """Sets m, mc, I of each link and all behind it, about O."""
    t = T.t
    first = t.first_link[g]
    for link in range(first + tree_lane(), t.first_link[g + 1], tree_lanes()):
        r = T.X[link] - T.X[first]
        m = t.mass[link]
        K = wp.skew(r)
        T.m[link] = m
        T.mc[link] = m * r
        T.inertia[link] = link_inertia_world(link, T) - m * (K * K)
    tree_barrier()
    levels = t.first_level[g + 1] - t.first_level[g]
    for back in range(levels):
        level = t.first_level[g + 1] - 1 - back
        for slot in range(t.level_start[level] + tree_lane(), t.level_start[level + 1], tree_lanes()):
            p = t.by_level[slot]
            for e in range(t.first_child[p], t.first_child[p + 1]):
                link = t.child[e]
                T.m[p] = T.m[p] + T.m[link]
                T.mc[p] = T.mc[p] + T.mc[link]
                T.inertia[p] = T.inertia[p] + T.inertia[link]
        tree_barrier()


@standalone_function
@wp.func
def assemble_tree_matrix(g: int, T: Trees):
    """Sets H of tree g, with the armature of its joints."""
    sum_composite_inertias(g, T)
    t = T.t
    dofs = tree_dofs(g, T)
    for i in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        link = t.dof_link[i]
        w = T.S_w[i]
        v = T.S_v[i]
        force = T.m[link] * v + wp.cross(w, T.mc[link])
        torque = T.inertia[link] * w + wp.cross(T.mc[link], v)
        for e in range(t.first_entry[i], t.first_entry[i + 1]):
            j = t.entry_dof[e]
            T.H[e] = wp.dot(T.S_w[j], torque) + wp.dot(T.S_v[j], force)
        T.H[t.first_entry[i]] = T.H[t.first_entry[i]] + t.armature[i]
    tree_barrier()


@standalone_function
@wp.func
def tree_dofs(g: int, T: Trees):
    """(first, last) degree of freedom of a tree, the last one left out."""
    return wp.vec2i(T.t.first_dof[T.t.first_link[g]], T.t.first_dof[T.t.first_link[g + 1]])


@standalone_function
@wp.func
def factor_tree_matrix(g: int, T: Trees):
    """H becomes L and D, in place."""
    t = T.t
    dofs = tree_dofs(g, T)
    for back in range(dofs[1] - dofs[0]):
        k = dofs[1] - 1 - back
        row = t.first_entry[k]
        end = t.first_entry[k + 1]
        for e in range(row + 1 + row_lane(), end, row_lanes()):
            part = T.H[e] / T.H[row]
            to = t.first_entry[t.entry_dof[e]]
            for f in range(e + column_lane(), end, column_lanes()):
                T.H[to + f - e] = T.H[to + f - e] - part * T.H[f]
        tree_barrier()
    for k in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        row = t.first_entry[k]
        for e in range(row + 1, t.first_entry[k + 1]):
            T.H[e] = T.H[e] / T.H[row]
    tree_barrier()


@standalone_function
@wp.func
def solve_lower_factor(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x becomes L^-1 x, in place: each dof is taken off those behind it."""
    t = T.t
    dofs = tree_dofs(g, T)
    for i in range(dofs[0], dofs[1]):
        if t.dof_end[i] > i + 1:
            depth = t.first_entry[i + 1] - t.first_entry[i]
            for j in range(i + 1 + tree_lane(), t.dof_end[i], tree_lanes()):
                x[j] = x[j] - T.H[t.first_entry[j + 1] - depth] * x[i]
            tree_barrier()


@standalone_function
@wp.func
def solve_tree_matrix(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x becomes H^-1 x, in place, by the factors of `factor_tree_matrix`."""
    t = T.t
    dofs = tree_dofs(g, T)
    for back in range(dofs[1] - dofs[0]):
        k = dofs[1] - 1 - back
        for e in range(t.first_entry[k] + 1 + tree_lane(), t.first_entry[k + 1], tree_lanes()):
            x[t.entry_dof[e]] = x[t.entry_dof[e]] - T.H[e] * x[k]
        tree_barrier()
    for k in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        x[k] = x[k] / T.H[t.first_entry[k]]
    tree_barrier()
    solve_lower_factor(g, x, T)


@standalone_function
@wp.func
def copy_tree_matrix(g: int, H: wp.array(dtype=wp.float64), out: wp.array(dtype=wp.float64), T: Trees):
    dofs = tree_dofs(g, T)
    for e in range(T.t.first_entry[dofs[0]] + tree_lane(), T.t.first_entry[dofs[1]], tree_lanes()):
        out[e] = H[e]
    tree_barrier()


@standalone_function
@wp.func
def multiply_tree_matrix(g: int, x: wp.array(dtype=wp.float64), out: wp.array(dtype=wp.float64), T: Trees):
    """out = H x, before H is factored."""
    t = T.t
    dofs = tree_dofs(g, T)
    for k in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        y = wp.float64(0.0)
        for e in range(t.first_entry[k], t.first_entry[k + 1]):
            y += T.H[e] * x[t.entry_dof[e]]
        depth = t.first_entry[k + 1] - t.first_entry[k]
        for j in range(k + 1, t.dof_end[k]):
            y += T.H[t.first_entry[j + 1] - depth] * x[j]
        out[k] = y
    tree_barrier()
