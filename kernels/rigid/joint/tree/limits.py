"""Limits and dry friction of the joints of trees: impulses of a step, by projected Gauss-Seidel with the response of the
whole tree.

    limit      low <= g + h g' <= high, an impulse of its sign where this acts
    friction   against the rate, |impulse| <= h f / 2 on the mean rate of a step, and as much again on the rate at its end: of
               order 2 while it slides, and what it can hold stands still

Rows that overlap already are brought back by BACK of their depth in a step. (Jourdan, Alart, Jean 1998.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tables import FAR, LIMITED
from wsim.kernels.rigid.joint.tree.joint_forces import JointRow, row_rate, row_response_column, tree_joint_row
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees

SWEEPS = wp.constant(64)
DONE = wp.constant(wp.float64(1.0e-12))      # of the largest rate: change in a sweep at which sweeps end
BACK = wp.constant(wp.float64(0.2))
REACH, NEAR = wp.constant(wp.float64(4.0)), wp.constant(wp.float64(0.02))       # a blow may reach farther: then a step late


@wp.func
def limit_rates(r: JointRow, j: int, row: int, h: wp.float64, J: Linked):
    """(lowest, highest) rate that keeps g within its limits over h [s]; h = 0: that it has at a limit, behind the places."""
    zero = wp.float64(0.0)
    if h <= zero:
        low = wp.where(r.g <= J.t.low[j, row], zero, -FAR)
        high = wp.where(r.g >= J.t.high[j, row], zero, FAR)
        return wp.vec2d(low, high)
    low = (J.t.low[j, row] - r.g) / h
    high = (J.t.high[j, row] - r.g) / h
    if low > wp.float64(0.0):
        low = low * BACK
    if high < wp.float64(0.0):
        high = high * BACK
    return wp.vec2d(low, high)


@standalone_function
@wp.func
def is_limited(link: int, d: int, T: Trees, J: Linked):
    """Whether dof d of link l has a limit."""
    found = bool(False)
    if T.t.joint[link] >= 0:
        found = J.t.kind[T.t.joint[link], T.t.row[d]] == LIMITED
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


@standalone_function
@wp.func
def apply_row_impulse(g: int, d: int, impulse: wp.float64, T: Trees):
    """qd += H^-1 J^T impulse, by the column of dof d."""
    dofs = tree_dofs(g, T)
    for i in range(dofs[0], dofs[1]):
        T.qd[i] = T.qd[i] + impulse * T.column[T.first_column[d] + i - dofs[0]]


@standalone_function
@wp.func
def start_tree_limits(g: int, h: wp.float64, T: Trees, J: Linked):
    """Number of rows that act, as qd would have it; their columns are ready. H is factored."""
    t = T.t
    acting = int(0)
    for link in range(t.first_link[g], t.first_link[g + 1]):
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
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
                acting += 1
    return acting


@standalone_function
@wp.func
def reset_limit_impulses(g: int, T: Trees):
    """A step begins: impulses count from 0, those behind the places of the last step stay given."""
    dofs = tree_dofs(g, T)
    for d in range(dofs[0], dofs[1]):
        T.push[d] = wp.float64(0.0)
        T.rub[d] = wp.float64(0.0)


@standalone_function
@wp.func
def sweep_tree_limits(g: int, h: wp.float64, T: Trees, J: Linked):
    """One sweep; returns the largest change of a row's rate, over the largest rate."""
    t = T.t
    worst = wp.float64(0.0)
    most = wp.float64(1.0e-300)
    for link in range(t.first_link[g], t.first_link[g + 1]):
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
            a = T.response[d]
            if a > wp.float64(0.0):
                r = tree_joint_row(link, d, T, J)
                if t.friction[d] > wp.float64(0.0):
                    rate = T.qd[d]
                    rub = wp.clamp(T.rub[d] - rate / a, -T.rub_most[d], T.rub_most[d])
                    apply_row_impulse(g, d, rub - T.rub[d], T)
                    worst = wp.max(worst, a * wp.abs(rub - T.rub[d]))
                    most = wp.max(most, wp.abs(rate))
                    T.rub[d] = rub
                if is_limited(link, d, T, J):
                    ends = limit_rates(r, t.joint[link], t.row[d], h, J)
                    rate = row_rate(r, T.qd)
                    free = rate - a * T.push[d]
                    push = (wp.clamp(free, ends[0], ends[1]) - free) / a
                    apply_row_impulse(g, d, push - T.push[d], T)
                    worst = wp.max(worst, a * wp.abs(push - T.push[d]))
                    most = wp.max(most, wp.abs(rate))
                    T.push[d] = push
    return worst / most


@standalone_function
@wp.func
def solve_tree_limits(g: int, h: wp.float64, T: Trees, J: Linked):
    """qd obeys limits and friction of tree g. Returns what the last sweep changed, over the largest rate."""
    left = wp.float64(0.0)
    if start_tree_limits(g, h, T, J) > 0:
        sweep = int(0)
        left = wp.float64(1.0)
        while left > DONE and sweep < SWEEPS:
            left = sweep_tree_limits(g, h, T, J)
            sweep += 1
    return left


@standalone_function
@wp.func
def passes_tree_limit(g: int, T: Trees, J: Linked):
    """1 where a coordinate is beyond a limit, or a joint has dry friction."""
    t = T.t
    found = int(0)
    for link in range(t.first_link[g], t.first_link[g + 1]):
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
            if t.friction[d] > wp.float64(0.0):
                found = 1
            if is_limited(link, d, T, J):
                r = tree_joint_row(link, d, T, J)
                if r.g < J.t.low[t.joint[link], t.row[d]] or r.g > J.t.high[t.joint[link], t.row[d]]:
                    found = 1
    return found
