"""All sweeps of a call in one launch (kernels/selfcontact/rows.py, in turn with contacts of points with colliders:
kernels/contact/project.py). Its threads meet behind each part of a sweep: which pairs take part, their pushes, points' moves.

Points that no pair pushes stay as they are: their contacts were projected before. On a GPU a thread keeps the pair that it
pushes, and the point that it moves, for as long as the same take part; of more than there are threads the others are read in
each sweep. Few pairs are one block's (sweeps/memory.py); few rows are a cluster's, whose blocks meet in a fraction of the time
that those of a grid take.

Results do not depend on which thread comes first: points sum in whole numbers, and each is moved by one thread.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled; `a if c else b` works out both.
# ruff: noqa: SIM102, SIM108, UP018

from functools import cache

import warp as wp

from wsim.kernels.math.block import meet, meet_cluster, meet_grid
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.selfcontact import pairs
from wsim.kernels.selfcontact.couple import holding
from wsim.kernels.selfcontact.rows import SPARED, TAKES, asked, asking, leads, pressing, weight, writing
from wsim.kernels.selfcontact.sweeps import memory
from wsim.kernels.selfcontact.sweeps.points import moving, orders, touching, turning

BLOCK = 256            # threads of one on a GPU, for which there are 255 registers each
NOBODY = 1 << 30       # number of a thread that has nothing to do
FEW = 1 << 14          # rows that one cluster takes, of more blocks
WORDS = 6              # where blocks meet; rows that take part and points that they move, of this turn of asking and the next;
                       # rows that are asked between sweeps


@cache
def choosing(real):
    """Function (at, how, k, near, to, side, span): lists the rows that take part in sweeps from number k on, and the points
    that they move. side: which words count them; span: lane, threads."""
    Pairs, State, Sums = pairs.lists(real), states(real), pairs.sums(real)
    How, ask, vec4 = orders(real)[0], asking(real), types(real).vec4

    @wp.func
    def enter(ids: wp.vec4i, b: vec4, how: How, side: int, to: Sums):
        """Adds the weights of a pair to its points, and lists those that had none: all at once, as each waits for memory."""
        before = wp.vec4i(0, 0, 0, 0)
        for c in range(4):
            before[c] = wp.atomic_add(to.share, ids[c], weight(b[c]))
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
    def choose(at: State, how: How, k: int, near: Pairs, to: Sums, side: int, span: wp.vec2i):
        last = wp.where(k == how.count - 1, 1, 0)
        all = asked(k, how.count)
        rows = wp.where(all, near.rows[0], how.words[5])
        i = span[0]
        while i < rows:
            j = int(i)
            if not all:
                j = near.seen[i]
            found = ask(at, how.climb, how.calm, last, j, near)
            if found == TAKES:
                enter(near.four[j], near.swept[4 * j + pairs.B], how, side, to)
                near.on[wp.atomic_add(how.words, 1 + side, 1)] = j
            if k == 0 and found > 0:
                near.seen[wp.atomic_add(how.words, 5, 1)] = j
            i += span[1]
        if span[0] == 0:
            how.words[2 - side] = 0
            how.words[4 - side] = 0

    return choose


@cache
def sharing(real, threads: int):
    """Function (at, how, given, to) -> what a thread does until it is asked anew. given: lane, threads of all blocks, pairs,
    points. Few pairs are the first block's, whose points go to its memory."""
    State, Sums, How, Turn = states(real), pairs.sums(real), orders(real)[0], turning(real)
    (place_moves, place_sums), room, vec3 = memory.places(real), memory.ROOM[real], types(real).vec3

    @wp.func
    def begin_alone(at: State, how: How, now: Turn):
        j = now.own
        while j < now.moved:
            i = how.moved[j]
            how.slot[i] = j
            now.d[j] = at.d[i]
            for k in range(3):
                now.sum[3 * j + k] = wp.int64(0)
            j += now.each
        if now.own < now.each:
            meet()

    @wp.func
    def share_out(at: State, how: How, given: wp.vec4i, to: Sums):
        now = Turn()
        now.own = given[0]
        now.each = given[1]
        now.active = given[2]
        now.moved = given[3]
        now.d = at.d
        now.sum = to.move
        if now.active <= how.alone and now.moved <= wp.static(room):
            now.alone = 1
            now.own = wp.where(given[0] < wp.static(threads), given[0], NOBODY)
            now.each = wp.static(threads)
            now.d = wp.array(ptr=place_moves(), shape=(wp.static(room),), dtype=vec3)
            now.sum = wp.array(ptr=place_sums(), shape=(wp.static(3 * room),), dtype=wp.int64)
        if now.alone > 0:
            begin_alone(at, how, now)
        return now

    return share_out


@cache
def reading(real, many: bool):
    """Function (s, at, how, now, turn, near, to) -> the first pair of this thread; it keeps the others as well."""
    Surfaces, Pairs, State, Sums = pairs.surfaces(real), pairs.lists(real), states(real), pairs.sums(real)
    (Held, hold), How, Turn, put_pair = holding(real), orders(real)[0], turning(real), memory.pooling(real)[0]
    kept_pairs = capacity(real, many)

    @wp.func
    def read_pairs(s: Surfaces, at: State, how: How, now: Turn, turn: bool, near: Pairs, to: Sums):
        held = Held()
        j = now.own
        while j < wp.min(now.active, kept_pairs(how)):
            other = hold(s, at, how.climb, turn, near.on[j], near, to)
            if now.alone > 0:
                for k in range(4):
                    other.ids[k] = how.slot[other.ids[k]]
            if wp.static(not many):
                how.held[j] = other
            elif j < now.each:
                held = other
            else:
                put_pair(how.pool, j, other)
            j += now.each
        return held

    return read_pairs


@cache
def capacity(real, many: bool):
    """Function: pairs that are not read anew in each sweep, at most."""
    How, size = orders(real)[0], wp.types.type_size_in_bytes(holding(real)[0]) // 4

    @wp.func
    def kept_pairs(how: How):
        return wp.where(wp.static(many), how.pool.shape[0] // wp.static(size), how.held.shape[0])

    return kept_pairs


@cache
def pushing(real, many: bool):
    """Function (s, at, how, now, lead, held, near, to) -> (pair of this thread, most) behind one sweep of the pairs that take
    part. lead: as `leads` has it, -2: in turn."""
    Surfaces, Pairs, State, Sums = pairs.surfaces(real), pairs.lists(real), states(real), pairs.sums(real)
    (Held, hold), How, Turn, write = holding(real), orders(real)[0], turning(real), writing(real)
    act, kept_pairs = pressing(real, memory.adding_whole(real) if many else None), capacity(real, many)
    _, put_push, take_pair = memory.pooling(real)

    @wp.func
    def push(s: Surfaces, at: State, how: How, now: Turn, lead: real, held: Held, near: Pairs, to: Sums):
        turn = lead < real(-1.0)
        use, sums = State(), Sums()
        use.d = now.d
        sums.move = now.sum
        most = real(0.0)
        j = now.own
        while j < now.active:
            kept = j < kept_pairs(how)
            other = held
            if not kept:
                other = hold(s, at, how.climb, turn, near.on[j], near, to)
            elif wp.static(not many):
                other = how.held[j]
            elif j >= now.each:
                other = take_pair(how.pool, j)
            other, change = act(use, other, how.climb, turn, lead, sums)
            if kept:
                if wp.static(not many):
                    how.held[j] = other
                elif j < now.each:
                    held = other
                else:
                    put_push(how.pool, j, other)
            if now.done > 0 or not kept:
                write(other, near.on[j], near)
            most = wp.max(most, change)
            j += now.each
        return held, most

    return push


@cache
def sweep(real, threads: int, touches: bool, turns: bool, module: str, cluster: int = 0):
    """Kernel: sweeps. threads: of a block; 1: of one thread, a CPU. touches: with contacts. turns: as `rows.press`. cluster:
    blocks that take up to FEW rows; 0: all blocks do."""
    Surfaces, Pairs, State, Sums = pairs.surfaces(real), pairs.lists(real), states(real), pairs.sums(real)
    (How, Touched), (Kept, keep, _), Turn = orders(real), touching(real), turning(real)
    many, clusters = threads > 1, cluster > 0
    choose, lead_of, (Held, _) = choosing(real), leads(real), holding(real)
    read_pairs, push, move = reading(real, many), pushing(real, many), moving(real, touches, many)
    share_out = sharing(real, threads)

    @wp.func
    def together(few: bool, how: How, turn: int):
        if wp.static(many):
            if few:
                meet_cluster()
            else:
                meet_grid(how.words, turn)
        return turn + 1

    @wp.func
    def within(few: bool, how: How, turn: int, alone: bool, lane: int):
        """As `together`; of one block alone its own threads meet."""
        if alone:
            if lane < wp.static(threads):
                meet()
            return turn
        return together(few, how, turn)

    @wp.kernel(module=module, enable_backward=False, grid_stride=False, launch_bounds=(threads, 1),
               **({"cluster_dim": cluster} if clusters else {}))
    def sweep_pairs(s: Surfaces, at: State, how: How, c: Touched, near_at: wp.array(dtype=Pairs), words: wp.array(dtype=int),
                    to: Sums):
        near, lane = near_at[0], wp.tid()
        few = bool(wp.static(clusters)) and near.rows[0] <= FEW
        every = wp.where(few, int(wp.static(max(cluster, 1) * threads)), how.threads)
        if near.rows[0] == 0 or lane >= every:
            return
        met, side = int(1), int(1)
        held, kept, now = Held(), Kept(), Turn()
        for k in range(how.count):
            last = wp.where(k == how.count - 1, 1, 0)
            more = wp.where(how.leads > 0, k, wp.where(k == how.spared, int(SPARED), int(-1)))
            turn = bool(wp.static(turns)) and more < 0 and words[pairs.NARROW] > 0
            if k % how.anew == 0 or last == 1:
                side = 1 - side
                choose(at, how, k, near, to, side, wp.vec2i(lane, every))
                met = together(few, how, met)
                now = share_out(at, how, wp.vec4i(lane, every, how.words[1 + side], how.words[3 + side]), to)
                held = read_pairs(s, at, how, now, turn, near, to)
                if wp.static(many):
                    if now.own < now.moved:
                        kept = keep(at, how, c, how.moved[now.own], bool(wp.static(touches)))
            now.done = wp.where(k == how.count - 2 or k % how.anew == how.anew - 1, 1, last)
            if not (turn and more == SPARED):
                lead = wp.where(turn, real(-2.0), lead_of(more, words))
                held, most = push(s, at, how, now, lead, held, near, to)
                if turn and most <= real(0.0):
                    now.active = 0
            met = within(few, how, met, now.alone > 0, lane)
            kept = move(at, how, now, kept, c, to)
            met = within(few, how, met, now.alone > 0 and now.done == 0, lane)

    return sweep_pairs
