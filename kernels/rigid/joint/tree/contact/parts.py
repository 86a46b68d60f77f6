"""Parts of a substep of touching trees (touching.py)."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.actuator_forces import add_actuator_inertia
from wsim.kernels.rigid.joint.tree.contact.contacts import COLUMNS, link_contact_functions
from wsim.kernels.rigid.joint.tree.contact.needs import TreeContactNeeds
from wsim.kernels.rigid.joint.tree.contact.responses import open_tree_sweeps, solve_tree_responses
from wsim.kernels.rigid.joint.tree.contact.soft_model import soft_goal_func
from wsim.kernels.rigid.joint.tree.contact.teams import WorldTeam, touching_manifold_functions
from wsim.kernels.rigid.joint.tree.joint_forces import add_drive_inertia
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_coordinates, place_tree
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.basis import ready_loops
from wsim.kernels.rigid.joint.tree.loops.steps import close_tree_loops
from wsim.kernels.rigid.joint.tree.mass_matrix import assemble_tree_matrix, factor_tree_matrix, tree_dofs
from wsim.kernels.rigid.joint.tree.steps import IMPLICIT, ROS2, tree_step_functions
from wsim.kernels.rigid.joint.tree.substep.bases import place_tree_base
from wsim.kernels.rigid.joint.tree.substep.one_sided import one_sided_functions
from wsim.kernels.rigid.joint.tree.substep.stages import copy_tree_state
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.lists.worlds import body_straying_func
from wsim.kernels.rigid.soft_step import body_steps


@cache
def tree_awake_func(real, sleeping: bool):
    """Function of a tree: whether it moves."""
    Rig = rig_type(real)

    @wp.func
    def tree_is_awake(g: int, rig: Rig, T: Trees):
        if wp.static(sleeping):
            return rig.work.asleep[T.t.body[T.t.first_link[g]]] == 0
        return True

    return tree_is_awake


@cache
def tree_part_functions(real, meet, coloured: bool, needs: TreeContactNeeds):
    """Parts of a substep of one tree, or of all of a team."""
    moving, one_sided = needs.moving, one_sided_functions(needs.strings)
    start, reset, place_supports = one_sided.start, one_sided.reset, one_sided.place
    Rig, f, contact = (rig_type(real), tree_step_functions(real, *needs.of_step),
                       link_contact_functions(real, moving, needs.soft))
    kick, advance, mark, arms, prepare, end = f.kick, f.predict, contact.mark, contact.arms, contact.prepare, contact.end
    nth = touching_manifold_functions(real, coloured)[1]
    awake, soft_goals = tree_awake_func(real, needs.sleeping), soft_goal_func(real, moving) if needs.soft else None
    (orient, _, _, _), stray = body_steps(real), body_straying_func(real)

    @standalone_function
    @wp.func
    def ready_tree(g: int, k: int, h: real, rig: Rig, J: Linked, T: Trees):
        """Places a tree at its coordinates, with the factors of H and limits; its bodies are turned as it is."""
        if wp.static(moving):
            place_supports(g, k, wp.float64(0.0), wp.float64(h), T, J)
        place_tree(g, T)
        assemble_tree_matrix(g, T)
        if T.integrator[g] == ROS2 or T.integrator[g] == IMPLICIT:
            add_drive_inertia(g, k, wp.float64(h), T, J)
            add_actuator_inertia(g, k, wp.float64(h), T, J)
        factor_tree_matrix(g, T)
        ready_loops(g, T)
        start(g, wp.float64(h), T, J)
        for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            T.met[link] = 0
        tree_barrier()

    @standalone_function
    @wp.func
    def ready_contacts(team: WorldTeam, k: int, rig: Rig, T: Trees):
        """Responses, arms, gaps of a world's manifolds where substep k begins."""
        lane = team.number * tree_lanes() + tree_lane()
        lanes = team.of * tree_lanes()
        for place in range(team.manifold + lane, team.end, lanes):
            m = nth(place, rig)
            if m >= 0:
                mark(m, rig, T)
                arms(m, k, rig)
        meet()
        for g in range(team.tree + team.number, team.last_tree, team.of):
            if awake(g, rig, T):
                solve_tree_responses(g, T)
        meet()
        for item in range(lane, COLUMNS * (team.end - team.manifold), lanes):
            m = nth(team.manifold + item // COLUMNS, rig)
            if m >= 0:
                prepare(m, item % COLUMNS, rig, T)
        meet()
        for place in range(team.manifold + lane, team.end, lanes):
            m = nth(place, rig)
            if m >= 0:
                end(m, rig)
        meet()

    @standalone_function
    @wp.func
    def predict_tree(g: int, k: int, h: wp.float64, rig: Rig, J: Linked, T: Trees, P: Trees):
        """q, qd of P a step on; qd of T: where the step begins."""
        copy_tree_state(g, T.q, T.qd, P.q, P.qd, T)
        if wp.static(moving):
            kick(g, k, h, P, J)
            copy_tree_state(g, P.q, P.qd, P.q, T.qd, T)
        advance(g, k, T.integrator[g], h, rig.b, P, J)
        reset(g, T)

    @standalone_function
    @wp.func
    def open_tree_velocity(g: int, qd: wp.array(dtype=wp.float64), T: Trees):
        """Sweeps go on from these velocities."""
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = qd[d]
        tree_barrier()
        open_tree_sweeps(g, T)

    @standalone_function
    @wp.func
    def move_tree(g: int, k: int, h: wp.float64, J: Linked, T: Trees, P: Trees):
        """Coordinates move by the mean rates `qd`."""
        if wp.static(moving):
            place_tree_base(g, k, wp.float64(1.0), h, T, J)
        copy_tree_state(g, T.q, T.qd, T.q_before, T.qd_before, T)
        move_tree_coordinates(g, h, T.qd, T.q_before, T)
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = P.qd[d] + (T.qd[d] - P.rates[d])
        tree_barrier()
        close_tree_loops(g, T)

    @standalone_function
    @wp.func
    def place_bodies(team: WorldTeam, k: int, h: real, rig: Rig, T: Trees):
        for g in range(team.tree + team.number, team.last_tree, team.of):
            for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
                i = T.t.body[link]
                orient(i, rig)
                stray(i, h, rig)
        meet()

    @standalone_function
    @wp.func
    def note_goals(team: WorldTeam, k: int, h: wp.float64, rig: Rig, J: Linked, T: Trees):
        """What soft contacts ask for, by the velocities where a substep begins."""
        if wp.static(needs.soft):
            for g in range(team.tree + team.number, team.last_tree, team.of):
                if awake(g, rig, T):
                    open_tree_sweeps(g, T)
            meet()
            for place in range(team.manifold + team.number, team.end, team.of):
                m = nth(place, rig)
                if m >= 0:
                    soft_goals(m, k, h, rig, T)
            meet()

    return SimpleNamespace(ready=ready_tree, contacts=ready_contacts, predict=predict_tree, open=open_tree_velocity,
                           move=move_tree, place=place_bodies, goals=note_goals, awake=awake)
