"""Exchange of impulses between two carriers, pair by pair: non-penetration with Coulomb friction, in displacements.

    U = way_a - way_b       relative displacement over the substep [m]        n   unit normal, from b to a
    V = slide_a - slide_b   relative motion [m], what friction stops          C = gap + n.U >= 0
    P   accumulated impulse of a, b has received -P [N s]: lam = n.P >= 0, T = P - lam n
    K = r_a W_a + r_b W_b   [m/(N s)], r = reach, W = inverse mass: U and V change by K dP

Projected Gauss-Seidel on accumulated impulses (Tonge, Benevolenski, Voroshilov 2012), as kernels/contact/project.py has it for
points against what nothing pushes:

    lam' = max(lam - C / n.Kn, 0)
    T*   = T - K_t^-1 V_t             K_t: K in the plane across n; V after the normal impulse
    T'   = T* where |T*| <= mu_s lam', else mu_d lam' T* / |T*|

One pair without friction, or with K isotropic, is solved by one visit. Both sides take dP = P' - P in one place: momentum is
kept to rounding whatever integrates them, and however few sweeps there are.

What an integrator makes of an impulse within a substep is not always the velocity that a contact leaves: BDF2 throws back half
of the speed at which it meets a wall, the implicit midpoint all of it. So after the last sweep those pairs that push are gone
through again, by impulses that change no place (`aim`, `settle`): relative velocity along n becomes the relative motion over h
without what led out of an overlap (gap < 0), or that of a rebound,

    n.v' = max((n.V - min(max(n.V, 0), max(-gap, 0))) / h, -restitution n.v_before)     the latter where n.v_before < -slow

and where the pair sticks, across n too; friction keeps to its cone with the total impulse. (`settle` of
kernels/contact/project.py does the first for points that use BDF2.) Of backward Euler, without an overlap and a rebound, it
changes nothing but rounding.
"""

from functools import cache
from typing import Any

import warp as wp

from wsim.kernels.carrier.pairs import lists
from wsim.kernels.cloth.constraint import inverse
from wsim.kernels.math.real import types


@cache
def formulas(real):
    """(across, cone): y across n with (K y + V) across n = 0; the impulse in the friction cone nearest to T along it."""
    t = types(real)
    vec3 = t.vec3

    @wp.func
    def across(K: t.mat33, V: vec3, n: vec3):
        side = vec3(real(1.0), real(0.0), real(0.0))
        if wp.abs(n[0]) > real(0.6):
            side = vec3(real(0.0), real(1.0), real(0.0))
        s = wp.normalize(wp.cross(n, side))
        r = wp.cross(n, s)
        Ks = K * s
        Kr = K * r
        a = wp.dot(s, Ks)
        b = wp.dot(r, Ks)
        c = wp.dot(r, Kr)
        over = inverse(a * c - b * b)
        x = wp.dot(s, V)
        y = wp.dot(r, V)
        return (over * (b * y - c * x)) * s + (over * (b * x - a * y)) * r

    @wp.func
    def cone(T: vec3, pressed: real, mu: t.vec2):
        size = wp.length(T)
        found = T
        if size > mu[0] * pressed:
            found = (wp.min(mu[1] * pressed, size) / size) * T
        return found

    return across, cone


@cache
def project(a: Any, b: Any, real, module):
    """Kernel over the threads that walk a group: one sweep of its pairs. a, b: carriers (kernels/carrier/response.py).
    walk: number of the group, and how many threads walk."""
    t, A, B, Pairs, (across, cone) = types(real), a(real), b(real), lists(real), formulas(real)

    def project(data_a: A.Data, data_b: B.Data, pairs: Pairs, walk: wp.vec2i,
                out_a: A.Pushed, out_b: B.Pushed, push_out: wp.array(dtype=t.vec3)):
        s = pairs.first[walk[0]] + wp.tid()
        last = pairs.first[walk[0] + 1]
        while s < last:
            i = pairs.order[s]
            s += walk[1]
            id_a = pairs.id_a[i]
            id_b = pairs.id_b[i]
            at_a = pairs.at_a[i]
            at_b = pairs.at_b[i]
            n = pairs.n[i]
            P = pairs.push[i]
            mu = pairs.friction[i]
            K = A.reach(data_a) * A.mass(data_a, id_a, at_a) + B.reach(data_b) * B.mass(data_b, id_b, at_b)
            lam = wp.dot(P, n)
            C = pairs.gap[i] + wp.dot(n, A.way(data_a, id_a, at_a) - B.way(data_b, id_b, at_b))
            pressed = wp.max(lam - C * inverse(wp.dot(n, K * n)), real(0.0))
            T = t.vec3()
            if pressed > real(0.0) and mu[0] > real(0.0):
                V = A.slide(data_a, id_a, at_a) - B.slide(data_b, id_b, at_b) + (pressed - lam) * (K * n)
                T = cone(P - lam * n + across(K, V, n), pressed, mu)
            given = pressed * n + T
            A.take(data_a, id_a, at_a, given - P, out_a)
            B.take(data_b, id_b, at_b, P - given, out_b)
            push_out[i] = given

    return wp.kernel(project, name=f"exchange_{A.name}_{B.name}_{t.name}", module=module, enable_backward=False)


@cache
def aim(a: Any, b: Any, real, module):
    """Kernel over the threads that walk a group, once after the last sweep: the relative velocity that its pairs shall have,
    and which of them stick: those that one more sweep would let. `total` begins as `push`. left: |min(C, lam n.Kn)| [m], what
    the sweeps have left of C >= 0, lam >= 0, lam C = 0."""
    t, A, B, Pairs, (across, _) = types(real), a(real), b(real), lists(real), formulas(real)

    def aim(data_a: A.Data, data_b: B.Data, pairs: Pairs, walk: wp.vec2i, aim_out: wp.array(dtype=t.vec3),
            sticks_out: wp.array(dtype=int), total_out: wp.array(dtype=t.vec3), left_out: wp.array(dtype=real)):
        s = pairs.first[walk[0]] + wp.tid()
        last = pairs.first[walk[0] + 1]
        while s < last:
            i = pairs.order[s]
            s += walk[1]
            id_a = pairs.id_a[i]
            id_b = pairs.id_b[i]
            at_a = pairs.at_a[i]
            at_b = pairs.at_b[i]
            n = pairs.n[i]
            P = pairs.push[i]
            bounce = pairs.bounce[i]
            lam = wp.dot(P, n)
            V = A.slide(data_a, id_a, at_a) - B.slide(data_b, id_b, at_b)
            K = A.reach(data_a) * A.mass(data_a, id_a, at_a) + B.reach(data_b) * B.mass(data_b, id_b, at_b)
            apart = wp.dot(n, V)
            more = -wp.clamp(apart, real(0.0), wp.max(-pairs.gap[i], real(0.0)))
            if bounce[1] < -pairs.slow:
                more = wp.max(more, -bounce[0] * bounce[1] * pairs.h - apart)
            sticks = int(0)
            if wp.length(P - lam * n + across(K, V, n)) <= pairs.friction[i][0] * lam:
                sticks = int(1)
            C = pairs.gap[i] + wp.dot(n, A.way(data_a, id_a, at_a) - B.way(data_b, id_b, at_b))
            left_out[i] = wp.abs(wp.min(C, lam * wp.dot(n, K * n)))
            aim_out[i] = (V + more * n) / pairs.h
            sticks_out[i] = sticks
            total_out[i] = P

    return wp.kernel(aim, name=f"aim_{A.name}_{B.name}_{t.name}", module=module, enable_backward=False)


@cache
def settle(a: Any, b: Any, real, module):
    """Kernel over the threads that walk a group, after `aim`: one sweep over the velocities of the pairs that push."""
    t, A, B, Pairs, (across, cone) = types(real), a(real), b(real), lists(real), formulas(real)

    def settle(data_a: A.Data, data_b: B.Data, pairs: Pairs, walk: wp.vec2i,
               out_a: A.Pushed, out_b: B.Pushed, total_out: wp.array(dtype=t.vec3)):
        s = pairs.first[walk[0]] + wp.tid()
        last = pairs.first[walk[0] + 1]
        while s < last:
            i = pairs.order[s]
            s += walk[1]
            n = pairs.n[i]
            P = pairs.push[i]
            lam = wp.dot(P, n)
            if lam > real(0.0):
                id_a = pairs.id_a[i]
                id_b = pairs.id_b[i]
                at_a = pairs.at_a[i]
                at_b = pairs.at_b[i]
                W = A.mass(data_a, id_a, at_a) + B.mass(data_b, id_b, at_b)
                miss = A.speed(data_a, id_a, at_a) - B.speed(data_b, id_b, at_b) - pairs.aim[i]
                before = pairs.total[i]
                had = wp.dot(before, n)
                pressed = wp.max(had - wp.dot(n, miss) * inverse(wp.dot(n, W * n)), real(0.0))
                T = (pressed / lam) * (P - lam * n)
                if pairs.sticks[i] != 0:
                    T = cone(before - had * n + across(W, miss + (pressed - had) * (W * n), n), pressed, pairs.friction[i])
                given = pressed * n + T
                A.recoil(data_a, id_a, at_a, given - before, out_a)
                B.recoil(data_b, id_b, at_b, before - given, out_b)
                total_out[i] = given

    return wp.kernel(settle, name=f"settle_{A.name}_{B.name}_{t.name}", module=module, enable_backward=False)


@cache
def remember(a: Any, b: Any, real, module):
    """Kernel over the threads that walk a group, at last: carriers with a memory take what their pairs gave out of it."""
    A, B, Pairs = a(real), b(real), lists(real)

    def remember(data_a: A.Data, data_b: B.Data, pairs: Pairs, walk: wp.vec2i, out_a: A.Pushed, out_b: B.Pushed):
        s = pairs.first[walk[0]] + wp.tid()
        last = pairs.first[walk[0] + 1]
        while s < last:
            i = pairs.order[s]
            s += walk[1]
            p = pairs.push[i]
            q = pairs.total[i] - p
            A.remember(data_a, pairs.id_a[i], pairs.at_a[i], p, q, out_a)
            B.remember(data_b, pairs.id_b[i], pairs.at_b[i], -p, -q, out_b)

    return wp.kernel(remember, name=f"remember_{A.name}_{B.name}_{types(real).name}", module=module, enable_backward=False)
