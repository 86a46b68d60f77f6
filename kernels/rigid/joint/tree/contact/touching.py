"""Substeps of trees that touch something, by the teams of each world (teams.py), which meet between the parts of a substep.

    predict    coordinates and velocities a step on without contacts and limits, by rk4 or implicitly (steps.py)
    solve      sweeps over contacts and limits, from the mean rate of the prediction: what they change is added to it
    place      q' = q moved by the mean rate and that change
    relax      a sweep without bias, with the velocities at the end and all responses at q'

A tree that nothing touches so moves as if it were alone. Bodies without joints are trees of one link. One team takes manifolds
as they are listed, several by their colours: no two of a colour have a tree in common.
"""

from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.actuator_forces import add_actuator_inertia, note_actuator_work
from wsim.kernels.rigid.joint.tree.contact.contacts import COLUMNS, link_contact_functions
from wsim.kernels.rigid.joint.tree.contact.responses import close_tree_sweeps, open_tree_sweeps, solve_tree_responses
from wsim.kernels.rigid.joint.tree.contact.teams import WorldTeam, touching_manifold_functions, world_team_func
from wsim.kernels.rigid.joint.tree.joint_forces import add_drive_inertia, note_drive_work
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_coordinates, place_tree
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.limits import reset_limit_impulses, start_tree_limits, sweep_tree_limits
from wsim.kernels.rigid.joint.tree.loops.basis import ready_loops
from wsim.kernels.rigid.joint.tree.loops.steps import close_tree_loops
from wsim.kernels.rigid.joint.tree.mass_matrix import assemble_tree_matrix, factor_tree_matrix, tree_dofs
from wsim.kernels.rigid.joint.tree.steps import IMPLICIT, ROS2, tree_step_functions
from wsim.kernels.rigid.joint.tree.substep.bases import place_tree_base
from wsim.kernels.rigid.joint.tree.substep.stages import copy_tree_state
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.kinds import SERIAL
from wsim.kernels.rigid.lists.pairs import body_straying_func
from wsim.kernels.rigid.soft_step import body_steps


def tree_part_functions(real, meet, coloured: bool, moving: bool):
    """Parts of a substep of one tree, or of all of a team."""
    Rig, f, contact = rig_type(real), tree_step_functions(real, moving), link_contact_functions(real, moving)
    advance, mark, arms, prepare, end = f.predict, contact.mark, contact.arms, contact.prepare, contact.end
    nth = touching_manifold_functions(real, coloured)[1]
    (orient, _, _, _), stray = body_steps(real), body_straying_func(real)

    @standalone_function
    @wp.func
    def ready_tree(g: int, k: int, h: real, rig: Rig, J: Linked, T: Trees):
        """Places a tree at its coordinates, with the factors of H and limits; its bodies are turned as it is."""
        if wp.static(moving):
            place_tree_base(g, k, wp.float64(0.0), wp.float64(h), T, J)
        place_tree(g, T)
        assemble_tree_matrix(g, T)
        if T.integrator[g] == ROS2 or T.integrator[g] == IMPLICIT:
            add_drive_inertia(g, k, wp.float64(h), T, J)
            add_actuator_inertia(g, k, wp.float64(h), T, J)
        factor_tree_matrix(g, T)
        ready_loops(g, T)
        start_tree_limits(g, wp.float64(h), T, J)
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
        copy_tree_state(g, T.q, T.qd, P.q, P.qd, T)
        advance(g, k, T.integrator[g], h, rig.b, P, J)
        reset_limit_impulses(g, T)
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = P.rates[d]
        tree_barrier()
        open_tree_sweeps(g, T)

    @standalone_function
    @wp.func
    def move_tree(g: int, k: int, h: wp.float64, J: Linked, T: Trees, P: Trees):
        close_tree_sweeps(g, T)
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

    return SimpleNamespace(ready=ready_tree, contacts=ready_contacts, predict=predict_tree, move=move_tree, place=place_bodies)


def tree_sweep_functions(real, meet, coloured: bool, moving: bool):
    """(warm, sweep): functions of a team; coloured: manifolds by their colours."""
    Rig, contact = rig_type(real), link_contact_functions(real, moving)
    warm, solve = contact.warm, contact.solve

    @wp.func
    def act_on_manifold(m: int, first: int, k: int, h: real, biased: int, rig: Rig, T: Trees):
        if first == 1:
            warm(m, k, h, rig, T)
        else:
            solve(m, k, h, biased, rig, T)

    @standalone_function
    @wp.func
    def walk_manifolds(team: WorldTeam, first: int, k: int, h: real, biased: int, rig: Rig, T: Trees):
        """first: 1: gives them the impulses of the substep before, 0: solves them."""
        if wp.static(coloured):
            for colour in range(rig.work.colours[0]):
                end = rig.work.starts[colour + 1]
                slot = rig.work.starts[colour] + team.number
                stride = team.of
                if colour >= SERIAL:
                    stride = 1
                    if team.number > 0:
                        slot = end
                while slot < end:
                    act_on_manifold(rig.work.order[slot], first, k, h, biased, rig, T)
                    slot += stride
                meet()
        else:
            for place in range(team.manifold, team.end):
                act_on_manifold(rig.work.order[place], first, k, h, biased, rig, T)

    @wp.func
    def sweep_world(team: WorldTeam, k: int, h: real, biased: int, rig: Rig, J: Linked, T: Trees):
        """One sweep over a world."""
        walk_manifolds(team, 0, k, h, biased, rig, T)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            sweep_tree_limits(g, wp.float64(biased) * wp.float64(h), T, J)
        meet()

    return walk_manifolds, sweep_world


def touching_tree_kernel(real, module, meet, coloured: bool, moving: bool = False, threads: int = 0, cluster: int = 0):
    """Kernel of substeps steps[0] .. steps[1] of a frame, of h [s], over so many teams of worlds, with steps[2] sweeps.
    Manifolds are those of steps[0]. P: scratch of the prediction. meet: the barrier of a world's teams; moving: what some trees
    hang from moves; threads, cluster: of a block, and blocks of a cluster, on CUDA."""
    Rig, f, world_team = rig_type(real), tree_step_functions(real, moving), world_team_func(real)
    parts, listed = tree_part_functions(real, meet, coloured, moving), touching_manifold_functions(real, coloured)[0]
    begin, write, ready, contacts, predict, move, place = (f.begin, f.write, parts.ready, parts.contacts, parts.predict,
                                                           parts.move, parts.place)
    walk, sweep = tree_sweep_functions(real, meet, coloured, moving)
    turn = body_steps(real)[1]

    @standalone_function
    @wp.func
    def begin_world(team: WorldTeam, k: int, h: real, rig: Rig, J: Linked, T: Trees):
        if k == 0:
            for g in range(team.tree + team.number, team.last_tree, team.of):
                begin(g, wp.float64(h), rig.b, T, J)
                ready(g, 0, h, rig, J, T)                # else as the launch before has left it
        for i in range(rig.b.w.shape[0] + tree_lane(), rig.work.turn.shape[0], tree_lanes()):
            turn(i, k, rig)
        place(team, k, h, rig, T)

    def rigid_touching_trees(steps: wp.vec3i, h: real, teams: int, rig: Rig, J: Linked, T: Trees, P: Trees):
        team = world_team(wp.tid() // tree_lanes(), teams, rig, T)
        team.end = listed(team, rig)
        d = wp.float64(h)
        begin_world(team, steps[0], h, rig, J, T)
        for k in range(steps[0], steps[1]):
            contacts(team, k, rig, T)
            for g in range(team.tree + team.number, team.last_tree, team.of):
                predict(g, k, d, rig, J, T, P)
            meet()
            walk(team, 1, k, h, 1, rig, T)
            for _sweep in range(steps[2]):
                sweep(team, k, h, 1, rig, J, T)
            for g in range(team.tree + team.number, team.last_tree, team.of):
                move(g, k, d, J, T, P)
                ready(g, k + 1, h, rig, J, T)
                write(g, T, rig.now)
                open_tree_sweeps(g, T)
            place(team, k + 1, h, rig, T)
            contacts(team, k + 1, rig, T)
            sweep(team, k, h, 0, rig, J, T)
            for g in range(team.tree + team.number, team.last_tree, team.of):
                close_tree_sweeps(g, T)
                note_actuator_work(g, k, d, T, J)
                note_drive_work(g, k, d, T, J)
                write(g, T, rig.now)

    more = ({"launch_bounds": threads} if threads else {}) | ({"cluster_dim": cluster} if cluster else {})
    return wp.kernel(rigid_touching_trees, name="rigid_touching_trees", module=module, enable_backward=False, grid_stride=False,
                     **more)
