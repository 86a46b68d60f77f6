"""Seams of closed strands (kernels/rods/seam.py) where a block of threads solves a world. The seven columns of M^-1 J^T are
kept behind each factorization, so that a solve of a ring costs one of an open strand and a sum:

    z = M^-1 r - (M^-1 J^T) lam,   lam = (J M^-1 J^T)^-1 J M^-1 r
"""

import warp as wp

from wsim.kernels.rods.coupled_newton.coupled import CoupledRods
from wsim.kernels.rods.coupled_newton.nodes import RodTeam
from wsim.kernels.rods.seam import seam_sign, without_angle
from wsim.kernels.rods.tables import RodTable, RodTrial

ROWS = 7                                 # of J: four of the first point, three of the second


@wp.func
def fill_seam_column(S: RodTable, G: CoupledRods, c: int, lane: int, threads: int, w: int):
    """Column c of J^T of all strands of world w into G.q."""
    first = G.first[w]
    count = G.first[w + 1] - first
    for t in range(lane, count * S.length.shape[0], threads):
        i = t / count
        k = first + t - i * count
        if i < S.points[k]:
            v = wp.vec4d()
            if S.own[k] < S.points[k]:
                v[c % 4] = seam_sign(c / 4, i, S.own[k])
            G.q[i, k] = v


@wp.func
def keep_seam_column(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, c: int, lane: int, threads: int, w: int):
    """T.z as column c of M^-1 J^T."""
    first = G.first[w]
    count = G.first[w + 1] - first
    for t in range(lane, count * S.length.shape[0], threads):
        i = t / count
        k = first + t - i * count
        if i < S.points[k]:
            A.slack[c, i, k] = T.z[i, k]


@wp.func
def factor_seams(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, lane: int, threads: int, w: int):
    """T.seam of the closed strands of world w, as `wsim.kernels.rods.seam.factor_seam` has it."""
    for k in range(G.first[w] + lane, G.first[w + 1], threads):
        own = S.own[k]
        if own < S.points[k]:
            a = wp.mat44d()
            b = wp.mat44d()
            e = wp.mat44d()
            e[3, 3] = wp.float64(1.0)
            n = int(7)
            for c in range(n):
                first = A.slack[c, 0, k] - A.slack[c, own, k]
                second = A.slack[c, 1, k] - A.slack[c, own + 1, k]
                for j in range(wp.static(4)):
                    if c < 4:
                        a[j, c] = first[j]
                    else:
                        b[j, c - 4] = first[j]
                        if j < 3:
                            e[j, c - 4] = second[j]
            P = wp.inverse((a + wp.transpose(a)) * wp.float64(0.5))
            X = P * b
            T.seam[k, 0] = P
            T.seam[k, 1] = X
            T.seam[k, 2] = wp.inverse(e - wp.transpose(b) * X)


@wp.func
def find_seam_forces(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, lane: int, threads: int, w: int):
    """lam of the closed strands of world w into A.lam, of T.z = M^-1 r."""
    for k in range(G.first[w] + lane, G.first[w + 1], threads):
        own = S.own[k]
        if own < S.points[k]:
            ga = T.z[0, k] - T.z[own, k]
            gb = without_angle(T.z[1, k] - T.z[own + 1, k])
            P = T.seam[k, 0]
            X = T.seam[k, 1]
            second = T.seam[k, 2] * (gb - wp.transpose(X) * ga)
            A.lam[k, 0] = P * ga - X * second
            A.lam[k, 1] = second


@wp.func
def close_point_seam(S: RodTable, T: RodTrial, G: CoupledRods, A: RodTeam, i: int, k: int):
    """T.z of a point, and of its copy, made that of the ring; J^T lam is taken off their G.r."""
    own = S.own[k]
    if own == S.points[k] or i >= own:
        return
    a = A.lam[k, 0]
    b = A.lam[k, 1]
    z = T.z[i, k]
    n = int(4)
    for c in range(n):
        z = z - A.slack[c, i, k] * a[c]
        if c < 3:
            z = z - A.slack[c + 4, i, k] * b[c]
    T.z[i, k] = z
    if i == 0:
        T.z[own, k] = z
        G.r[0, k] = G.r[0, k] - a
        G.r[own, k] = G.r[own, k] + a
    if i == 1:
        T.z[own + 1, k] = wp.vec4d(z[0], z[1], z[2], T.z[own + 1, k][3])
        G.r[1, k] = G.r[1, k] - b
        G.r[own + 1, k] = G.r[own + 1, k] + b
