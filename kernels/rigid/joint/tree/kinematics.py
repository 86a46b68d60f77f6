"""Forward kinematics of trees: places of links, motion subspaces of joints, velocities, and the coordinates after a step.

    frame b = frame a . slides . hinges or ball          S of a slide e: (0, e), of a turn about e through p: (e, e x (O - p))
    a hinge about e through c, in frame b before it: x -> c + R(e, q) (x - c)
    V_l = V_parent + S qd;    of a root whose base moves with v at p and spins with w: V_parent = (w, v + w x (O - p))
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import rotate_vector, rotation_exponential, unit_quaternion
from wsim.kernels.rigid.joint.tree.lanes import tree_barrier, tree_lane, tree_lanes
from wsim.kernels.rigid.joint.tree.tables import Trees, vec6d


@wp.func
def turn_about_unit_axis(e: wp.vec3d, angle: wp.float64):
    """Quaternion of a turn about a unit axis by an angle [rad]."""
    half = wp.float64(0.5) * angle
    s = wp.sin(half)
    return wp.quatd(s * e[0], s * e[1], s * e[2], wp.cos(half))


@wp.func
def coordinate_quaternion(c: int, q: wp.array(dtype=wp.float64)):
    """Quaternion of a ball whose coordinates begin at c."""
    return unit_quaternion(wp.quatd(q[c], q[c + 1], q[c + 2], q[c + 3]))


@standalone_function
@wp.func
def place_in_parent(link: int, T: Trees):
    """Sets X, Q of link l and S of its joint in the frame of its parent: of slides the linear part, of turns the angular one,
    and where they turn in the place of the linear one."""
    t = T.t
    at = t.at_a[link]
    Q = t.turn_a[link]
    d = t.first_dof[link]
    last = t.first_dof[link + 1]
    c = t.first_coordinate[link]
    turns = d + t.slides[link]
    for k in range(d, turns):
        e = rotate_vector(Q, t.axis[k])
        T.S_v[k] = e
        at += T.q[c + k - d] * e
    if t.ball[link] == 1:
        Q = Q * coordinate_quaternion(c + t.slides[link], T.q)
    for k in range(turns, last):
        T.S_w[k] = rotate_vector(Q, t.axis[k])
        at += rotate_vector(Q, t.point[k])
        T.S_v[k] = at
        if t.ball[link] == 0:
            Q = Q * turn_about_unit_axis(t.axis[k], T.q[c + k - d])
            at -= rotate_vector(Q, t.point[k])
    Q = unit_quaternion(Q * wp.quat_inverse(t.turn_b[link]))
    T.Q[link] = Q
    T.X[link] = at - rotate_vector(Q, t.at_b[link])


@standalone_function
@wp.func
def turn_joint_motion(link: int, root: int, T: Trees):
    """S of the joint of link l, from the axes of its parent to those of the world, at O. Links are placed."""
    t = T.t
    p = t.parent[link]
    Q = wp.quatd(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    origin = T.X[root]
    if p >= 0:
        Q = T.Q[p]
        origin -= T.X[p]
    d = t.first_dof[link]
    turns = d + t.slides[link]
    for k in range(d, turns):
        T.S_w[k] = wp.vec3d()
        T.S_v[k] = rotate_vector(Q, T.S_v[k])
    for k in range(turns, t.first_dof[link + 1]):
        w = rotate_vector(Q, T.S_w[k])
        T.S_w[k] = w
        T.S_v[k] = wp.cross(w, origin - rotate_vector(Q, T.S_v[k]))


@standalone_function
@wp.func
def place_tree(g: int, T: Trees):
    """Sets X, Q and S of the links and joints of tree g: all in their parents, then level by level in the world."""
    t = T.t
    root = t.first_link[g]
    for link in range(root + tree_lane(), t.first_link[g + 1], tree_lanes()):
        place_in_parent(link, T)
    tree_barrier()
    for level in range(t.first_level[g] + 1, t.first_level[g + 1]):
        for slot in range(t.level_start[level] + tree_lane(), t.level_start[level + 1], tree_lanes()):
            link = t.by_level[slot]
            p = t.parent[link]
            Q = T.Q[p]
            T.X[link] = T.X[p] + rotate_vector(Q, T.X[link])
            T.Q[link] = Q * T.Q[link]
        tree_barrier()
    for link in range(root + tree_lane(), t.first_link[g + 1], tree_lanes()):
        turn_joint_motion(link, root, T)
    tree_barrier()


@wp.func
def hangs_from_base(link: int, T: Trees):
    """Whether the joint of link l is one to what does not move by forces."""
    return T.t.parent[link] < 0 and T.t.joint[link] >= 0


@standalone_function
@wp.func
def base_twist(link: int, root: int, T: Trees):
    """Spatial velocity of what link l hangs from (bases.py)."""
    w = T.base_w[link]
    v = T.base_v[link] + wp.cross(w, T.X[root] - T.t.at_a[link])
    return vec6d(w[0], w[1], w[2], v[0], v[1], v[2])


@wp.func
def move_link_velocity(link: int, root: int, T: Trees):
    t = T.t
    p = t.parent[link]
    w = wp.vec3d()
    v = wp.vec3d()
    a = wp.vec3d()
    b = wp.vec3d()
    if p >= 0:
        w = T.W[p]
        v = T.V[p]
        a = T.A_w[p]
        b = T.A_v[p]
    elif T.moves == 1 and hangs_from_base(link, T):
        twist = base_twist(link, root, T)
        w = wp.vec3d(twist[0], twist[1], twist[2])
        v = wp.vec3d(twist[3], twist[4], twist[5])
        b = -wp.cross(w, T.base_v[link])
    turning = wp.vec3d()
    moving = wp.vec3d()
    for k in range(t.first_dof[link], t.first_dof[link + 1]):
        sw = T.qd[k] * T.S_w[k]
        sv = T.qd[k] * T.S_v[k]
        if t.ball[link] == 1 and k >= t.first_dof[link] + t.slides[link]:
            turning += sw                       # the axes of a ball turn with the link: V x S w, for all three at once
            moving += sv
        else:
            a += wp.cross(w, sw)
            b += wp.cross(w, sv) + wp.cross(v, sw)
            w += sw
            v += sv
    a += wp.cross(w, turning)
    b += wp.cross(w, moving) + wp.cross(v, turning)
    T.W[link] = w + turning
    T.V[link] = v + moving
    T.A_w[link] = a
    T.A_v[link] = b


@standalone_function
@wp.func
def move_tree_velocities(g: int, T: Trees):
    """Sets W, V of links, and their accelerations without qdd: A_l = A_parent + sum of V x S qd over the joint's dofs."""
    t = T.t
    for level in range(t.first_level[g], t.first_level[g + 1]):
        for slot in range(t.level_start[level] + tree_lane(), t.level_start[level + 1], tree_lanes()):
            move_link_velocity(t.by_level[slot], t.first_link[g], T)
        tree_barrier()


@standalone_function
@wp.func
def move_tree_coordinates(g: int, h: wp.float64, rate: wp.array(dtype=wp.float64), start: wp.array(dtype=wp.float64), T: Trees):
    """q = start moved for h [s] at generalised velocities `rate`: exact where they stay."""
    t = T.t
    for link in range(t.first_link[g] + tree_lane(), t.first_link[g + 1], tree_lanes()):
        d = t.first_dof[link]
        c = t.first_coordinate[link]
        turns = t.slides[link]
        if t.ball[link] == 0:
            turns = t.first_dof[link + 1] - d
        for k in range(turns):
            T.q[c + k] = start[c + k] + h * rate[d + k]
        if t.ball[link] == 1:
            e = rotation_exponential(h * wp.vec3d(rate[d + turns], rate[d + turns + 1], rate[d + turns + 2]))
            c += turns
            q = unit_quaternion(coordinate_quaternion(c, start) * wp.quatd(e[0], e[1], e[2], e[3]))
            T.q[c] = q[0]
            T.q[c + 1] = q[1]
            T.q[c + 2] = q[2]
            T.q[c + 3] = q[3]
    tree_barrier()
