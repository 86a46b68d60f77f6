"""A body and all points that touch it, solved at once: the points are eliminated, six unknowns are left (a star).

A point sees only the velocity that the body gives its place of contact, so its impulse is a function of that, Coulomb's law of
one contact in closed form (kernels/contact/project.py). With V the body's velocity less the one that contacts were found with,
U = v + omega x r that of a place with the arm r, and P [m] the push on the point without which it would be at d0:

    lam = max(base + k n.U, least)                base = -(b + n.d0) of the contact plane b + n.d = 0, k = h, least = 0
    T   = -s  where |s| <= mu lam,  else -mu lam s / |s|        s = (slip - g U) across n,  slip = d0 - a - g u
    J   = f (lam n + T)                           impulse on the point [N s], f = m / c (points.py)

    F(V) = M V - q + sum (J, r x J) = 0           q: momentum of the body without these impulses, less that of V = 0

Newton's method with J'(U) in closed form; a step that does not make |F| less, in the norm of M^-1, is halved. Friction makes
J' unsymmetric, and where contacts open and close |F| has minima that are no roots: a step of LEAST_STEP is taken as it is, and
from then on steps have to beat the greatest of the last four |F| (nonmonotone line search: Grippo, Lampariello, Lucidi 1986).
What is left throws a light body; so what ends beyond FAR is solved once more, by steps of friction.
F has one root without friction, where it is the gradient of a convex function. 2 to 12 evaluations to 1e-12 m for mu from 0 to
1, 4 to 3000 contacts, and points of .01 to 100 times the body's mass; an impulse that the body got a substep late would grow
once the points weigh twice the body, and Jacobi with split masses takes more than 64 sweeps.

Impulses that change no place have the same form, with k = 1 and no friction, in velocities instead of ways.

A team of threads sums over the contacts of a body, in an order that is always the same (kernels/math/team.py).
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.math.team import team_sum_func
from wsim.kernels.rigid.touch.contact_impulse import StarSums, star_impulse_func, star_structs

EVALUATIONS = wp.constant(80)
LEAST_STEP = wp.constant(wp.float64(1e-3))     # part of a Newton step below which it is taken as it is
FAR = 1e-6             # of the impulses
SMALL = wp.constant(wp.float64(1e-22))         # of F^2 to that of the impulses at hand: it is solved

real, vec3, mat33 = wp.float64, wp.vec3d, wp.mat33d
VALUES, sum_values = wp.types.vector(43, real), team_sum_func(43)  # those of `StarSums`


@wp.func
def sum_star_team(own: StarSums, warps: int, team: int):
    """Of all threads of a team."""
    v = VALUES()
    for i in range(3):
        v[i] = own.J[i]
        v[3 + i] = own.T[i]
        for j in range(3):
            v[6 + 3 * i + j] = own.A[i, j]
            v[15 + 3 * i + j] = own.B[i, j]
            v[24 + 3 * i + j] = own.C[i, j]
            v[33 + 3 * i + j] = own.D[i, j]
    v[42] = own.size
    v = sum_values(v, warps, team)
    all = StarSums()
    for i in range(3):
        all.J[i] = v[i]
        all.T[i] = v[3 + i]
        for j in range(3):
            all.A[i, j] = v[6 + 3 * i + j]
            all.B[i, j] = v[15 + 3 * i + j]
            all.C[i, j] = v[24 + 3 * i + j]
            all.D[i, j] = v[33 + 3 * i + j]
    all.size = v[42]
    return all


@wp.func
def schur_newton_step(S: StarSums, mass: real, inertia: mat33, Fv: vec3, Fo: vec3):
    """Step of V: [[A + m, B], [C, D + I]] dV = -F, by blocks."""
    back = wp.inverse(S.A + mass * wp.identity(n=3, dtype=real))
    do = wp.inverse(S.D + inertia - S.C * back * S.B) * (S.C * back * Fv - Fo)
    return -back * (Fv + S.B * do), do


@wp.func
def inertia_and_inverse(R: mat33, inverse: vec3):
    """I and I^-1, world, of the principal axes R."""
    moments = wp.cw_div(vec3(real(1.0), real(1.0), real(1.0)), inverse)
    return R * wp.diag(moments) * wp.transpose(R), R * wp.diag(inverse) * wp.transpose(R)


@cache
def star_sum_func(of, rolling: bool = False):
    """Function: the part of lane `lane` of the sums at V = (v, o). kg: k, g, and the part of friction that acts. rolling: balls
    turn."""
    Rows, _ = star_structs(of)
    formula = star_impulse_func(of)
    if rolling:
        from wsim.kernels.position_based.rolling.bodies import rolling_star_sum_func
        return rolling_star_sum_func(of)

    @wp.func
    def sum_star_contacts(rows: Rows, body: int, lane: int, lanes: int, kg: vec3, v: vec3, o: vec3):
        own = StarSums()
        s = rows.first[body] + lane
        while s < rows.first[body + 1]:
            r = vec3(rows.r[s])
            f = real(rows.f[s])
            P, slope = formula(rows, s, kg[0], kg[1], kg[2], v + wp.cross(o, r))
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

    return sum_star_contacts


@cache
def star_newton_func(of, rolling: bool = False):
    """Function (rows, hubs, body, at, kg, rub, v0, o0): V by Newton's method, see `star_solve_func`. rub: part of friction."""
    Rows, Hubs = star_structs(of)
    part_of = star_sum_func(of, rolling)

    @wp.func
    def iterate_star(rows: Rows, hubs: Hubs, body: int, at: wp.vec4i, kg: vec3, rub: real, v0: vec3, o0: vec3):
        inertia, spread = inertia_and_inverse(mat33(hubs.turn[body]), vec3(hubs.inverse[body]))
        w = real(hubs.w[body])
        acts = vec3(kg[0], kg[1], rub)
        v = v0
        o = o0
        dv = vec3()
        do = vec3()
        best_v, best_o = vec3(), vec3()
        best = real(-1.0)
        begun = real(0.0)
        scale = real(0.0)
        last = wp.vec4d()                              # F^2 of the last step, and once it is stuck of three before it
        stuck = int(0)
        part = real(1.0)
        going = wp.where(rows.first[body + 1] > rows.first[body], int(EVALUATIONS), 0)
        while going > 0:
            going -= 1
            tv = v + part * dv
            to = o + part * do
            S = sum_star_team(part_of(rows, body, at[0], at[1], acts, tv, to), at[2], at[3])
            Fv = tv / w - hubs.q[body] + S.J
            Fo = inertia * to - hubs.q[hubs.w.shape[0] + body] + S.T
            found = w * wp.dot(Fv, Fv) + wp.dot(Fo, spread * Fo)
            if best < real(0.0):
                begun = found
                last = wp.vec4d(found, real(0.0), real(0.0), real(0.0))
            if best < real(0.0) or found < best:
                best = found
                best_v = tv
                best_o = to
                scale = wp.max(begun, w * S.size * S.size)
                if best <= wp.max(SMALL * scale, kg[2]):
                    going = int(0)
            if part < LEAST_STEP:
                stuck = int(1)
            if found <= wp.max(wp.max(last[0], last[1]), wp.max(last[2], last[3])) or part < LEAST_STEP:
                v = tv
                o = to
                last = wp.vec4d(found, real(stuck) * last[0], real(stuck) * last[1], real(stuck) * last[2])
                part = real(1.0)
                dv, do = schur_newton_step(S, real(1.0) / w, inertia, Fv, Fo)
            else:
                part = real(0.5) * part
        return best_v, best_o, of(wp.sqrt(wp.max(best, real(0.0)) / wp.max(scale, real(1e-300))))

    return iterate_star


@cache
def star_solve_func(of, rolling: bool = False):
    """Function (rows, hubs, body, at, kg, v0, o0): V from the guess v0, o0 on, and what is left of F as a part of the impulses
    or of what it began with. at: lane, lanes and warps of the team of threads that solves, and its number in the block. kg: k,
    g, and F^2 that counts as nothing [J / 2]. Far from a root it begins again: without friction, then by 1/9, 4/9 and all."""
    Rows, Hubs = star_structs(of)
    iterate = star_newton_func(of, rolling)

    @wp.func
    def solve_star(rows: Rows, hubs: Hubs, body: int, at: wp.vec4i, kg: vec3, v0: vec3, o0: vec3):
        v = v0
        o = o0
        nv, no = v0, o0
        left = of(-1.0)
        thirds = int(3)                                # of the square root of the part of friction that acts
        while thirds < 4:
            nv, no, other = iterate(rows, hubs, body, at, kg, real(thirds * thirds) / real(9.0), nv, no)
            again = left < of(0.0) and other > of(FAR)
            if left < of(0.0) or thirds == 3 and other < left:
                v = nv
                o = no
                left = other
            thirds += 1
            if again:
                thirds = int(0)
                nv = vec3()
                no = vec3()
        return v, o, left

    return solve_star


@cache
def star_solve_kernel(of, module, rolling: bool = False):
    """Kernel over bodies times lanes: V (velocity, then spin) and what is left of F, see `star_solve_func`. k, g [s]."""
    Rows, Hubs = star_structs(of)
    solve = star_solve_func(of, rolling)

    def solve_all_stars(rows: Rows, hubs: Hubs, k: real, g: real, lanes: int, V_out: wp.array(dtype=vec3),
                        left_out: wp.array(dtype=of)):
        tid = wp.tid()
        body = tid // lanes
        at = wp.vec4i(tid % lanes, lanes, (lanes + 31) // 32, 0)
        v, o, left = solve(rows, hubs, body, at, vec3(k, g, real(0.0)), vec3(), vec3())
        if tid % lanes == 0:
            V_out[body] = v
            V_out[hubs.w.shape[0] + body] = o
            left_out[body] = left

    return wp.kernel(solve_all_stars, name=f"star_{types(of).name}", module=module, enable_backward=False)
