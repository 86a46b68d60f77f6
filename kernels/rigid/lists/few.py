"""The list of pairs where shapes are few: one launch of a block that tries all of them, with the list that trees give.

Trees take a dozen launches, and a branch of a graph in every substep that asks whether a body has strayed: on an H200 more than
the passes of a substep. Here the block asks, and ends where the list is to stay. See kernels/rigid/lists/pairs.py.
"""

import warp as wp

from wsim.kernels.rigid.contact import whole
from wsim.kernels.rigid.lists.pairs import reaching, taking, trees
from wsim.kernels.rigid.lists.rows import keep_row, lasts


def list_few(real, module, meet, threads: int = 0, filtered: bool = False):
    """Kernel of threads that `meet`: pairs for `time` [s] from substep k on. of: (threads, k, 1 where a list is due, shapes
    that may have moved). One that is not due is made where a body has strayed. The last list is kept before, unless k is 0.
    threads: of the block, on CUDA. first, count: as `wsim.physics.rigid.contacts.pair_list.PairList` has them."""
    Rig, Tree, Last = whole(real), trees(filtered), lasts(real)
    reach, take, keep = reaching(real, filtered), taking(real, filtered), keep_row(real)

    @wp.func
    def beside(i: int, j: int, tree: Tree, rig: Rig):
        """Whether the boxes of two shapes overlap; one that has no end is met by all."""
        found = bool(True)
        if rig.work.span[j][0] >= real(0.0):
            for e in range(3):
                found = found and tree.low[i][e] <= tree.high[j][e] and tree.high[i][e] >= tree.low[j][e]
        return found

    @wp.func
    def partners(i: int, at: int, write: int, tree: Tree, rig: Rig):
        """How many rows shape i takes; they are written from `at` on."""
        found = int(0)
        for j in range(i + 1, rig.s.frame.shape[0]):
            if beside(i, j, tree, rig):
                found += take(i, j, at + found, write, tree, rig)
        return found

    @wp.func
    def summed(mine: int, count: wp.array(dtype=int), first_out: wp.array(dtype=int)):
        sum = int(0)
        for i in range(mine):
            sum += count[i]
            first_out[i] = sum

    def rigid_list_few(of: wp.vec4i, time: real, rig: Rig, tree: Tree, last: Last, first: wp.array(dtype=int),
                       count: wp.array(dtype=int), wanted: wp.array(dtype=int)):
        i = wp.tid()
        threads = of[0]
        k = of[1]
        if of[2] == 0 and rig.work.strayed[0] == 0:
            return
        room = rig.c.a.shape[0]
        mine = first.shape[0]
        if k > 0:
            for m in range(i, room, threads):
                keep(m, rig.c, last)
        for s in range(i, of[3], threads):
            reach(s, k, time, tree, rig)
        meet()
        for s in range(i, mine, threads):
            count[s] = partners(s, 0, 0, tree, rig)
        meet()
        if i == 0:
            summed(mine, count, first)
            wanted[0] = wp.max(wanted[0], first[mine - 1])
            rig.work.strayed[0] = 1
        meet()
        for s in range(i, mine, threads):
            partners(s, first[s] - count[s], 1, tree, rig)
        for m in range(first[mine - 1] + i, room, threads):
            rig.c.a[m] = -1

    return wp.kernel(rigid_list_few, name="rigid_list_few", module=module, enable_backward=False, grid_stride=False,
                     **({"launch_bounds": threads} if threads else {}))
