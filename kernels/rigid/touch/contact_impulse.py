"""The impulse of one contact of a body with a point, as a function of the velocity that the body gives the place: a row of the
solve in kernels/rigid/touch/body_point_solve.py, which has the equations. Balls that turn:
kernels/position_based/rolling/bodies.py.
"""

from functools import cache

import warp as wp

from wsim.kernels.math.real import types

real, vec3, mat33 = wp.float64, wp.vec3d, wp.mat33d


@cache
def star_structs(of):
    """(Rows, Hubs): contacts in the order of their bodies, those of body k in first[k] .. first[k + 1]; bodies."""
    t = types(of)

    @wp.struct
    class StarRows:
        first: wp.array(dtype=int)                # (bodies + 1,)
        slot: wp.array(dtype=int)                 # of each contact, (room,)
        n: wp.array(dtype=t.vec3)
        r: wp.array(dtype=t.vec3)                 # arm [m]
        base: wp.array(dtype=of)
        least: wp.array(dtype=of)
        slip: wp.array(dtype=t.vec3)
        mu: wp.array(dtype=of)
        f: wp.array(dtype=of)
        ball: wp.array(dtype=t.vec3)              # of balls that turn (kernels/position_based/rolling/bodies.py), else none:
        psi: wp.array(dtype=t.vec3)               # a, 0 of others; mu_r; radius [m]; their turn [m]

    @wp.struct
    class StarHubs:
        """Of bodies; w [1/kg] and turn, inverse (principal, 1/[kg m^2]) as kernels/rigid/motion.py has them."""
        w: wp.array(dtype=of)
        inverse: wp.array(dtype=t.vec3)
        turn: wp.array(dtype=t.mat33)
        q: wp.array(dtype=vec3)                   # momentum, (bodies,), then angular momentum, (2 bodies,)

    return StarRows, StarHubs


@cache
def star_impulse_func(of):
    """Function: P of contact s and its derivative by U, where the body gives the place U. rub: part of its friction."""
    Rows, _ = star_structs(of)

    @wp.func
    def star_impulse_and_slope(rows: Rows, s: int, k: real, g: real, rub: real, U: vec3):
        n = vec3(rows.n[s])
        lam = real(rows.base[s]) + k * wp.dot(n, U)
        least = real(rows.least[s])
        slope = mat33()
        mu = real(0.0)
        if lam > least:
            slope = k * wp.outer(n, n)
            mu = rub * real(rows.mu[s])
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

    return star_impulse_and_slope


@wp.struct
class StarSums:
    """Over contacts: impulse and its moment, size, and the derivatives of both by velocity (A, C) and spin (B, D)."""
    J: vec3
    T: vec3
    A: mat33
    B: mat33
    C: mat33
    D: mat33
    size: real
