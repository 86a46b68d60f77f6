"""Near pairs of shapes in worlds of few shapes: each tries those that it could ever touch, by a table that all worlds share.

The table leaves out shapes of one body, of joints whose bodies do not touch, and of groups that do not. Its lists are sorted,
and so is the list of pairs. It is the list of pairs.py: balls that reach each other, and boxes that overlap. Trees of the boxes
of 1024 worlds, which all stand in one place, took 60 of 180 ms of a frame on an H200.
"""

import warp as wp

from wsim.kernels.rigid.contact import rig_type, rigid_contact_structs
from wsim.kernels.rigid.lists.pairs import pair_row_functions, shape_tree_type
from wsim.kernels.rigid.lists.worlds import kept_pairs_func


@wp.struct
class WorldPairs:
    """Of the shapes of a world's bodies, (shapes,) and the end: place in `other` of shapes with larger numbers that each may
    touch. Numbers from `shapes` on are those of colliders."""
    first: wp.array(dtype=int)
    other: wp.array(dtype=int)


def world_pair_kernel(real, module):
    """Kernel that counts the partners of a body's shape (write = 0), or writes them behind `first`, where there is room. aside,
    first: as in pairs.py."""
    Rig, Tree, (append_rows, end_rows) = rig_type(real), shape_tree_type(False), pair_row_functions(real, False)
    Table, keep = rigid_contact_structs(real)[2], kept_pairs_func(real)

    @wp.func
    def boxes_overlap(i: int, j: int, tree: Tree):
        found = bool(True)
        for c in range(3):
            if tree.low[i][c] > tree.high[j][c] or tree.low[j][c] > tree.high[i][c]:
                found = False
        return found

    @wp.func
    def list_partners_of_world(i: int, at: int, every: int, write: int, near: WorldPairs, tree: Tree, rig: Rig):
        shapes = near.first.shape[0] - 1
        own = i % shapes
        found = int(0)
        for e in range(near.first[own], near.first[own + 1]):
            j = near.other[e] + i - own
            if near.other[e] >= shapes:
                j = near.other[e] + every - shapes
            if rig.work.span[j][0] < real(0.0) or boxes_overlap(i, j, tree):
                found += append_rows(i, j, at + found, write, tree, rig)
        return found

    def rigid_world_pairs(rig: Rig, tree: Tree, near: WorldPairs, aside: Table, first: wp.array2d(dtype=int), write: int,
                          count: wp.array(dtype=int), wanted: wp.array(dtype=int)):
        i = wp.tid()
        found = int(0)
        at = int(0)
        if write == 1 and i > 0:
            at = first[0, i - 1]
        if rig.work.strayed[1 + rig.s.world[i]] == 1:
            found = list_partners_of_world(i, at, first.shape[1], write, near, tree, rig)
        else:
            found = keep(i, at, write, count[i], aside, first[1], rig)
        if write == 0:
            count[i] = found
        else:
            end_rows(i, first[0], rig, wanted)

    return wp.kernel(rigid_world_pairs, name="rigid_world_pairs", module=module, enable_backward=False)
