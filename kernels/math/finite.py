"""Whether arrays hold finite numbers alone."""

from functools import cache

import warp as wp


@cache
def finite_check_kernel(real, module):
    """Kernel over so many threads, which take all numbers a stride apart, `width` of a row and `rows` rows of a field: status
    becomes at least 1 + r for the highest row r that holds one that is not finite."""

    @wp.kernel(module=module, enable_backward=False)
    def mark_nonfinite_rows(values: wp.array(dtype=real), threads: int, width: int, rows: int, status: wp.array(dtype=int)):
        for i in range(wp.tid(), values.shape[0], threads):
            value = values[i]
            if value - value != real(0.0):                # no number less itself is no number
                wp.atomic_max(status, 0, 1 + (i // width) % rows)

    return mark_nonfinite_rows
