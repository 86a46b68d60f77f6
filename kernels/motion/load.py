"""Loads: forces on points that are known for all time, as accelerations beside gravity.

    g_i(t) = g_i0 + w_i F_i(t)        F_i(t) = sum_l c_il q_l(t)

w_i is the inverse mass of point i, q_l the value of load l at t, a row of a table (rows, loads): a force [N], or a traction
[Pa] of which c_il is an area [m^2]. A pinned point (w_i = 0) feels gravity alone, and its pin bears F_i. With y the
derivative of a loss by g of one evaluation,

    by g_i0: y_i        by w_i: F_i . y_i        by q_l: sum over i of c_il w_i y_i

LANES threads share the sum of a load, each every LANES'th point, so that its order does not depend on the device.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

LANES = 32             # threads a load


@cache
def load_entries(real):
    """Struct of what bears which load: reads only. The entries of point k are first[k] .. first[k + 1]."""

    @wp.struct
    class LoadEntries:
        point: wp.array(dtype=int)           # places of the points that bear any, (k,)
        first: wp.array(dtype=int)           # (k + 1,)
        load: wp.array(dtype=int)            # column of each entry, (m,)
        share: wp.array(dtype=real)          # c of each entry, 1 or [m^2], (m,)
        w: wp.array(dtype=real)              # inverse mass of every point [1/kg]
        begin: wp.array(dtype=int)           # first of `item` of each load, (loads + 1,)
        item: wp.array(dtype=int)            # entries by load, (m,)
        owner: wp.array(dtype=int)           # point of each entry, a place, (m,)

    return LoadEntries


@cache
def borne_loads(real):
    """Struct of who bears what, of frames that blocks take in one launch (kernels/motion/fused/march.py): reads only."""
    t, Entries = types(real), load_entries(real)

    @wp.struct
    class BorneLoads:
        place: wp.array(dtype=int)           # number of each point among those that bear some, -1: none, (points,)
        entries: Entries
        own: wp.array(dtype=t.vec3)          # gravity alone, of those that bear some [m/s^2]
        value: wp.array2d(dtype=t.vec3)      # of each load, (rows, loads)

    return BorneLoads


@cache
def load_bearing_kernel(real, module):
    """Kernel over the points that bear a load: gravity with what a row of values adds [m/s^2]."""
    t, Entries = types(real), load_entries(real)

    @wp.kernel(module=module, enable_backward=False)
    def bear_loads(c: Entries, own: wp.array(dtype=t.vec3), value: wp.array2d(dtype=t.vec3), row: int,
                   gravity_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        i = c.point[k]
        F = t.vec3()
        for e in range(c.first[k], c.first[k + 1]):
            F += c.share[e] * value[row, c.load[e]]
        gravity_out[i] = own[k] + c.w[i] * F

    return bear_loads


@cache
def load_share_kernel(real, module):
    """Kernel over the lanes of the loads: parts of the derivatives by their values."""
    t, Entries = types(real), load_entries(real)

    @wp.kernel(module=module, enable_backward=False)
    def load_shares(c: Entries, by_gravity: wp.array(dtype=t.vec3), share_out: wp.array(dtype=t.vec3)):
        j = wp.tid()
        column = j // LANES
        total = t.vec3()
        for n in range(c.begin[column] + j % LANES, c.begin[column + 1], LANES):
            e = c.item[n]
            i = c.owner[e]
            total += (c.share[e] * c.w[i]) * by_gravity[i]
        share_out[j] = total

    return load_shares


@cache
def load_release_kernel(real, module):
    """Kernel over the points that bear a load, and over the loads: adds to the derivatives by what `load_bearing_kernel` has
    read, and clears that by what it wrote."""
    t, Entries = types(real), load_entries(real)

    @wp.kernel(module=module, enable_backward=False)
    def load_release(c: Entries, value: wp.array2d(dtype=t.vec3), share: wp.array(dtype=t.vec3), row: int,
                     by_gravity: wp.array(dtype=t.vec3), by_own: wp.array(dtype=t.vec3), by_w: wp.array(dtype=real),
                     by_value: wp.array2d(dtype=t.vec3)):
        k = wp.tid()
        if k < c.point.shape[0]:
            i = c.point[k]
            y = by_gravity[i]
            F = t.vec3()
            for e in range(c.first[k], c.first[k + 1]):
                F += c.share[e] * value[row, c.load[e]]
            by_own[k] = by_own[k] + y
            by_w[i] = by_w[i] + wp.dot(F, y)
            by_gravity[i] = t.vec3()
        if k < value.shape[1]:
            total = by_value[row, k]
            for j in range(k * LANES, (k + 1) * LANES):
                total += share[j]
            by_value[row, k] = total

    return load_release
