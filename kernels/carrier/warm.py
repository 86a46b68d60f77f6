"""Warm start: a pair begins a substep with the impulse that the pair of the same keys ended the last one with.

The last list is kept in the order of its keys, so that a pair finds itself by halving. An impulse is dropped where the normal
has turned by more than 60 degrees, and of others what would pull along the new normal; the first sweep projects the rest. What
is kept is the impulse behind `settle` (kernels/carrier/exchange.py), which holds nothing of what led out of an overlap.

What was solved stays solved with one sweep a substep (a column of six points at rest: 20 substeps within 1e-13 m, cold 5 cm
lower). It is no soft contact: a column that starts without impulses, with one or two sweeps a substep, swings by 5 mm, since
hard contacts then correct places and begin with impulses that were not theirs.
"""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.carrier.pairs import ABSENT, lists
from wsim.kernels.math.real import types

TURNED = 0.5                         # cosine of the angle by which a normal may turn


@cache
def lasts(real):
    """Struct of the last list, (capacity,); rows that are not in use have the key ABSENT."""
    t = types(real)

    @wp.struct
    class Last:
        key_a: wp.array(dtype=wp.int64)
        key_b: wp.array(dtype=wp.int64)
        n: wp.array(dtype=t.vec3)
        push: wp.array(dtype=t.vec3)              # [N s]

    return Last


@cache
def keep(real, module):
    """Kernel over the room: the list becomes the last one."""
    Pairs, Last = lists(real), lasts(real)

    def keep(pairs: Pairs, out: Last):
        i = wp.tid()
        if i < pairs.count[0]:
            out.key_a[i] = pairs.key_a[i]
            out.key_b[i] = pairs.key_b[i]
            out.n[i] = pairs.n[i]
            out.push[i] = pairs.total[i]
        else:
            out.key_a[i] = ABSENT
            out.key_b[i] = ABSENT

    return wp.kernel(keep, name=f"keep_pairs_{types(real).name}", module=module, enable_backward=False)


@cache
def recall(real, module):
    """Kernel over the room: impulses of the last list, for pairs that were in it."""
    t, Pairs, Last = types(real), lists(real), lasts(real)

    @wp.func
    def before(a: wp.int64, b: wp.int64, c: wp.int64, d: wp.int64):
        """Whether the keys (a, b) stand before (c, d)."""
        return a < c or (a == c and b < d)

    def recall(pairs: Pairs, last: Last, room: int, push_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if i >= pairs.count[0]:
            return
        a = pairs.key_a[i]
        b = pairs.key_b[i]
        low = int(0)
        high = room
        while low < high:
            middle = (low + high) // 2
            if before(last.key_a[middle], last.key_b[middle], a, b):
                low = middle + 1
            else:
                high = middle
        found = t.vec3()
        if low < room:
            if last.key_a[low] == a and last.key_b[low] == b:
                n = pairs.n[i]
                if wp.dot(last.n[low], n) > real(TURNED):
                    found = last.push[low]
                    found = found - wp.min(wp.dot(found, n), real(0.0)) * n
        push_out[i] = found

    return wp.kernel(recall, name=f"recall_pairs_{t.name}", module=module, enable_backward=False)


@cache
def give(a: Any, b: Any, real, module):
    """Kernel over the threads that walk a group: both sides take the impulses that pairs begin with."""
    A, B, Pairs = a(real), b(real), lists(real)

    def give(data_a: A.Data, data_b: B.Data, pairs: Pairs, walk: wp.vec2i, out_a: A.Pushed, out_b: B.Pushed):
        s = pairs.first[walk[0]] + wp.tid()
        last = pairs.first[walk[0] + 1]
        while s < last:
            i = pairs.order[s]
            s += walk[1]
            P = pairs.push[i]
            A.take(data_a, pairs.id_a[i], pairs.at_a[i], P, out_a)
            B.take(data_b, pairs.id_b[i], pairs.at_b[i], -P, out_b)

    return wp.kernel(give, name=f"give_{A.name}_{B.name}_{types(real).name}", module=module, enable_backward=False)
