"""Frames of joints where their bodies are, their rows and arms, and the matrix A of an island of them."""

import warp as wp

from wsim.kernels.rigid.joint.coordinates import PI, JointCoordinates, JointFrames, joint_coordinates, unwind_twist_angle
from wsim.kernels.rigid.joint.elimination import Linked, block_product, factor_joint_blocks, mat66d, put_below, put_diagonal
from wsim.kernels.rigid.joint.rows import own_joint_block


@wp.func(inline=False)
def ends_of(j: int, k: int, J: Linked):
    """Frames of a joint with bodies as they are in J; of anchors those of row k."""
    ends = JointFrames()
    row = k * J.t.moving
    a = J.t.a[j]
    b = J.t.b[j]
    if a >= 0:
        ends.c_a = J.X[a]
        ends.p_a = J.X[a] + wp.quat_rotate(J.Q[a], J.t.at_a[j])
        ends.Q_a = J.Q[a] * J.t.turn_a[j]
    else:
        ends.c_a = J.t.anchor_x[row, j]
        ends.p_a = ends.c_a
        ends.Q_a = J.t.anchor_q[row, j]
    if b >= 0:
        ends.c_b = J.X[b] + J.t.apart[j]
        ends.p_b = ends.c_b + wp.quat_rotate(J.Q[b], J.t.at_b[j])
        ends.Q_b = J.Q[b] * J.t.turn_b[j]
    else:
        ends.c_b = J.t.anchor_x[row, j] + J.t.apart[j]
        ends.p_b = ends.c_b
        ends.Q_b = J.t.anchor_q[row, j]
    return ends


@wp.func(inline=False)
def coupling_joint_block(k: int, i: int, J: Linked):
    """A_ki of two joints, by the bodies of both."""
    A = mat66d()
    a = J.t.a[i]
    b = J.t.b[i]
    if a >= 0 and a == J.t.a[k]:
        A = A + block_product(k, i, J.r_a[k], J.r_a[i], J.t.w[a], J.S[a], J)
    if b >= 0 and b == J.t.b[k]:
        A = A + block_product(k, i, J.r_b[k], J.r_b[i], J.t.w[b], J.S[b], J)
    if a >= 0 and a == J.t.b[k]:
        A = A - block_product(k, i, J.r_b[k], J.r_a[i], J.t.w[a], J.S[a], J)
    if b >= 0 and b == J.t.a[k]:
        A = A - block_product(k, i, J.r_a[k], J.r_b[i], J.t.w[b], J.S[b], J)
    return A


@wp.func
def factor_joint_island(first: int, last: int, J: Linked):
    """A of the rows that act, and its factor."""
    for i in range(first, last):
        put_diagonal(i, own_joint_block(i, J), J)
        for e in range(J.t.first_near[i], J.t.first_near[i + 1]):
            k = J.t.near[e]
            put_below(J.t.a.shape[0] + e, k, i, coupling_joint_block(k, i, J), J)
    factor_joint_blocks(first, last, J)


@wp.func
def row_response(by: wp.vec3d, w: wp.float64, n: wp.vec3d, S: wp.mat33d):
    """What a row of A has on its diagonal by one body: n of its velocity, `by` of its angular velocity."""
    return w * wp.dot(n, n) + wp.dot(by, S * by)


@wp.func(inline=False)
def measure_turn(j: int, e: JointFrames, at: JointCoordinates, part: wp.float64, J: Linked):
    """Sets `turned` of a joint's rows: (D M^-1 D^T)_rr / 2 of their change D from now to the frames e. part: see `fast`."""
    a = J.t.a[j]
    b = J.t.b[j]
    zero = wp.vec3d()
    half = wp.float64(0.5) * part * part
    three = int(3)
    for r in range(three):
        n = J.axis[j][r]
        m = at.axis[r]
        turn = at.turn[r] - J.turn[j][r]
        shifts = wp.float64(0.0)
        turns = wp.float64(0.0)
        if a >= 0:
            by = wp.cross(e.p_b - e.c_a, m) - wp.cross(J.r_a[j], n)
            shifts += row_response(by, J.t.w[a], m - n, J.S[a])
            turns += row_response(turn, J.t.w[a], zero, J.S[a])
        if b >= 0:
            by = wp.cross(e.p_b - e.c_b, m) - wp.cross(J.r_b[j], n)
            shifts += row_response(by, J.t.w[b], m - n, J.S[b])
            turns += row_response(turn, J.t.w[b], zero, J.S[b])
        J.turned[j, r] = half * shifts
        J.turned[j, 3 + r] = half * turns


@wp.func(inline=False)
def set_joint_rows(j: int, k: int, J: Linked):
    """Coordinates of a joint now, its rows and arms."""
    ends = ends_of(j, k, J)
    at = joint_coordinates(ends, J.t.form[j], J.t.cone[j])
    J.axis[j] = at.axis
    J.turn[j] = at.turn
    J.r_a[j] = ends.p_b - ends.c_a
    J.r_b[j] = ends.p_b - ends.c_b
    phi = unwind_twist_angle(at.turned[0], J.quarters[j])
    J.quarters[j] = int(wp.round(wp.float64(2.0) * phi / PI))
    three = int(3)
    for r in range(three):
        J.now[j, r] = at.shift[r]
        J.now[j, 3 + r] = at.turned[r]
    J.now[j, 3] = phi
