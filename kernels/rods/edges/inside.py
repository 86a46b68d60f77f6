"""Contact of a strand's edges with colliders, between their points: the law of kernels/rods/contact.py at two places of an edge
(kernels/rods/edges/edge_contact_points.py), with forces b f on its points and stiffness b b^T K, b = (1 - y, y).

    e = deep_u - w - max(-w, deep_i, deep_i+1)         deep = r - phi: what the points of an edge do not meet by themselves

A strand that lies on a plane has no contact inside its edges; one whose points are clear has e = deep_u; and where a contact
moves on from an edge to a point, forces do not jump. As an edge turns its places move, and forces with them:

    K = N'(e) b b^T n n^T + N a a^T / phi'',   a = grad phi' = (-n + (1 - y) t phi'' / L, n + y t phi'' / L),   phi'' = L s'

of which hairs that land on a ball with points as far apart as a fifth of its radius had five times as much as of inertia. What
is left out of the stiffness (of e what the maximum changes by moves, of N grad grad phi what is below 0) leaves it symmetric
and positive.

Friction of a place is with the collider that it is deepest in. Where two press an edge, each has the friction of one site, by
all that it presses with: the one farther down the edge that of the first. Of three, that which presses least has none here.
"""

# Device code: an outer `if` on a Python bool drops its branch before it is compiled.
# ruff: noqa: SIM102, UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import into_pose_frame
from wsim.kernels.rods.contact import CLEAR, FAR, MET, SOFT, Colliders
from wsim.kernels.rods.edges.edge_contact_law import (
    EdgeSite,
    FacedEdge,
    RodEdge,
    add_force_on_edge,
    add_pressing_collider,
    end_edge_site,
    fill_edge_rows,
    press_edge_site,
)
from wsim.kernels.rods.edges.edge_contact_points import edge_flank_functions
from wsim.kernels.rods.tables import RodMotion, RodTable, RodTrial

DRAWN = wp.constant(wp.float64(0.25))        # of its length: how far outside an edge that is pressed still is


@cache
def inside_edge_functions(kinds: tuple[str, ...]) -> SimpleNamespace:
    """Functions of the edge behind a point in the substep at: clear(C, S, T, at, i, k) -> True where it touches nothing, as its
    ends say, which T.edge remembers; else touch(C, S, Q, T, hh, at, i, k) -> Inside, hh: h^2, of which T.inside and T.bristle
    remember what lasts. kinds: of colliders.

    Rows of T that edges have of their first places stand behind those of points, of their second behind these."""
    flanks, turns = edge_flank_functions(kinds).flanks, edge_flank_functions(kinds).turns

    @wp.func
    def edge_is_clear(C: Colliders, S: RodTable, T: RodTrial, at: int, i: int, k: int):
        had = T.edge[i, k]
        if had == MET:
            if not T.hit:
                return False
            row = T.x.shape[0] + i
            if wp.abs(T.load[row, k]) + wp.abs(T.load[row + T.x.shape[0], k]) > wp.float64(0.0):
                return False
        x0 = T.x[i, k] + S.origin[k]
        x1 = T.x[i + 1, k] + S.origin[k]
        reach = (SOFT + wp.float64(1.0)) * wp.max(S.radius[i, k], S.radius[i + 1, k])
        for c in range(C.kind.shape[0]):
            frame = C.pose[at + 1, c]
            if turns(C, c, at, into_pose_frame(frame, x0), into_pose_frame(frame, x1), reach + C.thick[c]):
                return False
        if had != CLEAR:
            T.edge[i, k] = CLEAR
        return True

    @wp.func
    def press_edge_on_collider(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, F: FacedEdge, E: RodEdge, c: int,
                               again: int):
        """The edge with what collider c does to it; again: that pressed with others, for its friction alone, 1: at the first
        site, 2: at the second."""
        zero = wp.float64(0.0)
        frame = C.pose[E.at + 1, c]
        both = flanks(C, c, E.at, into_pose_frame(frame, E.x0), into_pose_frame(frame, E.x1), E.reach + C.thick[c])
        E.ends = both.ends
        if both.a.u + both.b.u > zero and F.now == CLEAR:
            F.now = MET
            if E.had != MET:
                fill_edge_rows(T, E.had, E.i, E.k)
        one = F.first
        if again > 0:
            one = EdgeSite()
        force = zero
        if both.a.u > zero:
            one, N, slope = press_edge_site(C, S, Q, T, one, both.a, E, c)
            n = wp.transform_vector(frame, both.a.n)
            force = N
            if again == 0:
                F.to = add_force_on_edge(F.to, n * N, wp.outer(n, n) * slope, both.a.y)
        two = one
        if again == 0:
            two = F.second
        if both.b.u > zero:
            two, N2, slope2 = press_edge_site(C, S, Q, T, two, both.b, E, c)
            n2 = wp.transform_vector(frame, both.b.n)
            force += N2
            if again == 0:
                F.to = add_force_on_edge(F.to, n2 * N2, wp.outer(n2, n2) * slope2, both.b.y)
        if again == 0:
            F.first = one
            F.second = two
            F.pair = add_pressing_collider(F.pair, c, force, wp.max(both.a.y, both.b.y))
        else:
            two.more = force - two.N
            if again == 1:
                F.first = two
            else:
                F.second = two
        return F

    @wp.func
    def touch_inside_edge(C: Colliders, S: RodTable, Q: RodMotion, T: RodTrial, hh: wp.float64, at: int, i: int, k: int):
        edge = RodEdge()
        edge.i = i
        edge.k = k
        edge.at = at
        edge.hh = hh
        edge.x0 = T.x[i, k] + S.origin[k]
        edge.x1 = T.x[i + 1, k] + S.origin[k]
        edge.had = T.edge[i, k]
        edge.reach = (SOFT + wp.float64(1.0)) * wp.max(S.radius[i, k], S.radius[i + 1, k])
        F = FacedEdge()
        F.now = CLEAR
        F.first.side.deep = -FAR
        F.second.side.deep = -FAR
        zero = wp.float64(0.0)
        if T.hit and edge.had == MET:
            row = T.x.shape[0] + i
            if T.load[row, k] > zero or T.load[row + T.x.shape[0], k] > zero:    # it is drawn back as points are
                edge.reach = edge.reach + DRAWN * wp.length(edge.x1 - edge.x0)
        colliders = C.kind.shape[0]
        count = colliders
        j = int(0)
        while j < count:
            c = j
            if j >= colliders:
                c = wp.where((j == colliders) == (F.pair.y < F.pair.z), F.pair.first, F.pair.second)
            F = press_edge_on_collider(C, S, Q, T, F, edge, c, wp.max(j + 1 - colliders, 0))
            j += 1
            if j == colliders and F.pair.less > zero:
                count = colliders + 2
        found = F.to
        if F.now != edge.had:
            T.edge[i, k] = F.now
        if F.now == MET or edge.had == MET:
            found = end_edge_site(C, S, Q, T, found, F.first, edge, 0)
            found = end_edge_site(C, S, Q, T, found, F.second, edge, 1)
        return found

    return SimpleNamespace(clear=edge_is_clear, touch=touch_inside_edge, name="_".join(kinds))
