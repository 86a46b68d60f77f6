"""Structs of what material points push: rigid bodies, and the points of meshes (cloth, soft bodies).

Impulses of a step are sums over nodes and particles in whatever order threads have. They are whole numbers of a small unit, so
that each order gives the same bits, and what one gains the other loses:

    unit of mass  2^-46 (mass of all);    of momentum  that times dx / h;    of angular momentum  that times a body's reach

No particle crosses a cell in a step of h, so that a sum stays far below 2^62.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.math.real import types

FINE = wp.constant(wp.float64(2.0**-46))   # parts of a unit
SUMS = wp.constant(48)                     # numbers of a body: 36 and 6 of its response, 6 of its impulse
GIVEN = wp.constant(42)                    # the first of its impulse


@cache
def push_tables(real) -> SimpleNamespace:
    """Structs Pushed (what rows of the collider table push), Walls (that and the table), PushedBodies."""
    t, Colliders = types(real), collider_type(real)

    @wp.struct
    class Pushed:
        world: wp.array(dtype=int)             # of each row of the table; -1: in all
        first: wp.array(dtype=int)             # of each row: its body, or its mesh's first point of all meshes; -1: not pushed
        center: wp.array(dtype=t.vec3)         # of each body [m]
        reach: wp.array(dtype=real)            # length of a body's arms [m]
        sums: wp.array2d(dtype=wp.int64)       # (shares, SUMS bodies)
        turning: wp.array2d(dtype=wp.int64)    # (rows, 13): see balance.py
        point: wp.array(dtype=wp.int64)        # impulse of each point of meshes, three numbers behind each other
        mass: real                             # of all of a world [kg]
        dx: real                               # edge of a cell [m]
        dt: real                               # of a frame [s]: h of units of points

    @wp.struct
    class Walls:
        table: Colliders
        pushed: Pushed

    @wp.struct
    class PushedBodies:
        row: wp.array(dtype=int)               # of the bodies of the state, (bodies,)
        base: wp.array(dtype=t.vec3)           # place that their x counts from [m]
        start: wp.array(dtype=t.vec3)          # centre where the frame begins [m]
        before_p: wp.array(dtype=t.vec3)       # momenta then
        before_L: wp.array(dtype=t.vec3)
        turn: wp.array(dtype=t.quat)           # of the principal axes (x, y, z, w)
        p: wp.array(dtype=t.vec3)              # momentum [kg m/s]
        L: wp.array(dtype=t.vec3)              # angular momentum about the centre [kg m^2/s]
        v: wp.array(dtype=t.vec3)              # [m/s], as the table has it
        spin: wp.array(dtype=t.vec3)           # [rad/s]
        given_p: wp.array(dtype=wp.vec3d)      # impulses of particles since the frame began
        given_L: wp.array(dtype=wp.vec3d)      # about `start`
        held: wp.array(dtype=t.vec3)           # direction in which others hold it against a push, times the root of the part
        turned: wp.array(dtype=t.vec3)         # alike, of torques
        place: wp.array(dtype=t.vec3)          # of each row of the table, in the body's principal axes [m]
        axes: wp.array(dtype=t.quat)

    return SimpleNamespace(Pushed=Pushed, Walls=Walls, PushedBodies=PushedBodies)
