"""A body and all points that touch it, solved at once: the points are eliminated, six unknowns are left (a star).

A point sees only the velocity that the body gives its place of contact, so its impulse is a function of that, Coulomb's law of
one contact in closed form (kernels/contact/project.py). With V the body's velocity less the one that contacts were found with,
U = v + omega x r that of a place with the arm r, and P [m] the push on the point without which it would be at d0:

    lam = max(base + k n.U, least)                base = -(b + n.d0) of the contact plane b + n.d = 0, k = h, least = 0
    T   = -s  where |s| <= mu lam,  else -mu lam s / |s|        s = (slip - g U) across n,  slip = d0 - a - g u
    J   = f (lam n + T)                           impulse on the point [N s], f = m / c (kernels/carrier/response.py)

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


@cache
def star(of, module):
    """Kernel over bodies times lanes: V of each, (velocity, then spin), and what is left of F as a part of what it began with.
    k, g: of `law` [s]."""
    Rows, Hubs = structs(of)
    formula = law(of)

    def star(rows: Rows, hubs: Hubs, k: real, g: real, lanes: int, V_out: wp.array(dtype=vec3), left_out: wp.array(dtype=of)):
        tid = wp.tid()
        body = tid // lanes
        bodies = hubs.w.shape[0]
        first = rows.first[body]
        last = rows.first[body + 1]
        R = mat33(hubs.turn[body])
        inverse = vec3(hubs.inverse[body])
        spread = R * wp.diag(inverse) * wp.transpose(R)
        inertia = R * wp.diag(vec3(real(1.0) / inverse[0], real(1.0) / inverse[1], real(1.0) / inverse[2])) * wp.transpose(R)
        w = real(hubs.w[body])
        mass = real(1.0) / w
        p = hubs.q[body]
        L = hubs.q[bodies + body]
        v = vec3()
        o = vec3()
        dv = vec3()
        do = vec3()
        best = real(-1.0)
        scale = real(0.0)
        part = real(1.0)
        going = int(0)
        if last > first:
            going = int(EVALUATIONS)
        while going > 0:
            going -= 1
            tv = v + part * dv
            to = o + part * do
            J = vec3()
            T = vec3()
            A = mat33()
            B = mat33()
            C = mat33()
            D = mat33()
            size = real(0.0)
            s = first + tid % lanes
            while s < last:
                r = vec3(rows.r[s])
                f = real(rows.f[s])
                P, slope = formula(rows, s, k, g, tv + wp.cross(to, r))
                X = wp.skew(r)
                J += f * P
                T += f * wp.cross(r, P)
                size += f * wp.length(P)
                fS = f * slope
                A += fS
                B -= fS * X
                C += X * fS
                D -= X * fS * X
                s += lanes
            J = wp.tile_extract(wp.tile_sum(wp.tile(J, preserve_type=True)), 0)
            T = wp.tile_extract(wp.tile_sum(wp.tile(T, preserve_type=True)), 0)
            A = wp.tile_extract(wp.tile_sum(wp.tile(A, preserve_type=True)), 0)
            B = wp.tile_extract(wp.tile_sum(wp.tile(B, preserve_type=True)), 0)
            C = wp.tile_extract(wp.tile_sum(wp.tile(C, preserve_type=True)), 0)
            D = wp.tile_extract(wp.tile_sum(wp.tile(D, preserve_type=True)), 0)
            size = wp.tile_extract(wp.tile_sum(wp.tile(size)), 0)
            Fv = mass * tv - p + J
            Fo = inertia * to - L + T
            found = w * wp.dot(Fv, Fv) + wp.dot(Fo, spread * Fo)
            if best < real(0.0):
                scale = found
            if best < real(0.0) or found < best:
                v = tv
                o = to
                best = found
                part = real(1.0)
                if best <= SMALL * wp.max(scale, w * size * size):
                    going = int(0)
                A += mass * wp.identity(n=3, dtype=real)
                D += inertia
                back = wp.inverse(A)
                do = wp.inverse(D - C * back * B) * (C * back * Fv - Fo)
                dv = -back * (Fv + B * do)
            else:
                part = real(0.5) * part
                if part < LEAST_STEP:
                    going = int(0)
        if tid % lanes == 0:
            V_out[body] = v
            V_out[bodies + body] = o
            left_out[body] = of(0.0)
            if scale > real(0.0):
                left_out[body] = of(wp.sqrt(wp.max(best, real(0.0)) / scale))

    return wp.kernel(star, name=f"star_{types(of).name}", module=module, enable_backward=False)
