"""Who owns a pair while impulses are exchanged: a colour. No two pairs of a colour move one thing, so that it is one launch.

Colours are found on the device by Jones and Plassmann's method (1993): each pair has a number of its own, scattered from its
rank in the order of the keys (`scatter` is one to one). A pair whose number is the least among the uncoloured ones at all that
it moves takes the first colour that is free there, and so on, round by round, until all have one. The numbers are claimed by an
integer minimum, which knows no order: colours follow from the keys alone, and so do all bits of the result.

Where all colours are taken at a vertex, what is left there is the remainder, which one thread walks in the order of the keys.
That is right, and slow: a body under many points wants an owner of its own (a star around the body). What moves nothing (two
kinematic sides) is not in any group.

Groups, colour by colour and in it combination by combination: number colour * combinations + kind; the remainder is the last
colour.

Convergence: sweeps over colours are projected Gauss-Seidel. On a chain of n pairs between equal masses the slowest error falls
by cos^2 (pi / (n + 1)), about 1 - (pi / n)^2, a sweep; Jacobi with split masses, which needs no colours, takes four times as
many sweeps there: (1 + cos (pi / (n + 1))) / 2.

The kernels of kernels/carrier/exchange.py know nothing of colours: they walk a group. Another owner is another grouping, as
long as what runs at once moves no thing twice.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.carrier.pairs import lists
from wsim.kernels.carrier.points import CORNERS
from wsim.kernels.math.real import types

ODD = wp.constant(wp.uint32(0x7feb352d))
OTHER_ODD = wp.constant(wp.uint32(0x846ca68b))
FREE = wp.constant(wp.uint32(0xffffffff))            # of a claim: nobody's
NONE, UNCOLOURED = -2, -1                            # of a colour: moves nothing; not yet


@wp.func
def scatter(rank: int):
    """A bijection of 32 bits (two multiplications by odd numbers between shifts)."""
    r = wp.uint32(rank)
    r = (r ^ (r >> wp.uint32(16))) * ODD
    r = (r ^ (r >> wp.uint32(15))) * OTHER_ODD
    return r ^ (r >> wp.uint32(16))


@cache
def sides():
    """Struct of what pairs move, and of their colours."""

    @wp.struct
    class Coloring:
        a: wp.array(dtype=wp.vec4i)               # vertices of side a, -1: none, (capacity,)
        b: wp.array(dtype=wp.vec4i)
        claim: wp.array(dtype=wp.uint32)          # least number of those that are not coloured, (vertices,)
        taken: wp.array(dtype=wp.int64)           # bits of the colours there
        colour: wp.array(dtype=int)               # (capacity,)
        left: wp.array(dtype=int)                 # whether some pair has no colour yet, (1,)
        going: wp.array(dtype=int)

    return Coloring


@cache
def vertices(a: Any, b: Any, real, module):
    """Kernel over the room: what pairs of the carriers a and b move; kind: of this combination."""
    A, B, Pairs, Coloring = a(real), b(real), lists(real), sides()

    def vertices(pairs: Pairs, kind: int, data_a: A.Data, data_b: B.Data, out: Coloring):
        i = wp.tid()
        if i >= pairs.count[0]:
            return
        if pairs.kind[i] != kind:
            return
        found_a = wp.vec4i()
        found_b = wp.vec4i()
        least = int(-1)
        for k in range(CORNERS):
            found_a[k] = A.vertex(data_a, pairs.id_a[i], pairs.at_a[i], k)
            found_b[k] = B.vertex(data_b, pairs.id_b[i], pairs.at_b[i], k)
            least = wp.max(least, wp.max(found_a[k], found_b[k]))
        out.a[i] = found_a
        out.b[i] = found_b
        out.colour[i] = wp.where(least < 0, wp.static(NONE), wp.static(UNCOLOURED))

    return wp.kernel(vertices, name=f"vertices_{A.name}_{B.name}_{types(real).name}", module=module, enable_backward=False)


@wp.func
def vertex(a: wp.vec4i, b: wp.vec4i, k: int):
    """The k-th of eight."""
    if k < CORNERS:
        return a[k]
    return b[k - CORNERS]


@cache
def claim(module):
    """Kernel over the room: uncoloured pairs put their numbers where they move something."""
    Coloring = sides()

    def claim(count: wp.array(dtype=int), c: Coloring):
        i = wp.tid()
        if i == 0:
            c.left[0] = 0
        if i >= count[0]:
            return
        if c.colour[i] != UNCOLOURED:
            return
        for k in range(2 * CORNERS):
            at = vertex(c.a[i], c.b[i], k)
            if at >= 0:
                wp.atomic_min(c.claim, at, scatter(i))

    return wp.kernel(claim, name="claim_colour", module=module, enable_backward=False)


@cache
def pick(module):
    """Kernel over the room: who has the least number everywhere takes the first free of `colours`; where none is free, the
    remainder. It frees its claims: others that look at the same time lose there before and after."""
    Coloring = sides()

    def pick(count: wp.array(dtype=int), colours: int, c: Coloring):
        i = wp.tid()
        if i >= count[0]:
            return
        if c.colour[i] != UNCOLOURED:
            return
        own = scatter(i)
        least = int(1)
        taken = wp.int64(0)
        for k in range(2 * CORNERS):
            at = vertex(c.a[i], c.b[i], k)
            if at >= 0:
                if c.claim[at] != own:
                    least = int(0)
                taken = taken | c.taken[at]
        if least == 0:
            c.left[0] = 1
            return
        found = int(0)
        while found < colours and ((taken >> wp.int64(found)) & wp.int64(1)) != wp.int64(0):
            found += 1
        c.colour[i] = found
        for k in range(2 * CORNERS):
            at = vertex(c.a[i], c.b[i], k)
            if at >= 0:
                c.claim[at] = FREE
                if found < colours:
                    c.taken[at] = c.taken[at] | (wp.int64(1) << wp.int64(found))

    return wp.kernel(pick, name="pick_colour", module=module, enable_backward=False)


@cache
def proceed(module):
    """Kernel of one thread: whether there is another round."""
    Coloring = sides()

    def proceed(c: Coloring):
        c.going[0] = c.left[0]

    return wp.kernel(proceed, name="proceed_colour", module=module, enable_backward=False)


@cache
def number(module):
    """Kernel over the room: the group of each pair, or one behind the last."""

    def number(count: wp.array(dtype=int), colour: wp.array(dtype=int), kind: wp.array(dtype=int), combinations: int,
               groups: int, key_out: wp.array(dtype=int), row_out: wp.array(dtype=int)):
        i = wp.tid()
        found = groups
        if i < count[0]:
            if colour[i] >= 0:
                found = colour[i] * combinations + kind[i]
        key_out[i] = found
        row_out[i] = i

    return wp.kernel(number, name="number_groups", module=module, enable_backward=False)


@cache
def bounds(module):
    """Kernel over groups + 1: where each begins among the sorted numbers."""

    def bounds(keys: wp.array(dtype=int), room: int, first_out: wp.array(dtype=int)):
        group = wp.tid()
        low = int(0)
        high = room
        while low < high:
            middle = (low + high) // 2
            if keys[middle] < group:
                low = middle + 1
            else:
                high = middle
        first_out[group] = low

    return wp.kernel(bounds, name="bounds_of_groups", module=module, enable_backward=False)
