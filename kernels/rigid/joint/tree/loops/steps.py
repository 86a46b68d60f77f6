"""Steps of trees with loops: accelerations that keep them, and places and velocities behind a step (equations.py, basis.py).

    J qdd = -J' qd,   -J' qd = -(l' . (V_b - V_a) + l . (A_b - A_a)),   A: accelerations without qdd
    shift    l' = (v_p x e + (p_b - O) x e', e'),   e' = omega_a x e,   v_p the velocity of p_b
    turn     l' = (s' x u + s x u', 0)
    span     -J' qd = -n . (a_b - a_a) - (|w|^2 - (n . w)^2) / g,   a: accelerations of the ends without qdd, w = v_b - v_a
    mimic    -J' qd = p'' qd_b^2
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.kinematics import move_tree_coordinates, place_tree
from wsim.kernels.rigid.joint.tree.lanes import greatest_of_lanes, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.basis import add_loop_correction, constrain_tree_rates, loop_row_rate, ready_loops
from wsim.kernels.rigid.joint.tree.loops.equations import (
    loop_row_ends,
    loop_row_line,
    loop_violation,
    mimic_polynomial,
    tree_loop_rows,
)
from wsim.kernels.rigid.joint.tree.mass_matrix import assemble_tree_matrix, factor_tree_matrix, tree_dofs
from wsim.kernels.rigid.joint.tree.tables import LOOP_SHIFT, LOOP_SPAN, LOOP_TURN, Trees

CLOSED = wp.constant(wp.float64(1.0e-12))      # [m], [rad] of a loop that is closed
FARTHEST = wp.constant(wp.float64(0.3))        # [m], [rad] of a coordinate in a step of Newton's method
TRIES = wp.constant(12)
FOLLOWS = wp.constant(wp.float64(0.5))         # a step that leaves more of the gap ends it


@wp.func
def end_motion(link: int, r: wp.vec3d, T: Trees):
    """(velocity, acceleration without qdd) of the place r from O on a link; -1: 0."""
    v = wp.vec3d()
    a = wp.vec3d()
    if link >= 0:
        w = T.W[link]
        v = T.V[link] + wp.cross(w, r)
        a = T.A_v[link] + wp.cross(T.A_w[link], r) + wp.cross(w, v)
    return v, a


@standalone_function
@wp.func
def span_row_bias(r: int, root: int, T: Trees):
    """-J' qd of a span."""
    ends = loop_row_ends(r, T)
    v_a, a_a = end_motion(T.loops.a[r], ends.p_a - T.X[root], T)
    v_b, a_b = end_motion(T.loops.b[r], ends.p_b - T.X[root], T)
    w = v_b - v_a
    along = wp.dot(ends.u, w)
    g = wp.max(wp.dot(ends.u, ends.p_b - ends.p_a), wp.float64(1.0e-300))
    return -wp.dot(ends.u, a_b - a_a) - (wp.dot(w, w) - along * along) / g


@standalone_function
@wp.func
def loop_row_bias(r: int, root: int, T: Trees):
    """-J' qd of a row. Velocities of links and their accelerations without qdd are there."""
    kind = T.loops.kind[r]
    found = wp.float64(0.0)
    if kind == LOOP_SPAN:
        found = span_row_bias(r, root, T)
    elif kind == LOOP_SHIFT or kind == LOOP_TURN:
        ends = loop_row_ends(r, T)
        a = T.loops.a[r]
        b = T.loops.b[r]
        w_a = wp.vec3d()
        w = wp.vec3d()
        v = wp.vec3d()
        A_w = wp.vec3d()
        A_v = wp.vec3d()
        w_b = wp.vec3d()
        v_b = wp.vec3d()
        if b >= 0:
            w_b = T.W[b]
            v_b = T.V[b]
            w = T.W[b]
            v = T.V[b]
            A_w = T.A_w[b]
            A_v = T.A_v[b]
        if a >= 0:
            w_a = T.W[a]
            w -= T.W[a]
            v -= T.V[a]
            A_w -= T.A_w[a]
            A_v -= T.A_v[a]
        line = loop_row_line(r, root, ends, T)
        m = wp.vec3d(line[0], line[1], line[2])
        turned = wp.cross(w_a, ends.u)
        if kind == LOOP_SHIFT:
            p = ends.p_b - T.X[root]
            moved = wp.cross(v_b + wp.cross(w_b, p), ends.u) + wp.cross(p, turned)
            found = -(wp.dot(moved, w) + wp.dot(turned, v) + wp.dot(m, A_w) + wp.dot(ends.u, A_v))
        else:
            moved = wp.cross(wp.cross(w_b, ends.s), ends.u) + wp.cross(ends.s, turned)
            found = -(wp.dot(moved, w) + wp.dot(m, A_w))
    elif T.loops.b[r] >= 0:
        rate = T.qd[T.loops.b[r]]
        found = mimic_polynomial(r, T.q[T.loops.c_b[r]], T)[2] * rate * rate
    return found


@standalone_function
@wp.func
def constrain_tree_accelerations(g: int, T: Trees):
    """tau, accelerations without loops, become those with them. The tree is evaluated, H is factored."""
    rows = tree_loop_rows(g, T)
    if rows[1] > rows[0]:
        ready_loops(g, T)
        for r in range(rows[0] + tree_lane(), rows[1], tree_lanes()):
            T.loops.z[r] = loop_row_bias(r, T.t.first_link[g], T) - loop_row_rate(g, r, T.tau, T)
        add_loop_correction(g, T.tau, T)


@standalone_function
@wp.func
def constrain_tree_stage(g: int, T: Trees):
    """tau, solved for where a step of ros2 begins, becomes the nearest with J tau = J like. H is the stage's, factored."""
    rows = tree_loop_rows(g, T)
    if rows[1] > rows[0]:
        place_tree(g, T)
        ready_loops(g, T)
        for r in range(rows[0] + tree_lane(), rows[1], tree_lanes()):
            T.loops.z[r] = loop_row_rate(g, r, T.loops.like, T) - loop_row_rate(g, r, T.tau, T)
        add_loop_correction(g, T.tau, T)


@standalone_function
@wp.func
def note_tree_stage(g: int, T: Trees):
    """like = rate."""
    rows = tree_loop_rows(g, T)
    if rows[1] > rows[0]:
        dofs = tree_dofs(g, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.loops.like[d] = T.rate[d]
        tree_barrier()


@standalone_function
@wp.func
def measure_loop_gap(g: int, T: Trees):
    """Sets C of the rows of tree g, which is placed; returns the largest."""
    rows = tree_loop_rows(g, T)
    found = wp.float64(0.0)
    for r in range(rows[0] + tree_lane(), rows[1], tree_lanes()):
        C = loop_violation(r, T)
        T.loops.C[r] = C
        found = wp.max(found, wp.abs(C))
    tree_barrier()
    return greatest_of_lanes(found)


@standalone_function
@wp.func
def step_to_loops(g: int, T: Trees):
    """A step of Newton's method for C = 0 from q, by C as measured. Places the tree."""
    rows = tree_loop_rows(g, T)
    dofs = tree_dofs(g, T)
    for r in range(rows[0] + tree_lane(), rows[1], tree_lanes()):
        T.loops.z[r] = -T.loops.C[r]
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        T.loops.like[d] = wp.float64(0.0)
    add_loop_correction(g, T.loops.like, T)
    most = wp.float64(0.0)
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        most = wp.max(most, wp.abs(T.loops.like[d]))
    part = wp.min(wp.float64(1.0), FARTHEST / wp.max(greatest_of_lanes(most), FARTHEST))
    move_tree_coordinates(g, part, T.loops.like, T.q, T)
    place_tree(g, T)


@standalone_function
@wp.func
def close_tree_loops(g: int, T: Trees):
    """q and qd become the nearest that keep the loops of tree g, by Newton's method."""
    rows = tree_loop_rows(g, T)
    if rows[1] > rows[0]:
        before = wp.float64(1.0e300)
        tries = int(0)
        place_tree(g, T)
        gap = measure_loop_gap(g, T)
        while gap > CLOSED and gap < FOLLOWS * before and tries < TRIES:
            assemble_tree_matrix(g, T)
            factor_tree_matrix(g, T)
            ready_loops(g, T)
            step_to_loops(g, T)
            before = gap
            gap = measure_loop_gap(g, T)
            tries += 1
        assemble_tree_matrix(g, T)
        factor_tree_matrix(g, T)
        ready_loops(g, T)
        constrain_tree_rates(g, T.qd, T)
