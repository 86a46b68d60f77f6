"""Substeps that the device counts: the number of the present one, and rows of tables by it. Whole numbers alone, so that one
module serves every scene."""

from functools import cache

import warp as wp

MODULE = "wsim_loop"


@cache
def substep_count_kernel():
    """Kernel: the next substep; going becomes 0 where it is `last`."""
    @wp.kernel(module=MODULE, enable_backward=False)
    def count_device_substep(last: int, number: wp.array(dtype=int), going: wp.array(dtype=int)):
        number[0] = number[0] + 1
        going[0] = wp.where(number[0] < last, 1, 0)

    return count_device_substep


@cache
def row_pick_kernel():
    """Kernel over (rows, width): copies rows of a table from that of the present substep on, as whole numbers of 4 bytes."""
    @wp.kernel(module=MODULE, enable_backward=False)
    def pick_substep_rows(table: wp.array2d(dtype=int), number: wp.array(dtype=int), rows_out: wp.array2d(dtype=int)):
        i, j = wp.tid()
        rows_out[i, j] = table[number[0] + i, j]

    return pick_substep_rows
