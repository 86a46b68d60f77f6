"""What a carrier of contacts is: the formulas that an exchange of impulses (kernels/carrier/exchange.py) asks of each side.

A carrier is a function of the precision that returns a namespace with

    name                               of the kernels that are made with it
    Data, Pushed                       structs: what a launch reads of the carrier, what it may write of it
    slide(data, id, at)                motion of a feature over the whole substep [m], from which its mean velocity follows
    way(data, id, at)                  that and what rounding had left before: the feature ends the substep at place + way
    speed(data, id, at)                velocity with which it will end the substep [m/s]
    mass(data, id, at)                 W, its inverse mass [1/kg], (3, 3): n.W n along a direction n
    reach(data)                        its way changes by reach W p [s] with an impulse p [N s] that it takes in the substep
    take(data, id, at, p, out)         takes p: writes its unknowns
    recoil(data, id, at, q, out)       takes q [N s], which changes the velocity and not the place; after the last `take`
    remember(data, id, at, p, q, out)  of a carrier with a memory: what it has taken so, p by `take` and q by `recoil`, is put
                                       into its history
    vertex(data, id, at, k)            number of the k-th thing (< 4) that an impulse moves among those of all carriers, or -1

`id` (four integers) and `at` (three numbers) say which feature: of points their numbers and barycentric weights, of a body its
number and the arm [m].

An impulse p is N s. Every carrier turns it into the same change W p of its velocity, whatever integrates it, so that momentum
is kept between any two; the displacement follows from the integrator. x + d is solved at a part of the substep h, which is
`ahead` times as long; d changes by c W p, e is what it started from:

    integrator           g        c         ahead   memory      v at the end
    backward Euler       h        h         1       0           (d - a) / g
    explicit ones        h        h         1       0           v~ + ((d - a) - (d~ - e)) / h
    BDF2                 2h/3     2h/3      1       1           (d - a) / g, a = e + s/3
    implicit midpoint    h/2      h/4       2       0           2 (d - e) / g - v

memory: the multistep formula would make half as much again of W p in the steps after. So the step s and the velocity u before
are put where they would be had the point always moved with the W p that it has now: u += W p, s += h W p.
"""

from functools import cache

import warp as wp


@cache
def response(real):
    """Struct of how one integrator answers in one substep."""

    @wp.struct
    class Response:
        h: real              # substep [s]
        g: real              # effective step [s]
        c: real              # [s]
        ahead: real
        memory: int

    return Response
