"""Kernels over trees, by the lanes of each: substeps of those that touch nothing, accelerations, and velocities of momenta."""

import warp as wp

from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.steps import joint_step_functions
from wsim.kernels.rigid.joint.tree.actuator_forces import note_actuator_work
from wsim.kernels.rigid.joint.tree.joint_forces import note_drive_work
from wsim.kernels.rigid.joint.tree.kinematics import place_tree
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.basis import constrain_tree_rates, ready_loops
from wsim.kernels.rigid.joint.tree.loops.steps import constrain_tree_accelerations
from wsim.kernels.rigid.joint.tree.mass_matrix import (
    assemble_tree_matrix,
    factor_tree_matrix,
    link_inertia_world,
    solve_tree_matrix,
    tree_dofs,
)
from wsim.kernels.rigid.joint.tree.newton_euler import sum_tree_wrenches
from wsim.kernels.rigid.joint.tree.steps import tree_step_functions
from wsim.kernels.rigid.joint.tree.substep.bases import link_base_twist, place_tree_base, take_base_velocity
from wsim.kernels.rigid.joint.tree.substep.breaks import note_break_start, set_break_tables, tree_break_functions
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.motion import body_structs, double_vec3


def tree_substep_kernel(real, module, moving: bool = False, breaking: bool = False, strings: bool = False, **bounds):
    """Kernel of substeps steps[0] .. steps[1] of h [s] of trees and of bodies without joints: a thread each. asleep: 1 for
    bodies of those that stay, or None. moving: what some hang from moves (bases.py); breaking: joints may break (breaks.py);
    strings: some distances stay within a range (loops/strings.py). bounds: of a launch on a GPU (lanes.py)."""
    Bodies, Moving = body_structs(real)
    f, lone = tree_step_functions(real, moving, breaking, strings), joint_step_functions(real)
    begin, step, write, kicks, place = f.begin, f.step, f.write, lone.kicks, lone.place
    end_break = tree_break_functions(real).end if breaking else None

    def rigid_trees(steps: wp.vec2i, h: real, b: Bodies, J: Linked, T: Trees, asleep: wp.array(dtype=int), now: Moving):
        g = wp.tid() // tree_lanes()
        i = J.t.body[J.t.first_body[g]]
        if asleep:
            if asleep[i] == 1:
                return
        d = wp.float64(h)
        if T.t.first_link[g + 1] > T.t.first_link[g]:
            T.left[g] = wp.float64(0.0)
            begin(g, d, b, T, J)
            if wp.static(breaking):
                note_break_start(g, T)
            for k in range(steps[0], steps[1]):
                step(g, k, d, b, T, J)
                note_actuator_work(g, k, d, T, J)
                note_drive_work(g, k, d, T, J)
                if wp.static(breaking):
                    if wp.static(moving):
                        place_tree_base(g, k, wp.float64(1.0), d, T, J)
                    place_tree(g, T)
                    end_break(g, d, b, T, J)
            if wp.static(moving):
                place_tree_base(g, steps[1] - 1, wp.float64(1.0), d, T, J)
            place_tree(g, T)
            write(g, T, now)
        elif tree_lane() == 0:
            for _k in range(steps[0], steps[1]):
                kicks(i, h, b, now, J)
                place(i, h, b, now, J)

    return wp.kernel(rigid_trees, name="rigid_trees", module=module, enable_backward=False, **bounds)


def tree_velocity_kernel(real, module):
    """Kernel, over trees where a frame begins: qd of the momenta of its bodies, by least kinetic energy of what is left over,
    H qd = S^T (L + r x p, p), both beyond what they have from a base that moves."""
    Bodies, Moving = body_structs(real)

    def project_tree_velocity(now: Moving, J: Linked, T: Trees):
        g = wp.tid() // tree_lanes()
        t = T.t
        if t.first_link[g + 1] > t.first_link[g]:
            set_break_tables(g, T)
            place_tree_base(g, 0, wp.float64(0.0), wp.float64(0.0), T, J)
            take_base_velocity(g, 0, T, J)
            place_tree(g, T)
            assemble_tree_matrix(g, T)
            root = t.first_link[g]
            dofs = tree_dofs(g, T)
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                T.tau[d] = wp.float64(0.0)
                if wp.length_sq(t.axis[d]) > wp.float64(0.0):      # momenta of bodies are without it; a dof that is held stays
                    T.H[t.first_entry[d]] = T.H[t.first_entry[d]] - t.armature[d]
            tree_barrier()
            factor_tree_matrix(g, T)
            for link in range(root + tree_lane(), t.first_link[g + 1], tree_lanes()):
                r = T.X[link] - T.X[root]
                base = link_base_twist(link, root, T)
                w = wp.vec3d(base[0], base[1], base[2])
                p = double_vec3(now.p[t.body[link]]) - t.mass[link] * (wp.vec3d(base[3], base[4], base[5]) + wp.cross(w, r))
                L = double_vec3(now.L[t.body[link]]) - link_inertia_world(link, T) * w
                T.F[link] = -p
                T.N[link] = -L - wp.cross(r, p)
            tree_barrier()
            sum_tree_wrenches(g, T)
            solve_tree_matrix(g, T.tau, T)
            ready_loops(g, T)
            constrain_tree_rates(g, T.tau, T)
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                T.qd[d] = T.tau[d]

    return wp.kernel(project_tree_velocity, name="project_tree_velocity", module=module, enable_backward=False)


def tree_acceleration_kernel(real, module, moving: bool, breaking: bool):
    """Kernel, over trees: accelerations qdd in `tau` at q, qd, with drives as they are at the end of substep 0."""
    f = tree_step_functions(real, moving, breaking, False)
    begin, evaluate = f.begin, f.evaluate
    Bodies, _ = body_structs(real)

    def tree_accelerations(h: real, b: Bodies, J: Linked, T: Trees):
        g = wp.tid() // tree_lanes()
        if T.t.first_link[g + 1] > T.t.first_link[g]:
            begin(g, wp.float64(h), b, T, J)
            evaluate(g, 0, wp.float64(1.0), wp.float64(h), b, T, J)
            factor_tree_matrix(g, T)
            solve_tree_matrix(g, T.tau, T)
            constrain_tree_accelerations(g, T)

    return wp.kernel(tree_accelerations, name="tree_accelerations", module=module, enable_backward=False)
