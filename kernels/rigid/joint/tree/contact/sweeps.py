"""Sweeps of a team over the contacts and limits of its world (touching.py), and rounds of impacts (impacts.py)."""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.complementarity.converged import EACH, MOST
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.impact import ROUNDS, SWEEPS
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.contact.contacts import link_contact_functions
from wsim.kernels.rigid.joint.tree.contact.impacts import MARK, STRIKE, link_impact_functions
from wsim.kernels.rigid.joint.tree.contact.needs import TreeContactNeeds
from wsim.kernels.rigid.joint.tree.contact.parts import tree_awake_func, tree_part_functions
from wsim.kernels.rigid.joint.tree.contact.responses import close_tree_sweeps
from wsim.kernels.rigid.joint.tree.contact.teams import WorldTeam, touching_manifold_functions, world_flag_func
from wsim.kernels.rigid.joint.tree.lanes import tree_lane
from wsim.kernels.rigid.joint.tree.substep.one_sided import one_sided_functions
from wsim.kernels.rigid.joint.tree.substep.stages import copy_tree_state
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.kinds import SERIAL

WARM, SOLVE, BLOW = wp.constant(0), wp.constant(1), wp.constant(2)


def tree_sweep_functions(real, meet, coloured: bool, needs: TreeContactNeeds):
    """(walk, sweep, solve): functions of a team; coloured: manifolds by their colours."""
    moving = needs.moving
    Rig, contact = rig_type(real), link_contact_functions(real, moving, needs.soft)
    warm, solve, residual, awake = contact.warm, contact.solve, contact.residual, tree_awake_func(real, needs.sleeping)
    strike = link_impact_functions(real, moving).strike if needs.bouncing else None
    nth, sweep_limits = touching_manifold_functions(real, coloured)[1], one_sided_functions(needs.strings).sweep

    @wp.func
    def act_on_manifold(m: int, act: int, w: int, k: int, h: real, biased: int, rig: Rig, T: Trees):
        if act == WARM:
            warm(m, k, h, rig, T)
        elif act == SOLVE:
            solve(m, k, h, biased, rig, T)
        elif wp.static(needs.bouncing):
            strike(m, w, k, rig, T)

    @standalone_function
    @wp.func
    def walk_manifolds(team: WorldTeam, act: int, k: int, h: real, biased: int, rig: Rig, T: Trees):
        """act: WARM: gives them the impulses of the substep before; SOLVE; BLOW: strikes what is marked."""
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
                    act_on_manifold(rig.work.order[slot], act, team.world, k, h, biased, rig, T)
                    slot += stride
                meet()
        else:
            for place in range(team.manifold, team.end):
                act_on_manifold(rig.work.order[place], act, team.world, k, h, biased, rig, T)

    @wp.func
    def sweep_world(team: WorldTeam, act: int, k: int, h: real, biased: int, rig: Rig, J: Linked, T: Trees):
        """One sweep over a world."""
        walk_manifolds(team, act, k, h, biased, rig, T)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            if awake(g, rig, T):
                sweep_limits(g, wp.float64(biased) * wp.float64(h), T, J)
        meet()

    @standalone_function
    @wp.func
    def world_residual(team: WorldTeam, k: int, h: real, biased: int, rig: Rig, T: Trees):
        """Residual of all contacts of a world, for all of its teams."""
        meet()
        if team.number == 0 and tree_lane() == 0:
            T.residual[team.world] = wp.float64(0.0)
        meet()
        found = real(0.0)
        for place in range(team.manifold + team.number, team.end, team.of):
            m = nth(place, rig)
            if m >= 0:
                found = wp.max(found, residual(m, k, h, biased, rig, T))
        if tree_lane() == 0:
            wp.atomic_max(T.residual, team.world, wp.float64(found))
        meet()
        return real(T.residual[team.world])

    @wp.func
    def solve_world(team: WorldTeam, n: int, k: int, h: real, biased: int, rig: Rig, J: Linked, T: Trees):
        """n sweeps, or as many as the residual takes that is asked for."""
        if wp.static(needs.exact):
            miss = real(0.0)
            for i in range(int(MOST)):
                sweep_world(team, int(SOLVE), k, h, biased, rig, J, T)
                if i % EACH == EACH - 1:
                    miss = world_residual(team, k, h, biased, rig, T)
                    if miss <= real(T.tolerance):
                        break
            if team.number == 0 and tree_lane() == 0:
                wp.atomic_max(rig.work.residual, 1, miss)
        else:
            for _sweep in range(n):
                sweep_world(team, int(SOLVE), k, h, biased, rig, J, T)

    return walk_manifolds, sweep_world, solve_world


def world_impact_func(real, meet, coloured: bool, sweep, needs: TreeContactNeeds):
    """Function of a team: impacts of substep k, on velocities where it begins; P is predicted. Returns 1 if there were some."""
    Rig, parts = rig_type(real), tree_part_functions(real, meet, coloured, needs)
    impact = link_impact_functions(real, needs.moving)
    nth = touching_manifold_functions(real, coloured)[1]
    told, opened, awake, note, lean, mark = (world_flag_func(meet), parts.open, parts.awake, impact.note, impact.lean,
                                             impact.mark)

    @standalone_function
    @wp.func
    def note_blows(team: WorldTeam, k: int, h: real, rig: Rig, T: Trees, P: Trees):
        """Approach and acceleration of all points; u is then that of where the substep begins."""
        for part in range(int(3)):
            for g in range(team.tree + team.number, team.last_tree, team.of):
                if awake(g, rig, T):
                    if part == 1:
                        opened(g, P.qd, T)
                    else:
                        opened(g, P.qd_start, T)
            meet()
            for place in range(team.manifold + team.number, team.end, team.of):
                m = nth(place, rig)
                if m >= 0 and part == 0:
                    note(m, k, rig, T)
                elif m >= 0 and part == 1:
                    lean(m, k, h, rig, T)
            meet()

    @standalone_function
    @wp.func
    def resolve_world_impacts(team: WorldTeam, k: int, h: real, rig: Rig, J: Linked, T: Trees, P: Trees):
        some = int(0)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            copy_tree_state(g, T.q, T.qd, T.q, P.qd_start, T)
        note_blows(team, k, h, rig, T, P)
        for _round in range(int(ROUNDS)):
            for place in range(team.manifold + team.number, team.end, team.of):
                m = nth(place, rig)
                if m >= 0:
                    mark(m, team.world, k, h, rig, T)
            if told(int(MARK), team, T) == 0:
                break
            some = int(1)
            for _sweep in range(int(SWEEPS)):
                sweep(team, int(BLOW), k, h, 0, rig, J, T)
                if told(int(STRIKE), team, T) == 0:
                    break
        for g in range(team.tree + team.number, team.last_tree, team.of):
            if awake(g, rig, T):
                close_tree_sweeps(g, T)
        return some

    return resolve_world_impacts
