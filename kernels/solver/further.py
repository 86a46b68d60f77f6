"""Further Newton steps of a substep: whether a system needs one, and none for those that do not.

A system goes on while its residual is above what its integrator needs (`met` in wsim/scene/integrator.py), for MOST steps. One
that has met it keeps its d to the bit, whatever others do: worlds do not see each other.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types


@cache
def look(real, module):
    """Kernel of one thread: words[0] is 1 while some of the residuals is above `least`, for `most` looks; words[1] counts
    them. A residual that is no number goes on as well."""

    @wp.kernel(module=module, enable_backward=False)
    def look_further(residual: wp.array(dtype=real), least: real, most: int, first: int, words: wp.array(dtype=int)):
        looks = words[1] + 1
        if first == 1:
            looks = int(0)  # noqa: UP018
        words[1] = looks
        on = int(0)  # noqa: UP018
        for i in range(residual.shape[0]):
            if not residual[i] <= least:
                on = 1
        words[0] = wp.where(looks < most, on, 0)

    return look_further


@cache
def stand(real, module):
    """Kernel over points: no step for those of systems that have met `least`. of: system of a point."""
    t = types(real)

    @wp.kernel(module=module, enable_backward=False)
    def stand_still(of: wp.array(dtype=int), residual: wp.array(dtype=real), least: real, y_out: wp.array(dtype=t.vec3)):
        i = wp.tid()
        if residual[of[i]] <= least:
            y_out[i] = t.vec3()

    return stand_still
