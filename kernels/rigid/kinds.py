"""Kinds of constraints between rigid bodies, and walks over those of a kind: in any order, or colour by colour.

A kind (contacts, joints) is a row of functions, see `Kind`. No body occurs twice in a colour, so its constraints may be solved
at the same time; those of colour SERIAL, which found no other, are taken in turn by one thread. A walk is a function that all
threads call, i of so many; on a CPU there is one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from wsim.kernels.rigid.contact import whole

BLOCK = wp.constant(256)          # threads of a block of a cluster
SERIAL = wp.constant(60)          # colours whose constraints are solved at the same time; the next is solved in turn


@dataclass(frozen=True)
class Kind:
    """Functions of a kind of constraints; j: one of them, k: substep, slot: its place in the order of colours.

    prepare(j, k, rig)               arms and the like, as bodies are where substep k begins
    warm(j, k, h, rig)               impulses of the substep before
    solve(j, k, h, biased, rig)      one sweep; biased 1: with what closes gaps and errors, 0: without (relax)
    colours(rig)                     how many
    start(colour, rig)               first slot of a colour; start(colours) is the end
    item(slot, rig)                  j
    """

    name: str
    prepare: Any
    warm: Any
    solve: Any
    colours: Any
    start: Any
    item: Any


@dataclass(frozen=True)
class Act:
    """Functions of one shape, (j, k, h, biased, rig), of a kind: what `by_colour` and `at_once` walk with."""

    prepare: Any
    warm: Any
    solve: Any


def acts(kind: Kind, real) -> Act:
    Rig, prepare_one, warm_one = whole(real), kind.prepare, kind.warm

    @wp.func
    def prepare(j: int, k: int, h: real, biased: int, rig: Rig):
        prepare_one(j, k, rig)

    @wp.func
    def warm(j: int, k: int, h: real, biased: int, rig: Rig):
        warm_one(j, k, h, rig)

    return Act(prepare, warm, kind.solve)


@wp.func
def spread(i: int, threads: int):
    """Which constraint thread i begins with. The first warps of all blocks come before their second ones: those of a colour
    seldom fill more than a few warps, which wait for one another on one multiprocessor."""
    first = i
    if threads % BLOCK == 0:
        blocks = threads // BLOCK
        first = ((i % BLOCK) // 32 * blocks + i // BLOCK) * 32 + i % 32
    return first


def in_colour(kind: Kind, act, real):
    """Function: constraints of one colour, by thread i of so many."""
    Rig, start, item = whole(real), kind.start, kind.item

    @wp.func
    def walk(colour: int, i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        last = start(colour + 1, rig)
        slot = start(colour, rig) + spread(i, threads)
        stride = threads
        if colour >= SERIAL:
            stride = 1
            if i > 0:
                slot = last
        while slot < last:
            act(item(slot, rig), k, h, biased, rig)
            slot += stride

    return walk


def by_colour(kind: Kind, act, meet, real):
    """Function: all constraints of a kind, colour by colour."""
    Rig, colours, walk = whole(real), kind.colours, in_colour(kind, act, real)

    @wp.func
    def sweep(i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        for colour in range(colours(rig)):
            walk(colour, i, threads, k, h, biased, rig)
            meet()

    return sweep


def at_once(kind: Kind, act, real):
    """Function: all constraints of a kind, whatever their colours: what they change is their own."""
    Rig, colours, start, item = whole(real), kind.colours, kind.start, kind.item

    @wp.func
    def walk(i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        for slot in range(start(0, rig) + spread(i, threads), start(colours(rig), rig), threads):
            act(item(slot, rig), k, h, biased, rig)

    return walk


def in_turn(walks: Sequence, real):
    """Function that calls all of them."""
    Rig = whole(real)
    if len(walks) == 1:
        return walks[0]
    head, tail = walks[0], in_turn(walks[1:], real)

    @wp.func
    def both(i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        head(i, threads, k, h, biased, rig)
        tail(i, threads, k, h, biased, rig)

    return both
