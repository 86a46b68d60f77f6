"""The list of pairs of features in contact, its keys and its order.

A search appends pairs in any order (`add`, one integer atomic a pair) up to the room that there is, and says how many it
wanted. Then they are put in the order of their keys: what follows depends on which pairs there are, not on who found them.
A key is 63 bits: kind of the feature (7), object (24), number within it (32); it holds no place, so that it is the same from
substep to substep and wherever the scene stands. Two features make one pair: key_a, key_b, found once.

Warp has no indirect launch: lists are walked by a fixed number of threads up to a count on the device.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

ABSENT = wp.constant(wp.int64(0x7fffffffffffffff))          # the key of no pair


@wp.func
def key(kind: int, object: int, feature: int):
    """Of a feature. kind < 128, object < 2^24, feature < 2^31."""
    return (wp.int64(kind) << wp.int64(56)) | (wp.int64(object) << wp.int64(32)) | wp.int64(feature)


@cache
def lists(real):
    """Struct of pairs, all arrays of (capacity,) but count."""
    t = types(real)

    @wp.struct
    class Pairs:
        capacity: int
        h: real                                   # substep [s]
        recovery: real                            # greatest speed out of an overlap [m/s]
        slow: real                                # approach below which a pair does not throw back [m/s]
        count: wp.array(dtype=int)                # (1,)
        kind: wp.array(dtype=int)                 # which two carriers
        key_a: wp.array(dtype=wp.int64)
        key_b: wp.array(dtype=wp.int64)
        id_a: wp.array(dtype=wp.vec4i)            # features, as the carriers have them
        id_b: wp.array(dtype=wp.vec4i)
        at_a: wp.array(dtype=t.vec3)
        at_b: wp.array(dtype=t.vec3)
        n: wp.array(dtype=t.vec3)                 # unit normal, from b to a
        gap: wp.array(dtype=t.scalar)             # n.(a - b) at the start of the substep less what is kept free [m]
        friction: wp.array(dtype=t.vec2)          # static, dynamic
        bounce: wp.array(dtype=t.vec2)            # restitution; n.(velocity of a - of b) before [m/s]
        first: wp.array(dtype=int)                # of each group in `order`, (groups + 1,)
        order: wp.array(dtype=int)                # pairs, group by group
        push: wp.array(dtype=t.vec3)              # impulse that a has received in this substep and b its opposite [N s]
        aim: wp.array(dtype=t.vec3)               # relative velocity that it shall have in the end [m/s]
        sticks: wp.array(dtype=int)               # whether friction holds it
        left: wp.array(dtype=t.scalar)            # what the last sweep has left [m]
        total: wp.array(dtype=t.vec3)             # impulse with what restores the velocity [N s]

    return Pairs


@cache
def appending(real):
    """(add, put): functions of a search. add(pairs, kind, key_a, key_b) -> the row, or -1 where there is no room; put writes
    the features, the normal and the gap, all that a pair without friction has."""
    t, Pairs = types(real), lists(real)

    @wp.func
    def add(pairs: Pairs, kind: int, key_a: wp.int64, key_b: wp.int64):
        row = wp.atomic_add(pairs.count, 0, 1)
        if row >= pairs.capacity:
            row = int(-1)
        else:
            pairs.kind[row] = kind
            pairs.key_a[row] = key_a
            pairs.key_b[row] = key_b
            pairs.friction[row] = t.vec2()
            pairs.bounce[row] = t.vec2()
        return row

    @wp.func
    def put(pairs: Pairs, row: int, id_a: wp.vec4i, at_a: t.vec3, id_b: wp.vec4i, at_b: t.vec3, n: t.vec3, gap: real):
        pairs.id_a[row] = id_a
        pairs.at_a[row] = at_a
        pairs.id_b[row] = id_b
        pairs.at_b[row] = at_b
        pairs.n[row] = n
        pairs.gap[row] = gap

    return add, put


@cache
def tally(module):
    """Kernel of one thread: the count is no more than there was room for; wanted: most that was, where it was more."""

    def tally(capacity: int, count_out: wp.array(dtype=int), wanted: wp.array(dtype=int)):
        found = count_out[0]
        if found > capacity:
            wp.atomic_max(wanted, 0, found)
            count_out[0] = capacity

    return wp.kernel(tally, name="tally_pairs", module=module, enable_backward=False)


@cache
def rank(module):
    """Kernel over the room: what the next of two stable sorts goes by, key_b and then key_a of where the first has put them."""

    def rank(count: wp.array(dtype=int), keys: wp.array(dtype=wp.int64), again: int, key_out: wp.array(dtype=wp.int64),
             row_out: wp.array(dtype=int)):
        i = wp.tid()
        row = i
        if again != 0:
            row = row_out[i]
        found = ABSENT
        if row < count[0]:
            found = keys[row]
        key_out[i] = found
        row_out[i] = row

    return wp.kernel(rank, name="rank_pairs", module=module, enable_backward=False)


@cache
def permute(real, module):
    """Kernel over the room: pairs in the order of their keys, without an impulse."""
    t, Pairs = types(real), lists(real)

    def permute(found: Pairs, row: wp.array(dtype=int), out: Pairs):
        i = wp.tid()
        if i == 0:
            out.count[0] = found.count[0]
        if i < found.count[0]:
            j = row[i]
            out.kind[i] = found.kind[j]
            out.key_a[i] = found.key_a[j]
            out.key_b[i] = found.key_b[j]
            out.id_a[i] = found.id_a[j]
            out.id_b[i] = found.id_b[j]
            out.at_a[i] = found.at_a[j]
            out.at_b[i] = found.at_b[j]
            out.n[i] = found.n[j]
            out.gap[i] = wp.max(found.gap[j], -found.recovery * found.h)
            out.friction[i] = found.friction[j]
            out.bounce[i] = found.bounce[j]
            out.push[i] = t.vec3()
            out.total[i] = t.vec3()

    return wp.kernel(permute, name=f"permute_pairs_{t.name}", module=module, enable_backward=False)
