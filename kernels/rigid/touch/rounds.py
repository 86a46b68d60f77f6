"""Bodies and the points that touch them, a block of threads a world: the list of their contacts, and all rounds of stars,
points and sweeps of a substep in one launch. kernels/rigid/touch/points.py has the equations.

    round   gather, star, tell       of each body, by a team of warps: kernels/rigid/touch/body_point_solve.py, exchange.py
            project                  contacts of each point, in order: kernels/contact/project.py
            take                     momenta of each body
            sweep                    bodies against each other and against colliders, colour by colour

A star foresees where its body goes if nothing else pushes it. Once each body of a world has the momenta that its star has
foreseen, to NEAR, or those that it had before the round, and points with several contacts stay where they are, another round
would change nothing: the world ends. The first star begins at V = 0, the next ones at the V before. (What a star foresees may
stay off: it takes static or dynamic friction of each contact as the round before has left it.)
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from collections.abc import Sequence
from functools import cache

import warp as wp

from wsim.kernels.contact import project
from wsim.kernels.math import block
from wsim.kernels.math.real import types
from wsim.kernels.math.team import any_of, block_prefix_count, split_into_teams, team_barrier
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.kinds import ConstraintKind
from wsim.kernels.rigid.motion import double_vec3
from wsim.kernels.rigid.touch.body_point_solve import star_solve_func
from wsim.kernels.rigid.touch.body_point_solve import star_structs as stars
from wsim.kernels.rigid.touch.exchange import rotate_moments, star_body_funcs, star_contact_funcs, star_energy_funcs
from wsim.kernels.rigid.touch.points import touch_begin_funcs, touch_structs
from wsim.kernels.rigid.touch.step import world_sweep_func

NEAR = {wp.float32: 1e-6, wp.float64: 1e-10}     # part of a momentum that counts as nothing: beyond rounding


@cache
def world_type(real):
    """Struct of what worlds have besides: their bodies, contacts, and points that touch something."""
    Rows, Hubs = stars(real)
    Shapes, Found, _ = touch_structs(real)

    @wp.struct
    class TouchingWorlds:
        rows: Rows
        hubs: Hubs
        found: Found
        shapes: Shapes
        first: wp.array(dtype=int)                # body of each world, (worlds + 1,)
        points: int                               # of a world
        many: wp.array(dtype=int)                 # points of each world that touch something
        point: wp.array(dtype=int)                # these, from w * points on
        count: wp.array(dtype=int)                # contacts of each body
        going: wp.array(dtype=int)                # of worlds: 1 points moved in the last round, 0 none did, -1 it ended
        V: wp.array(dtype=wp.vec3d)               # velocity, then spin, less those that contacts were found with, (2 bodies,)
        aim: wp.array(dtype=wp.vec3d)             # momenta that the stars have foreseen, (2 bodies,)
        was: wp.array(dtype=wp.vec3d)             # momenta before the round, (2 bodies,)
        left: wp.array(dtype=real)                # see `star.solving`

    return TouchingWorlds


@cache
def touch_list_kernel(real, threads: int, module, rolling: bool = False):
    """Kernel over threads of worlds, behind a search: points that touch something, contacts in the order of bodies, points and
    slots, arms and planes. phase: 0 where there is one world; else 1, which counts, and 2, which lists."""
    Worlds, Rig, Slots, Points = world_type(real), rig_type(real), project.slot_type(real), touch_structs(real)[2]
    ahead, found = touch_begin_funcs(real, rolling)
    together = block.no_barrier if threads == 1 else block.block_barrier

    @wp.func
    def thread_item_range(many: int, lane: int):
        """(first, last) of so many that a thread has."""
        each = (many + wp.static(threads - 1)) / wp.static(threads)
        return wp.min(lane * each, many), wp.min((lane + 1) * each, many)

    @wp.func
    def list_touching_points(W: Worlds, s: Slots, w: int, lane: int):
        begin, end = thread_item_range(W.points, lane)
        own = int(0)
        for i in range(w * W.points + begin, w * W.points + end):
            if s.count[i] > 0:
                own += 1
        all = block_prefix_count(own)
        at = w * W.points + all[0]
        for i in range(w * W.points + begin, w * W.points + end):
            if s.count[i] > 0:
                W.point[at] = i
                at += 1
        if lane == 0:
            W.many[w] = all[1]

    @wp.func
    def list_body_contacts(W: Worlds, s: Slots, body: int, w: int, lane: int, into: int):
        """How many contacts of a body the points of a thread have; their slots from `into` on, if that is not below 0."""
        begin, end = thread_item_range(W.many[w], lane)
        own = int(0)
        for k in range(w * W.points + begin, w * W.points + end):
            i = W.point[k]
            for slot in range(s.count[i]):
                j = slot * s.points + i
                if W.shapes.of[s.row[j]] == body:
                    if into >= 0:
                        W.rows.slot[into + own] = j
                    own += 1
        return own

    def list_world_contacts(W: Worlds, rig: Rig, s: Slots, p: Points, phase: int):
        w = wp.tid() / wp.static(threads)
        lane = wp.tid() - w * wp.static(threads)
        first = W.first[w]
        last = W.first[w + 1]
        if phase < 2:
            list_touching_points(W, s, w, lane)
            together()
        if phase == 1:
            for body in range(first, last):
                all = block_prefix_count(list_body_contacts(W, s, body, w, lane, -1))
                if lane == 0:
                    W.count[body] = all[1]
            return
        before = int(0)
        if phase == 2:
            for body in range(lane, first, wp.static(threads)):
                before += W.count[body]
            all = block_prefix_count(before)
            before = all[1]
        start = before
        for body in range(first, last):
            own = list_body_contacts(W, s, body, w, lane, -1)
            all = block_prefix_count(own)
            if own > 0:
                list_body_contacts(W, s, body, w, lane, before + all[0])
            if lane == 0:
                W.rows.first[body] = before
                W.rows.first[body + 1] = before + all[1]
            before += all[1]
        for body in range(first + lane, last, wp.static(threads)):
            ahead(rig, body, W.found)
        together()
        for m in range(start + lane, before, wp.static(threads)):
            found(W.shapes, rig, s, p, m, W.rows, W.found)

    return wp.kernel(list_world_contacts, name=f"list_touches_{types(real).name}", module=module, enable_backward=False,
                     grid_stride=False, launch_bounds=threads)


@cache
def star_aim_func(real):
    """Function of body i: notes its momenta before a round, and those that its star foresees, which changes its velocity by v
    and its spin by o."""
    Worlds, Rig = world_type(real), rig_type(real)

    @wp.func
    def note_star_aim(W: Worlds, rig: Rig, i: int, v: wp.vec3d, o: wp.vec3d):
        n = rig.b.w.shape[0]
        W.was[i] = double_vec3(rig.now.p[i])
        W.was[n + i] = double_vec3(rig.now.L[i])
        W.aim[i] = W.was[i]
        W.aim[n + i] = W.was[n + i]
        if W.rows.first[i + 1] > W.rows.first[i]:
            W.aim[i] = (W.found.ahead[i] + v) / wp.float64(rig.b.w[i])
            W.aim[n + i] = rotate_moments(wp.mat33d(rig.work.turn[i]), double_vec3(rig.b.inverse[i]),
                                          W.found.ahead[n + i] + o)

    return note_star_aim


@cache
def star_round_funcs(real, rolling: bool = False):
    """(foresee, reached): functions of body i: the star, by a team; whether the body has the momenta that the star has
    foreseen, or those before the round. first: 1 in the first round."""
    Worlds, Rig, Slots, Points = world_type(real), rig_type(real), project.slot_type(real), touch_structs(real)[2]
    Table = project.contact_tables(real)[0]
    (gather, tell), (hub, _), solve = (star_contact_funcs(real, rolling), star_body_funcs(real, rolling),
                                     star_solve_func(real, rolling))
    (energy, weight), near, aim = star_energy_funcs(real), NEAR[real] ** 2, star_aim_func(real)

    @wp.func
    def foresee_body_velocity(c: Table, s: Slots, p: Points, W: Worlds, rig: Rig, i: int, at: wp.vec4i, first: int):
        n = rig.b.w.shape[0]
        if at[0] == 0:
            hub(rig, W.found, wp.float64(1.0), i, W.hubs)
        for m in range(W.rows.first[i] + at[0], W.rows.first[i + 1], at[1]):
            gather(c, s, p, W.found, m, W.rows)
        v = wp.vec3d()
        o = wp.vec3d()
        if first == 0:
            v = W.V[i]
            o = W.V[n + i]
        team_barrier(at[2], at[3])
        own = energy(rig, i, double_vec3(rig.now.p[i]), double_vec3(rig.now.L[i])) + weight(rig, i, p.h)
        kg = wp.vec3d(wp.float64(p.h), wp.float64(p.g), wp.float64(1e-6 * near) * own)
        left = real(0.0)
        v, o, left = solve(W.rows, W.hubs, i, at, kg, v, o)
        for m in range(W.rows.first[i] + at[0], W.rows.first[i + 1], at[1]):
            tell(W.rows, W.found, m, v, o, p.h, s)
        if at[0] == 0:
            W.V[i] = v
            W.V[n + i] = o
            W.left[i] = left
            aim(W, rig, i, v, o)

    @wp.func
    def foreseen_momentum_reached(W: Worlds, rig: Rig, i: int, h: real):
        n = rig.b.w.shape[0]
        p = W.aim[i]
        L = W.aim[n + i]
        own = double_vec3(rig.now.p[i])
        turning = double_vec3(rig.now.L[i])
        off = wp.min(energy(rig, i, own - p, turning - L), energy(rig, i, own - W.was[i], turning - W.was[n + i]))
        all = energy(rig, i, p, L) + energy(rig, i, W.found.total[i], W.found.total[n + i]) + weight(rig, i, h)
        return off <= wp.float64(near) * all

    return foresee_body_velocity, foreseen_momentum_reached


@cache
def world_point_func(real, threads: int, rolling: bool = False):
    """Function of a thread of a world: contacts of its points, once; 1 where a point of several has moved."""
    Worlds, Slots, Points = world_type(real), project.slot_type(real), touch_structs(real)[2]
    (Table, Reach), projected, near = project.contact_tables(real), project.point_projection_func(real), NEAR[real] ** 2
    if rolling:
        from wsim.kernels.position_based.rolling.walls import rolling_point_func
        turning = rolling_point_func(real)

    @wp.func
    def project_world_points(c: Table, reach: Reach, s: Slots, p: Points, W: Worlds, w: int, lane: int):
        moved = int(0)
        for k in range(w * W.points + lane, w * W.points + W.many[w], wp.static(threads)):
            i = W.point[k]
            d0 = p.d[i]
            if wp.static(rolling):
                d1 = turning(c, reach, s, W.found.roll, i, p.g, wp.matrix_from_rows(d0, p.a[i]), p.push)
            else:
                d1 = projected(c, reach, s, i, p.g, wp.matrix_from_rows(d0, p.a[i]), p.push, p.push)
            p.d[i] = d1
            if s.count[i] > 1:
                way = d1 - d0
                size = wp.length_sq(d1 - p.a[i])
                for slot in range(s.count[i]):
                    size += wp.length_sq(p.push[slot * s.points + i])
                if wp.length_sq(way) > real(near) * size:
                    moved = int(1)
        return moved

    return project_world_points


@cache
def touch_round_kernel(kinds: Sequence[ConstraintKind], real, threads: int, module, rolling: bool = False):
    """Kernel over threads of worlds: so many rounds. steps: substep, sweeps in a round, rounds, and 1 where the first of them
    is the first of an iteration. kinds: of constraints between bodies, contacts alone."""
    t, Worlds, Rig, Slots, Points = (types(real), world_type(real), rig_type(real), project.slot_type(real),
                                     touch_structs(real)[2])
    Table, Reach = project.contact_tables(real)
    together = block.no_barrier if threads == 1 else block.block_barrier
    (foresee, reached), take, project_world_points = (star_round_funcs(real, rolling), star_body_funcs(real, rolling)[1],
                                                      world_point_func(real, threads, rolling))
    sweep = world_sweep_func(kinds, real, together, threads)

    def touch_rounds(c: Table, reach: Reach, s: Slots, p: Points, W: Worlds, steps: wp.vec4i, rig: Rig):
        w = wp.tid() / wp.static(threads)
        lane = wp.tid() - w * wp.static(threads)
        first = W.first[w]
        last = W.first[w + 1]
        each, count = split_into_teams(wp.static(threads), last - first)
        team = lane / (32 * each)
        at = wp.vec4i(lane - team * 32 * each, wp.min(wp.static(threads), 32 * each), each, team)
        going = W.going[w]
        if steps[3] == 1:
            going = int(1)
        fresh = steps[3]
        for _round in range(steps[2]):
            if going == 0:
                off = int(0)
                for i in range(first + lane, last, wp.static(threads)):
                    if not reached(W, rig, i, p.h):
                        off = int(1)
                if any_of(off) == 0:
                    going = int(-1)
            if going >= 0:
                for i in range(first + team, last, count):
                    foresee(c, s, p, W, rig, i, at, fresh)
                fresh = int(0)
                together()
                going = any_of(project_world_points(c, reach, s, p, W, w, lane))
                for i in range(first + team, last, count):
                    take(W.rows, p.push, W.found, 0, i, at, rig)
                together()
                for _sweep in range(steps[1]):
                    sweep(w, lane, steps[0], p.h, rig)
        if lane == 0:
            W.going[w] = going

    return wp.kernel(touch_rounds, name=f"touch_rounds_{t.name}", module=module, enable_backward=False, grid_stride=False,
                     launch_bounds=threads)
