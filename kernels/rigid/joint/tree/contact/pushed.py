"""Substeps of trees in three launches, between which points and strands push their links.

    begin     prediction (touching.py), and the momenta with which links go on: m v, I omega of their mean velocities
    sweep     what others have changed of these momenta goes to the trees as impulses at the links, u += Z i (responses.py);
              sweeps over contacts and limits; the momenta then
    end       places and velocities

So others need to know bodies and momenta alone. A link's momenta are those of its mean velocity in the substep, until it ends:
they lead it to its next place. Moments are about centres of mass as they stand where the substep begins.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tree.contact.link_pair import point_line, twist_at
from wsim.kernels.rigid.joint.tree.contact.needs import TreeContactNeeds
from wsim.kernels.rigid.joint.tree.contact.responses import link_twist, push_link
from wsim.kernels.rigid.joint.tree.contact.teams import touching_manifold_functions, world_team_func
from wsim.kernels.rigid.joint.tree.contact.touching import touching_part_functions
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.mass_matrix import link_inertia_world
from wsim.kernels.rigid.joint.tree.substep.bases import link_base_twist
from wsim.kernels.rigid.joint.tree.tables import Trees, vec6d
from wsim.kernels.rigid.motion import double_vec3


@cache
def link_motion_func(moving: bool):
    """Function of a link: (velocity of the centre of mass, spin, centre of mass from O). moving: what some hang from moves."""

    @standalone_function
    @wp.func
    def link_center_motion(link: int, T: Trees):
        first = T.t.first_link[T.tree_of[link]]
        V = link_twist(link, T)
        if wp.static(moving):
            V += link_base_twist(link, first, T)
        x = T.X[link] - T.X[first]
        return twist_at(V, x), wp.vec3d(V[0], V[1], V[2]), x

    return link_center_motion


@wp.func
def wrench_at_origin(x: wp.vec3d, J: wp.vec3d, M: wp.vec3d):
    """An impulse J and a moment M about x, as a wrench about O."""
    found = point_line(x, J)
    return vec6d(found[0] + M[0], found[1] + M[1], found[2] + M[2], J[0], J[1], J[2])


@cache
def pushed_link_functions(real, moving: bool):
    """(tell, take): functions of a tree: momenta of its links; what has been changed of them."""
    t, Rig, motion = types(real), rig_type(real), link_motion_func(moving)

    @standalone_function
    @wp.func
    def tell_link_momenta(g: int, rig: Rig, T: Trees):
        for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
            i = T.t.body[link]
            v, o, x = motion(link, T)
            p = T.t.mass[link] * v
            L = link_inertia_world(link, T) * o
            rig.now.p[i] = t.vec3(real(p[0]), real(p[1]), real(p[2]))
            rig.now.L[i] = t.vec3(real(L[0]), real(L[1]), real(L[2]))
            T.links.p[i] = double_vec3(rig.now.p[i])
            T.links.L[i] = double_vec3(rig.now.L[i])
        tree_barrier()

    @standalone_function
    @wp.func
    def take_link_impulses(g: int, rig: Rig, T: Trees):
        first = T.t.first_link[g]
        for link in range(first, T.t.first_link[g + 1]):
            i = T.t.body[link]
            J = double_vec3(rig.now.p[i]) - T.links.p[i]
            M = double_vec3(rig.now.L[i]) - T.links.L[i]
            if wp.length_sq(J) + wp.length_sq(M) > wp.float64(0.0):
                push_link(link, wrench_at_origin(T.X[link] - T.X[first], J, M), T)
        tree_barrier()

    return tell_link_momenta, take_link_impulses


def pushed_tree_kernels(real, module, meet, coloured: bool, needs: TreeContactNeeds, threads: int = 0, cluster: int = 0,
                        **bounds):
    """Kernels begin, sweep, end of substep steps[0] of h [s], with steps[2] sweeps; the other arguments as of
    `touching_tree_kernel`."""
    Rig, world_team, listed = rig_type(real), world_team_func(real), touching_manifold_functions(real, coloured)[0]
    begin, predict, solve, end = touching_part_functions(real, meet, coloured, needs)
    tell, take = pushed_link_functions(real, needs.moving)

    def begin_pushed_trees(steps: wp.vec3i, h: real, teams: int, rig: Rig, J: Linked, T: Trees, P: Trees):
        team = world_team(wp.tid() // tree_lanes(), teams, rig, T)
        team.end = listed(team, rig)
        begin(team, steps[0], h, rig, J, T)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            for link in range(T.t.first_link[g] + tree_lane(), T.t.first_link[g + 1], tree_lanes()):
                if T.met[link] == 0:
                    T.met[link] = 1                              # any link may be pushed
        meet()
        predict(team, steps[0], h, rig, J, T, P)
        meet()
        for g in range(team.tree + team.number, team.last_tree, team.of):
            tell(g, rig, T)

    def sweep_pushed_trees(steps: wp.vec3i, h: real, teams: int, rig: Rig, J: Linked, T: Trees, P: Trees):
        team = world_team(wp.tid() // tree_lanes(), teams, rig, T)
        team.end = listed(team, rig)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            take(g, rig, T)
        meet()
        solve(team, steps[2], steps[0], h, 1, rig, J, T)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            tell(g, rig, T)

    def end_pushed_trees(steps: wp.vec3i, h: real, teams: int, rig: Rig, J: Linked, T: Trees, P: Trees):
        team = world_team(wp.tid() // tree_lanes(), teams, rig, T)
        team.end = listed(team, rig)
        for g in range(team.tree + team.number, team.last_tree, team.of):
            take(g, rig, T)
        meet()
        end(team, 1, steps[0], h, rig, J, T, P)

    more = bounds | ({"launch_bounds": threads} if threads else {}) | ({"cluster_dim": cluster} if cluster else {})
    begun, swept, ended = [wp.kernel(f, name=f.__name__, module=module, enable_backward=False, grid_stride=False, **more)
                           for f in (begin_pushed_trees, sweep_pushed_trees, end_pushed_trees)]
    return SimpleNamespace(begin=begun, sweep=swept, end=ended)
