"""Forces of actuators on the dofs of trees, beside those of drives (joint_forces.py). Laws: ../actuation/actuators.py."""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.actuation.actuators import actuator_law, is_saturated, row_actuator_force
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.joint_forces import (
    add_row_force,
    add_row_inertia,
    row_rate,
    row_response_column,
    tree_joint_row,
)
from wsim.kernels.rigid.joint.tree.lanes import greatest_of_lanes, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.tables import Trees


@wp.func
def is_actuated(j: int, r: int, J: Linked):
    """Whether row r of joint j has an actuator, and is whole; j: -1 for a free body."""
    found = bool(False)
    if j >= 0:
        found = J.t.actuators.first[j, r] < J.t.actuators.first[j, r + 1] and J.broken[j] == 0
    return found


@standalone_function
@wp.func
def add_actuator_forces(g: int, k: int, part: wp.float64, T: Trees, J: Linked):
    """tau += J^T F of all actuators."""
    t = T.t
    if J.t.actuated == 1:
        for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
            for d in range(t.first_dof[link], t.first_dof[link + 1]):
                if is_actuated(t.joint[link], t.row[d], J):
                    r = tree_joint_row(link, d, T, J)
                    force = row_actuator_force(t.joint[link], t.row[d], k, part, r.g, row_rate(r, T.qd), J.t.actuators)
                    add_row_force(r, force, T.tau)
        tree_barrier()


@standalone_function
@wp.func
def add_actuator_inertia(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
    """H += J^T (h c + h^2 k) J of all actuators below their limits."""
    t = T.t
    if J.t.actuated == 1:
        for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
            for d in range(t.first_dof[link], t.first_dof[link + 1]):
                j = t.joint[link]
                if is_actuated(j, t.row[d], J):
                    r = tree_joint_row(link, d, T, J)
                    for i in range(J.t.actuators.first[j, t.row[d]], J.t.actuators.first[j, t.row[d] + 1]):
                        law = actuator_law(J.t.actuators.entry[i], k, wp.float64(0.0), J.t.actuators)
                        if not is_saturated(law, r.g, row_rate(r, T.qd)):
                            add_row_inertia(r, h * (law.c + h * law.k), T)
        tree_barrier()


@standalone_function
@wp.func
def add_actuator_springs(g: int, k: int, much: wp.float64, x: wp.array(dtype=wp.float64), T: Trees, J: Linked):
    """tau += much J^T k J x, with the same actuators as `add_actuator_inertia` and velocities qd."""
    t = T.t
    if J.t.actuated == 1:
        for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
            for d in range(t.first_dof[link], t.first_dof[link + 1]):
                j = t.joint[link]
                if is_actuated(j, t.row[d], J):
                    r = tree_joint_row(link, d, T, J)
                    for i in range(J.t.actuators.first[j, t.row[d]], J.t.actuators.first[j, t.row[d] + 1]):
                        law = actuator_law(J.t.actuators.entry[i], k, wp.float64(0.0), J.t.actuators)
                        if not is_saturated(law, r.g, row_rate(r, T.qd)):
                            add_row_force(r, much * law.k * row_rate(r, x), T.tau)
        tree_barrier()


@standalone_function
@wp.func
def actuator_stiffness(g: int, h: wp.float64, T: Trees, J: Linked):
    """Largest h^2 k / m and h c / m of the actuators of a tree, as `drive_stiffness`. H is factored."""
    t = T.t
    found = wp.float64(0.0)
    if J.t.actuated == 1:
        for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
            for d in range(t.first_dof[link], t.first_dof[link + 1]):
                j = t.joint[link]
                if is_actuated(j, t.row[d], J):
                    much = row_response_column(g, tree_joint_row(link, d, T, J), d, T)
                    for i in range(J.t.actuators.first[j, t.row[d]], J.t.actuators.first[j, t.row[d] + 1]):
                        law = actuator_law(J.t.actuators.entry[i], 0, wp.float64(0.0), J.t.actuators)
                        found = wp.max(found, wp.max(h * h * law.k * much, h * law.c * much))
        tree_barrier()
    return greatest_of_lanes(found)


@standalone_function
@wp.func
def note_actuator_work(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
    """Work of actuators in a step of h [s], by the force in its middle. Before `note_drive_work`: `now` is where it began."""
    t = T.t
    if J.t.actuated == 1:
        for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
            for d in range(t.first_dof[link], t.first_dof[link + 1]):
                j = t.joint[link]
                if is_actuated(j, t.row[d], J):
                    r = tree_joint_row(link, d, T, J)
                    way = r.g - J.now[j, t.row[d]]
                    half = wp.float64(0.5)
                    force = row_actuator_force(j, t.row[d], k, half, r.g - half * way, way / h, J.t.actuators)
                    J.given[j] = J.given[j] + force * way
        tree_barrier()
