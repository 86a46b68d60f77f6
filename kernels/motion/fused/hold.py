"""Soft pins and tethers of a point within frames of one launch (kernels/motion/fused/march.py), in the order of launches;
behind them come strain limits (limits.py).

    x   where the substep began [m]     d   displacement, a   anchor [m]: velocity (d - a) / g, g the substep [s]

    soft pin   C = x + d - target, a spring with damping: `hold_pins` of kernels/motion/points.py
    tether     no further than a length from a hard pin, which has no mass to give way: its end is where it is put
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.fused.limits import strain_limits


@cache
def point_holdings(real):
    """Struct of what holds points: reads only, but for lam, and the letters of limits."""
    t, Limits = types(real), strain_limits(real)

    @wp.struct
    class PointHoldings:
        first: wp.array(dtype=int)           # soft pins of point i: item[first[i]] .. item[first[i + 1]], (points + 1,)
        item: wp.array(dtype=int)
        alpha: wp.array(dtype=t.scalar)      # compliance [m/N], (pins,)
        damping: wp.array(dtype=t.scalar)    # [N s/m], (pins,)
        goal: wp.array2d(dtype=t.vec3)       # [m], (substeps, pins)
        lam: wp.array(dtype=t.vec3)          # [N s^2], (pins,)
        tether: wp.array(dtype=int)          # of each point, -1: it has none, (points,)
        ends: wp.array(dtype=wp.vec2i)       # pinned point and the other, (tethers,)
        length: wp.array(dtype=t.scalar)     # [m], (tethers,)
        pin: wp.array(dtype=int)             # column of `target` of each point, (points,)
        target: wp.array2d(dtype=t.vec3)     # of hard pins [m], (rows, pins)
        stride: int                          # rows of it a substep
        h: real                              # substep [s]
        limits: Limits

    return PointHoldings


@cache
def pin_projection(real):
    """Function (held, at: point, substep and iteration, w, x, move: rows d and a) -> d with what soft pins change."""
    t, Held = types(real), point_holdings(real)

    @wp.func
    def project_soft_pins(c: Held, at: wp.vec3i, w: real, x: t.vec3, move: wp.types.matrix((2, 3), real)):
        d1 = move[0]
        for j in range(c.first[at[0]], c.first[at[0] + 1]):
            p = c.item[j]
            soft = c.alpha[p] / (c.h * c.h)
            gamma = soft * c.damping[p] * c.h
            K = (real(1.0) + gamma) * w + soft
            before = t.vec3()
            if at[2] > 0:
                before = c.lam[p]
            if K > real(0.0):
                more = -((x - c.goal[at[1], p]) + d1 + soft * before + gamma * (d1 - move[1])) / K
                c.lam[p] = before + more
                d1 += w * more
        return d1

    return project_soft_pins


@cache
def tether_pulling(real):
    """Function (held, i, k, x, d) -> d of point i in substep k, which its tether draws back."""
    t, Held = types(real), point_holdings(real)

    @wp.func
    def pull_by_tether(c: Held, i: int, k: int, x: t.vec3, d: t.vec3):
        tether = c.tether[i]
        d1 = d
        if tether >= 0:
            end = c.target[c.stride * k, c.pin[c.ends[tether][0]]]
            way = (x - end) + d
            far = wp.length(way)
            if far > c.length[tether]:
                d1 = d - ((far - c.length[tether]) / far) * way
        return d1

    return pull_by_tether
