"""Substeps of trees that touch something, by the teams of each world (teams.py), which meet between the parts of a substep.

    predict    coordinates and velocities a step on without contacts and limits, by rk4 or implicitly (steps.py)
    solve      sweeps over contacts and limits, from the mean rate of the prediction: what they change is added to it
    place      q' = q moved by the mean rate and that change
    relax      a sweep without bias, with the velocities at the end and all responses at q'

A tree that nothing touches so moves as if it were alone. Bodies without joints are trees of one link. One team takes manifolds
as they are listed, several by their colours: no two of a colour have a tree in common. Where something bounces, impacts come
behind the prediction, which is then made again.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.actuator_forces import note_actuator_work
from wsim.kernels.rigid.joint.tree.contact.balance import balance_tree_momentum, expected_tree_momentum
from wsim.kernels.rigid.joint.tree.contact.needs import TreeContactNeeds
from wsim.kernels.rigid.joint.tree.contact.parts import tree_part_functions
from wsim.kernels.rigid.joint.tree.contact.responses import close_tree_sweeps, open_tree_sweeps
from wsim.kernels.rigid.joint.tree.contact.sweeps import WARM, tree_sweep_functions, world_impact_func
from wsim.kernels.rigid.joint.tree.contact.teams import WorldTeam, touching_manifold_functions, world_team_func
from wsim.kernels.rigid.joint.tree.joint_forces import note_drive_work
from wsim.kernels.rigid.joint.tree.lanes import tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.steps import tree_step_functions
from wsim.kernels.rigid.joint.tree.substep.breaks import note_break_start, tree_break_functions
from wsim.kernels.rigid.joint.tree.tables import Trees, vec6d
from wsim.kernels.rigid.soft_step import body_steps


def touching_part_functions(real, meet, coloured: bool, needs: TreeContactNeeds):
    """(begin, predict, solve, end): functions of a team, of a substep of its world, behind each other."""
    Rig, f, parts = rig_type(real), tree_step_functions(real, *needs.of_step), tree_part_functions(real, meet, coloured, needs)
    begin, write, ready, contacts, predict, opened, move, place = (f.begin, f.write, parts.ready, parts.contacts, parts.predict,
                                                                   parts.open, parts.move, parts.place)
    walk, sweep, solve = tree_sweep_functions(real, meet, coloured, needs)
    impacts = world_impact_func(real, meet, coloured, sweep, needs) if needs.bouncing else None
    goals, awake = parts.goals, parts.awake
    turn, end_break = body_steps(real)[1], tree_break_functions(real).end if needs.breaking else None

    @wp.func
    def stop_tree(g: int, T: Trees):
        """A tree that sleeps has no velocity."""
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = wp.float64(0.0)

    @standalone_function
    @wp.func
    def begin_world(team: WorldTeam, k: int, h: real, rig: Rig, J: Linked, T: Trees):
        if k == 0 or wp.static(needs.sleeping):
            for g in range(team.tree + team.number, team.last_tree, team.of):
                if k == 0:
                    begin(g, wp.float64(h), rig.b, T, J)  # one that sleeps may wake within the frame
                if awake(g, rig, T):
                    ready(g, k, h, rig, J, T)            # else as the launch before has left it
                    if wp.static(needs.breaking):
                        note_break_start(g, T)
                else:
                    stop_tree(g, T)
        for i in range(rig.b.w.shape[0] + tree_lane(), rig.work.turn.shape[0], tree_lanes()):
            turn(i, k, rig)
        place(team, k, h, rig, T)

    @wp.func
    def predict_world(team: WorldTeam, k: int, h: real, rig: Rig, J: Linked, T: Trees, P: Trees):
        """Velocities become the mean rates of the prediction, with the impulses of the substep before."""
        d = wp.float64(h)
        contacts(team, k, rig, T)
        if wp.static(needs.soft):
            goals(team, k, d, rig, J, T)
        again = int(1)
        tries = int(0)
        while tries <= again:
            for g in range(team.tree + team.number, team.last_tree, team.of):
                if awake(g, rig, T):
                    predict(g, k, d, rig, J, T, P)
            again = int(0)
            if wp.static(needs.bouncing):
                if tries == 0:
                    again = impacts(team, k, h, rig, J, T, P)
            tries += 1
        for g in range(team.tree + team.number, team.last_tree, team.of):
            if awake(g, rig, T):
                opened(g, P.rates, T)
        meet()
        walk(team, int(WARM), k, h, 1, rig, T)

    @wp.func
    def end_world(team: WorldTeam, n: int, k: int, h: real, rig: Rig, J: Linked, T: Trees, P: Trees):
        """Places behind the sweeps, and velocities without bias."""
        d = wp.float64(h)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            if awake(g, rig, T):
                close_tree_sweeps(g, T)
                kept = vec6d()
                if wp.static(needs.pushed):
                    kept = expected_tree_momentum(g, T, P)
                move(g, k, d, J, T, P)
                ready(g, k + 1, h, rig, J, T)
                if wp.static(needs.pushed):
                    balance_tree_momentum(g, kept, T)
                write(g, T, rig.now)
                open_tree_sweeps(g, T)
        place(team, k + 1, h, rig, T)
        contacts(team, k + 1, rig, T)
        if wp.static(not needs.soft):
            solve(team, n, k, h, 0, rig, J, T)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            if awake(g, rig, T):
                close_tree_sweeps(g, T)
                note_actuator_work(g, k, d, T, J)
                note_drive_work(g, k, d, T, J)
                if wp.static(needs.breaking):
                    if end_break(g, d, rig.b, T, J) == 1:
                        ready(g, k + 1, h, rig, J, T)
                write(g, T, rig.now)

    return begin_world, predict_world, solve, end_world


def touching_tree_kernel(real, module, meet, coloured: bool, needs: TreeContactNeeds, threads: int = 0, cluster: int = 0,
                         **bounds):
    """Kernel of substeps steps[0] .. steps[1] of a frame, of h [s], over so many teams of worlds, with steps[2] sweeps.
    Manifolds are those of steps[0]. P: scratch of the prediction. meet: the barrier of a world's teams; threads, cluster: of a
    block, and blocks of a cluster, on CUDA; else bounds of a launch of warps (lanes.py)."""
    Rig, world_team, listed = rig_type(real), world_team_func(real), touching_manifold_functions(real, coloured)[0]
    begin, predict, solve, end = touching_part_functions(real, meet, coloured, needs)

    def rigid_touching_trees(steps: wp.vec3i, h: real, teams: int, rig: Rig, J: Linked, T: Trees, P: Trees):
        team = world_team(wp.tid() // tree_lanes(), teams, rig, T)
        team.end = listed(team, rig)
        begin(team, steps[0], h, rig, J, T)
        for k in range(steps[0], steps[1]):
            predict(team, k, h, rig, J, T, P)
            solve(team, steps[2], k, h, 1, rig, J, T)
            end(team, 1, k, h, rig, J, T, P)

    more = bounds | ({"launch_bounds": threads} if threads else {}) | ({"cluster_dim": cluster} if cluster else {})
    return wp.kernel(rigid_touching_trees, name="rigid_touching_trees", module=module, enable_backward=False, grid_stride=False,
                     **more)
