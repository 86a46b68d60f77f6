"""Contacts of grains with Coulomb friction, as constraints of the XPBD iterations.

    d  displacement in a substep, the unknown [m]          a  anchor: velocity v = (d - a) / g        u = d - a
    n  unit normal from grain j to i where the substep begins       C = b + n.(u_i - u_j) >= 0        b  gap there, >= 0 [m]
    w  inverse mass [1/kg]       m_i  contacts of grain i       K = m_i w_i + m_j w_j       L  impulse times g [kg m], on
    grain i

Each grain is split into as many parts as it has contacts, all contacts are solved at once, and the parts are joined again (mass
splitting: Tonge, Benevolenski, Voroshilov 2012). In projected Gauss-Seidel's form, on accumulated impulses L = lam n + T:

    lam' = max(lam - C / K, 0)          T* = T - (u_i - u_j)_t / K,      T' = T* where |T*| <= mu_s lam', else mu_d lam' T*/|T*|
    d_i += w_i sum (L' - L)             and d_j the opposite: momentum is kept to rounding, whatever the masses

The average of positions in Macklin et al. 2014, eq. 13, divides each side by its own number of contacts, and loses momentum
where those differ. Sums have the order of the grains' numbers. A fixed point is Coulomb's law, exactly; how far it is shows
in the overlap and in the speed at rest. What contacts have borne as forces [N] is where the next substep begins: piles
converge over substeps, not within one, and friction remembers what it holds.

Grains that stand on others answer such contacts alone, so that deep piles need few iterations: stacks.py.

Here grains do not turn, as if resistance to rolling had no bound. Those that do: rolling/pairs.py.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.marks import kernel_over_cores
from wsim.kernels.math.real import types

OVER = 1.7             # over-relaxation of what both sides answer; stable below 2, as K bounds what all contacts do together
PUSHED = 0.5           # of a push by a grain that holds another, that the other takes: see stacks.py


@cache
def grain_structs(real) -> SimpleNamespace:
    """Structs: GrainTable (constants and scratch by place), GrainContacts (those of a substep), GrainForces (what lasts)."""
    t = types(real)

    @wp.struct
    class GrainTable:
        friction: wp.array(dtype=t.vec2)   # static, dynamic, by p
        piece: wp.array(dtype=int)         # rigid cluster that a point belongs to, -1: none, by p
        whole: wp.array(dtype=t.scalar)    # inverse mass of it along any direction at that point, at most [1/kg], by p
        pressed: wp.array(dtype=int)       # contacts that press a rigid cluster, by cluster
        w: wp.array(dtype=t.scalar)        # inverse mass of points of the state
        point: wp.array(dtype=int)         # place among the points of the state, by k
        inverse: wp.array(dtype=t.scalar)  # inverse mass by k [1/kg]
        y: wp.array(dtype=t.vec3)          # where the substep begins, by k [m]
        u: wp.array(dtype=t.vec3)          # by k [m]
        split: wp.array(dtype=t.scalar)    # m w, by k [1/kg]
        up: wp.array(dtype=t.vec4)         # against gravity, and its size [m/s^2], by k: see stacks.py
        felt: wp.array(dtype=t.vec2)       # of gravity in the substep before, below 0: no grain; then its share; by k
        held: wp.array(dtype=t.vec4)       # part, load over weight, ground, due, by k
        rise: wp.array(dtype=t.scalar)     # up.u before contacts, by k [m]
        rub: wp.array(dtype=t.vec2)        # friction by k
        back: wp.array(dtype=t.vec3)       # correction of overlaps, by k [m]
        fast: wp.array(dtype=int)          # how many passed others in a substep, (1,): see grain_contacts.py
        deepest: wp.array(dtype=int)       # the greatest overlap [1e-6 of R_i + R_j], (1,)

    @wp.struct
    class GrainContacts:
        room: int
        size: int                          # contact s of place k stands at s * size + k
        count: wp.array(dtype=int)         # by k
        other: wp.array(dtype=int)         # k of the other grain
        id: wp.array(dtype=int)            # p of it
        support: wp.array(dtype=int)       # 1: the other holds this one, -1: this one holds the other, else 0
        n: wp.array(dtype=t.vec3)
        b: wp.array(dtype=t.scalar)        # [m]
        L: wp.array(dtype=t.vec3)          # [kg m]
        share: wp.array(dtype=t.scalar)    # part of L that the lower one feels; 1 where support is 0: see stacks.py
        wanted: wp.array(dtype=int)        # most contacts of a grain that had no room, (1,)

    @wp.struct
    class GrainForces:
        id: wp.array(dtype=int)            # p of the other grain, ascending; -1: no more. Entry s of grain p at s * size + p
        f: wp.array(dtype=t.vec3)          # force on p [N]

    @wp.struct
    class GrainSupport:
        felt: wp.array(dtype=t.scalar)     # upward acceleration by contacts over gravity, by p [1]
        part: wp.array(dtype=t.scalar)     # of the weight, that grains carry, by p [1]
        load: wp.array(dtype=t.vec3)       # of the grains above, by p [N]
        due: wp.array(dtype=t.scalar)      # its weight and what it feels from above, over its weight, by p [1]
        share: wp.array(dtype=t.scalar)    # part of what stands on it that it feels, by p [1]
        ground: wp.array(dtype=t.scalar)   # substeps on something else than grains, SETTLED at most, by p

    return SimpleNamespace(GrainTable=GrainTable, GrainContacts=GrainContacts, GrainForces=GrainForces,
                           GrainSupport=GrainSupport)


@cache
def motion_kernel(real, module):
    """Kernel over places: u in the order of cells, before an iteration."""
    t, S = types(real), grain_structs(real)

    def gather_motion(g: S.GrainTable, d: wp.array(dtype=t.vec3), a: wp.array(dtype=t.vec3)):
        k = wp.tid()
        i = g.point[k]
        g.u[k] = d[i] - a[i]

    return kernel_over_cores(gather_motion, f"grains_motion_{t.name}", module)


@cache
def pair_normal_func(real):
    """Function (y_i - y_j, i, j) -> (n, distance); coincident ones get a direction from their numbers, opposite for both."""
    t = types(real)

    @wp.func
    def normal_of_pair(way: t.vec3, i: int, j: int):
        D = wp.length(way)
        n = t.vec3()
        if D > real(0.0):
            n = way / D
        else:
            low = wp.min(i, j)
            seed = wp.rand_init(low, wp.max(i, j))
            z = real(wp.randf(seed, -1.0, 1.0))
            turn = real(wp.randf(seed, 0.0, 6.2831853))
            flat = wp.sqrt(wp.max(real(1.0) - z * z, real(0.0)))
            n = t.vec3(flat * wp.cos(turn), flat * wp.sin(turn), z)
            if i != low:
                n = -n
        return n, D

    return normal_of_pair


@cache
def pair_impulse_func(real):
    """Function (n, b, L, u_i - u_j, K, mu) -> L' of one contact, split as K says."""
    t = types(real)

    @wp.func
    def solve_grain_pair(n: t.vec3, b: real, L: t.vec3, u: t.vec3, K: real, mu: t.vec2):
        lam = wp.dot(L, n)
        close = wp.dot(n, u)
        pressed = wp.max(lam - (b + close) / K, real(0.0))
        T = t.vec3()
        if pressed > real(0.0):
            T = (L - lam * n) - (u - close * n) / K
            size = wp.length(T)
            if size > mu[0] * pressed:
                T *= wp.min(mu[1] * pressed / size, real(1.0))
        return pressed * n + T

    return solve_grain_pair


@cache
def grain_solve_kernel(shares: bool, real, module):
    """Kernel over places: one iteration of all contacts of a grain. shares: what stands on a grain may be felt in part."""
    t, S, solve = types(real), grain_structs(real), pair_impulse_func(real)

    def solve_grain_contacts(g: S.GrainTable, q: S.GrainContacts, d_out: wp.array(dtype=t.vec3)):
        k = wp.tid()
        m = q.count[k]
        if m == 0:
            return
        u = g.u[k]
        own = g.split[k]
        rub = g.rub[k]
        given = t.vec3()
        w = g.inverse[k]
        for s in range(m):
            slot = s * q.size + k
            other = q.other[slot]
            held = q.support[slot]
            share = real(0.0)
            if wp.static(shares):
                share = q.share[slot]
            n = q.n[slot]
            K = own + g.split[other]
            away = u - g.u[other]
            felt = real(1.0)
            if held == 1:
                K = own + share * g.split[other]
                away += (real(1.0 - PUSHED) * (real(1.0) - share) * wp.max(wp.dot(n, g.u[other]), real(0.0))) * n
            if held == -1:
                felt = share
                K = share * own + g.split[other]
                away += (real(1.0 - PUSHED) * (real(1.0) - share) * wp.max(-wp.dot(n, u), real(0.0))) * n
            K *= real(1.0 / OVER)
            if held == 1 and share == real(0.0):
                K = w
                away += w * given
            if K > real(0.0) and felt > real(0.0):
                L = q.L[slot]
                new = solve(n, q.b[slot], L, away, K, real(0.5) * (rub + g.rub[other]))
                q.L[slot] = new
                given += felt * (new - L)
        i = g.point[k]
        d_out[i] = d_out[i] + w * given

    return kernel_over_cores(solve_grain_contacts, f"grains_solve{'_shares' * shares}_{t.name}", module)
