"""The pairs of edges that press in a world, in the order of their points (kernels/rods/coupled_newton/reduced.py)."""

import warp as wp

from wsim.kernels.math.team import block_prefix_count
from wsim.kernels.rods.coupled_newton.coupled import CoupledRods
from wsim.kernels.rods.coupled_newton.nodes import RodTeam
from wsim.kernels.rods.tables import EdgePairs, RodTable


@wp.func
def leads_edge_pair(S: RodTable, A: RodTeam, entry: int):
    """True at one of a pair's points: the first that nothing holds."""
    m = S.points.shape[0]
    ids = A.ids[entry / 4]
    first = int(1)
    for c in range(entry % 4):
        if S.hold[ids[c] / m, ids[c] % m] < 0:
            first = int(0)
    return first == 1


@wp.func
def list_pressing_pairs(S: RodTable, G: CoupledRods, P: EdgePairs, A: RodTeam, lane: int, threads: int, w: int):
    """Lists the pairs of world w that press; how many there are, or 0 where there is not room for them. All threads come."""
    first = G.first[w]
    count = G.first[w + 1] - first
    m = S.points.shape[0]
    own = int(0)
    for t in range(lane, 2 * A.most[w] * count, threads):
        i = t / count
        k = first + t - i * count
        if i < S.points[k]:
            for j in range(P.ons[i * m + k]):
                if leads_edge_pair(S, A, P.on[i * m + k, j]):
                    own += 1
    all = block_prefix_count(own)
    if all[1] > A.chosen.shape[1]:
        return 0
    at = all[0]
    for t in range(lane, 2 * A.most[w] * count, threads):
        i = t / count
        k = first + t - i * count
        if i < S.points[k]:
            for j in range(P.ons[i * m + k]):
                entry = P.on[i * m + k, j]
                if leads_edge_pair(S, A, entry):
                    A.chosen[w, at] = entry / 4
                    A.number[entry / 4] = at
                    at += 1
    return all[1]
