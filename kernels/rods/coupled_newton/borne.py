"""Rigid bodies among the unknowns of strands (kernels/rigid/touch/strands.py has the equations): what a body gives way as
points are moved, y = D^-1 sum J^T K p, and what that pushes points with."""

import warp as wp

from wsim.kernels.rods.tables import RodContacts, RodTable


@wp.func
def solve_body_block(B: RodContacts, i: int, u: wp.vec3d, a: wp.vec3d):
    """D^-1 (u, a) of body i."""
    turn = B.H[i] * (a - wp.transpose(B.X[i]) * (B.P[i] * u))
    return B.P[i] * (u - B.X[i] * turn), turn


@wp.func
def force_pulled_by_contact(S: RodTable, B: RodContacts, p: wp.array2d(dtype=wp.vec4d), j: int):
    """J^T K p of contact j, in the order of bodies."""
    m = S.points.shape[0]
    point = B.slot[j] / B.body.shape[1]
    c = B.slot[j] - point * B.body.shape[1]
    row = point / m
    k = point - row * m
    at = B.u[point, c]
    move = wp.vec3d()
    if S.hold[row, k] < 0:
        move += wp.vec3d(p[row, k][0], p[row, k][1], p[row, k][2]) * (wp.float64(1.0) - at)
    if at > wp.float64(0.0):
        if S.hold[row + 1, k] < 0:
            move += wp.vec3d(p[row + 1, k][0], p[row + 1, k][1], p[row + 1, k][2]) * at
    f = B.K[point, c] * move
    return f, wp.cross(B.arm[point, c], f)


@wp.func
def contact_force_of_motion(B: RodContacts, row: int, j: int):
    """Force of contact j of a row, whose body moves by y."""
    body = B.body[row, j]
    return B.K[row, j] * (B.y[body, 0] + wp.cross(B.y[body, 1], B.arm[row, j]))


@wp.func
def point_force_of_bodies(B: RodContacts, strands: int, p: int):
    """Force on the point of flat row p of bodies that move by y, at its contacts and at those of the edge before it."""
    f = wp.vec3d()
    for j in range(wp.min(B.many[p], B.body.shape[1])):
        f += contact_force_of_motion(B, p, j) * (wp.float64(1.0) - B.u[p, j])
    before = p - strands
    if before >= 0:
        for j in range(wp.min(B.many[before], B.body.shape[1])):
            if B.u[before, j] > wp.float64(0.0):
                f += contact_force_of_motion(B, before, j) * B.u[before, j]
    return f
