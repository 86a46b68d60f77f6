"""Teams of the trees of a world, and the manifolds that each takes. A team is the lanes of a tree (lanes.py). A world has one,
or, where it has many trees and is the only one, the warps of a block or of a cluster of blocks.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.contact import first_manifold_func, rig_type
from wsim.kernels.rigid.joint.tree.lanes import count_lanes, lanes_before, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.tables import Trees


@wp.struct
class WorldTeam:
    """A team of a world, which has a number: its own of so many, the trees and manifolds of the world, first and last, and the
    place behind the listed ones that touch."""
    world: int
    number: int
    of: int
    tree: int
    last_tree: int
    manifold: int
    last_manifold: int
    end: int


def world_team_func(real):
    """Function (warp, teams, rig, T): the team of a warp."""
    Rig, first_manifold = rig_type(real), first_manifold_func(real)

    @wp.func
    def world_team(warp: int, teams: int, rig: Rig, T: Trees):
        w = warp // teams
        found = WorldTeam()
        found.world = w
        found.number = warp % teams
        found.of = teams
        found.tree = T.first_tree[w]
        found.last_tree = T.first_tree[w + 1]
        found.manifold = first_manifold(w, rig)
        found.last_manifold = first_manifold(w + 1, rig)
        return found

    return world_team


def touching_manifold_functions(real, coloured: bool):
    """(listed, nth): listed(team, rig): the place behind a team's manifolds that touch, which it lists where it is the only one
    of its world; nth(place, rig): the manifold of a place from `team.manifold` on, -1 for one that does not touch."""
    Rig = rig_type(real)

    @standalone_function
    @wp.func
    def list_touching_manifolds(team: WorldTeam, rig: Rig):
        end = team.last_manifold
        if not wp.static(coloured):
            end = team.manifold
            base = team.manifold
            while base < team.last_manifold:
                m = base + tree_lane()
                touches = int(0)
                if m < team.last_manifold:
                    if rig.c.count[m] > 0:
                        touches = 1
                slot = end + lanes_before(touches)
                if touches == 1:
                    rig.work.order[slot] = m
                end += count_lanes(touches)
                base += tree_lanes()
            tree_barrier()
        return end

    @wp.func
    def nth_touching_manifold(place: int, rig: Rig):
        m = place
        if wp.static(coloured):
            if rig.c.count[m] <= 0:
                m = -1
        else:
            m = rig.work.order[place]
        return m

    return list_touching_manifolds, nth_touching_manifold


def world_flag_func(meet):
    """Function (flag, team, T): what a team has said since this was asked last, and then forgets; all get it."""
    @standalone_function
    @wp.func
    def world_flag_was_raised(flag: int, team: WorldTeam, T: Trees):
        meet()
        said = T.flags[2 * team.world + flag]
        meet()
        if team.number == 0 and tree_lane() == 0:
            T.flags[2 * team.world + flag] = 0
        meet()                                       # before anyone may say it again
        return said

    return world_flag_was_raised
