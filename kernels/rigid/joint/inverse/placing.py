"""Forward kinematics of arms (tables.py), how far they are from their goals, and the normal equations of that.

    e_p = at - p(q),   e_r = log(turn Q(q)^-1),   E = sum over goals of (w_p |e_p|)^2 + (w_r |e_r|)^2
    column of a slide along s: (s, 0);   of a turn about s through c: (s x (p - c), s)
    d^2 p / dq_i dq_j = s_j x column i    where dof j is a turn and comes before i on the way to the goal, or is i
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import (
    conjugate_rotation,
    multiply_rotations,
    rotate_vector,
    rotation_exponential,
    rotation_logarithm,
    unit_quaternion,
)
from wsim.kernels.rigid.joint.inverse.tables import ArmGoals, ArmTable, ArmWork
from wsim.kernels.rigid.joint.tree.kinematics import turn_about_unit_axis


@wp.func
def arm_ball_quaternion(q: wp.array2d(dtype=wp.float64), c: int, arm: int):
    """Quaternion of a ball whose coordinates begin at c."""
    return unit_quaternion(wp.quatd(q[c, arm], q[c + 1, arm], q[c + 2, arm], q[c + 3, arm]))


@standalone_function
@wp.func
def place_arm(t: ArmTable, W: ArmWork, q: wp.array2d(dtype=wp.float64), arm: int):
    """Sets X, Q, S and pivot of an arm from coordinates q."""
    for link in range(t.parent.shape[0]):
        p = t.parent[link]
        at = t.at_a[link]
        Q = t.turn_a[link]
        if p >= 0:
            at = W.X[p, arm] + rotate_vector(W.Q[p, arm], at)
            Q = W.Q[p, arm] * Q
        d = t.first_dof[link]
        c = t.first_coordinate[link]
        turns = d + t.slides[link]
        for k in range(d, turns):
            s = rotate_vector(Q, t.axis[k])
            W.S[k, arm] = s
            at += q[c + k - d, arm] * s
        if t.ball[link] == 1:
            Q = Q * arm_ball_quaternion(q, c + t.slides[link], arm)
        for k in range(turns, t.first_dof[link + 1]):
            W.S[k, arm] = rotate_vector(Q, t.axis[k])
            at += rotate_vector(Q, t.point[k])
            W.pivot[k, arm] = at
            if t.ball[link] == 0:
                Q = Q * turn_about_unit_axis(t.axis[k], q[c + k - d, arm])
                at -= rotate_vector(Q, t.point[k])
        Q = unit_quaternion(Q * conjugate_rotation(t.turn_b[link]))
        W.Q[link, arm] = Q
        W.X[link, arm] = at - rotate_vector(Q, t.at_b[link])


@wp.func
def goal_offset(G: ArmGoals, W: ArmWork, k: int, arm: int):
    """(place of goal k now [m], what is left to it [m], what is left to turn [rad])."""
    link = G.link[k]
    p = W.X[link, arm] + rotate_vector(W.Q[link, arm], G.point[k])
    r = wp.vec3d()
    who = W.arm[arm]
    if G.length[k][1] > wp.float64(0.0):
        now = multiply_rotations(W.Q[link, arm], G.own[k])
        u = rotation_logarithm(multiply_rotations(G.turn[k, who], conjugate_rotation(now)))
        r = wp.vec3d(u[0], u[1], u[2])
    return p, G.at[k, who] - p, r


@standalone_function
@wp.func
def weigh_arm_goals(t: ArmTable, G: ArmGoals, W: ArmWork, q: wp.array2d(dtype=wp.float64), A: wp.array2d(dtype=wp.float64),
                    g: wp.array2d(dtype=wp.float64), second: int, arm: int):
    """Sets A = J^T J and g = J^T e at coordinates q; second: 1: with second derivatives of places in A.
    Returns (E [m^2], largest |e_p| [m], largest |e_r| [rad])."""
    n = t.axis.shape[0]
    place_arm(t, W, q, arm)
    for i in range(n * (n + 1) / 2):
        A[i, arm] = wp.float64(0.0)
    for i in range(n):
        g[i, arm] = wp.float64(0.0)
    found = wp.vec3d()
    for k in range(G.link.shape[0]):
        p, e_p, e_r = goal_offset(G, W, k, arm)
        w = G.length[k]
        w_p = w[0] * w[0]
        w_r = w[1] * w[1]
        for i in range(n):
            column = wp.vec3d()
            turning = wp.vec3d()
            if G.on_path[k, i] == 1:
                s = W.S[i, arm]
                column = s
                if t.turns[i] == 1:
                    turning = s
                    column = wp.cross(s, p - W.pivot[i, arm])
                g[i, arm] = g[i, arm] + w_p * wp.dot(column, e_p) + w_r * wp.dot(turning, e_r)
            W.J_p[i, arm] = column
            W.J_r[i, arm] = turning
        row = int(0)
        for i in range(n):
            if G.on_path[k, i] == 1:
                column = w_p * W.J_p[i, arm]
                turning = w_r * W.J_r[i, arm]
                bent = wp.vec3d()
                if second == 1:
                    bent = w_p * wp.cross(e_p, W.J_p[i, arm])            # e . (s_j x column i), of a turn j before i
                for j in range(i + 1):
                    a = wp.dot(column, W.J_p[j, arm]) + wp.dot(turning, W.J_r[j, arm]) + wp.dot(bent, W.J_r[j, arm])
                    A[row + j, arm] = A[row + j, arm] + a
            row += i + 1
        size_p = wp.where(w[0] > wp.float64(0.0), wp.length(e_p), wp.float64(0.0))
        size_r = wp.length(e_r)
        found = wp.vec3d(found[0] + w_p * size_p * size_p + w_r * size_r * size_r, wp.max(found[1], size_p),
                         wp.max(found[2], size_r))
    return found


@standalone_function
@wp.func
def step_arm(t: ArmTable, W: ArmWork, arm: int):
    """trial = q moved by `step`, within limits."""
    for link in range(t.parent.shape[0]):
        d = t.first_dof[link]
        c = t.first_coordinate[link]
        last = t.first_dof[link + 1]
        if t.ball[link] == 1:
            last = d + t.slides[link]
        for k in range(d, last):
            i = c + k - d
            W.trial[i, arm] = wp.clamp(W.q[i, arm] + W.step[k, arm], t.low[i], t.high[i])
        if t.ball[link] == 1:
            c += t.slides[link]
            u = rotation_exponential(wp.vec3d(W.step[last, arm], W.step[last + 1, arm], W.step[last + 2, arm]))
            q = unit_quaternion(arm_ball_quaternion(W.q, c, arm) * wp.quatd(u[0], u[1], u[2], u[3]))
            for k in range(4):
                W.trial[c + k, arm] = q[k]
