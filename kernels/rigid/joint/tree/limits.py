"""Limits and dry friction of the joints of trees: impulses of a step, by projected Gauss-Seidel with the response of the
whole tree.

    limit      low <= g + h g' <= high, an impulse of its sign where this acts
    friction   against the rate, |impulse| <= h f / 2 on the mean rate of a step, and as much again on the rate at its end: of
               order 2 while it slides, and what it can hold stands still

Rows that overlap already are brought back by BACK of their depth in a step, at PULL or SPIN at most.

(Jourdan, Alart, Jean 1998.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.rows import PULL, SPIN
from wsim.kernels.rigid.joint.tables import FAR, LIMITED
from wsim.kernels.rigid.joint.tree.joint_forces import JointRow, row_rate, row_response_column, tree_joint_row
from wsim.kernels.rigid.joint.tree.lanes import any_lane, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.impulses import keep_loops_of_row
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees

AT = wp.constant(wp.float64(1.0e-9))         # [m], [rad] from a limit: there, behind the places
BACK = wp.constant(wp.float64(0.2))
REACH, NEAR = wp.constant(wp.float64(4.0)), wp.constant(wp.float64(0.02))       # a blow may reach farther: then a step late


@wp.func
def limit_rates(r: JointRow, j: int, row: int, h: wp.float64, J: Linked):
    """(lowest, highest) rate that keeps g within its limits over h [s]; h = 0: that it has at a limit, behind the places."""
    zero = wp.float64(0.0)
    if h <= zero:
        low = wp.where(r.g <= J.t.low[j, row] + AT, zero, -FAR)
        high = wp.where(r.g >= J.t.high[j, row] - AT, zero, FAR)
        return wp.vec2d(low, high)
    low = (J.t.low[j, row] - r.g) / h
    high = (J.t.high[j, row] - r.g) / h
    most = wp.where(row < 3, PULL, SPIN)
    if low > wp.float64(0.0):
        low = wp.min(low * BACK, most)
    if high < wp.float64(0.0):
        high = wp.max(high * BACK, -most)
    return wp.vec2d(low, high)


@standalone_function
@wp.func
def is_limited(link: int, d: int, T: Trees, J: Linked):
    """Whether dof d of link l has a limit."""
    found = bool(False)
    j = T.t.joint[link]
    if j >= 0:
        found = J.t.kind[j, T.t.row[d]] == LIMITED and J.broken[j] == 0
    return found


@standalone_function
@wp.func
def near_limit(link: int, d: int, h: wp.float64, T: Trees, J: Linked):
    """Whether a limit may act in the next step of h [s]: nearer than REACH steps at the rate now, or than NEAR of the range."""
    r = tree_joint_row(link, d, T, J)
    j = T.t.joint[link]
    low = J.t.low[j, T.t.row[d]]
    high = J.t.high[j, T.t.row[d]]
    reach = REACH * h * wp.abs(row_rate(r, T.qd)) + NEAR * wp.min(high - low, wp.float64(1.0))
    return r.g - low < reach or high - r.g < reach


@wp.func
def last_row_dof(d: int, T: Trees):
    """Last dof on which row d depends: of a ball its third."""
    link = T.t.dof_link[d]
    found = d
    if T.t.ball[link] == 1 and d >= T.t.first_dof[link] + T.t.slides[link]:
        found = T.t.first_dof[link + 1] - 1
    return found


@standalone_function
@wp.func
def column_rate(d: int, T: Trees):
    """J qd of row d, by u (responses.py)."""
    last = last_row_dof(d, T)
    row = T.t.first_entry[last]
    found = wp.float64(0.0)
    for p in range(T.t.first_entry[last + 1] - row):
        found += T.column[T.first_column[d] + p] * T.u[T.t.entry_dof[row + p]]
    return found


@standalone_function
@wp.func
def apply_row_impulse(d: int, impulse: wp.float64, T: Trees):
    """u += Z impulse, by the column of dof d."""
    last = last_row_dof(d, T)
    row = T.t.first_entry[last]
    tree_barrier()                                     # all lanes have read u
    for p in range(tree_lane(), T.t.first_entry[last + 1] - row, tree_lanes()):
        k = T.t.entry_dof[row + p]
        T.u[k] = T.u[k] + impulse * T.column[T.first_column[d] + p]
    tree_barrier()


@standalone_function
@wp.func
def start_tree_limits(g: int, h: wp.float64, T: Trees, J: Linked):
    """1 if a row acts, as qd would have it; the columns of those are ready. H is factored."""
    t = T.t
    acting = int(0)
    dofs = tree_dofs(g, T)
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        link = t.dof_link[d]
        T.push[d] = wp.float64(0.0)
        T.rub[d] = wp.float64(0.0)
        T.response[d] = wp.float64(0.0)
        if h > wp.float64(0.0):
            T.rub_most[d] = wp.float64(0.5) * h * t.friction[d]
        acts = t.friction[d] > wp.float64(0.0)
        if is_limited(link, d, T, J):
            acts = acts or near_limit(link, d, h, T, J)
        if acts:
            T.response[d] = row_response_column(g, tree_joint_row(link, d, T, J), d, T)
            acting = 1
    tree_barrier()
    return any_lane(acting)


@standalone_function
@wp.func
def reset_limit_impulses(g: int, T: Trees):
    """A step begins: impulses count from 0, those behind the places of the last step stay given."""
    dofs = tree_dofs(g, T)
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        T.push[d] = wp.float64(0.0)
        T.rub[d] = wp.float64(0.0)
    tree_barrier()


@standalone_function
@wp.func
def sweep_tree_limits(g: int, h: wp.float64, T: Trees, J: Linked):
    """One sweep over u; (largest change of a row's rate, largest rate)."""
    t = T.t
    worst = wp.float64(0.0)
    most = wp.float64(1.0e-300)
    dofs = tree_dofs(g, T)
    for d in range(dofs[0], dofs[1]):
        a = T.response[d]
        if a > wp.float64(0.0):
            link = t.dof_link[d]
            if t.friction[d] > wp.float64(0.0):
                rate = column_rate(d, T)
                before = T.rub[d]
                rub = wp.clamp(before - rate / a, -T.rub_most[d], T.rub_most[d])
                apply_row_impulse(d, rub - before, T)
                keep_loops_of_row(g, d, last_row_dof(d, T), rub - before, T)
                worst = wp.max(worst, a * wp.abs(rub - before))
                most = wp.max(most, wp.abs(rate))
                T.rub[d] = rub
            if is_limited(link, d, T, J):
                ends = limit_rates(tree_joint_row(link, d, T, J), t.joint[link], t.row[d], h, J)
                rate = column_rate(d, T)
                before = T.push[d]
                free = rate - a * before
                push = (wp.clamp(free, ends[0], ends[1]) - free) / a
                apply_row_impulse(d, push - before, T)
                keep_loops_of_row(g, d, last_row_dof(d, T), push - before, T)
                worst = wp.max(worst, a * wp.abs(push - before))
                most = wp.max(most, wp.abs(rate))
                T.push[d] = push
            tree_barrier()
    return wp.vec2d(worst, most)


@standalone_function
@wp.func
def passes_tree_limit(g: int, T: Trees, J: Linked):
    """1 where a coordinate is beyond a limit, or a joint has dry friction."""
    t = T.t
    found = int(0)
    dofs = tree_dofs(g, T)
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        link = t.dof_link[d]
        if t.friction[d] > wp.float64(0.0):
            found = 1
        if is_limited(link, d, T, J):
            r = tree_joint_row(link, d, T, J)
            if r.g < J.t.low[t.joint[link], t.row[d]] or r.g > J.t.high[t.joint[link], t.row[d]]:
                found = 1
    return any_lane(found)
