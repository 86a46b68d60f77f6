"""Inverse dynamics of arms (tables.py) by recursive Newton-Euler: generalised forces of joints, for given accelerations.

    tau = H(q) qdd + C(q, qd) + armature qdd - S^T (outer forces, weight)

Spatial vectors stand at the origin O of places. V_l = V_p + S qd, A_l = A_p + S qdd + V x S qd; of a ball all three dofs turn
with the link. (Luh, Walker, Paul 1980; Featherstone 2008, section 5.3.)
"""

import warp as wp

from wsim.kernels.math.marks import standalone_function
from wsim.kernels.math.rotation import rotation_to_matrix
from wsim.kernels.rigid.joint.inverse.placing import place_arm
from wsim.kernels.rigid.joint.inverse.tables import ArmTable, ArmWork


@wp.struct
class ArmForces:
    """Spatial vectors of links, (links, arms), about O."""

    w: wp.array2d(dtype=wp.vec3d)                # velocity: angular [rad/s], linear [m/s]
    v: wp.array2d(dtype=wp.vec3d)
    dw: wp.array2d(dtype=wp.vec3d)               # acceleration
    dv: wp.array2d(dtype=wp.vec3d)
    n: wp.array2d(dtype=wp.vec3d)                # wrench: torque [N m], force [N]
    f: wp.array2d(dtype=wp.vec3d)


@wp.func
def dof_twist(t: ArmTable, W: ArmWork, k: int, arm: int):
    """(angular, linear part at O) of the motion that dof k gives."""
    s = W.S[k, arm]
    turning = wp.vec3d()
    moving = s
    if t.turns[k] == 1:
        turning = s
        moving = wp.cross(W.pivot[k, arm], s)
    return turning, moving


@standalone_function
@wp.func
def move_arm_link(t: ArmTable, W: ArmWork, F: ArmForces, qd: wp.array2d(dtype=wp.float64), qdd: wp.array2d(dtype=wp.float64),
                  link: int, arm: int):
    """Sets velocity and acceleration of a link; those of its parent are set."""
    p = t.parent[link]
    w = wp.vec3d()
    v = wp.vec3d()
    dw = wp.vec3d()
    dv = wp.vec3d()
    if p >= 0:
        w = F.w[p, arm]
        v = F.v[p, arm]
        dw = F.dw[p, arm]
        dv = F.dv[p, arm]
    ball_w = wp.vec3d()
    ball_v = wp.vec3d()
    for k in range(t.first_dof[link], t.first_dof[link + 1]):
        turning, moving = dof_twist(t, W, k, arm)
        dw += qdd[k, arm] * turning
        dv += qdd[k, arm] * moving
        turning = qd[k, arm] * turning
        moving = qd[k, arm] * moving
        if t.ball[link] == 1 and t.turns[k] == 1:
            ball_w += turning
            ball_v += moving
        else:
            dw += wp.cross(w, turning)
            dv += wp.cross(w, moving) + wp.cross(v, turning)
            w += turning
            v += moving
    dw += wp.cross(w, ball_w)
    dv += wp.cross(w, ball_v) + wp.cross(v, ball_w)
    F.w[link, arm] = w + ball_w
    F.v[link, arm] = v + ball_v
    F.dw[link, arm] = dw
    F.dv[link, arm] = dv


@wp.func
def load_arm_link(t: ArmTable, W: ArmWork, F: ArmForces, link: int, arm: int):
    """Sets the wrench that the motion of one link takes."""
    r = W.X[link, arm]
    w = F.w[link, arm]
    R = rotation_to_matrix(W.Q[link, arm])
    K = R * wp.diag(t.moments[link]) * wp.transpose(R)
    a = F.dv[link, arm] + wp.cross(F.dw[link, arm], r) + wp.cross(w, F.v[link, arm] + wp.cross(w, r))
    f = t.mass[link] * a - t.force[link]
    F.f[link, arm] = f
    F.n[link, arm] = K * F.dw[link, arm] + wp.cross(w, K * w) - t.torque[link] + wp.cross(r, f)


@wp.kernel(enable_backward=False, module="wsim_arms")
def inverse_dynamics_kernel(t: ArmTable, W: ArmWork, F: ArmForces, qd: wp.array2d(dtype=wp.float64),
                            qdd: wp.array2d(dtype=wp.float64), tau: wp.array2d(dtype=wp.float64)):
    """Over arms, at coordinates W.q. tau, qd, qdd: (dofs, arms)."""
    arm = wp.tid()
    place_arm(t, W, W.q, arm)
    links = t.parent.shape[0]
    for link in range(links):
        move_arm_link(t, W, F, qd, qdd, link, arm)
        load_arm_link(t, W, F, link, arm)
    for back in range(links):
        link = links - 1 - back
        for k in range(t.first_dof[link], t.first_dof[link + 1]):
            turning, moving = dof_twist(t, W, k, arm)
            tau[k, arm] = (wp.dot(turning, F.n[link, arm]) + wp.dot(moving, F.f[link, arm])) + t.armature[k] * qdd[k, arm]
        p = t.parent[link]
        if p >= 0:
            F.n[p, arm] = F.n[p, arm] + F.n[link, arm]
            F.f[p, arm] = F.f[p, arm] + F.f[link, arm]


@wp.kernel(enable_backward=False, module="wsim_arms")
def arm_pose_kernel(t: ArmTable, W: ArmWork):
    """Over arms: X, Q of links at coordinates W.q."""
    place_arm(t, W, W.q, wp.tid())
