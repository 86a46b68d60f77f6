"""Elimination of a strand's system, point by point: blocks of 4 x 4 (kernels/rods/system.py), with two beside the diagonal.

A thread a strand goes from the first point to the last with a window of three, and back. No pivots: the system is positive
definite."""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102

from functools import cache

import warp as wp

from wsim.kernels.rods.tables import RodTable, RodTrial


@wp.struct
class EliminationWindow:
    """Blocks of three points in a row: diagonal, between the first and the second or third, second and third; right sides."""

    D0: wp.mat44d
    D1: wp.mat44d
    D2: wp.mat44d
    P: wp.mat44d
    N: wp.mat44d
    F: wp.mat44d
    r0: wp.vec4d
    r1: wp.vec4d
    r2: wp.vec4d


@wp.func
def symmetric_part(D: wp.mat44d):
    """The symmetric part of a block. Rounding makes others of blocks, which grow from point to point: of strands of 200 points
    nothing was left of the forces' digits."""
    return (D + wp.transpose(D)) * wp.float64(0.5)


@cache
def point_elimination_func(kept: bool):
    """Function (T, w, i, k): the window moved on by a point, whose factors are stored. kept: with T.pivot and T.b."""
    @wp.func
    def eliminate_point_block(T: RodTrial, w: EliminationWindow, i: int, k: int):
        L1 = wp.mat44d()
        L2 = wp.mat44d()
        y = wp.vec4d()
        if i >= 0:
            D = symmetric_part(wp.inverse(symmetric_part(w.D0)))
            L1 = D * w.P
            L2 = D * w.F
            y = D * w.r0
            T.near[i, k] = L1
            T.far[i, k] = L2
            T.z[i, k] = y
            if wp.static(kept):
                T.pivot[i, k] = D
                T.b[i, k] = w.r0
        Pt = wp.transpose(w.P)
        Ft = wp.transpose(w.F)
        new = EliminationWindow()
        new.D0 = w.D1 - Pt * L1
        new.P = w.N - Pt * L2
        new.D1 = w.D2 - Ft * L2
        new.r0 = w.r1 - Pt * y
        new.r1 = w.r2 - Ft * y
        return new

    return eliminate_point_block


@wp.func
def substitute_strand_backward(S: RodTable, T: RodTrial, k: int):
    """Solves, from the last point to the first; the greatest correction of a point [m]."""
    z1 = wp.vec4d()
    z2 = wp.vec4d()
    most = wp.float64(0.0)
    n = S.points[k]
    for j in range(n):
        i = n - 1 - j
        z = T.z[i, k] - T.near[i, k] * z1 - T.far[i, k] * z2
        T.z[i, k] = z
        most = wp.max(most, wp.length(wp.vec3d(z[0], z[1], z[2])))
        z2 = z1
        z1 = z
    return most
