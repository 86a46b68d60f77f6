"""All sweeps of a call in one launch (kernels/selfcontact/rows.py, in turn with contacts of points with colliders:
kernels/contact/project.py). Its blocks meet behind each part of a sweep: which pairs take part, their pushes, points' moves.

The same bits as a launch for each part has: points sum in whole numbers, and nothing else depends on which thread comes first.
A frame of scenes/ribbon.usda has 864 sweeps, of three or four launches each.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache

import warp as wp

from wsim.kernels.contact.project import projecting, slots, tables
from wsim.kernels.math.block import meet_grid
from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.selfcontact import pairs
from wsim.kernels.selfcontact.rows import SPARED, asking, leads, pressing

BLOCK = 256            # threads of one on a GPU


@cache
def orders(real):
    """(How, Touched): structs of what a call asks for, and of contacts with colliders."""
    t = types(real)
    Rows, Points = tables(real)
    Slots = slots(real)

    @wp.struct
    class How:
        climb: t.scalar                           # as `rows.lean` has it [m]; calm likewise
        calm: t.scalar
        g: t.scalar                               # effective step of contacts [s]
        count: int                                # sweeps
        anew: int                                 # behind which it is asked anew what takes part
        leads: int                                # 1: they lead ahead
        spared: int                               # number of the sweep that is left out where pairs are taken in turn
        points: int                               # that pairs move
        free: int                                 # of them, that have contacts
        threads: int                              # of all blocks
        word: wp.array(dtype=int)                 # where they meet, 0 before the launch

    @wp.struct
    class Touched:
        rows: Rows
        points: Points
        slots: Slots
        push: wp.array(dtype=t.vec3)              # P of each slot

    return How, Touched


@cache
def sweep(real, threads: int, touches: bool, turns: bool, module: str):
    """Kernel: sweeps. threads: of a block; 1: of one thread, a CPU. touches: with contacts. turns: as `rows.press`."""
    Surfaces, Pairs, State, Sums = pairs.surfaces(real), pairs.lists(real), states(real), pairs.sums(real)
    (How, Touched), add, project = orders(real), pairs.adding(real), projecting(real)
    ask, one, lead_of = asking(real), pressing(real), leads(real)

    @wp.func
    def together(how: How, turn: int):
        if wp.static(threads > 1):
            meet_grid(how.word, turn)
        return turn + 1

    @wp.func
    def press(s: Surfaces, at: State, how: How, more: int, near: Pairs, words: wp.array(dtype=int), to: Sums, lane: int):
        """One sweep of the pairs that take part."""
        turn = wp.static(turns) and more < 0 and words[pairs.NARROW] > 0
        if turn and more == SPARED:
            return
        lead = lead_of(more, words)
        most = real(0.0)
        j = int(lane)
        while j < near.active[0]:
            most = wp.max(most, one(s, at, how.climb, turn, lead, near.on[j], near, to))
            j += how.threads
        if turn and most <= real(0.0):
            near.active[0] = 0

    @wp.func
    def move(at: State, how: How, done: int, touch: Touched, to: Sums, lane: int):
        """Points go as pairs have summed up, and then as their contacts say."""
        i = int(lane)
        while i < how.points:
            if to.share[i] > 0:
                at.d[i] = add(at.d[i], done, i, to)
            if wp.static(touches):
                if i < how.free:
                    if touch.slots.count[i] > 0:
                        at.d[i] = project(touch.rows, touch.points, touch.slots, i, how.g,
                                          wp.matrix_from_rows(at.d[i], at.a[i]), touch.push, touch.push)
            i += how.threads

    @wp.kernel(module=module, enable_backward=False, launch_bounds=threads)
    def sweep_pairs(s: Surfaces, at: State, how: How, touch: Touched, near_at: wp.array(dtype=Pairs),
                    words: wp.array(dtype=int), to: Sums):
        near = near_at[0]
        lane = wp.tid()
        met = int(1)
        for k in range(how.count):
            last = int(0)
            if k == how.count - 1:
                last = 1
            if k % how.anew == 0 or last == 1:
                if lane == 0:
                    near.active[0] = 0
                met = together(how, met)
                j = int(lane)
                while j < near.rows[0]:
                    ask(at, how.climb, how.calm, last, j, near, to)
                    j += how.threads
                met = together(how, met)
            more = int(-1)
            if how.leads > 0:
                more = k
            elif k == how.spared:
                more = SPARED
            press(s, at, how, more, near, words, to, lane)
            met = together(how, met)
            done = last
            if k == how.count - 2 or k % how.anew == how.anew - 1:
                done = 1
            move(at, how, done, touch, to, lane)
            met = together(how, met)

    return sweep_pairs
