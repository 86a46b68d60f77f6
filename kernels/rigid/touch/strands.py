"""Rigid bodies and strands, solved at once: Newton's system of the strands (kernels/rods/coupled_newton/coupled.py) has the
motion of every body that they touch among its unknowns. Their contacts: kernels/rigid/touch/strand_forces.py.

A body goes where its momentum leads it, and is moved from there by xi = (u [m], a [rad]) about its centre of mass; a place at
the arm r from it by J xi = u + a x r. With the law of kernels/rods/contact.py, a force f on the point and K = -df/dx,

    point     (A + K) z - K J zeta = f + ...            z, zeta: corrections of points (in an edge: b . z) and of bodies
    body      (W + sum J^T K J) zeta - sum J^T K z = -W xi - sum J^T f,        W = (m, I) / h^2

Bodies are eliminated: with D = W + sum J^T K J, zeta = D^-1 (b + sum J^T K z), and what is left of them among the points is
K - K J D^-1 J^T K, which conjugate gradients take (kernels/rods/coupled_newton/conjugate.py), in 6 rounds a body at most. What
a body gets in the end is the momentum of how far it was moved, m u / h and I a / h: the sum of the linear equations that points
were solved with, so that both together keep theirs, whatever Newton's method has left. Arms are those of the points, or of the
places within edges, so that angular momentum is what points lose of theirs.

A drag c [1/s] of the body acts on what forces have given it since the substep began, whatever they are: a constant force leaves
the part s = (1 - exp(-c h)) / (c h) of h times it, as weight does (`kick_momentum`, kernels/rigid/motion.py). So W = (m / s, I
/ s') / h^2, and at rest the points bear m g; of a blow, which has no duration, the air takes as much.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.contact import rig_type
from wsim.kernels.rigid.motion import double_vec3, kick_momentum
from wsim.kernels.rods.coupled_newton.borne import force_pulled_by_contact, point_force_of_bodies, solve_body_block
from wsim.kernels.rods.coupled_newton.coupled import ACTIVE, CoupledRods
from wsim.kernels.rods.tables import RodContacts, RodTable, RodTrial


@wp.struct
class RodBodies:
    """Bodies in a substep: by body, by shape of one, and of contacts in the order of bodies."""

    h: wp.float64                                   # of the substep [s]
    c0: wp.array(dtype=wp.vec3d)                    # centre of mass where the substep begins, and where momentum leads it [m]
    c1: wp.array(dtype=wp.vec3d)
    q0: wp.array(dtype=wp.quatd)                    # orientation of the principal axes likewise
    q1: wp.array(dtype=wp.quatd)
    m: wp.array(dtype=wp.float64)                   # m / s [kg]
    J: wp.array(dtype=wp.mat33d)                    # I / s' in the world [kg m^2]
    xi: wp.array2d(dtype=wp.vec3d)                  # u [m], a [rad], (bodies, 2); r, z, last likewise
    r: wp.array2d(dtype=wp.vec3d)                   # right-hand side
    z: wp.array2d(dtype=wp.vec3d)                   # correction
    last: wp.array2d(dtype=wp.vec3d)                # the last step
    begin: wp.array(dtype=wp.vec3d)                 # where a body's x is counted from [m]
    body: wp.array(dtype=int)                       # of a shape
    world: wp.array(dtype=int)                      # of a shape
    place: wp.array(dtype=wp.transformd)            # of a shape in the frame of the centre of mass and the principal axes
    size: wp.array(dtype=wp.vec4d)                  # middle of a ball about a shape, in its frame, and its radius [m]
    pose0: wp.array(dtype=wp.transformd)            # of a shape where the substep begins, and in the trial
    pose1: wp.array(dtype=wp.transformd)
    ball: wp.array(dtype=wp.vec4d)                  # middle in the trial, radius [m]
    strand: wp.array(dtype=int)                     # world of a strand
    stick: wp.array2d(dtype=wp.vec3d)               # of points: bristle [m], normal force of the substep before [N]
    load: wp.array2d(dtype=wp.float64)
    stick1: wp.array2d(dtype=wp.vec3d)              # of two places within the edges behind them likewise
    load1: wp.array2d(dtype=wp.float64)
    stick2: wp.array2d(dtype=wp.vec3d)
    load2: wp.array2d(dtype=wp.float64)
    tied: wp.array2d(dtype=int)                     # of points: body that holds it, -1: none; these only where there are ties
    tie_at: wp.array2d(dtype=wp.vec3d)              # place of it from the centre of mass, in the principal axes [m]
    tie: wp.array2d(dtype=wp.vec3d)                 # force of its tie in the substep before [N]
    passes: wp.array2d(dtype=wp.vec4i)              # bodies that a point does not meet, and the edge behind it, two each


@wp.func
def mean_drag_factor(drag: Any, h: wp.float64):
    """s, see above."""
    return kick_momentum(wp.float64(0.0), wp.float64(1.0), wp.float64(drag), h) / h


@cache
def body_key_kernel(module: str):
    """Kernel over contacts: the body of each, or the number of bodies where there is none."""
    @wp.kernel(module=module, enable_backward=False)
    def key_contacts(B: RodContacts, bodies: int, key_out: wp.array(dtype=int), slot_out: wp.array(dtype=int)):
        j = wp.tid()
        room = B.body.shape[1]
        p = j / room
        body = bodies
        if j - p * room < B.many[p]:
            body = B.body[p, j - p * room]
        key_out[j] = body
        slot_out[j] = j

    return key_contacts


@cache
def body_newton_kernels(module: str):
    """Kernels over bodies: lean, forces and D where an iteration begins, and y = D^-1 b; cross, y = D^-1 sum J^T K p of motions
    p of points; measure, corrections; take, them or a part."""
    @wp.kernel(module=module, enable_backward=False)
    def lean_bodies(W: RodBodies, B: RodContacts, words: wp.array(dtype=int)):
        i = wp.tid()
        room = B.body.shape[1]
        hh = W.h * W.h
        P = wp.identity(n=3, dtype=wp.float64) * (W.m[i] / hh)
        X = wp.mat33d()
        H = W.J[i] * (wp.float64(1.0) / hh)
        u = W.xi[i, 0] * (-W.m[i] / hh)
        a = W.J[i] * W.xi[i, 1] * (wp.float64(-1.0) / hh)
        for j in range(B.start[i], B.start[i + 1]):
            p = B.slot[j] / room
            c = B.slot[j] - p * room
            K = B.K[p, c]
            r = wp.skew(B.arm[p, c])
            P += K
            X -= K * r
            H -= r * K * r
            u -= B.f[p, c]
            a -= wp.cross(B.arm[p, c], B.f[p, c])
        if B.start[i + 1] > B.start[i]:
            wp.atomic_max(words, ACTIVE, 1)
        B.P[i] = wp.inverse(P)
        B.X[i] = X
        B.H[i] = wp.inverse(H - wp.transpose(X) * B.P[i] * X)
        W.r[i, 0] = u
        W.r[i, 1] = a
        y, turn = solve_body_block(B, i, u, a)
        B.y[i, 0] = y
        B.y[i, 1] = turn
        B.ahead[i] = wp.dot(u, W.last[i, 0]) + wp.dot(a, W.last[i, 1])

    @wp.func
    def all_pulled(S: RodTable, B: RodContacts, p: wp.array2d(dtype=wp.vec4d), i: int):
        u = wp.vec3d()
        a = wp.vec3d()
        for j in range(B.start[i], B.start[i + 1]):
            f, turn = force_pulled_by_contact(S, B, p, j)
            u += f
            a += turn
        return u, a

    @wp.kernel(module=module, enable_backward=False)
    def cross_bodies(S: RodTable, G: CoupledRods, B: RodContacts):
        i = wp.tid()
        u, a = all_pulled(S, B, G.p, i)
        y, turn = solve_body_block(B, i, u, a)
        B.y[i, 0] = y
        B.y[i, 1] = turn

    @wp.kernel(module=module, enable_backward=False)
    def measure_bodies(S: RodTable, T: RodTrial, W: RodBodies, B: RodContacts):
        i = wp.tid()
        u, a = all_pulled(S, B, T.z, i)
        y, turn = solve_body_block(B, i, W.r[i, 0] + u, W.r[i, 1] + a)
        W.z[i, 0] = y
        W.z[i, 1] = turn
        most = wp.float64(0.0)
        for j in range(B.start[i], B.start[i + 1]):
            point = B.slot[j] / B.body.shape[1]
            most = wp.max(most, wp.length(y + wp.cross(turn, B.arm[point, B.slot[j] - point * B.body.shape[1]])))
        B.left[i] = most
        B.gain[i] = wp.dot(y, W.r[i, 0]) + wp.dot(turn, W.r[i, 1])

    @wp.kernel(module=module, enable_backward=False)
    def apply_body_corrections(G: CoupledRods, W: RodBodies, world: wp.array(dtype=int)):
        i = wp.tid()
        k = world[i]
        if G.on[k] == 0:
            return
        a = G.scale[k]
        for c in range(2):
            z = W.z[i, c]
            if G.back[k] > 0:
                z = W.last[i, c]
                W.last[i, c] = z * (wp.float64(1.0) + a)
            else:
                W.last[i, c] = z * a
            W.xi[i, c] = W.xi[i, c] + z * a

    return lean_bodies, cross_bodies, measure_bodies, apply_body_corrections


@cache
def body_motion_force_kernel(module: str):
    """Kernel over points: forces of bodies that move by y, at their contacts and at those of the edges before them."""
    @wp.kernel(module=module, enable_backward=False)
    def push_points(B: RodContacts, strands: int):
        B.push[wp.tid()] = point_force_of_bodies(B, strands, wp.tid())

    return push_points


@cache
def strand_end_kernels(real, module: str):
    """Kernels: momenta of bodies that were moved, over bodies; bristles, over points and the edges behind them."""
    t, Rig = types(real), rig_type(real)

    @wp.kernel(module=module, enable_backward=False)
    def give_bodies(W: RodBodies, B: RodContacts, rig: Rig):
        i = wp.tid()
        if B.start[i + 1] == B.start[i] and wp.length_sq(W.xi[i, 0]) + wp.length_sq(W.xi[i, 1]) == wp.float64(0.0):
            return
        p = double_vec3(rig.now.p[i]) + W.xi[i, 0] * (W.m[i] * mean_drag_factor(rig.b.drag[i], W.h) / W.h)
        L = double_vec3(rig.now.L[i]) + W.J[i] * W.xi[i, 1] * (mean_drag_factor(rig.b.spin_drag[i], W.h) / W.h)
        rig.now.p[i] = t.vec3(real(p[0]), real(p[1]), real(p[2]))
        rig.now.L[i] = t.vec3(real(L[0]), real(L[1]), real(L[2]))
        rig.work.touched[i] = 1

    @wp.kernel(module=module, enable_backward=False)
    def cling_points(B: RodContacts, W: RodBodies):
        p = wp.tid()
        i = p / W.strand.shape[0]
        k = p - i * W.strand.shape[0]
        W.stick[i, k] = B.s[p, 0]
        W.load[i, k] = B.N[p, 0]
        W.stick1[i, k] = B.s[p, 1]
        W.load1[i, k] = B.N[p, 1]
        W.stick2[i, k] = B.s[p, 2]
        W.load2[i, k] = B.N[p, 2]

    return give_bodies, cling_points
