"""Distances between two links, or a link and the world, that joints of trees keep within a range: strings, and rods that give
way along one side.

    low <= g <= high,   g = |p_b - p_a|,   g' = l . (V_b - V_a),   l = ((p_b - O) x n, n),   n = (p_b - p_a) / g

An impulse of its sign acts where g + h g' + bend would leave the range, in sweeps with the limits of joints (limits.py). It
acts through all joints: Z = C^-T J^T (responses.py), less what loops take. bend is what g does in the step that is not linear
in the rates. Trees that touch nothing find it by the places that rates lead to, so that a taut string has its length to
rounding at the end of a step (SHAKE: Ryckaert, Ciccotti, Berendsen 1977); others take that of a straight way. Behind the
places g' = 0 of strings that were taut (RATTLE: Andersen 1983). The step is of order 2 while a string stays taut.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.rows import PULL
from wsim.kernels.rigid.joint.tables import FAR
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_velocities
from wsim.kernels.rigid.joint.tree.lanes import any_lane, greatest_of_lanes, sum_over_lanes, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.equations import link_frame_place, substitute_dense_row
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.substep.bases import link_base_twist
from wsim.kernels.rigid.joint.tree.tables import Trees

AT = wp.constant(wp.float64(1.0e-9))         # [m] from an end: there, behind the places
BACK = wp.constant(wp.float64(0.2))          # of what is beyond an end that a step takes back, at PULL at most
EMPTY = wp.constant(wp.float64(1.0e-12))     # of a response: loops and joints hold this distance


@wp.struct
class StringEnds:
    """Ends from where the root began, what they are apart, and the direction from a to b."""
    p_a: wp.vec3d
    p_b: wp.vec3d
    g: wp.float64
    n: wp.vec3d


@wp.func
def has_strings(g: int, T: Trees):
    return T.strings.first_row[g + 1] > T.strings.first_row[g]


@wp.func
def is_string_whole(s: int, T: Trees):
    return T.breaks.broken[T.strings.joint[s]] == 0


@standalone_function
@wp.func
def string_ends(s: int, T: Trees):
    found = StringEnds()
    found.p_a = link_frame_place(T.strings.a[s], T.strings.at_a[s], T)
    found.p_b = link_frame_place(T.strings.b[s], T.strings.at_b[s], T)
    d = found.p_b - found.p_a
    found.g = wp.length(d)
    found.n = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    if found.g > wp.float64(0.0):
        found.n = d / found.g
    return found


@standalone_function
@wp.func
def place_string_ends(g: int, k: int, part: wp.float64, h: wp.float64, T: Trees, J: Linked):
    """Ends on what moves by itself, at a part of substep k of h [s] (bases.py)."""
    if T.moves == 1 and has_strings(g, T):
        row = k * J.t.moving
        for s in range(T.strings.first_row[g] + tree_lane(), T.strings.first_row[g + 1], tree_lanes()):
            j = T.strings.joint[s]
            at = T.strings.hang[s] + J.t.anchor_x[row, j] + part * h * J.t.anchor_v[row, j]
            if T.strings.a[s] < 0:
                T.strings.at_a[s] = at
            if T.strings.b[s] < 0:
                T.strings.at_b[s] = at
            T.strings.drawn[s] = J.t.anchor_v[row, j]
        tree_barrier()


@wp.func
def end_velocity(link: int, p: wp.vec3d, root: int, moved: wp.vec3d, T: Trees):
    """Velocity of an end p on a link, -1: on what moves at `moved`."""
    v = moved
    if link >= 0:
        v = T.V[link] + wp.cross(T.W[link], p - T.X[root])
    return v


@standalone_function
@wp.func
def straight_bend(s: int, root: int, h: wp.float64, e: StringEnds, T: Trees):
    """bend [m] of ends that go straight on for h [s]."""
    w = end_velocity(T.strings.b[s], e.p_b, root, T.strings.drawn[s], T)
    w -= end_velocity(T.strings.a[s], e.p_a, root, T.strings.drawn[s], T)
    return wp.length(e.p_b - e.p_a + h * w) - e.g - h * wp.dot(e.n, w)


@standalone_function
@wp.func
def string_base_rate(s: int, root: int, e: StringEnds, T: Trees):
    """g' by what the tree hangs from, as if its joints stood."""
    found = wp.float64(0.0)
    for side in range(2):
        link = wp.where(side == 0, T.strings.a[s], T.strings.b[s])
        p = wp.where(side == 0, e.p_a, e.p_b)
        v = T.strings.drawn[s]
        if link >= 0:
            base = link_base_twist(link, root, T)
            v = wp.vec3d(base[3], base[4], base[5]) + wp.cross(wp.vec3d(base[0], base[1], base[2]), p - T.X[root])
        found += wp.where(side == 0, -wp.dot(e.n, v), wp.dot(e.n, v))
    return found


@standalone_function
@wp.func
def add_string_side(s: int, link: int, p: wp.vec3d, n: wp.vec3d, sign: wp.float64, first: int, T: Trees):
    """J += sign l . S of the dofs on the way from a link to the root, in the place of Z."""
    d = int(-1)
    if link >= 0:
        d = T.t.last_dof[link]
    m = wp.cross(p, n)
    while d >= 0:
        e = T.strings.first_value[s] + d - first
        T.strings.Z[e] = T.strings.Z[e] + sign * (wp.dot(m, T.S_w[d]) + wp.dot(n, T.S_v[d]))
        d = T.t.dof_parent[d]


@standalone_function
@wp.func
def keep_loops_of_string(g: int, at: int, n: int, T: Trees):
    """Z becomes (1 - Q Q^T) Z. One lane."""
    for k in range(T.loops.rank[g]):
        q = T.loops.first_value[T.loops.first_row[g] + T.loops.order[T.loops.first_row[g] + k]]
        part = wp.float64(0.0)
        for d in range(n):
            part += T.loops.Q[q + d] * T.strings.Z[at + d]
        for d in range(n):
            T.strings.Z[at + d] = T.strings.Z[at + d] - part * T.loops.Q[q + d]


@standalone_function
@wp.func
def set_string_row(g: int, s: int, h: wp.float64, T: Trees):
    """Z of a string, its response, its length now, and its bend by straight ways. Links are placed, H is factored. One lane."""
    dofs = tree_dofs(g, T)
    n = dofs[1] - dofs[0]
    at = T.strings.first_value[s]
    root = T.t.first_link[g]
    ends = string_ends(s, T)
    for d in range(n):
        T.strings.Z[at + d] = wp.float64(0.0)
    arm = ends.p_b - T.X[root]
    add_string_side(s, T.strings.b[s], arm, ends.n, wp.float64(1.0), dofs[0], T)
    add_string_side(s, T.strings.a[s], arm, ends.n, wp.float64(-1.0), dofs[0], T)
    whole = substitute_dense_row(T.strings.Z, at, dofs[0], n, T)
    left = whole
    if T.loops.first_row[g + 1] > T.loops.first_row[g]:
        keep_loops_of_string(g, at, n, T)
        left = wp.float64(0.0)
        for d in range(n):
            left += T.strings.Z[at + d] * T.strings.Z[at + d]
    acts = left > EMPTY * whole and is_string_whole(s, T)
    T.strings.response[s] = wp.where(acts, left, wp.float64(0.0))
    T.strings.length[s] = ends.g
    T.strings.n[s] = ends.n
    T.strings.base[s] = wp.float64(0.0)
    T.strings.bend[s] = wp.float64(0.0)
    if h > wp.float64(0.0):
        T.strings.bend[s] = straight_bend(s, root, h, ends, T)
    if T.moves == 1:
        T.strings.base[s] = string_base_rate(s, root, ends, T)


@standalone_function
@wp.func
def start_tree_strings(g: int, h: wp.float64, T: Trees):
    """1 if a tree has strings, whose rows are ready. Impulses so far count for the substep."""
    found = int(0)
    if has_strings(g, T):
        found = 1
        move_tree_velocities(g, T)
        for s in range(T.strings.first_row[g] + tree_lane(), T.strings.first_row[g + 1], tree_lanes()):
            set_string_row(g, s, h, T)
            T.strings.taut[s] = 0
            if T.strings.push[s] != wp.float64(0.0):
                T.strings.taut[s] = int(wp.sign(T.strings.push[s]))
            T.strings.sum[s] = T.strings.sum[s] + T.strings.push[s]
            T.strings.push[s] = wp.float64(0.0)
        tree_barrier()
    return found


@standalone_function
@wp.func
def reset_string_impulses(g: int, T: Trees):
    """A substep begins: impulses count from 0."""
    for s in range(T.strings.first_row[g] + tree_lane(), T.strings.first_row[g + 1], tree_lanes()):
        T.strings.push[s] = wp.float64(0.0)
        T.strings.sum[s] = wp.float64(0.0)
    tree_barrier()


@standalone_function
@wp.func
def string_rates(s: int, h: wp.float64, T: Trees):
    """(lowest, highest) g' that keeps a string in its range over h [s]; h = 0: that it has at an end, behind the places."""
    zero = wp.float64(0.0)
    low = T.strings.low[s] - T.strings.length[s]
    high = T.strings.high[s] - T.strings.length[s]
    if h <= zero:
        low = wp.where(low >= -AT or T.strings.taut[s] > 0, zero, -FAR)
        high = wp.where(high <= AT or T.strings.taut[s] < 0, zero, FAR)
    else:
        low = (wp.where(low > zero, wp.min(BACK * low, h * PULL), low) - T.strings.bend[s]) / h
        high = (wp.where(high < zero, wp.max(BACK * high, -h * PULL), high) - T.strings.bend[s]) / h
    return wp.vec2d(low, high)


@standalone_function
@wp.func
def sweep_tree_strings(g: int, h: wp.float64, T: Trees):
    """One sweep over u; (largest change of a rate, largest rate)."""
    worst = wp.float64(0.0)
    most = wp.float64(0.0)
    dofs = tree_dofs(g, T)
    for s in range(T.strings.first_row[g], T.strings.first_row[g + 1]):
        a = T.strings.response[s]
        if a > wp.float64(0.0):
            at = T.strings.first_value[s] - dofs[0]
            own = wp.float64(0.0)
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                own += T.strings.Z[at + d] * T.u[d]
            rate = sum_over_lanes(own) + T.strings.base[s]
            ends = string_rates(s, h, T)
            before = T.strings.push[s]
            free = rate - a * before
            push = (wp.clamp(free, ends[0], ends[1]) - free) / a
            tree_barrier()                                     # all lanes have read u and push
            for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
                T.u[d] = T.u[d] + (push - before) * T.strings.Z[at + d]
            T.strings.push[s] = push
            tree_barrier()
            worst = wp.max(worst, a * wp.abs(push - before))
            most = wp.max(most, wp.abs(rate))
    return wp.vec2d(worst, most)


@standalone_function
@wp.func
def renew_string_bends(g: int, h: wp.float64, T: Trees):
    """bend of strings by u and by the places that it leads to, where the tree stands. Returns by how much they change [m]."""
    dofs = tree_dofs(g, T)
    found = wp.float64(0.0)
    for s in range(T.strings.first_row[g] + tree_lane(), T.strings.first_row[g + 1], tree_lanes()):
        rate = T.strings.base[s]
        for d in range(dofs[0], dofs[1]):
            rate += T.strings.Z[T.strings.first_value[s] + d - dofs[0]] * T.u[d]
        bend = string_ends(s, T).g - T.strings.length[s] - h * rate
        if T.strings.push[s] != wp.float64(0.0):
            found = wp.max(found, wp.abs(bend - T.strings.bend[s]))
        T.strings.bend[s] = bend
    tree_barrier()
    return greatest_of_lanes(found)


@standalone_function
@wp.func
def passes_tree_string(g: int, T: Trees):
    """1 where a string of a tree, which is placed, is out of its range."""
    found = int(0)
    for s in range(T.strings.first_row[g] + tree_lane(), T.strings.first_row[g + 1], tree_lanes()):
        length = string_ends(s, T).g
        if is_string_whole(s, T) and (length > T.strings.high[s] or length < T.strings.low[s]):
            found = 1
    return any_lane(found)
