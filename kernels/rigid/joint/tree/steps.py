"""Time steps of trees that touch nothing, by the lanes of each (lanes.py).

    rk4        classical Runge-Kutta of order 4. Balls take it in the tangent space (stages.py)
    ros2       two linearly implicit stages of order 2, L-stable in the drives of joints (Verwer, Spee, Blom, Hundsdorfer 1999):
               W k_1 = f(u),  W k_2 = f(u + h k_1) - 2 k_1,  u' = u + 3/2 h k_1 + 1/2 h k_2,  W = 1 - gamma h J
               For u = (q, v): (H + gamma h c + (gamma h)^2 k) k_v = H r_v - gamma h k r_q,  k_q = r_q + gamma h k_v

What rk4 meets in a step it tells by its own stages. The second and the third are both in the middle, and their accelerations
differ by (omega h / 2)^2 of the first, if motion has the frequency omega: 4 |a_3 - a_2| / |a_1| = (h omega)^2 (Hairer, Wanner
1996, section IV.2). Where that is more than LONG, the step is done again in so many parts.

    symplectic_euler      v' = v + h a(q, v),  q' = q + h v'
    backward_euler        the same, linearly implicit in the drives: (H + h c + h^2 k) (v' - v) = h (tau - h k v)

A step is rk4 where the drives are soft enough for it (h^2 k / m and h c / m below STIFF), else ros2, unless the scene names its
integrator. Limits, where they act, are impulses behind it, of order 1; dry friction see limits.py.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.actuator_forces import (
    actuator_stiffness,
    add_actuator_forces,
    add_actuator_inertia,
    add_actuator_springs,
)
from wsim.kernels.rigid.joint.tree.joint_forces import (
    add_drive_forces,
    add_drive_inertia,
    add_spring_forces,
    drive_stiffness,
    scale_accelerations,
)
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_coordinates, move_tree_velocities, place_tree
from wsim.kernels.rigid.joint.tree.lanes import sum_over_lanes, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.basis import ready_loops
from wsim.kernels.rigid.joint.tree.loops.steps import (
    close_tree_loops,
    constrain_tree_accelerations,
    constrain_tree_stage,
    note_tree_stage,
)
from wsim.kernels.rigid.joint.tree.loops.strings import reset_string_impulses
from wsim.kernels.rigid.joint.tree.mass_matrix import (
    assemble_tree_matrix,
    copy_tree_matrix,
    factor_tree_matrix,
    link_inertia_world,
    multiply_tree_matrix,
    put_tree_factors,
    solve_tree_matrix,
    tree_dofs,
)
from wsim.kernels.rigid.joint.tree.newton_euler import bounded_decay, link_inertial_wrench, sum_tree_wrenches
from wsim.kernels.rigid.joint.tree.substep.bases import kick_tree, place_tree_base
from wsim.kernels.rigid.joint.tree.substep.bodies import tree_writing_func
from wsim.kernels.rigid.joint.tree.substep.breaks import set_break_tables
from wsim.kernels.rigid.joint.tree.substep.one_sided import one_sided_functions
from wsim.kernels.rigid.joint.tree.substep.stages import advance_stage, copy_tree_state, mean_tree_rates, tangent_rates
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.motion import body_structs, double_vec3

LONG = wp.constant(wp.float64(1.0))        # (h omega)^2 of one step: unstable from 8 on; at 1 it damps 0.7 % of that mode
MOST = wp.constant(64)                     # parts of a substep
STIFF = wp.constant(wp.float64(1.0))       # rk4 is stable up to 2.8^2 and 2.8
RK4, ROS2, SYMPLECTIC, IMPLICIT = wp.constant(1), wp.constant(0), wp.constant(2), wp.constant(3)      # of `integrator`
GAMMA = wp.constant(wp.float64(1.0 - 0.5**0.5))


@cache
def tree_step_functions(real, moving: bool, breaking: bool, strings: bool):
    """Functions of a tree: evaluate (terms of its equation of motion), step, write (its bodies). moving: what some hang from
    moves (bases.py); breaking: joints may break (breaks.py); strings: some distances stay within a range (loops/strings.py)."""
    (Bodies, _), one_sided = body_structs(real), one_sided_functions(strings)
    passes, solve, place_supports = one_sided.passes, one_sided.solve, one_sided.place

    @standalone_function
    @wp.func
    def evaluate_tree(g: int, k: int, part: wp.float64, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """tau = forces - C and H at q, qd, which are at a part of substep k of h [s]."""
        t = T.t
        if wp.static(moving):
            place_tree_base(g, k, part, h, T, J)
        place_tree(g, T)
        move_tree_velocities(g, T)
        root = t.first_link[g]
        for link in range(root + tree_lane(), t.first_link[g + 1], tree_lanes()):
            link_inertial_wrench(link, root, T)
            i = t.body[link]
            r = T.X[link] - T.X[root]
            v = T.V[link] + wp.cross(T.W[link], r)
            force = double_vec3(b.push[i]) - bounded_decay(wp.float64(b.drag[i]), h) * t.mass[link] * v
            torque = double_vec3(b.torque[i])
            if b.spin_drag[i] > real(0.0):
                torque -= bounded_decay(wp.float64(b.spin_drag[i]), h) * (link_inertia_world(link, T) * T.W[link])
            T.F[link] = T.F[link] - force
            T.N[link] = T.N[link] - torque - wp.cross(r, force)
        assemble_tree_matrix(g, T)
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.tau[d] = wp.float64(0.0)
        tree_barrier()
        add_drive_forces(g, k, part, T, J)
        add_actuator_forces(g, k, part, T, J)
        sum_tree_wrenches(g, T)

    @standalone_function
    @wp.func
    def begin_tree(g: int, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """A frame begins: which steps the drives of a tree allow, and what those of accelerations move."""
        if wp.static(moving):
            place_tree_base(g, 0, wp.float64(0.0), h, T, J)
        if wp.static(breaking):
            set_break_tables(g, T)
        place_tree(g, T)
        assemble_tree_matrix(g, T)
        factor_tree_matrix(g, T)
        ready_loops(g, T)
        scale_accelerations(g, T, J)
        stiffness = wp.max(drive_stiffness(g, h, T, J), actuator_stiffness(g, h, T, J))
        T.integrator[g] = wp.where(T.scheme >= 0, T.scheme, wp.where(stiffness < STIFF, int(RK4), int(ROS2)))
        tree_barrier()

    @standalone_function
    @wp.func
    def step_by_stages(g: int, k: int, first: wp.float64, part: wp.float64, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """One step of rk4 of a part of substep k, from q, qd, without limits. Returns (h omega)^2, see the head of the file."""
        copy_tree_state(g, T.q, T.qd, T.q_before, T.qd_before, T)
        dofs = tree_dofs(g, T)
        moved = wp.float64(0.0)
        all = wp.float64(0.0)
        stages = int(4)                          # a variable: a loop over a constant is unrolled
        for s in range(stages):
            at = wp.where(s == 0, wp.float64(0.0), wp.where(s == 3, part, wp.float64(0.5) * part))
            evaluate_tree(g, k, first + at, h, b, T, J)
            factor_tree_matrix(g, T)
            solve_tree_matrix(g, T.tau, T)
            constrain_tree_accelerations(g, T)
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                weight = T.H[T.t.first_entry[d]]
                if s == 0:
                    all += weight * T.tau[d] * T.tau[d]
                elif s == 1:
                    T.mean[d] = T.tau[d]
                elif s == 2:
                    moved += weight * (T.tau[d] - T.mean[d]) * (T.tau[d] - T.mean[d])
            advance_stage(g, s, part * h, T)
        moved = sum_over_lanes(moved)
        all = sum_over_lanes(all)
        found = wp.float64(0.0)
        if all > wp.float64(0.0):
            found = wp.float64(4.0) * wp.sqrt(moved / all)
        return found

    @standalone_function
    @wp.func
    def predict_by_stages(g: int, k: int, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """One step of rk4 from q, qd, without limits, or several where one is too long; `rates` is the mean rate of the
        coordinates."""
        square = step_by_stages(g, k, wp.float64(0.0), wp.float64(1.0), h, b, T, J)
        if square > LONG:
            parts = int(wp.min(wp.ceil(wp.sqrt(square / LONG)), wp.float64(MOST)))       # square may be beyond integers
            copy_tree_state(g, T.q_before, T.qd_before, T.q, T.qd, T)
            copy_tree_state(g, T.q, T.qd, T.q_start, T.qd_start, T)
            part = wp.float64(1.0) / wp.float64(parts)
            for i in range(parts):
                step_by_stages(g, k, wp.float64(i) * part, part, h, b, T, J)
            copy_tree_state(g, T.q_start, T.qd_start, T.q_before, T.qd_before, T)
            mean_tree_rates(g, h, T)

    @standalone_function
    @wp.func
    def predict_implicitly(g: int, k: int, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """One step of ros2 from q, qd, without limits; `rates` is the mean rate of the coordinates."""
        copy_tree_state(g, T.q, T.qd, T.q_before, T.qd_before, T)
        dofs = tree_dofs(g, T)
        part = GAMMA * h
        evaluate_tree(g, k, GAMMA, h, b, T, J)
        copy_tree_matrix(g, T.H, T.H_before, T)
        add_drive_inertia(g, k, part, T, J)
        add_actuator_inertia(g, k, part, T, J)
        factor_tree_matrix(g, T)
        copy_tree_matrix(g, T.H, T.W_factors, T)
        add_spring_forces(g, k, -part, T.qd, T, J)
        add_actuator_springs(g, k, -part, T.qd, T, J)
        solve_tree_matrix(g, T.tau, T)
        constrain_tree_accelerations(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.gains[d] = T.tau[d]
            T.rates[d] = T.qd[d] + part * T.tau[d]
            T.qd[d] = T.qd_before[d] + h * T.tau[d]
        tree_barrier()
        move_tree_coordinates(g, h, T.rates, T.q_before, T)
        evaluate_tree(g, k, wp.float64(1.0) - GAMMA, h, b, T, J)
        factor_tree_matrix(g, T)
        solve_tree_matrix(g, T.tau, T)
        constrain_tree_accelerations(g, T)
        tangent_rates(g, h, T.rates, T)
        two = wp.float64(2.0)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.mean[d] = T.rate[d] - two * T.rates[d]
            T.rate[d] = T.tau[d] - two * T.gains[d]
        tree_barrier()
        copy_tree_state(g, T.q_before, T.qd_before, T.q, T.qd, T)
        copy_tree_matrix(g, T.H_before, T.H, T)
        multiply_tree_matrix(g, T.rate, T.tau, T)
        note_tree_stage(g, T)
        add_spring_forces(g, k, -part, T.mean, T, J)
        add_actuator_springs(g, k, -part, T.mean, T, J)
        put_tree_factors(g, T.W_factors, T)
        solve_tree_matrix(g, T.tau, T)
        constrain_tree_stage(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = T.qd_before[d] + h * (wp.float64(1.5) * T.gains[d] + wp.float64(0.5) * T.tau[d])
            T.rates[d] = wp.float64(1.5) * T.rates[d] + wp.float64(0.5) * (T.mean[d] + part * T.tau[d])
        tree_barrier()
        move_tree_coordinates(g, h, T.rates, T.q_before, T)

    @standalone_function
    @wp.func
    def predict_by_euler(g: int, k: int, implicit: int, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """One step of symplectic or backward Euler from q, qd, without limits; `rates` is the rate of the coordinates."""
        copy_tree_state(g, T.q, T.qd, T.q_before, T.qd_before, T)
        evaluate_tree(g, k, wp.float64(implicit), h, b, T, J)
        if implicit == 1:
            add_drive_inertia(g, k, h, T, J)
            add_actuator_inertia(g, k, h, T, J)
            add_spring_forces(g, k, -h, T.qd, T, J)
            add_actuator_springs(g, k, -h, T.qd, T, J)
        factor_tree_matrix(g, T)
        solve_tree_matrix(g, T.tau, T)
        constrain_tree_accelerations(g, T)
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = T.qd_before[d] + h * T.tau[d]
            T.rates[d] = T.qd[d]
        tree_barrier()
        move_tree_coordinates(g, h, T.rates, T.q_before, T)

    @standalone_function
    @wp.func
    def predict_tree(g: int, k: int, scheme: int, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """One step of a scheme from q, qd, without limits; `rates` is the mean rate of the coordinates."""
        if scheme == RK4:
            predict_by_stages(g, k, h, b, T, J)
        elif scheme == ROS2:
            predict_implicitly(g, k, h, b, T, J)
        else:
            predict_by_euler(g, k, wp.where(scheme == IMPLICIT, 1, 0), h, b, T, J)

    @standalone_function
    @wp.func
    def step_tree(g: int, k: int, h: wp.float64, b: Bodies, T: Trees, J: Linked):
        """One step, with limits and dry friction where they act: their impulses change the end velocity and the mean rate
        alike."""
        if wp.static(moving):
            kick_tree(g, k, h, T, J)
        if wp.static(strings):
            reset_string_impulses(g, T)
        predict_tree(g, k, T.integrator[g], h, b, T, J)
        if passes(g, k, h, T, J) == 1:
            dofs = tree_dofs(g, T)
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                T.gains[d] = T.qd[d] - T.rates[d]
                T.mean[d] = T.rates[d]
                T.qd[d] = T.rates[d]
            tree_barrier()
            copy_tree_state(g, T.q_before, T.qd, T.q, T.qd, T)
            if wp.static(moving):
                place_supports(g, k, wp.float64(0.0), h, T, J)
            place_tree(g, T)
            assemble_tree_matrix(g, T)
            add_drive_inertia(g, k, h, T, J)
            add_actuator_inertia(g, k, h, T, J)
            factor_tree_matrix(g, T)
            ready_loops(g, T)
            T.left[g] = wp.max(T.left[g], solve(g, k, h, T, J))
            move_tree_coordinates(g, h, T.qd, T.q_before, T)
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                T.qd[d] = T.qd[d] + T.gains[d]
            tree_barrier()
            if wp.static(moving):
                place_supports(g, k, wp.float64(1.0), h, T, J)
            close_tree_loops(g, T)
            place_tree(g, T)
            assemble_tree_matrix(g, T)
            factor_tree_matrix(g, T)
            ready_loops(g, T)
            T.left[g] = wp.max(T.left[g], solve(g, k, wp.float64(0.0), T, J))
        else:
            close_tree_loops(g, T)

    return SimpleNamespace(evaluate=evaluate_tree, begin=begin_tree, step=step_tree, write=tree_writing_func(real),
                           kick=kick_tree, predict=predict_tree)
