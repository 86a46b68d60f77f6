"""What holds points during a Newton step (kernels/newton.py): contacts as filters, soft pins as springs.

A contact that pushes takes its direction out of the system: P = S (A_ii)^-1 S, S = I - n n^T (Baraff, Witkin 1998, section 5.1;
an active set as in Bertsekas 1982). f is the force without contacts. A contact stays as long as f presses, f.n < 0, and is
let go where f pulls; its push P = lam n + T [m] (kernels/contact.py; impulse m P / g) is the reaction,

    lam = -f.n / own                      own = m / g^2
    stuck:  T = -f_t / own,  S = 0        where the projection before left |T| under the cone and f_t is under mu_s own lam
    slides: |T| = mu_d lam along the last T, a constant force for this Newton step

Between Newton steps the projection of kernels/contact.py finds new contacts and turns T against the sliding; at the
solution of the substep neither changes anything. A soft pin k |x + d - target|^2 / 2 + c |d - a|^2 / (2 g) and the inertia
are one parabola of stiffness own' = own + k + c / g about b' = (own b + k (target - x) + (c / g) a) / own'.
"""

from functools import cache

import warp as wp

from wsim.kernels import contact
from wsim.kernels.constraint import inverse
from wsim.kernels.newton import structs
from wsim.kernels.points import soft_pins
from wsim.kernels.real import types

NEAR = 0.01            # part of the search's skin: a gap under it touches, as kernels/search.py has it


@cache
def hold(real, module):
    """Kernel over points, after `assemble`: f without what contacts bear, P filtered, pushes; q [m]: b and friction."""
    t, A, Slots = types(real), structs(real).Matrix, contact.slots(real)
    Rows, Points = contact.tables(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.func
    def friction(P: t.vec3, n: t.vec3, f: t.vec3, lam: real, own: real, mu: t.vec2):
        """T, and whether it sticks. P the push before, lam the new one along n, f the force across it."""
        before = wp.dot(P, n)
        T = P - before * n
        size = wp.length(T)
        still = -(real(1.0) / own) * f
        slides = wp.abs(size - mu[1] * before) <= real(1.0e-3) * mu[1] * before
        if not slides and wp.length(still) <= mu[0] * lam:
            return still, True
        return (mu[1] * lam * inverse(size)) * T, False

    @wp.kernel(module=module, enable_backward=False)
    def hold(c: Rows, points: Points, s: Slots, d: vec3, b: vec3, f: vec3, push: vec3, w: wp.array(dtype=real), A_out: A,
             f_out: vec3, push_out: vec3, q_out: vec3):
        i = wp.tid()
        q = b[i]
        if s.count[i] > 0 and w[i] > real(0.0):
            own = A_out.own[i]
            left = f[i]
            S = wp.identity(n=3, dtype=real)
            for slot in range(s.count[i]):
                j = slot * s.points + i
                n = s.n[j]
                P = push[j]
                lam = -wp.dot(left, n) / own
                touches = wp.dot(P, n) > real(0.0) or s.b[j] + wp.dot(n, d[i]) <= real(NEAR) * c.skin
                if touches and lam > real(0.0):
                    left += (lam * own) * n
                    Sn = S * n
                    S -= inverse(wp.dot(n, Sn)) * wp.outer(Sn, Sn)
                    mu = real(0.5) * (points.friction[i] + c.friction[s.row[j]])
                    T, sticks = friction(P, n, left, lam, own, mu)
                    left += own * T
                    q += T
                    if sticks:
                        S = t.mat33()
                    push_out[j] = lam * n + T
                else:
                    push_out[j] = t.vec3()
            f_out[i] = S * left
            A_out.P[i] = S * A_out.P[i] * S
        q_out[i] = q

    return hold


@cache
def pinned(real, module):
    """Kernel over softly pinned points: own and b with their pins, first[j] .. first[j + 1] of point[j]; at substep k."""
    t, A, SoftPins = types(real), structs(real).Matrix, soft_pins(real)
    vec3 = wp.array(dtype=t.vec3)

    @wp.kernel(module=module, enable_backward=False)
    def pinned(pins: SoftPins, first: wp.array(dtype=int), item: wp.array(dtype=int), target: wp.array2d(dtype=t.vec3),
               x: vec3, a: vec3, k: int, rate: real, A_out: A, b_out: vec3):
        j = wp.tid()
        i = pins.point[item[first[j]]]
        if pins.w[i] > real(0.0):
            own = A_out.own[i]
            whole = own
            force = t.vec3()
            b = b_out[i]
            for m in range(first[j], first[j + 1]):
                pin = item[m]
                stiffness = inverse(pins.alpha[pin])
                drag = rate * pins.damping[pin]
                whole += stiffness + drag
                force += stiffness * ((target[k, pin] - x[i]) - b) + drag * (a[i] - b)
            A_out.own[i] = whole
            b_out[i] = b + force / whole

    return pinned
