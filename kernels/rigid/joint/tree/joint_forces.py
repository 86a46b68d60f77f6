"""Springs, dampers and limits of the joints of trees, by the rows of JointTable.

A row has a coordinate g with the rate J qd. Slides and hinges have a dof each: g = q, J = 1. A ball has three rows, twist and
two
swings: g' = M^-1 R omega with omega along the axes of frame b (kernels/rigid/joint/coordinates.py), so that J is a row of
M^-1 R.

    F = k (target - g) + c (speed - g'),  |F| <= most
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.joint.coordinates import CONE, swing_twist_angles, swing_twist_rate_matrix
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tables import ACCELERATION, NONE
from wsim.kernels.rigid.joint.tree.kinematics import coordinate_quaternion
from wsim.kernels.rigid.joint.tree.lanes import greatest_of_lanes, has_many_lanes, tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.loops.impulses import loop_column_share
from wsim.kernels.rigid.joint.tree.mass_matrix import tree_dofs
from wsim.kernels.rigid.joint.tree.tables import Trees


@wp.struct
class JointRow:
    """Coordinate g of a row and its derivative J by the dofs first, first + 1, ... of the joint."""
    g: wp.float64
    first: int
    count: int
    J: wp.vec3d


@standalone_function
@wp.func
def ball_joint_rows(link: int, cone: wp.vec2d, form: int, T: Trees):
    """(g, J): twist and swings of a ball, and their derivatives by its dofs."""
    q = coordinate_quaternion(T.t.first_coordinate[link] + T.t.slides[link], T.q)
    s, swing = swing_twist_angles(q)
    J = swing_twist_rate_matrix(s, swing) * rotation_to_matrix(q)
    if form == CONE:
        y = s[1] * cone[0]
        z = s[2] * cone[1]
        f = wp.sqrt(y * y + z * z)
        size = wp.float64(1.0) / wp.max(cone[0], cone[1])
        way = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
        if f > wp.float64(1.0e-9):
            way = -size * wp.vec2d(y * cone[0] / f, z * cone[1] / f)
        s = wp.vec3d(s[0], size * (wp.float64(1.0) - f), wp.float64(0.0))
        J = wp.matrix_from_rows(J[0], way[0] * J[1] + way[1] * J[2], wp.vec3d())
    return s, J


@standalone_function
@wp.func
def tree_joint_row(link: int, d: int, T: Trees, joints: Linked):
    """Row of dof d of link l. Of a ball: the row with its number."""
    found = JointRow()
    k = d - T.t.first_dof[link] - T.t.slides[link]
    if T.t.ball[link] == 1 and k >= 0:
        j = T.t.joint[link]
        g, J = ball_joint_rows(link, joints.t.cone[j], joints.t.form[j], T)
        found.first = d - k
        found.count = 3
        found.g = g[k]
        found.J = J[k]
    else:
        found.first = d
        found.count = 1
        found.g = T.q[T.t.first_coordinate[link] + d - T.t.first_dof[link]]
        found.J = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    return found


@wp.func
def row_rate(r: JointRow, qd: wp.array(dtype=wp.float64)):
    """J qd."""
    found = wp.float64(0.0)
    for i in range(r.count):
        found += r.J[i] * qd[r.first + i]
    return found


@wp.func
def add_row_force(r: JointRow, force: wp.float64, to: wp.array(dtype=wp.float64)):
    """to += J^T force."""
    for i in range(r.count):
        to[r.first + i] = to[r.first + i] + force * r.J[i]


@wp.func
def add_row_inertia(r: JointRow, much: wp.float64, T: Trees):
    """H += J^T much J, which fills nothing in."""
    for i in range(r.count):
        for j in range(i + 1):
            e = T.t.first_entry[r.first + i] + i - j
            T.H[e] = T.H[e] + much * r.J[i] * r.J[j]


@wp.struct
class RowDrive:
    """Spring and damper of a row now, 0 where it has none."""
    k: wp.float64
    c: wp.float64
    target: wp.float64
    speed: wp.float64
    most: wp.float64


@wp.func
def row_drive(j: int, r: int, k: int, part: wp.float64, J: Linked):
    """Drive of row r of joint j, at a part of substep k; at the end of a frame k is the number of substeps."""
    found = RowDrive()
    if j >= 0:
        if J.t.drive[j, r] > NONE and J.broken[j] == 0:
            found.k = J.t.stiffness[j, r]
            found.c = J.t.damping[j, r]
            found.target = J.t.target[j, r]
            found.speed = J.t.speed[j, r]
            found.most = J.t.most[j, r]
            if J.t.aiming == 1:
                after = wp.min(k + 1, J.t.aim.shape[0] - 1)
                found.target = J.t.aim[k, j, r] + part * (J.t.aim[after, j, r] - J.t.aim[k, j, r])
                found.speed = J.t.pace[k, j, r] + part * (J.t.pace[after, j, r] - J.t.pace[k, j, r])
    return found


@standalone_function
@wp.func
def substitute_column(r: JointRow, last: int, d: int, T: Trees):
    """|Z|^2 of a row whose last dof is `last`, and Z, by its factors. One lane."""
    t = T.t
    row = t.first_entry[last]
    n = t.first_entry[last + 1] - row
    to = T.first_column[d]
    for p in range(n):
        T.column[to + p] = wp.float64(0.0)
    for i in range(r.count):
        T.column[to + i] = r.J[r.count - 1 - i]
    found = wp.float64(0.0)
    for p in range(n):
        first = t.first_entry[t.entry_dof[row + p]]
        y = T.column[to + p]
        for i in range(p + 1, n):
            T.column[to + i] = T.column[to + i] - T.H[first + i - p] * y
        y = y / wp.sqrt(T.H[first])
        T.column[to + p] = y
        found += y * y
    return found


@standalone_function
@wp.func
def multiply_column(r: JointRow, last: int, d: int, T: Trees):
    """As `substitute_column`, by the inverse M of the factor L: rows of M, weighed. One lane."""
    t = T.t
    row = t.first_entry[last]
    found = wp.float64(0.0)
    for p in range(t.first_entry[last + 1] - row):
        y = wp.float64(0.0)
        for i in range(wp.max(r.count - 1 - p, 0), r.count):
            y += r.J[i] * T.M[t.first_entry[r.first + i] + p - (r.count - 1 - i)]
        y = y / wp.sqrt(T.H[t.first_entry[t.entry_dof[row + p]]])
        T.column[T.first_column[d] + p] = y
        found += y * y
    return found


@standalone_function
@wp.func
def row_response_column(g: int, r: JointRow, d: int, T: Trees):
    """J H^-1 J^T [1/kg], [1/(kg m^2)], as loops allow; Z (responses.py) becomes the column of dof d, which r is the row of. H
    is factored. One lane."""
    last = r.first + r.count - 1
    found = wp.float64(0.0)
    if has_many_lanes():
        found += multiply_column(r, last, d, T)
    else:
        found += substitute_column(r, last, d, T)
    if T.loops.first_row[g + 1] > T.loops.first_row[g]:
        found = wp.max(found - loop_column_share(g, d, last, T), wp.float64(1.0e-12) * found)
    return found


@standalone_function
@wp.func
def scale_accelerations(g: int, T: Trees, J: Linked):
    """Sets `mass` of rows with a drive of an acceleration to what the row moves, 1 / J H^-1 J^T; 1 of others. H is factored."""
    t = T.t
    dofs = tree_dofs(g, T)
    for d in range(dofs[0] + tree_lane(), dofs[1], tree_lanes()):
        link = t.dof_link[d]
        T.mass[d] = wp.float64(1.0)
        if t.joint[link] >= 0:
            if J.t.drive[t.joint[link], t.row[d]] == ACCELERATION and J.broken[t.joint[link]] == 0:
                T.mass[d] = wp.float64(1.0) / row_response_column(g, tree_joint_row(link, d, T, J), d, T)
    tree_barrier()


@wp.func
def row_drive_force(r: JointRow, drive: RowDrive, m: wp.float64, qd: wp.array(dtype=wp.float64)):
    """F of a drive, without its limit."""
    return m * (drive.k * (drive.target - r.g) + drive.c * (drive.speed - row_rate(r, qd)))


@standalone_function
@wp.func
def add_drive_forces(g: int, k: int, part: wp.float64, T: Trees, J: Linked):
    """tau += J^T F of all drives."""
    t = T.t
    for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
            drive = row_drive(t.joint[link], t.row[d], k, part, J)
            if drive.k > wp.float64(0.0) or drive.c > wp.float64(0.0):
                r = tree_joint_row(link, d, T, J)
                add_row_force(r, wp.clamp(row_drive_force(r, drive, T.mass[d], T.qd), -drive.most, drive.most), T.tau)
    tree_barrier()


@standalone_function
@wp.func
def add_drive_inertia(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
    """H += J^T (h c + h^2 k) J of all drives whose force is below its limit."""
    t = T.t
    for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
            drive = row_drive(t.joint[link], t.row[d], k, wp.float64(0.0), J)
            if drive.k > wp.float64(0.0) or drive.c > wp.float64(0.0):
                r = tree_joint_row(link, d, T, J)
                if wp.abs(row_drive_force(r, drive, T.mass[d], T.qd)) < drive.most:
                    add_row_inertia(r, T.mass[d] * h * (drive.c + h * drive.k), T)
    tree_barrier()


@standalone_function
@wp.func
def add_spring_forces(g: int, k: int, much: wp.float64, x: wp.array(dtype=wp.float64), T: Trees, J: Linked):
    """tau += much J^T k J x, with the same drives as `add_drive_inertia` and velocities qd."""
    t = T.t
    for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
            drive = row_drive(t.joint[link], t.row[d], k, wp.float64(0.0), J)
            if drive.k > wp.float64(0.0):
                r = tree_joint_row(link, d, T, J)
                if wp.abs(row_drive_force(r, drive, T.mass[d], T.qd)) < drive.most:
                    add_row_force(r, much * T.mass[d] * drive.k * row_rate(r, x), T.tau)
    tree_barrier()


@standalone_function
@wp.func
def drive_stiffness(g: int, h: wp.float64, T: Trees, J: Linked):
    """Largest h^2 k / m and h c / m of the drives of a tree, with 1 / m = J H^-1 J^T. H is factored."""
    t = T.t
    found = wp.float64(0.0)
    for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
            drive = row_drive(t.joint[link], t.row[d], 0, wp.float64(0.0), J)
            if drive.k > wp.float64(0.0) or drive.c > wp.float64(0.0):
                much = T.mass[d] * row_response_column(g, tree_joint_row(link, d, T, J), d, T)
                found = wp.max(found, wp.max(h * h * drive.k * much, h * drive.c * much))
    tree_barrier()
    return greatest_of_lanes(found)


@standalone_function
@wp.func
def note_drive_work(g: int, k: int, h: wp.float64, T: Trees, J: Linked):
    """Coordinates of joints now, for checks of energy, and the work of drives that ask for a speed over a step of h [s]:
    what is not the spring's, times that speed."""
    t = T.t
    for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
        j = t.joint[link]
        for d in range(t.first_dof[link], t.first_dof[link + 1]):
            whole = bool(False)
            if j >= 0:
                whole = J.broken[j] == 0
            if whole:
                r = tree_joint_row(link, d, T, J)
                J.now[j, t.row[d]] = r.g
                drive = row_drive(j, t.row[d], k, wp.float64(1.0), J)
                if drive.speed != wp.float64(0.0):
                    m = T.mass[d]
                    force = wp.clamp(row_drive_force(r, drive, m, T.qd), -drive.most, drive.most)
                    spring = wp.clamp(m * drive.k * (drive.target - r.g), -drive.most, drive.most)
                    J.given[j] = J.given[j] + h * (force - spring) * drive.speed
    tree_barrier()
