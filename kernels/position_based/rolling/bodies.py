"""Balls that turn at a rigid body: what a star (kernels/rigid/touch/body_point_solve.py) knows of them.

A ball sees of the body the velocity U = v + omega x r of the place of contact and the spin omega alone, so its impulse P and
its torque q are functions of both, by the law of law.py with A = 1 + a, B = C = a in pushes [m]:

    lam = max(base + k n.U, least)         s0 = (slip - g U) across n         psi0 = psi - k R omega
    P   = lam n + T(lam, s0, psi0)         q(lam, s0, psi0)                   J = f P,   moment f (r x P + R q)

slip and psi are those without this contact's P and q, the body as contacts were found with it. A torque that the star does not
know turns a light body without bound: a ball of a hundred times its mass gives it all that stops the ball. Newton's method has

    dP/dU = (n + T_lam) k n^T - g T_s,    dP/domega = -k R T_psi,    and the same of q

T and q are cut off twice or three times (`cut_with_slope`), each time by the chain rule.
"""

from functools import cache

import warp as wp

from wsim.kernels.rigid.touch.contact_impulse import StarSums, star_impulse_func, star_structs

real, vec3, mat33 = wp.float64, wp.vec3d, wp.mat33d


@wp.struct
class SlopedVector:
    """A vector, and its derivatives by s0, by psi0 and by lam."""
    v: vec3
    s: mat33
    psi: mat33
    lam: vec3


@wp.func
def cut_with_slope(x: SlopedVector, mu: real, lam: real):
    """(x, cut off at the length mu lam; whether it was)."""
    size = wp.length(x.v)
    if size <= mu * lam:
        return x, False
    way = x.v / size
    Y = (mu * lam / size) * (wp.identity(n=3, dtype=real) - wp.outer(way, way))
    y = SlopedVector()
    y.v = (mu * lam) * way
    y.s = Y * x.s
    y.psi = Y * x.psi
    y.lam = Y * x.lam + mu * way
    return y, True


@wp.func
def sloped_rolling_contact(n: vec3, lam: real, s0: vec3, psi0: vec3, kappa: real, mu: real, rolling: real):
    """T and q of a ball at a wall, see `rolling_law_func`. mu: one bound of friction, static or dynamic; kappa, lam above 0."""
    about = wp.outer(n, n)
    across = wp.identity(n=3, dtype=real) - about
    N = wp.skew(n)
    A = real(1.0) + kappa
    q = SlopedVector()
    q.psi = (real(-1.0) / kappa) * about - (A / kappa) * across
    q.s = real(-1.0) * N
    q.v = q.psi * psi0 - wp.cross(n, s0)
    q, _cut = cut_with_slope(q, rolling, lam)
    T = SlopedVector()
    T.v = (-real(1.0) / A) * (s0 + kappa * wp.cross(n, q.v))
    T.s = (-real(1.0) / A) * (across + kappa * (N * q.s))
    T.psi = (-kappa / A) * (N * q.psi)
    T.lam = (-kappa / A) * wp.cross(n, q.lam)
    T, slides = cut_with_slope(T, mu, lam)
    if slides:
        q.v = wp.cross(n, T.v) - psi0 / kappa
        q.s = N * T.s
        q.psi = N * T.psi - (real(1.0) / kappa) * wp.identity(n=3, dtype=real)
        q.lam = wp.cross(n, T.lam)
        q, _cut = cut_with_slope(q, rolling, lam)
    return T, q


@cache
def rolling_star_sum_func(of):
    """Function: as `star_sum_func` has it, where balls turn."""
    Rows, plain = star_structs(of)[0], star_impulse_func(of)

    @wp.func
    def add_star_slopes(own: StarSums, f: real, r: vec3, P: vec3, slope: mat33, spun: mat33):
        """Adds P, its moment and its derivatives by U and omega. spun: the latter, at the same U."""
        X = wp.skew(r)
        by_spin = f * (spun - slope * X)
        own.J += f * P
        own.T += f * wp.cross(r, P)
        own.A += f * slope
        own.B += by_spin
        own.C += f * (X * slope)
        own.D += X * by_spin
        own.size += f * wp.length(P)
        return own

    @wp.func
    def add_rolling_contact(own: StarSums, rows: Rows, s: int, kg: vec3, v: vec3, o: vec3):
        n = vec3(rows.n[s])
        r = vec3(rows.r[s])
        ball = vec3(rows.ball[s])
        f = real(rows.f[s])
        U = v + wp.cross(o, r)
        lam = real(rows.base[s]) + kg[0] * wp.dot(n, U)
        if lam <= real(0.0):
            return own
        slide = vec3(rows.slip[s]) - kg[1] * U
        T, q = sloped_rolling_contact(n, lam, slide - wp.dot(n, slide) * n, vec3(rows.psi[s]) - (kg[0] * ball[2]) * o,
                                      ball[0], kg[2] * real(rows.mu[s]), kg[2] * ball[1])
        across = wp.identity(n=3, dtype=real) - wp.outer(n, n)
        slope = kg[0] * wp.outer(n + T.lam, n) - kg[1] * (T.s * across)
        own = add_star_slopes(own, f, r, lam * n + T.v, slope, (-kg[0] * ball[2]) * T.psi)
        turned = kg[0] * wp.outer(q.lam, n) - kg[1] * (q.s * across)
        own.T += (f * ball[2]) * q.v
        own.C += (f * ball[2]) * turned
        own.D -= (f * ball[2]) * (turned * wp.skew(r) + (kg[0] * ball[2]) * q.psi)
        return own

    @wp.func
    def sum_rolling_contacts(rows: Rows, body: int, lane: int, lanes: int, kg: vec3, v: vec3, o: vec3):
        own = StarSums()
        s = rows.first[body] + lane
        while s < rows.first[body + 1]:
            if rows.ball[s][0] > of(0.0) and rows.least[s] == of(0.0):
                own = add_rolling_contact(own, rows, s, kg, v, o)
            else:
                r = vec3(rows.r[s])
                P, slope = plain(rows, s, kg[0], kg[1], kg[2], v + wp.cross(o, r))
                own = add_star_slopes(own, real(rows.f[s]), r, P, slope, mat33())
            s += lanes
        return own

    return sum_rolling_contacts
