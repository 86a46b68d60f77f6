"""What trees hang from, where that moves: frames a of links without a parent, and their velocities.

    at_a = hang + x_k + s h v_k,   turn_a = exp(s h omega_k) q_k          at a part s of substep k, straight on from its start
    H (qd' - qd) = -S^T I (V' - V)                                        where the velocity V of the base jumps to V'

so that links take a jump of the velocity as a blow at the joint, and motion between keyframes that are straight is exact;
where it is curved, places have order 2. V is state: a jump may lie between two frames.

(Featherstone 2008, section 11.1: impulsive dynamics.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import rotation_exponential, unit_quaternion
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.kinematics import base_twist, hangs_from_base, place_tree
from wsim.kernels.rigid.joint.tree.lanes import any_lane, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.basis import constrain_tree_rates, ready_loops
from wsim.kernels.rigid.joint.tree.mass_matrix import assemble_tree_matrix, factor_tree_matrix, solve_tree_matrix, tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees, vec6d


@standalone_function
@wp.func
def place_tree_base(g: int, k: int, part: wp.float64, h: wp.float64, T: Trees, J: Linked):
    """Frames a of links that hang from what moves, at a part of substep k of h [s]."""
    if T.moves == 1:
        row = k * J.t.moving
        for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            j = T.t.joint[link]
            if hangs_from_base(link, T):
                e = rotation_exponential(part * h * J.t.anchor_o[row, j])
                T.t.at_a[link] = T.hang[link] + J.t.anchor_x[row, j] + part * h * J.t.anchor_v[row, j]
                T.t.turn_a[link] = unit_quaternion(wp.quatd(e[0], e[1], e[2], e[3]) * J.t.anchor_q[row, j])
        tree_barrier()


@standalone_function
@wp.func
def take_base_velocity(g: int, k: int, T: Trees, J: Linked):
    """Velocities of what links hang from become those of substep k."""
    if T.moves == 1:
        row = k * J.t.moving
        for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            if hangs_from_base(link, T):
                T.base_v[link] = J.t.anchor_v[row, T.t.joint[link]]
                T.base_w[link] = J.t.anchor_o[row, T.t.joint[link]]
        tree_barrier()


@standalone_function
@wp.func
def base_jumps(g: int, k: int, T: Trees, J: Linked):
    """1 if what tree g hangs from has another velocity in substep k than before. `A_v`, `A_w` of its links: the difference."""
    found = int(0)
    row = k * J.t.moving
    for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
        if hangs_from_base(link, T):
            j = T.t.joint[link]
            T.A_v[link] = J.t.anchor_v[row, j] - T.base_v[link]
            T.A_w[link] = J.t.anchor_o[row, j] - T.base_w[link]
            if wp.length_sq(T.A_v[link]) + wp.length_sq(T.A_w[link]) > wp.float64(0.0):
                found = 1
    tree_barrier()
    return any_lane(found)


@wp.func
def root_of_link(link: int, T: Trees):
    """The link without a parent on the way from link l to what the tree hangs from."""
    found = link
    while T.t.parent[found] >= 0:
        found = T.t.parent[found]
    return found


@standalone_function
@wp.func
def kick_tree(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
    """Substep k begins: qd behind a jump of the velocity of what tree g hangs from."""
    if T.moves == 1:
        place_tree_base(g, k, wp.float64(0.0), h, T, J)
        if base_jumps(g, k, T, J) == 1:
            place_tree(g, T)
            assemble_tree_matrix(g, T)
            dofs = tree_dofs(g, T)
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                link = T.t.dof_link[d]
                root = root_of_link(link, T)
                T.tau[d] = wp.float64(0.0)
                if hangs_from_base(root, T):
                    w = T.A_w[root]
                    v = T.A_v[root] + wp.cross(w, T.X[T.t.first_link[g]] - T.t.at_a[root])
                    force = T.m[link] * v + wp.cross(w, T.mc[link])
                    torque = T.inertia[link] * w + wp.cross(T.mc[link], v)
                    T.tau[d] = -wp.dot(T.S_w[d], torque) - wp.dot(T.S_v[d], force)
            tree_barrier()
            factor_tree_matrix(g, T)
            solve_tree_matrix(g, T.tau, T)
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                T.qd[d] = T.qd[d] + T.tau[d]
            tree_barrier()
            ready_loops(g, T)
            constrain_tree_rates(g, T.qd, T)
        take_base_velocity(g, k, T, J)


@standalone_function
@wp.func
def link_base_twist(link: int, first: int, T: Trees):
    """Spatial velocity of link l as if the joints on the way to what it hangs from stood; 0 if that stands. first: the tree's
    first link."""
    found = vec6d()
    if T.moves == 1:
        root = root_of_link(link, T)
        if hangs_from_base(root, T):
            found = base_twist(root, first, T)
    return found
