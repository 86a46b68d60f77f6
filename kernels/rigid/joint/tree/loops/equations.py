"""Equations between the coordinates of a tree: joints that close loops, and joints that mimic others.

    shift    C = e . (p_b - p_a), e fixed in a            C' = l . (V_b - V_a), l = ((p_b - O) x e, e)
    turn     C = u . s, u fixed in a, s in b              C' = l . (V_b - V_a), l = (s x u, 0)
    span     C = |p_b - p_a| - length                      C' = l . (V_b - V_a), l = ((p_b - O) x n, n), n along p_b - p_a
    mimic    C = q_a - sum_k c_k q_b^k                    C' = qd_a - p'(q_b) qd_b

C' = J qd. A hinge has u, s = (y, x), (z, x); a joint that locks all turns (z, y) too.

(Featherstone 2008, section 8.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import rotate_vector
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.tables import LOOP_MIMIC, LOOP_SPAN, LOOP_TURN, Trees, vec6d


@wp.struct
class LoopEnds:
    """Places and axes of a row's two sides in the world, from where the root began."""
    p_a: wp.vec3d
    p_b: wp.vec3d
    u: wp.vec3d
    s: wp.vec3d


@wp.func
def tree_loop_rows(g: int, T: Trees):
    """(first, last) row of a tree, the last one left out."""
    return wp.vec2i(T.loops.first_row[g], T.loops.first_row[g + 1])


@wp.func
def link_frame_place(link: int, at: wp.vec3d, T: Trees):
    """Where a place of a link is, or of the world (-1), from where the root began."""
    found = at
    if link >= 0:
        found = T.X[link] + rotate_vector(T.Q[link], at)
    return found


@standalone_function
@wp.func
def loop_row_ends(r: int, T: Trees):
    found = LoopEnds()
    a = T.loops.a[r]
    b = T.loops.b[r]
    found.p_a = link_frame_place(a, T.loops.at_a[r], T)
    found.u = T.loops.e_a[r]
    found.p_b = link_frame_place(b, T.loops.at_b[r], T)
    found.s = T.loops.e_b[r]
    if a >= 0:
        found.u = rotate_vector(T.Q[a], found.u)
    if b >= 0:
        found.s = rotate_vector(T.Q[b], found.s)
    if T.loops.kind[r] == LOOP_SPAN:
        found.u = wp.normalize(found.p_b - found.p_a)
    return found


@wp.func
def mimic_polynomial(r: int, q: wp.float64, T: Trees):
    """(p, p', p'') of the coordinate that is followed."""
    c = T.loops.coefficients[r]
    p = c[4]
    slope = wp.float64(0.0)
    bend = wp.float64(0.0)
    four = int(4)
    for k in range(four):
        bend = bend * q + wp.float64(2.0) * slope
        slope = slope * q + p
        p = p * q + c[3 - k]
    return wp.vec3d(p, slope, bend)


@standalone_function
@wp.func
def loop_violation(r: int, T: Trees):
    """C of a row. Links are placed."""
    kind = T.loops.kind[r]
    found = wp.float64(0.0)
    if kind != LOOP_MIMIC:
        ends = loop_row_ends(r, T)
        found = wp.where(kind == LOOP_TURN, wp.dot(ends.u, ends.s), wp.dot(ends.u, ends.p_b - ends.p_a))
        found -= T.loops.coefficients[r][0]
    else:
        leader = wp.float64(0.0)
        if T.loops.c_b[r] >= 0:
            leader = T.q[T.loops.c_b[r]]
        found = T.q[T.loops.c_a[r]] - mimic_polynomial(r, leader, T)[0]
    return found


@wp.func
def loop_row_line(r: int, root: int, ends: LoopEnds, T: Trees):
    """l of a shift, turn or span."""
    found = vec6d()
    if T.loops.kind[r] != LOOP_TURN:
        m = wp.cross(ends.p_b - T.X[root], ends.u)
        found = vec6d(m[0], m[1], m[2], ends.u[0], ends.u[1], ends.u[2])
    else:
        m = wp.cross(ends.s, ends.u)
        found = vec6d(m[0], m[1], m[2], wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    return found


@standalone_function
@wp.func
def add_loop_side(r: int, link: int, line: vec6d, p: wp.vec3d, sign: wp.float64, first: int, T: Trees):
    """J of a row += sign l . S of the dofs on the way from a link to the root; Q: by how much they move the place p from O, or
    turn it, in any direction."""
    d = int(-1)
    if link >= 0:
        d = T.t.last_dof[link]
    w = wp.vec3d(line[0], line[1], line[2])
    v = wp.vec3d(line[3], line[4], line[5])
    while d >= 0:
        e = T.loops.first_value[r] + d - first
        T.loops.J[e] = T.loops.J[e] + sign * (wp.dot(w, T.S_w[d]) + wp.dot(v, T.S_v[d]))
        moved = T.S_w[d]
        if T.loops.kind[r] != LOOP_TURN:
            moved = T.S_v[d] + wp.cross(T.S_w[d], p)
        T.loops.Q[e] = wp.max(T.loops.Q[e], wp.length(moved))
        d = T.t.dof_parent[d]


@standalone_function
@wp.func
def substitute_dense_row(x: wp.array(dtype=wp.float64), at: int, first: int, n: int, T: Trees):
    """Row x[at], ..., of n dofs from `first` on, becomes C^-T x. Returns its size^2. One lane."""
    size = wp.float64(0.0)
    for back in range(n):
        k = n - 1 - back
        row = T.t.first_entry[first + k]
        y = x[at + k]
        for e in range(row + 1, T.t.first_entry[first + k + 1]):
            to = at + T.t.entry_dof[e] - first
            x[to] = x[to] - T.H[e] * y
        y = y / wp.sqrt(T.H[row])
        x[at + k] = y
        size += y * y
    return size


@standalone_function
@wp.func
def set_loop_row(g: int, r: int, T: Trees):
    """J of a row, and C^-T J^T in the place of Q. Links are placed, H is factored. One lane."""
    t = T.t
    one = wp.float64(1.0)
    dofs = tree_dofs(g, T)
    first = dofs[0]
    n = dofs[1] - first
    at = T.loops.first_value[r]
    for d in range(n):
        T.loops.J[at + d] = wp.float64(0.0)
        T.loops.Q[at + d] = wp.float64(0.0)
    if T.loops.kind[r] != LOOP_MIMIC:
        root = t.first_link[g]
        ends = loop_row_ends(r, T)
        line = loop_row_line(r, root, ends, T)
        add_loop_side(r, T.loops.b[r], line, ends.p_b - T.X[root], one, first, T)
        add_loop_side(r, T.loops.a[r], line, ends.p_b - T.X[root], -one, first, T)
    else:
        T.loops.J[at + T.loops.a[r] - first] = one
        if T.loops.b[r] >= 0:
            T.loops.J[at + T.loops.b[r] - first] = -mimic_polynomial(r, T.q[T.loops.c_b[r]], T)[1]
    whole = wp.float64(0.0)
    own = wp.float64(0.0)
    for d in range(n):
        y = T.loops.J[at + d]
        own += y * y
        whole += T.loops.Q[at + d] * T.loops.Q[at + d]
        T.loops.Q[at + d] = y
    size = substitute_dense_row(T.loops.Q, at, first, n, T)
    T.loops.left[r] = size
    T.loops.size[r] = size * wp.max(one, whole / wp.max(own, wp.float64(1.0e-300)))
