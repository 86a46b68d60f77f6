"""Whether arrays hold finite numbers alone."""

from functools import cache

import warp as wp


@cache
def not_finite_rows(real, module):
    """Kernel over numbers, `width` of a row and `rows` rows of a field: status becomes at least 1 + r for the highest row r
    that holds one that is not finite."""

    @wp.kernel(module=module, enable_backward=False)
    def not_finite_rows(values: wp.array(dtype=real), width: int, rows: int, status: wp.array(dtype=int)):
        i = wp.tid()
        if values[i] - values[i] != real(0.0):            # no number less itself is no number
            wp.atomic_max(status, 0, 1 + (i // width) % rows)

    return not_finite_rows
