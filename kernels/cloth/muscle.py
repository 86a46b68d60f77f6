"""Muscles: springs whose rest length follows a factor over time.

    L_c(t) = s_g(t) L0_c        s_g  factor of group g at t, a row of a table (rows, groups + 1) whose last column is 1: passive

The lengths are written where the kernels of forces read them, before each evaluation. With y the derivative of a loss by the
lengths of one evaluation,

    by s_g: sum over c in g of L0_c y_c         by L0_c: s_g y_c

LANES threads share the sum of a group, each every LANES'th spring, so that its order does not depend on the device.
"""

from functools import cache

import warp as wp

LANES = 32             # threads a group


@cache
def muscle_contraction_kernel(real, module):
    """Kernel over entries of a table of springs: their lengths [m] by a row of the factors."""

    @wp.kernel(module=module, enable_backward=False)
    def contract_muscles(group: wp.array(dtype=int), rest: wp.array(dtype=real), factor: wp.array2d(dtype=real), row: int,
                         length_out: wp.array(dtype=real)):
        e = wp.tid()
        length_out[e] = factor[row, group[e]] * rest[e]

    return contract_muscles


@cache
def muscle_share_kernel(real, module):
    """Kernel over the lanes of the groups: parts of the derivatives by the factors. item: entries by group, first: of each."""

    @wp.kernel(module=module, enable_backward=False)
    def muscle_factor_shares(first: wp.array(dtype=int), item: wp.array(dtype=int), rest: wp.array(dtype=real),
                             by_length: wp.array(dtype=real), share_out: wp.array(dtype=real)):
        i = wp.tid()
        g = i // LANES
        total = real(0.0)
        for k in range(first[g] + i % LANES, first[g + 1], LANES):
            total += rest[item[k]] * by_length[item[k]]
        share_out[i] = total

    return muscle_factor_shares


@cache
def muscle_release_kernel(real, module):
    """Kernel over entries: adds to the derivatives by what `muscle_contraction_kernel` has read, and clears that by what it
    wrote. The first threads add the shares of a group, too."""

    @wp.kernel(module=module, enable_backward=False)
    def release_muscle_gradient(group: wp.array(dtype=int), factor: wp.array2d(dtype=real), share: wp.array(dtype=real),
                                row: int,
                                by_length: wp.array(dtype=real), by_rest: wp.array(dtype=real),
                                by_factor: wp.array2d(dtype=real)):
        e = wp.tid()
        if e < group.shape[0]:
            by_rest[e] = by_rest[e] + factor[row, group[e]] * by_length[e]
            by_length[e] = real(0.0)
        if e < factor.shape[1] - 1:
            total = by_factor[row, e]
            for k in range(e * LANES, (e + 1) * LANES):
                total += share[k]
            by_factor[row, e] = total

    return release_muscle_gradient
