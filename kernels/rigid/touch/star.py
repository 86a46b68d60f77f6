"""A body and all points that touch it, solved at once: the points are eliminated, six unknowns are left (a star).

A point sees only the velocity that the body gives its place of contact, so its impulse is a function of that, Coulomb's law of
one contact in closed form (kernels/contact/project.py). With V the body's velocity less the one that contacts were found with,
U = v + omega x r that of a place with the arm r, and P [m] the push on the point without which it would be at d0:

    lam = max(base + k n.U, least)                base = -(b + n.d0) of the contact plane b + n.d = 0, k = h, least = 0
    T   = -s  where |s| <= mu lam,  else -mu lam s / |s|        s = (slip - g U) across n,  slip = d0 - a - g u
    J   = f (lam n + T)                           impulse on the point [N s], f = m / c (points.py)

    F(V) = M V - q + sum (J, r x J) = 0           q: momentum of the body without these impulses, less that of V = 0

Newton's method with J'(U) in closed form; a step that does not make |F| less, in the norm of M^-1, is halved. Friction makes J'
unsymmetric. F has one root without friction, where it is the gradient of a convex function. 2 to 12 evaluations to 1e-12 m for
mu from 0 to 1, 4 to 3000 contacts, and points of .01 to 100 times the body's mass; an impulse that the body got a substep late
would grow once the points weigh twice the body, and Jacobi with split masses takes more than 64 sweeps.

Impulses that change no place have the same form, with k = 1 and no friction, in velocities instead of ways.

A block of `lanes` threads sums over the contacts of a body, in an order that is always the same; on a CPU it is one thread.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

EVALUATIONS = wp.constant(80)
LEAST_STEP = wp.constant(wp.float64(1e-4))     # part of a Newton step that is not halved again: it ends there
SMALL = wp.constant(wp.float64(1e-22))         # of F^2 to that of the impulses at hand: it is solved

real, vec3, mat33 = wp.float64, wp.vec3d, wp.mat33d


@cache
def structs(of):
    """(Rows, Hubs): contacts in the order of their bodies, those of body k in first[k] .. first[k + 1]; bodies."""
    t = types(of)

    @wp.struct
    class Rows:
        first: wp.array(dtype=int)                # (bodies + 1,)
        slot: wp.array(dtype=int)                 # of each contact, (room,)
        n: wp.array(dtype=t.vec3)
        r: wp.array(dtype=t.vec3)                 # arm [m]
        base: wp.array(dtype=of)
        least: wp.array(dtype=of)
        slip: wp.array(dtype=t.vec3)
        mu: wp.array(dtype=of)
        f: wp.array(dtype=of)

    @wp.struct
    class Hubs:
        """Of bodies; w [1/kg] and turn, inverse (principal, 1/[kg m^2]) as kernels/rigid/motion.py has them."""
        w: wp.array(dtype=of)
        inverse: wp.array(dtype=t.vec3)
        turn: wp.array(dtype=t.mat33)
        q: wp.array(dtype=vec3)                   # momentum, (bodies,), then angular momentum, (2 bodies,)

    return Rows, Hubs


@cache
def law(of):
    """Function: P of contact s and its derivative by U, where the body gives the place U."""
    Rows, _ = structs(of)

    @wp.func
    def law(rows: Rows, s: int, k: real, g: real, U: vec3):
        n = vec3(rows.n[s])
        lam = real(rows.base[s]) + k * wp.dot(n, U)
        least = real(rows.least[s])
        slope = mat33()
        mu = real(0.0)
        if lam > least:
            slope = k * wp.outer(n, n)
            mu = real(rows.mu[s])
        else:
            lam = least
        P = lam * n
        if mu > real(0.0) and lam > real(0.0):
            across = wp.identity(n=3, dtype=real) - wp.outer(n, n)
            slide = across * (vec3(rows.slip[s]) - g * U)
            size = wp.length(slide)
            bound = mu * lam
            if size <= bound:
                P = P - slide
                slope = slope + g * across
            else:
                way = slide / size
                P = P - bound * way
                slope = slope - (mu * k) * wp.outer(way, n) + (bound * g / size) * (across - wp.outer(way, way))
        return P, slope

    return law


@wp.struct
class Sums:
    """Over contacts: impulse and its moment, size, and the derivatives of both by velocity (A, C) and spin (B, D)."""
    J: vec3
    T: vec3
    A: mat33
    B: mat33
    C: mat33
    D: mat33
    size: real


@wp.func
def total(x: real):
    """Of all threads of a block, in an order that is always the same."""
    return wp.tile_extract(wp.tile_sum(wp.tile(x)), 0)


@wp.func
def total_vector(x: vec3):
    return wp.tile_extract(wp.tile_sum(wp.tile(x, preserve_type=True)), 0)


@wp.func
def total_matrix(x: mat33):
    return wp.tile_extract(wp.tile_sum(wp.tile(x, preserve_type=True)), 0)


@wp.func
def gathered(own: Sums):
    """Of all threads of a block."""
    all = Sums()
    all.J = total_vector(own.J)
    all.T = total_vector(own.T)
    all.A = total_matrix(own.A)
    all.B = total_matrix(own.B)
    all.C = total_matrix(own.C)
    all.D = total_matrix(own.D)
    all.size = total(own.size)
    return all


@wp.func
def newton(S: Sums, mass: real, inertia: mat33, Fv: vec3, Fo: vec3):
    """Step of V: [[A + m, B], [C, D + I]] dV = -F, by blocks."""
    back = wp.inverse(S.A + mass * wp.identity(n=3, dtype=real))
    do = wp.inverse(S.D + inertia - S.C * back * S.B) * (S.C * back * Fv - Fo)
    return -back * (Fv + S.B * do), do


@cache
def sums(of):
    """Function: the part of lane `lane` of the sums at V = (v, o)."""
    Rows, _ = structs(of)
    formula = law(of)

    @wp.func
    def sums(rows: Rows, body: int, lane: int, lanes: int, k: real, g: real, v: vec3, o: vec3):
        own = Sums()
        s = rows.first[body] + lane
        while s < rows.first[body + 1]:
            r = vec3(rows.r[s])
            f = real(rows.f[s])
            P, slope = formula(rows, s, k, g, v + wp.cross(o, r))
            X = wp.skew(r)
            fS = f * slope
            own.J += f * P
            own.T += f * wp.cross(r, P)
            own.A += fS
            own.B -= fS * X
            own.C += X * fS
            own.D -= X * fS * X
            own.size += f * wp.length(P)
            s += lanes
        return own

    return sums


@cache
def star(of, module):
    """Kernel over bodies times lanes: V of each, (velocity, then spin), and what is left of F as a part of what it began with.
    k, g: of `law` [s]."""
    Rows, Hubs = structs(of)
    part_of = sums(of)

    def star(rows: Rows, hubs: Hubs, k: real, g: real, lanes: int, V_out: wp.array(dtype=vec3), left_out: wp.array(dtype=of)):
        tid = wp.tid()
        body = tid // lanes
        R = mat33(hubs.turn[body])
        moments = wp.cw_div(vec3(real(1.0), real(1.0), real(1.0)), vec3(hubs.inverse[body]))
        inertia = R * wp.diag(moments) * wp.transpose(R)
        spread = R * wp.diag(vec3(hubs.inverse[body])) * wp.transpose(R)
        w = real(hubs.w[body])
        v = vec3()
        o = vec3()
        dv = vec3()
        do = vec3()
        best = real(-1.0)
        scale = real(0.0)
        part = real(1.0)
        going = wp.where(rows.first[body + 1] > rows.first[body], int(EVALUATIONS), 0)
        while going > 0:
            going -= 1
            tv = v + part * dv
            to = o + part * do
            S = gathered(part_of(rows, body, tid % lanes, lanes, k, g, tv, to))
            Fv = tv / w - hubs.q[body] + S.J
            Fo = inertia * to - hubs.q[hubs.w.shape[0] + body] + S.T
            found = w * wp.dot(Fv, Fv) + wp.dot(Fo, spread * Fo)
            if best < real(0.0) or found < best:
                scale = wp.where(best < real(0.0), found, scale)
                v = tv
                o = to
                best = found
                part = real(1.0)
                if best <= SMALL * wp.max(scale, w * S.size * S.size):
                    going = int(0)
                dv, do = newton(S, real(1.0) / w, inertia, Fv, Fo)
            else:
                part = real(0.5) * part
                if part < LEAST_STEP:
                    going = int(0)
        if tid % lanes == 0:
            V_out[body] = v
            V_out[hubs.w.shape[0] + body] = o
            left_out[body] = of(wp.sqrt(wp.max(best, real(0.0)) / wp.max(scale, real(1e-300))))

    return wp.kernel(star, name=f"star_{types(of).name}", module=module, enable_backward=False)
