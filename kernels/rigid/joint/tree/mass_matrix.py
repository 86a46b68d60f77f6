"""Joint-space inertia matrix of a tree by composite rigid bodies, its factors, and systems with it.

    I_l^c = I_l + sum of I^c of its children,   H_ij = S_j . I^c_i S_i     for j on the way from i to the root
    H = L^T D L,  L_ij != 0 for j on the way from i to the root alone: nothing fills in

(Featherstone 2008, section 6.2; Featherstone 2005, Efficient factorization of the joint-space inertia matrix for branched
kinematic trees.) A row of H holds the dof itself, then those on its way to the root. After `factor_tree_matrix` the first is D,
the others are L. One lane goes from dof to dof, many take what does not depend on each other at once (wide_factor.py).
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.joint.tree.lanes import has_many_lanes, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.tables import Trees, tree_dofs
from wsim.kernels.rigid.joint.tree.wide_factor import (
    factor_by_levels,
    invert_tree_factor,
    multiply_inverse_factor,
    solve_by_inverse_factor,
)


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
            if t.first_child[p + 1] > t.first_child[p]:
                m = T.m[p]
                mc = T.mc[p]
                inertia = T.inertia[p]
                for e in range(t.first_child[p], t.first_child[p + 1]):
                    link = t.child[e]
                    m += T.m[link]
                    mc += T.mc[link]
                    inertia += T.inertia[link]
                T.m[p] = m
                T.mc[p] = mc
                T.inertia[p] = inertia
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
def factor_in_turn(g: int, T: Trees):
    """H becomes L and D, in place, dof after dof. One lane."""
    t = T.t
    dofs = tree_dofs(g, T)
    for back in range(dofs[1] - dofs[0]):
        k = dofs[1] - 1 - back
        row = t.first_entry[k]
        end = t.first_entry[k + 1]
        for e in range(row + 1, end):
            if T.H[e] != wp.float64(0.0):              # else one of them is held (substep/breaks.py)
                part = T.H[e] / T.H[row]
                to = t.first_entry[t.entry_dof[e]]
                for f in range(e, end):
                    T.H[to + f - e] = T.H[to + f - e] - part * T.H[f]
                T.H[e] = part


@standalone_function
@wp.func
def factor_tree_matrix(g: int, T: Trees):
    """H becomes L and D, in place."""
    if has_many_lanes():
        factor_by_levels(g, T)
        invert_tree_factor(g, T)
    else:
        factor_in_turn(g, T)


@standalone_function
@wp.func
def put_tree_factors(g: int, H: wp.array(dtype=wp.float64), T: Trees):
    """H becomes these factors."""
    copy_tree_matrix(g, H, T.H, T)
    if has_many_lanes():
        invert_tree_factor(g, T)


@standalone_function
@wp.func
def substitute_lower_factor(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x becomes L^-1 x, in place. One lane."""
    t = T.t
    dofs = tree_dofs(g, T)
    for i in range(dofs[0], dofs[1]):
        y = x[i]
        for e in range(t.first_entry[i] + 1, t.first_entry[i + 1]):
            y -= T.H[e] * x[t.entry_dof[e]]
        x[i] = y


@standalone_function
@wp.func
def solve_lower_factor(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x becomes L^-1 x, in place."""
    if has_many_lanes():
        multiply_inverse_factor(g, x, T)
    else:
        substitute_lower_factor(g, x, T)


@standalone_function
@wp.func
def solve_tree_matrix(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x becomes H^-1 x, in place, by the factors of `factor_tree_matrix`."""
    t = T.t
    dofs = tree_dofs(g, T)
    if has_many_lanes():
        solve_by_inverse_factor(g, x, T)
    else:
        for back in range(dofs[1] - dofs[0]):
            k = dofs[1] - 1 - back
            for e in range(t.first_entry[k] + 1, t.first_entry[k + 1]):
                x[t.entry_dof[e]] = x[t.entry_dof[e]] - T.H[e] * x[k]
            x[k] = x[k] / T.H[t.first_entry[k]]
        substitute_lower_factor(g, x, T)


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
