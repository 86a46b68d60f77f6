"""All sweeps of a call in one launch (kernels/contact/selfcontact/rows.py, in turn with contacts of points with colliders:
kernels/contact/project.py). Its threads meet behind each part of a sweep: which pairs take part, their pushes, points' moves.

Points that no pair pushes stay as they are: their contacts were projected before. On a GPU a thread keeps the pair that it
pushes, and the point that it moves, for as long as the same take part; of more than there are threads the others are read anew
in each sweep. Few rows are a cluster's, whose blocks meet in a fraction of the time that those of a grid take.

Results do not depend on which thread comes first: points sum in whole numbers, and each is moved by one thread.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled; `a if c else b` works out both.
# ruff: noqa: SIM102, SIM108, UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.project import SUNK, TOUCHED, contact_tables, plane_projection_func, slot_type, softness_func
from wsim.kernels.contact.selfcontact import pairs
from wsim.kernels.contact.selfcontact.moment_correction import held_type
from wsim.kernels.contact.selfcontact.rows import (
    SPARED,
    TAKES,
    all_rows_asked,
    nesterov_func,
    pair_sweep_func,
    pair_write_func,
    row_active_func,
    whole_point_weight,
)
from wsim.kernels.math.block import cluster_barrier, grid_barrier
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import point_states

BLOCK = 256            # threads of one on a GPU, for which there are 255 registers each
WARP = 32
FEW = 1 << 14          # rows that one cluster takes, of more blocks
WORDS = 6              # where blocks meet; rows that take part and points that they move, of this turn of asking and the next;
                       # rows that are asked between sweeps


@cache
def sweep_order_types(real):
    """(How, Touched): structs of what a call asks for, and of contacts with colliders."""
    t, (Held, _) = types(real), held_type(real)
    Rows, Points = contact_tables(real)
    Slots = slot_type(real)

    @wp.struct
    class SweepOrders:
        climb: t.scalar                           # as `rows.lean` has it [m]; calm likewise
        calm: t.scalar
        g: t.scalar                               # effective step of contacts [s]
        count: int                                # sweeps
        anew: int                                 # behind which it is asked anew what takes part
        leads: int                                # 1: they lead ahead
        spared: int                               # number of the sweep that is left out where pairs are taken in turn
        free: int                                 # points that have contacts
        threads: int                              # of all blocks
        words: wp.array(dtype=int)                # (WORDS,), 0 before the launch
        moved: wp.array(dtype=int)                # points that pairs move, in no order
        held: wp.array(dtype=Held)                # pairs that take part, as many as are not read anew in each sweep

    @wp.struct
    class TouchedPoints:
        rows: Rows
        points: Points
        slots: Slots
        push: wp.array(dtype=t.vec3)              # P of each slot

    return SweepOrders, TouchedPoints


@cache
def sweep_contact_funcs(real):
    """(Kept, keep, touch): struct of a point and its first contact; function (at, how, c, i) -> it, of point i; and
    (how, c, p, d, writes) -> (p, d), d of the point behind one iteration of its contacts. writes: the push of the first is
    written, and the point's mark; those of others always are."""
    t, (_, Touched) = types(real), sweep_order_types(real)
    How, meet, soften = sweep_order_types(real)[0], plane_projection_func(real), softness_func(real)
    State = point_states(real)

    @wp.struct
    class SweepPoint:
        point: int
        count: int                                # of its contacts
        d: t.vec3
        a: t.vec3
        n: t.vec3
        b: t.scalar
        gu: t.vec3
        mu: t.vec2
        P: t.vec3

    @wp.func
    def read_sweep_contact(c: Touched, how: How, p: SweepPoint, slot: int):
        """Contact of a slot."""
        j = slot * c.slots.points + p.point
        p.n = c.slots.n[j]
        p.b = c.slots.b[j]
        p.gu = how.g * c.slots.u[j]
        p.mu = real(0.5) * (c.points.friction[p.point] + c.rows.of.friction[c.slots.row[j]])
        p.P = c.push[j]
        return p

    @wp.func
    def gather_sweep_point(at: State, how: How, c: Touched, i: int, touches: bool):
        p = SweepPoint()
        p.point = i
        p.d = at.d[i]
        if touches:
            p.a = at.a[i]
            if i < how.free:
                p.count = c.slots.count[i]
            if p.count > 0:
                p = read_sweep_contact(c, how, p, 0)
        return p

    @wp.func
    def project_sweep_point(how: How, c: Touched, p: SweepPoint, d: t.vec3, writes: bool):
        soft = soften(c.rows, how.g)
        d, P, pressed = meet(p.n, p.b, p.a, p.gu, p.P, d, p.mu, soft)
        p.P = P
        most = pressed
        for slot in range(1, p.count):
            o = read_sweep_contact(c, how, p, slot)
            d, P, pressed = meet(o.n, o.b, p.a, o.gu, o.P, d, o.mu, soft)
            c.push[slot * c.slots.points + p.point] = P
            most = wp.max(most, pressed)
        if writes:
            c.push[p.point] = p.P
            c.slots.mark[p.point] = (c.slots.mark[p.point] & SUNK) | wp.where(most > real(0.0), TOUCHED, 0)
        return p, d

    return SweepPoint, gather_sweep_point, project_sweep_point


@wp.func
def spread_lanes(lane: int, every: int, threads: int):
    """Number of a thread of `every`, in blocks of `threads`: warps in a row are of different blocks. Few pairs keep few warps
    busy, which then have a multiprocessor each; 8 of one block would share it."""
    inside = lane % threads
    return (inside // WARP * (every // threads) + lane // threads) * WARP + inside % WARP


@cache
def all_sweeps_kernel(real, threads: int, touches: bool, turns: bool, module: str, cluster: int = 0):
    """Kernel: sweeps. threads: of a block; 1: of one thread, a CPU. touches: with contacts. turns: as `rows.press`. cluster:
    blocks that take up to FEW rows; 0: all blocks do."""
    Surfaces, Pairs, State, Sums = pairs.surface_type(real), pairs.pair_type(real), point_states(real), pairs.sum_type(real)
    (How, Touched), add, (Kept, keep, touch) = (sweep_order_types(real), pairs.pair_sum_apply_func(real),
                                                sweep_contact_funcs(real))
    ask, (Held, hold), act, write, lead_of = (row_active_func(real), held_type(real), pair_sweep_func(real),
                                              pair_write_func(real), nesterov_func(real))
    many, clusters, vec4 = threads > 1, cluster > 0, types(real).vec4

    @wp.func
    def all_threads_barrier(few: bool, how: How, turn: int):
        if wp.static(many):
            if few:
                cluster_barrier()
            else:
                grid_barrier(how.words, turn)
        return turn + 1

    @wp.func
    def enter_pair_weights(ids: wp.vec4i, b: vec4, how: How, side: int, to: Sums):
        """Adds the weights of a pair to its points, and lists those that had none: all at once, as each waits for memory."""
        before = wp.vec4i(0, 0, 0, 0)
        for c in range(4):
            before[c] = wp.atomic_add(to.share, ids[c], whole_point_weight(b[c]))
        some = int(0)
        for c in range(4):
            some += wp.where(before[c] == 0, 1, 0)
        if some > 0:
            place = wp.atomic_add(how.words, 3 + side, some)
            for c in range(4):
                if before[c] == 0:
                    how.moved[place] = ids[c]
                    place += 1

    @wp.func
    def choose_active_rows(at: State, how: How, k: int, near: Pairs, to: Sums, side: int, span: wp.vec2i):
        """Lists the rows that take part in sweeps from number k on, and the points that they move. span: lane, threads."""
        last = wp.where(k == how.count - 1, 1, 0)
        all = all_rows_asked(k, how.count)
        rows = wp.where(all, near.rows[0], how.words[5])
        i = span[0]
        while i < rows:
            j = int(i)
            if not all:
                j = near.seen[i]
            found = ask(at, how.climb, how.calm, last, j, near)
            if found == TAKES:
                enter_pair_weights(near.four[j], near.swept[4 * j + pairs.B], how, side, to)
                near.on[wp.atomic_add(how.words, 1 + side, 1)] = j
            if k == 0 and found > 0:
                near.seen[wp.atomic_add(how.words, 5, 1)] = j
            i += span[1]
        if span[0] == 0:
            how.words[2 - side] = 0
            how.words[4 - side] = 0

    @wp.func
    def move_swept_point(at: State, how: How, p: Kept, done: int, writes: bool, c: Touched, to: Sums):
        """A point goes as pairs have summed up, and then as its contacts say."""
        d = add(p.d, done, p.point, to)
        if wp.static(touches):
            if p.count > 0:
                p, d = touch(how, c, p, d, writes)
        at.d[p.point] = d
        p.d = d
        return p

    @wp.func
    def push_active_rows(s: Surfaces, at: State, how: How, span: wp.vec4i, lead: real, held: Held, near: Pairs, to: Sums):
        """(pair of this thread, most) behind one sweep of the pairs that take part. span: lane, threads, pairs, 1: pushes are
        written; lead: as `nesterov_func` has it, -2: in turn."""
        turn = lead < real(-1.0)
        most = real(0.0)
        j = span[0]
        if wp.static(many):
            if j < span[2]:
                held, _change = act(at, held, how.climb, False, lead, to)
                if span[3] > 0:
                    write(held, near.on[j], near)
            j += span[1]
        while j < span[2]:
            kept = bool(wp.static(not many)) and j < how.held.shape[0]
            other = Held()
            if wp.static(not many):
                if kept:
                    other = how.held[j]
            if not kept:
                other = hold(s, at, how.climb, turn, near.on[j], near, to)
            other, change = act(at, other, how.climb, turn, lead, to)
            if wp.static(not many):
                if kept:
                    how.held[j] = other
            if span[3] > 0 or not kept:
                write(other, near.on[j], near)
            most = wp.max(most, change)
            j += span[1]
        return held, most

    @wp.func
    def move_listed_points(at: State, how: How, span: wp.vec3i, done: int, kept: Kept, c: Touched, to: Sums):
        """The point of this thread, behind a move of all. span: lane, threads, points."""
        j = span[0]
        if wp.static(many):
            if j < span[2]:
                kept = move_swept_point(at, how, kept, done, done > 0, c, to)
            j += span[1]
        while j < span[2]:
            move_swept_point(at, how, keep(at, how, c, how.moved[j], bool(wp.static(touches))), done, True, c, to)
            j += span[1]
        return kept

    @wp.kernel(module=module, enable_backward=False, grid_stride=False, launch_bounds=threads,
               **({"cluster_dim": cluster} if clusters else {}))
    def sweep_pairs(s: Surfaces, at: State, how: How, c: Touched, near_at: wp.array(dtype=Pairs), words: wp.array(dtype=int),
                    to: Sums):
        near, lane = near_at[0], wp.tid()
        few = bool(wp.static(clusters)) and near.rows[0] <= FEW
        every = wp.where(few, int(wp.static(max(cluster, 1) * threads)), how.threads)
        if near.rows[0] == 0 or lane >= every:
            return
        if wp.static(many):
            lane = spread_lanes(lane, every, wp.static(threads))
        met, side, active, moved = int(1), int(1), int(0), int(0)
        held, kept = Held(), Kept()
        for k in range(how.count):
            last = wp.where(k == how.count - 1, 1, 0)
            more = wp.where(how.leads > 0, k, wp.where(k == how.spared, int(SPARED), int(-1)))
            turn = bool(wp.static(turns)) and more < 0 and words[pairs.NARROW] > 0
            if k % how.anew == 0 or last == 1:
                side = 1 - side
                choose_active_rows(at, how, k, near, to, side, wp.vec2i(lane, every))
                met = all_threads_barrier(few, how, met)
                active = how.words[1 + side]
                moved = how.words[3 + side]
                if wp.static(not many):
                    for j in range(wp.min(active, how.held.shape[0])):
                        how.held[j] = hold(s, at, how.climb, turn, near.on[j], near, to)
                if wp.static(many):
                    if lane < active:
                        held = hold(s, at, how.climb, False, near.on[lane], near, to)
                    if lane < moved:
                        kept = keep(at, how, c, how.moved[lane], bool(wp.static(touches)))
            done = wp.where(k == how.count - 2 or k % how.anew == how.anew - 1, 1, last)
            if not (turn and more == SPARED):
                lead = wp.where(turn, real(-2.0), lead_of(more, words))
                held, most = push_active_rows(s, at, how, wp.vec4i(lane, every, active, done), lead, held, near, to)
                if turn and most <= real(0.0):
                    active = 0
            met = all_threads_barrier(few, how, met)
            kept = move_listed_points(at, how, wp.vec3i(lane, every, moved), done, kept, c, to)
            met = all_threads_barrier(few, how, met)

    return sweep_pairs
