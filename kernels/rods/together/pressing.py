"""The pairs of edges that press in a world, in the order of their points (kernels/rods/together/reduced.py)."""

import warp as wp

from wsim.kernels.math.team import counted
from wsim.kernels.rods.tables import Pressed, Strands
from wsim.kernels.rods.together.coupled import Coupled
from wsim.kernels.rods.together.nodes import Team


@wp.func
def leads(S: Strands, A: Team, entry: int):
    """True at one of a pair's points: the first that nothing holds."""
    m = S.points.shape[0]
    ids = A.ids[entry / 4]
    first = int(1)
    for c in range(entry % 4):
        if S.hold[ids[c] / m, ids[c] % m] < 0:
            first = int(0)
    return first == 1


@wp.func
def list_pairs(S: Strands, G: Coupled, P: Pressed, A: Team, lane: int, threads: int, w: int):
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
                if leads(S, A, P.on[i * m + k, j]):
                    own += 1
    all = counted(own)
    if all[1] > A.chosen.shape[1]:
        return 0
    at = all[0]
    for t in range(lane, 2 * A.most[w] * count, threads):
        i = t / count
        k = first + t - i * count
        if i < S.points[k]:
            for j in range(P.ons[i * m + k]):
                entry = P.on[i * m + k, j]
                if leads(S, A, entry):
                    A.chosen[w, at] = entry / 4
                    A.number[entry / 4] = at
                    at += 1
    return all[1]
