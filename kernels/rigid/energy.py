"""Energy of rigid bodies and the work on them in a frame; energy of the springs of drives.

    K = 1/2 (p . p / m + M I^-1 M),  M = q* L q          W = F . (x - x0) + sum of work of moving colliders

F: weight and force [N]. A drive of stiffness k and force at most f holds U = 1/2 k y^2 where |k y| <= f, y = g - target, else
f |y| - f^2 / 2 k: its damping, and the force left out beyond f, only take energy.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.point_energy import bounded, motions
from wsim.kernels.math.real import types
from wsim.kernels.math.rotation import conjugate, normalized, rotate
from wsim.kernels.rigid.joint.elimination import Linked
from wsim.kernels.rigid.joint.tables import NONE
from wsim.kernels.rigid.motion import double, structs


@cache
def balance_bodies(real):
    """Kernel over (worlds x threads): a row of the ledger each. p_more, L_more: momenta of half a step more, or none."""
    t, (Motions, moved) = types(real), motions(real)
    Bodies, Moving = structs(real)
    vec3 = wp.array(dtype=t.vec3)

    def balance_bodies(b: Bodies, now: Moving, p_more: vec3, L_more: vec3, worlds: int, at: Motions,
                       rows: wp.array(dtype=wp.vec4d)):
        threads = rows.shape[0] // worlds
        world = wp.tid() // threads
        each = b.w.shape[0] // worlds
        K = wp.float64(0.0)
        W = wp.float64(0.0)
        for i in range(world * each + wp.tid() % threads, (world + 1) * each, threads):
            p = wp.vec3d(now.p[i])
            L = wp.vec3d(now.L[i])
            if p_more:
                p += wp.vec3d(p_more[i])
                L += wp.vec3d(L_more[i])
            M = rotate(conjugate(normalized(double(now.q[i], now.o[i]))), L)
            K += wp.float64(0.5) * (wp.float64(b.w[i]) * wp.dot(p, p) + wp.dot(M, wp.cw_mul(wp.vec3d(b.inverse[i]), M)))
            W += wp.dot(wp.vec3d(b.push[i]), moved(at, i))
            if at.given:
                W += bounded(at.given[i])
                at.given[i] = wp.float64(0.0)
        rows[wp.tid()] = wp.vec4d(K, wp.float64(0.0), wp.float64(0.0), W)

    return wp.kernel(balance_bodies, name=f"balance_bodies_{t.name}", module=f"wsim_balance_bodies_{t.name}",
                     enable_backward=False)


@wp.kernel(module="wsim_balance_drives", enable_backward=False)
def balance_drives(J: Linked, worlds: int, rows: wp.array(dtype=wp.vec4d)):
    """Over (worlds x threads): the energy of the springs of drives, and the work of those that ask for a speed."""
    threads = rows.shape[0] // worlds
    world = wp.tid() // threads
    each = J.broken.shape[0] // worlds
    U = wp.float64(0.0)
    W = wp.float64(0.0)
    six = int(6)
    for j in range(world * each + wp.tid() % threads, (world + 1) * each, threads):
        W += bounded(J.given[j])
        J.given[j] = wp.float64(0.0)
        if J.broken[j] == 0:
            for r in range(six):
                k = J.t.stiffness[j, r]
                if J.t.drive[j, r] > NONE and k > wp.float64(0.0):
                    target = J.t.target[j, r]
                    if J.t.aiming == 1:
                        target = J.t.aim[J.t.aim.shape[0] - 1, j, r]
                    y = wp.abs(J.now[j, r] - target)
                    f = J.t.most[j, r]
                    if k * y <= f:
                        U += wp.float64(0.5) * k * y * y
                    else:
                        U += f * y - wp.float64(0.5) * f * f / k
    rows[wp.tid()] = wp.vec4d(wp.float64(0.0), U, U, W)
