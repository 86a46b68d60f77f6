"""A round of stars and points of a world with trees, by one block of threads: kernels/rigid/touch/rounds.py for links.

    gather, stars, tell      of each tree, by a warp: link_star.py, kernels/rigid/touch/exchange.py
    project                  contacts of each point, in order: kernels/contact/project.py
    take                     momenta of each link

Sweeps of trees over their own contacts and limits stand between rounds, in launches of their own (pushed.py).
"""

from functools import cache

import warp as wp

from wsim.kernels.contact import project
from wsim.kernels.math import block
from wsim.kernels.math.team import any_of
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.joint.tree.contact.link_star import tree_star_func
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.tables import Trees
from wsim.kernels.rigid.touch.exchange import star_body_funcs, star_contact_funcs
from wsim.kernels.rigid.touch.points import touch_structs
from wsim.kernels.rigid.touch.rounds import star_aim_func, star_round_funcs, world_point_func, world_type


@cache
def link_round_kernel(real, threads: int, module, moving: bool, rolling: bool = False):
    """Kernel over threads of worlds: a round. fresh: 1 where it is the first of an iteration. moving: what some trees hang from
    moves. rolling: balls turn."""
    Worlds, Rig, Slots, Points = world_type(real), rig_type(real), project.slot_type(real), touch_structs(real)[2]
    Table, Reach = project.contact_tables(real)
    together = block.no_barrier if threads == 1 else block.block_barrier
    (gather, tell), take, reached = (star_contact_funcs(real, rolling), star_body_funcs(real, rolling)[1],
                                     star_round_funcs(real)[1])
    stars, project_world_points, aim = (tree_star_func(real, moving, rolling), world_point_func(real, threads, rolling),
                                        star_aim_func(real))

    @wp.func
    def foresee_tree(c: Table, s: Slots, p: Points, W: Worlds, rig: Rig, g: int, warp: int, T: Trees):
        n = rig.b.w.shape[0]
        for link in range(T.t.first_link[g], T.t.first_link[g + 1]):
            i = T.t.body[link]
            for m in range(W.rows.first[i] + tree_lane(), W.rows.first[i + 1], tree_lanes()):
                gather(c, s, p, W.found, m, W.rows)
        tree_barrier()
        stars(g, warp, wp.vec3d(wp.float64(p.h), wp.float64(p.g), wp.float64(1.0)), W.rows, W.found, T, W.V, W.left)
        tree_barrier()
        for link in range(T.t.first_link[g], T.t.first_link[g + 1]):
            i = T.t.body[link]
            v = W.V[i]
            o = W.V[n + i]
            for m in range(W.rows.first[i] + tree_lane(), W.rows.first[i + 1], tree_lanes()):
                tell(W.rows, W.found, m, v, o, p.h, s)
            if tree_lane() == 0:
                aim(W, rig, i, v, o)

    def link_rounds(c: Table, reach: Reach, s: Slots, p: Points, W: Worlds, fresh: int, rig: Rig, T: Trees):
        w = wp.tid() / wp.static(threads)
        lane = wp.tid() - w * wp.static(threads)
        warp = lane / tree_lanes()
        warps = (wp.static(threads) + tree_lanes() - 1) / tree_lanes()
        first = W.first[w]
        last = W.first[w + 1]
        going = wp.where(fresh == 1, int(1), W.going[w])
        if going == 0:
            off = int(0)
            for i in range(first + lane, last, wp.static(threads)):
                if not reached(W, rig, i, p.h):
                    off = int(1)
            if any_of(off) == 0:
                going = int(-1)
        if going >= 0:
            for g in range(T.first_tree[w] + warp, T.first_tree[w + 1], warps):
                foresee_tree(c, s, p, W, rig, g, warp, T)
            together()
            going = any_of(project_world_points(c, reach, s, p, W, w, lane))
            for i in range(first + warp, last, warps):
                take(W.rows, p.push, W.found, 0, i, wp.vec4i(tree_lane(), tree_lanes(), 1, warp), rig)
            together()
        if lane == 0:
            W.going[w] = going

    return wp.kernel(link_rounds, name="link_rounds", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=threads)
