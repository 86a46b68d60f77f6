"""Orthonormal basis of what the equations of a tree's loops hold (equations.py). In velocities u = C qd (responses.py),

    C^-T J^T = Q R,   Q^T Q = 1,   qd + C^-1 Q R^-T (b - J qd)

is the one nearest to a given qd, by kinetic energy, with J qd = b: accelerations with b = -J' qd, steps of Newton's method for
C = 0. An impulse Z i of a limit or contact becomes (1 - Q Q^T) Z i, so that a loop is as rigid as a joint. Rows that others
imply (a planar linkage has 3 of 5) are left out: Gram-Schmidt with pivots, down to EMPTY of what a row is that has the whole
motion of its place.

(Golub, Van Loan 2013, section 5.4.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.equations import set_loop_row, tree_loop_rows
from wsim.kernels.rigid.joint.tree.mass_matrix import solve_lower_factor, tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees

EMPTY = wp.constant(wp.float64(1.0e-8))        # sin^2 of the angle to other rows: 1e-4 rad of joints that do not quite agree


@standalone_function
@wp.func
def largest_loop_row(first: int, rank: int, n: int, T: Trees):
    """Place in the order of the row with the largest part left, behind so many pivots; -1: nothing is left."""
    best = int(-1)
    most = wp.float64(EMPTY)
    for i in range(rank, n):
        o = first + T.loops.order[first + i]
        if T.loops.left[o] > most * T.loops.size[o]:
            most = T.loops.left[o] / T.loops.size[o]
            best = i
    return best


@standalone_function
@wp.func
def subtract_loop_row(p: int, r: int, dofs: int, T: Trees):
    """Row r loses its part along the unit row p, which it returns. One lane."""
    part = wp.float64(0.0)
    for d in range(dofs):
        part += T.loops.Q[T.loops.first_value[p] + d] * T.loops.Q[T.loops.first_value[r] + d]
    size = wp.float64(0.0)
    for d in range(dofs):
        e = T.loops.first_value[r] + d
        y = T.loops.Q[e] - part * T.loops.Q[T.loops.first_value[p] + d]
        T.loops.Q[e] = y
        size += y * y
    T.loops.left[r] = size
    return part


@standalone_function
@wp.func
def factor_loop_rows(g: int, T: Trees):
    """Q and R in the order of the largest pivots, and their number."""
    rows = tree_loop_rows(g, T)
    first = rows[0]
    n = rows[1] - first
    at = T.loops.first_square[g]
    dofs = tree_dofs(g, T)
    for i in range(tree_lane(), n, tree_lanes()):
        T.loops.order[first + i] = i
    tree_barrier()
    rank = int(0)
    best = largest_loop_row(first, 0, n, T)
    while best >= 0:
        p = T.loops.order[first + best]
        other = T.loops.order[first + rank]
        size = wp.sqrt(T.loops.left[first + p])
        tree_barrier()                                     # all lanes have read these
        if tree_lane() == 0:
            T.loops.order[first + best] = other
            T.loops.order[first + rank] = p
            T.loops.R[at + n * p + rank] = size
        for d in range(tree_lane(), dofs[1] - dofs[0], tree_lanes()):
            e = T.loops.first_value[first + p] + d
            T.loops.Q[e] = T.loops.Q[e] / size
        tree_barrier()
        for i in range(rank + 1 + tree_lane(), n, tree_lanes()):
            o = T.loops.order[first + i]
            T.loops.R[at + n * o + rank] = subtract_loop_row(first + p, first + o, dofs[1] - dofs[0], T)
        tree_barrier()
        rank += 1
        best = largest_loop_row(first, rank, n, T)
    T.loops.rank[g] = rank
    tree_barrier()


@standalone_function
@wp.func
def ready_loops(g: int, T: Trees):
    """J, Q and R of tree g, which is placed. H is factored."""
    rows = tree_loop_rows(g, T)
    if rows[1] > rows[0]:
        for r in range(rows[0] + tree_lane(), rows[1], tree_lanes()):
            set_loop_row(g, r, T)
        tree_barrier()
        factor_loop_rows(g, T)


@standalone_function
@wp.func
def loop_row_rate(g: int, r: int, x: wp.array(dtype=wp.float64), T: Trees):
    """J x of a row. One lane."""
    dofs = tree_dofs(g, T)
    found = wp.float64(0.0)
    for d in range(dofs[0], dofs[1]):
        found += T.loops.J[T.loops.first_value[r] + d - dofs[0]] * x[d]
    return found


@wp.func
def loop_combination(g: int, d: int, T: Trees):
    """(Q z)_d: z by rows, those of pivots."""
    first = T.loops.first_row[g]
    found = wp.float64(0.0)
    for k in range(T.loops.rank[g]):
        r = first + T.loops.order[first + k]
        found += T.loops.Q[T.loops.first_value[r] + d] * T.loops.z[r]
    return found


@standalone_function
@wp.func
def add_loop_correction(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x += C^-1 Q R^-T z, z: b - J x."""
    first = T.loops.first_row[g]
    n = T.loops.first_row[g + 1] - first
    at = T.loops.first_square[g]
    dofs = tree_dofs(g, T)
    tree_barrier()
    if tree_lane() == 0:
        for i in range(T.loops.rank[g]):
            o = T.loops.order[first + i]
            y = T.loops.z[first + o]
            for k in range(i):
                y -= T.loops.R[at + n * o + k] * T.loops.z[first + T.loops.order[first + k]]
            T.loops.z[first + o] = y / T.loops.R[at + n * o + i]
    tree_barrier()
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        T.loops.x[d] = loop_combination(g, d - dofs[0], T) / wp.sqrt(T.H[T.t.first_entry[d]])
    tree_barrier()
    solve_lower_factor(g, T.loops.x, T)
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        x[d] = x[d] + T.loops.x[d]
    tree_barrier()


@standalone_function
@wp.func
def constrain_tree_rates(g: int, x: wp.array(dtype=wp.float64), T: Trees):
    """x becomes the nearest one with J x = 0."""
    rows = tree_loop_rows(g, T)
    if rows[1] > rows[0]:
        for r in range(rows[0] + tree_lane(), rows[1], tree_lanes()):
            T.loops.z[r] = -loop_row_rate(g, r, x, T)
        add_loop_correction(g, x, T)
