"""Kinds of constraints between rigid bodies, and walks over those of a kind: in any order, or colour by colour.

A kind (contacts, joints) is a row of functions, see `ConstraintKind`. No body occurs twice in a colour, so its constraints may
be solved at the same time; those of colour SERIAL, which found no other, are taken in turn by one thread. A walk is a function
that all threads call, i of so many; on a CPU there is one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import warp as wp

from wsim.kernels.rigid.contact import rig_type

BLOCK = wp.constant(256)          # threads of a block of a cluster
SERIAL = wp.constant(60)          # colours whose constraints are solved at the same time; the next is solved in turn


@dataclass(frozen=True)
class ConstraintKind:
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
class KindActs:
    """Functions of one shape, (j, k, h, biased, rig), of a kind: what `by_colour` and `at_once_func` walk with."""

    prepare: Any
    warm: Any
    solve: Any


def acts_of_kind(kind: ConstraintKind, real) -> KindActs:
    Rig, prepare_one, warm_one = rig_type(real), kind.prepare, kind.warm

    @wp.func
    def prepare_constraint(j: int, k: int, h: real, biased: int, rig: Rig):
        prepare_one(j, k, rig)

    @wp.func
    def warm_start_constraint(j: int, k: int, h: real, biased: int, rig: Rig):
        warm_one(j, k, h, rig)

    return KindActs(prepare_constraint, warm_start_constraint, kind.solve)


@wp.func
def first_of_thread(i: int, threads: int):
    """Which constraint thread i begins with. The first warps of all blocks come before their second ones: those of a colour
    seldom fill more than a few warps, which wait for one another on one multiprocessor."""
    first = i
    if threads % BLOCK == 0:
        blocks = threads // BLOCK
        first = ((i % BLOCK) // 32 * blocks + i // BLOCK) * 32 + i % 32
    return first


def in_colour(kind: ConstraintKind, act, real):
    """Function: constraints of one colour, by thread i of so many."""
    Rig, start, item = rig_type(real), kind.start, kind.item

    @wp.func
    def walk_one_colour(colour: int, i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        last = start(colour + 1, rig)
        slot = start(colour, rig) + first_of_thread(i, threads)
        stride = threads
        if colour >= SERIAL:
            stride = 1
            if i > 0:
                slot = last
        while slot < last:
            act(item(slot, rig), k, h, biased, rig)
            slot += stride

    return walk_one_colour


def by_colour(kind: ConstraintKind, act, meet, real):
    """Function: all constraints of a kind, colour by colour."""
    Rig, colours, walk = rig_type(real), kind.colours, in_colour(kind, act, real)

    @wp.func
    def sweep_by_colour(i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        for colour in range(colours(rig)):
            walk(colour, i, threads, k, h, biased, rig)
            meet()

    return sweep_by_colour


def at_once_func(kind: ConstraintKind, act, real):
    """Function: all constraints of a kind, whatever their colours: what they change is their own."""
    Rig, colours, start, item = rig_type(real), kind.colours, kind.start, kind.item

    @wp.func
    def walk_all_constraints(i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        for slot in range(start(0, rig) + first_of_thread(i, threads), start(colours(rig), rig), threads):
            act(item(slot, rig), k, h, biased, rig)

    return walk_all_constraints


def walk_in_turn_func(walks: Sequence, real):
    """Function that calls all of them."""
    Rig = rig_type(real)
    if len(walks) == 1:
        return walks[0]
    head, tail = walks[0], walk_in_turn_func(walks[1:], real)

    @wp.func
    def walk_both_in_turn(i: int, threads: int, k: int, h: real, biased: int, rig: Rig):
        head(i, threads, k, h, biased, rig)
        tail(i, threads, k, h, biased, rig)

    return walk_both_in_turn
