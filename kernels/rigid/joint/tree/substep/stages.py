"""Coordinates of trees within a step: rates in the tangent space of balls, the stages of rk4, means, copies (steps.py).

A ball's quaternion is q_0 exp(u), with u' = w + u x w / 2 + u x (u x w) / 12 (Munthe-Kaas 1998). Others have u' = qd.
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import conjugate_rotation, multiply_rotations, rotation_logarithm
from wsim.kernels.rigid.joint.tree.kinematics import coordinate_quaternion, move_tree_coordinates
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees


@standalone_function
@wp.func
def tangent_rates(g: int, h: wp.float64, before: wp.array(dtype=wp.float64), T: Trees):
    """`rate`: of coordinates in the tangent space at the start of the step, where they are h before on. h = 0: qd."""
    t = T.t
    for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
        turns = t.first_dof[link] + t.slides[link]
        u = wp.vec3d()
        if t.ball[link] == 1 and h > wp.float64(0.0):
            u = h * wp.vec3d(before[turns], before[turns + 1], before[turns + 2])
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
            T.rate[d] = T.qd[d]
        if t.ball[link] == 1:
            w = wp.vec3d(T.qd[turns], T.qd[turns + 1], T.qd[turns + 2])
            x = wp.cross(u, w)
            w += wp.float64(0.5) * x + wp.cross(u, x) / wp.float64(12.0)
            T.rate[turns] = w[0]
            T.rate[turns + 1] = w[1]
            T.rate[turns + 2] = w[2]
    tree_barrier()


@standalone_function
@wp.func
def advance_stage(g: int, s: int, h: wp.float64, T: Trees):
    """Adds stage s of rk4 to the sums, and moves to the next: q, qd at h / 2, h / 2, h, and at the end. tau: qdd."""
    dofs = tree_dofs(g, T)
    since = wp.float64(0.0)
    if s > 0:
        since = wp.where(s < 3, wp.float64(0.5), wp.float64(1.0)) * h
    tangent_rates(g, since, T.rate, T)
    weight = wp.where(s == 0 or s == 3, wp.float64(1.0), wp.float64(2.0)) / wp.float64(6.0)
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        before = wp.where(s == 0, wp.float64(0.0), wp.float64(1.0))
        T.rates[d] = before * T.rates[d] + weight * T.rate[d]
        T.gains[d] = before * T.gains[d] + weight * T.tau[d]
    tree_barrier()
    if s < 3:
        part = wp.where(s < 2, wp.float64(0.5), wp.float64(1.0)) * h
        move_tree_coordinates(g, part, T.rate, T.q_before, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = T.qd_before[d] + part * T.tau[d]
    else:
        move_tree_coordinates(g, h, T.rates, T.q_before, T)
        for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
            T.qd[d] = T.qd_before[d] + h * T.gains[d]
    tree_barrier()


@standalone_function
@wp.func
def mean_tree_rates(g: int, h: wp.float64, T: Trees):
    """`rates`: with which q_before comes to q in h [s]."""
    t = T.t
    for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
        d = t.first_dof[link]
        c = t.first_coordinate[link]
        turns = t.slides[link]
        if t.ball[link] == 0:
            turns = t.first_dof[link + 1] - d
        for k in range(turns):
            T.rates[d + k] = (T.q[c + k] - T.q_before[c + k]) / h
        if t.ball[link] == 1:
            before = coordinate_quaternion(c + turns, T.q_before)
            u = rotation_logarithm(multiply_rotations(conjugate_rotation(before), coordinate_quaternion(c + turns, T.q)))
            for k in range(3):
                T.rates[d + turns + k] = u[k] / h
    tree_barrier()


@standalone_function
@wp.func
def copy_tree_state(g: int, q: wp.array(dtype=wp.float64), qd: wp.array(dtype=wp.float64), q_out: wp.array(dtype=wp.float64),
                    qd_out: wp.array(dtype=wp.float64), T: Trees):
    first = T.t.first_link[g]
    last = T.t.first_link[g + 1]
    for c in range(T.t.first_coordinate[first] + tree_lane(), T.t.first_coordinate[last], tree_lanes()):
        q_out[c] = q[c]
    for d in range(T.t.first_dof[first] + tree_lane(), T.t.first_dof[last], tree_lanes()):
        qd_out[d] = qd[d]
    tree_barrier()
