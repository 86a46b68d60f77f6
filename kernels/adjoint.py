"""Small kernels of the backward pass."""

from functools import cache

import warp as wp


@cache
def give(dtype):
    """Kernel: adds a gradient to another and clears it."""

    @wp.kernel(module="unique", enable_backward=False)
    def give(grad: wp.array(dtype=dtype), into: wp.array(dtype=dtype)):
        i = wp.tid()
        g = grad[i]
        into[i] = into[i] + g
        grad[i] = dtype()

    return give
