"""Velocities behind contacts of pairs where a step goes on from its middle to its end (implicit midpoint), by impulses that change
no place.

Contacts push at the end of a substep h, where d~ and v~ are without them, and v~ + (d - d~) / h is right of a blow: what is left
of the way is left of the velocity. Of a force that lasts the same push takes back the way h^2 f / 2, and with it half of the
velocity h f. Relative velocities along n of pairs that push tell one from the other: they are made those of relative motions,
by impulses that have the friction of the push P [m kg], n . P / h + Q >= 0 (as BDF2's, kernels/selfcontact/settle.py):

    n . sum_k b_k v_k = n . sum_k b_k (d_k - e_k) / h        v_k <- v_k + w_k Q u_k
    u_k = b_k p - (J^-1 (D x p)) x r_k,   p = P / n . P,   r, D, J where the substep ends (kernels/selfcontact/couple.py)

They have no moment. P has one: it is none about the place where the substep begins, and counts about

    y = x + d~ - h v~,      as  (x + d) x (v~ + w P / h) - (x + d~) x v~ = y x w P / h     for what it gives to one point, d = d~ + w P

which is x by what the forces of the substep change in h / 2. So a couple gives back sum_k y_k x P_k.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.motion.points import states
from wsim.kernels.selfcontact import pairs
from wsim.kernels.selfcontact.couple import couple
from wsim.kernels.selfcontact.settle import aims


@cache
def gather(real, module):
    """Kernel: the pairs that push, and the moments of their pushes. ahead: d~ [m]; v: v~ [m/s]."""
    t = types(real)
    Surfaces, State, Pairs, Aims = pairs.surfaces(real), states(real), pairs.lists(real), aims(real)
    arms, lever, _ = couple(real)

    @wp.func
    def moment(s: Surfaces, at: State, ahead: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), ids: wp.vec4i, b: t.vec4,
               push: t.vec3, h: real):
        """sum_k y_k x P_k: of y - x alone, as P has none about x."""
        rubs, mu = real(1.0), real(0.0)
        for k in range(4):
            rubs *= s.w[ids[k]]
            mu += wp.abs(b[k]) * s.friction[ids[k]][0]
        r, D = arms(s, at, ids, b)
        back = real(0.0) * push
        if mu * rubs > real(0.0):
            back = lever(r) * wp.cross(D, push)
        M = t.vec3()
        for k in range(4):
            y = (ahead[ids[k]] - at.e[ids[k]]) - h * v[ids[k]]
            M += wp.cross(y, b[k] * push - wp.cross(back, r[k]))
        if mu * rubs == real(0.0):
            M += wp.cross(D, push)
        return wp.where(rubs > real(0.0), M, real(0.0) * M)

    @wp.kernel(module=module, enable_backward=False)
    def gather_pushes(s: Surfaces, at: State, near: Pairs, ahead: wp.array(dtype=t.vec3), v: wp.array(dtype=t.vec3), h: real,
                      threads: int, to: Aims):
        j = wp.tid()
        if j == 0:
            to.count[0] = near.rows[0]
        while j < near.rows[0]:
            i = near.row[j]
            push = near.push[i]
            size = wp.dot(push, near.n[i])
            to.ids[j] = near.ids[i]
            to.b[j] = near.b[i]
            to.keep[j] = near.keep[i]
            to.n[j] = near.n[i]
            to.turn[j] = t.vec3()
            to.least[j] = real(0.0)
            to.most[j] = real(0.0)
            to.q[j] = real(0.0)
            if size > real(0.0):
                to.along[j] = push / size
                to.turn[j] = moment(s, at, ahead, v, near.ids[i], near.b[i], push, h)
                to.least[j] = -size / h
                to.most[j] = real(1.0e30)
            j += threads

    return gather_pushes


@cache
def aim(real, module):
    """Kernel: u of the pairs, the relative velocities that are wanted, and the couples that give back moments, to the sums of points
    [m/s] and to their shares, so that they are taken."""
    t = types(real)
    Surfaces, State, Aims, Sums = pairs.surfaces(real), states(real), aims(real), pairs.sums(real)
    points, fixed = wp.types.matrix((4, 3), real), pairs.fixed(real)
    _, lever, _ = couple(real)
    place, _ = pairs.reading(real)

    @wp.func
    def ends(s: Surfaces, at: State, ids: wp.vec4i):
        """Points of a pair from their middle, where the substep ends."""
        r, middle = points(), t.vec3()
        for k in range(4):
            r[k] = place(s, at.x, at.d, ids[k], ids[0])
            middle += real(0.25) * r[k]
        for k in range(4):
            r[k] = r[k] - middle
        return r

    @wp.kernel(module=module, enable_backward=False)
    def aim_pushes(s: Surfaces, at: State, h: real, threads: int, aim: Aims, to: Sums):
        j = wp.tid()
        while j < aim.count[0]:
            if aim.most[j] > real(0.0):
                ids = aim.ids[j]
                p = aim.along[j]
                r = ends(s, at, ids)
                free, D = real(1.0), t.vec3()
                for k in range(4):
                    free *= s.w[ids[k]]
                    D += aim.b[j][k] * r[k]
                K = t.mat33()
                if free > real(0.0):                      # what cannot move takes moments
                    K = lever(r)
                back = K * wp.cross(D, p)
                give = K * aim.turn[j] / h
                u, motion = points(), real(0.0)
                for k in range(4):
                    u[k] = aim.b[j][k] * p - wp.cross(back, r[k])
                    motion += aim.b[j][k] * wp.dot(aim.n[j], at.d[ids[k]] - at.e[ids[k]])
                    wp.atomic_add(to.share, ids[k], 1)
                    fixed(to, ids[k], -s.w[ids[k]] * wp.cross(give, r[k]))
                aim.u[j] = u
                aim.aim[j] = motion / h
            j += threads

    return aim_pushes
