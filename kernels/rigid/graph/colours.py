"""Colours of manifolds: no two of one colour have a body in common, colliders aside, so that they can be solved together.

A pair that had a colour keeps it. Of the others, in rounds, each asks both its bodies; a body grants the one of least rank, and
who is granted by all takes the least colour that neither body has yet (Jones and Plassmann 1993, on the edges of the graph of
bodies). Ranks are a bijection of the place in the list that mixes its bits: neighbours do not wait in a row. Colours so depend
on the list alone, not on the order of threads. What finds no colour below SERIAL within ROUNDS becomes SERIAL, and is solved in
turn. Manifolds without points have none. At last they are sorted by colour. All stays as it is where none was made.
"""

from functools import cache

import warp as wp

from wsim.kernels.rigid.contact import manifold_count_func, rig_type
from wsim.kernels.rigid.kinds import SERIAL

ROUNDS = wp.constant(128)
FREE = wp.constant(2147483647)
ALL = wp.constant(wp.int64(2**60 - 1))           # SERIAL colours, a bit each


@wp.func
def scrambled_rank(m: int):
    """A bijection of 31 bits: multiplications by odd numbers and shifts can be undone."""
    x = wp.uint32(m) * wp.uint32(40503)
    x = x & wp.uint32(2147483647)
    x = x ^ (x >> wp.uint32(15))
    x = (x * wp.uint32(73244475)) & wp.uint32(2147483647)
    return int(x ^ (x >> wp.uint32(13)))


@cache
def colour_grant_functions(real):
    """(known, keep, ask, take): functions of a manifold m."""
    Rig = rig_type(real)

    @wp.func
    def coloured_node(shape: int, rig: Rig):
        """What a shape's body shares colours with: itself, or all of its tree. -1 for a collider."""
        f = rig.s.frame[shape]
        found = int(-1)
        if f < rig.b.w.shape[0]:
            found = rig.work.node[f]
        return found

    @wp.func
    def colours_of_bodies(m: int, rig: Rig):
        """Colours that the bodies of m have."""
        f = coloured_node(rig.c.a[m], rig)
        g = coloured_node(rig.c.b[m], rig)
        bits = wp.int64(0)
        if f >= 0:
            bits = rig.work.taken[f]
        if g >= 0:
            bits = bits | rig.work.taken[g]
        return bits

    @wp.func
    def mark_manifold_colour(m: int, colour: int, rig: Rig):
        f = coloured_node(rig.c.a[m], rig)
        g = coloured_node(rig.c.b[m], rig)
        bit = wp.int64(1) << wp.int64(colour)
        if f >= 0:
            wp.atomic_or(rig.work.taken, f, bit)
        if g >= 0:
            wp.atomic_or(rig.work.taken, g, bit)
        rig.c.colour[m] = colour

    @wp.func
    def keep_manifold_colour(m: int, rig: Rig):
        colour = rig.c.colour[m]
        if rig.c.count[m] <= 0 or colour >= SERIAL:
            rig.c.colour[m] = -1
        elif colour >= 0:
            mark_manifold_colour(m, colour, rig)

    @wp.func
    def ask_manifold_colour(m: int, rig: Rig):
        """Whether m asks for a colour."""
        asks = rig.c.count[m] > 0 and rig.c.colour[m] < 0
        if asks:
            f = coloured_node(rig.c.a[m], rig)
            g = coloured_node(rig.c.b[m], rig)
            if colours_of_bodies(m, rig) == ALL:
                rig.c.colour[m] = SERIAL
                asks = False
            else:
                if f >= 0:
                    wp.atomic_min(rig.work.first, f, scrambled_rank(m))
                if g >= 0:
                    wp.atomic_min(rig.work.first, g, scrambled_rank(m))
        return asks

    @wp.func
    def assign_manifold_colour(m: int, rig: Rig):
        if rig.c.count[m] > 0 and rig.c.colour[m] < 0:
            f = coloured_node(rig.c.a[m], rig)
            g = coloured_node(rig.c.b[m], rig)
            granted = bool(True)
            if f >= 0:
                granted = rig.work.first[f] == scrambled_rank(m)
            if g >= 0:
                granted = granted and rig.work.first[g] == scrambled_rank(m)
            if granted:
                bits = colours_of_bodies(m, rig)
                colour = int(0)
                while ((bits >> wp.int64(colour)) & wp.int64(1)) == wp.int64(1):
                    colour += 1
                mark_manifold_colour(m, colour, rig)

    return keep_manifold_colour, ask_manifold_colour, assign_manifold_colour


def colour_sort_func(meet, real):
    """Function: manifolds by their colours in `order`, those of a colour from `starts` of it on. Serial ones stand as listed;
    the others in any order, on which nothing depends."""
    Rig, manifolds_of = rig_type(real), manifold_count_func(real)

    @wp.func
    def colour_prefix_sums(count: int, rig: Rig, serial: wp.array(dtype=int)):
        """Starts from the numbers of each colour, which stand one place behind; `first` as places to write to."""
        most = int(0)
        for colour in range(SERIAL + 1):
            if rig.work.starts[colour + 1] > 0:
                most = colour + 1
            rig.work.starts[colour + 1] = rig.work.starts[colour] + rig.work.starts[colour + 1]
        for colour in range(SERIAL + 1):
            rig.work.place[colour] = rig.work.starts[colour]
        rig.work.colours[0] = most
        if most > SERIAL:
            serial[0] = wp.max(serial[0], rig.work.starts[SERIAL + 1] - rig.work.starts[SERIAL])
            slot = int(rig.work.starts[SERIAL])
            for m in range(count):
                if rig.c.colour[m] == SERIAL:
                    rig.work.order[slot] = m
                    slot += 1

    @wp.func
    def sort_by_colour(i: int, threads: int, rig: Rig, serial: wp.array(dtype=int)):
        count = manifolds_of(rig)
        for e in range(i, SERIAL + 2, threads):
            rig.work.starts[e] = 0
        meet()
        for m in range(i, count, threads):
            if rig.c.colour[m] >= 0:
                wp.atomic_add(rig.work.starts, rig.c.colour[m] + 1, 1)
        meet()
        if i == 0:
            colour_prefix_sums(count, rig, serial)
        meet()
        for m in range(i, count, threads):
            colour = rig.c.colour[m]
            if colour >= 0 and colour < SERIAL:
                rig.work.order[wp.atomic_add(rig.work.place, colour, 1)] = m

    return sort_by_colour


def contact_colour_kernel(real, module, meet, threads: int = 0, cluster: int = 0):
    """Kernel of the colours of all manifolds, by so many threads that `meet`; serial: how many found none, if any.

    threads, cluster: of a block, and blocks of a cluster, on CUDA."""
    Rig, manifolds_of = rig_type(real), manifold_count_func(real)
    keep, ask, take = colour_grant_functions(real)
    sort = colour_sort_func(meet, real)

    @wp.func
    def free_body_ranks(i: int, threads: int, rig: Rig):
        for f in range(i, rig.b.w.shape[0], threads):
            rig.work.first[f] = FREE

    @wp.func
    def list_has_changed(i: int, threads: int, count: int, rig: Rig):
        """Whether the list, or a manifold, was made in this substep."""
        if i == 0 and rig.work.strayed[0] == 1:
            rig.work.flags[0] = 1
        for m in range(i, count, threads):
            if rig.work.renewed[m] > 0:
                rig.work.flags[0] = 1
        meet()
        found = rig.work.flags[0]
        meet()
        return found == 1

    def rigid_colours(threads: int, rig: Rig, serial: wp.array(dtype=int)):
        i = wp.tid()
        count = manifolds_of(rig)
        if not list_has_changed(i, threads, count, rig):
            return
        for f in range(i, rig.b.w.shape[0], threads):
            rig.work.taken[f] = wp.int64(0)
        if i == 0:
            rig.work.flags[0] = 0
        meet()
        for m in range(i, count, threads):
            keep(m, rig)
        for r in range(int(ROUNDS)):
            free_body_ranks(i, threads, rig)
            meet()
            for m in range(i, count, threads):
                if ask(m, rig):
                    rig.work.flags[r & 1] = 1
            meet()
            if rig.work.flags[r & 1] == 0:
                break
            for m in range(i, count, threads):
                take(m, rig)
            if i == 0:
                rig.work.flags[(r + 1) & 1] = 0
            meet()
        for m in range(i, count, threads):
            if rig.c.count[m] > 0 and rig.c.colour[m] < 0:
                rig.c.colour[m] = SERIAL
        meet()
        if i == 0:
            rig.work.flags[0] = 0
            rig.work.flags[1] = 0
        sort(i, threads, rig, serial)

    return wp.kernel(rigid_colours, name="rigid_colours", module=module, enable_backward=False, grid_stride=False,
                     **({"launch_bounds": threads} if threads else {}), **({"cluster_dim": cluster} if cluster else {}))
