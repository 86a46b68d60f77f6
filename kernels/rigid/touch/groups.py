"""Where groups begin among sorted numbers: contacts by body, places of strands by body."""

# Device code: int(0) makes a variable of what would be a constant.
# ruff: noqa: UP018

from functools import cache

import warp as wp


@cache
def group_bound_kernel(module):
    """Kernel over groups + 1: where each begins among the sorted numbers."""

    def find_group_bounds(keys: wp.array(dtype=int), room: int, first_out: wp.array(dtype=int)):
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

    return wp.kernel(find_group_bounds, name="bounds_of_groups", module=module, enable_backward=False)
