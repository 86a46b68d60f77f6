"""Frames of joints where their bodies are, their rows and arms, and the matrix A of an island of them."""

import warp as wp

from wsim.kernels.rigid.joint.coordinates import PI, Ends, place_of, unwound
from wsim.kernels.rigid.joint.elimination import Linked, factor, mat66d, product, put_below, put_diagonal
from wsim.kernels.rigid.joint.rows import both


@wp.func(inline=False)
def ends_of(j: int, k: int, J: Linked):
    """Frames of a joint with bodies as they are in J; of anchors those of row k."""
    e = Ends()
    row = k * J.t.moving
    a = J.t.a[j]
    b = J.t.b[j]
    if a >= 0:
        e.c_a = J.X[a]
        e.p_a = J.X[a] + wp.quat_rotate(J.Q[a], J.t.at_a[j])
        e.Q_a = J.Q[a] * J.t.turn_a[j]
    else:
        e.c_a = J.t.anchor_x[row, j]
        e.p_a = e.c_a
        e.Q_a = J.t.anchor_q[row, j]
    if b >= 0:
        e.c_b = J.X[b] + J.t.apart[j]
        e.p_b = e.c_b + wp.quat_rotate(J.Q[b], J.t.at_b[j])
        e.Q_b = J.Q[b] * J.t.turn_b[j]
    else:
        e.c_b = J.t.anchor_x[row, j] + J.t.apart[j]
        e.p_b = e.c_b
        e.Q_b = J.t.anchor_q[row, j]
    return e


@wp.func(inline=False)
def shared(k: int, i: int, J: Linked):
    """A_ki of two joints, by the bodies of both."""
    A = mat66d()
    a = J.t.a[i]
    b = J.t.b[i]
    if a >= 0 and a == J.t.a[k]:
        A = A + product(k, i, J.r_a[k], J.r_a[i], J.t.w[a], J.S[a], J)
    if b >= 0 and b == J.t.b[k]:
        A = A + product(k, i, J.r_b[k], J.r_b[i], J.t.w[b], J.S[b], J)
    if a >= 0 and a == J.t.b[k]:
        A = A - product(k, i, J.r_b[k], J.r_a[i], J.t.w[a], J.S[a], J)
    if b >= 0 and b == J.t.a[k]:
        A = A - product(k, i, J.r_a[k], J.r_b[i], J.t.w[b], J.S[b], J)
    return A


@wp.func
def factored(first: int, last: int, J: Linked):
    """A of the rows that act, and its factor."""
    for i in range(first, last):
        put_diagonal(i, both(i, J), J)
        for e in range(J.t.first_near[i], J.t.first_near[i + 1]):
            k = J.t.near[e]
            put_below(J.t.a.shape[0] + e, k, i, shared(k, i, J), J)
    factor(first, last, J)


@wp.func(inline=False)
def lined(j: int, k: int, J: Linked):
    """Coordinates of a joint now, its rows and arms."""
    e = ends_of(j, k, J)
    at = place_of(e, J.t.form[j], J.t.cone[j])
    J.axis[j] = at.axis
    J.turn[j] = at.turn
    J.r_a[j] = e.p_b - e.c_a
    J.r_b[j] = e.p_b - e.c_b
    phi = unwound(at.turned[0], J.quarters[j])
    J.quarters[j] = int(wp.round(wp.float64(2.0) * phi / PI))
    three = int(3)
    for r in range(three):
        J.now[j, r] = at.shift[r]
        J.now[j, 3 + r] = at.turned[r]
    J.now[j, 3] = phi
