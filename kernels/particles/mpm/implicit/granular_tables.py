"""Structs of implicit steps of sand: cells with one stress each, and corners of cells with one velocity each.

The cell (i, j, k) is the cube about node (i, j, k) of the explicit grid, so that particles are sorted in the same way. Its
corner (0, 0, 0) has the same number (i, j, k), half a cell below the node along each axis. Corners of a cell have the numbers
4 x + 2 y + z.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.tables import CELLS, point_tables

CONTACTS = 4                       # colliders that hold one corner, at most: the nearest


@cache
def granular_tables(real) -> SimpleNamespace:
    """Structs SandCells (a row a cell), SandCorners (a row a corner), CornerContacts; corner_rows(grid, block, cell) -> rows of
    a cell's corners; corner_sign(n, axis) -> 1 or -1."""
    t, T = types(real), point_tables(real)
    vec8i = wp.types.vector(8, int)

    @wp.struct
    class SandCells:
        rule: wp.array(dtype=t.vec4)       # volume [m^3], opening [1], slope of the cone [1], its width without pressure [Pa]
        S: wp.array(dtype=t.vec3)          # xx, yy, zz of minus the stress [Pa]: pressure counts as positive
        R: wp.array(dtype=t.vec3)          # yz, zx, xy of it [Pa]
        G: wp.array2d(dtype=t.vec4)        # hourglass stress of component i: yz, zx, xy, xyz [Pa], see granular_sweeps.py
        S_last: wp.array(dtype=t.vec3)     # of the sweep before [Pa]
        R_last: wp.array(dtype=t.vec3)
        G_last: wp.array2d(dtype=t.vec4)
        sum: wp.array2d(dtype=t.vec4)      # what a cell's particles give to its corner n: momentum [kg m/s], mass [kg]

    @wp.struct
    class SandCorners:
        v: wp.array(dtype=t.vec4)          # velocity [m/s], 1 / mass [1/kg], negative where a collider may hold it
        last: wp.array(dtype=t.vec3)       # velocity without colliders, of the sweep before [m/s]
        held: wp.array(dtype=t.vec3)       # change of velocity by colliders [m/s]
        free: wp.array(dtype=t.vec3)       # 1 / mass that colliders leave it along each axis [1/kg]
        count: wp.array(dtype=int)         # colliders that may hold it; -1: none is near

    @wp.struct
    class CornerContacts:
        n: wp.array2d(dtype=t.vec4)        # normal, static friction; a row a contact, a column a corner
        u: wp.array2d(dtype=t.vec4)        # velocity of the collider [m/s], dynamic friction
        gap: wp.array2d(dtype=real)        # distance that the corner may still go [m]

    @wp.func
    def corner_rows(g: T.BlockGrid, b: int, c: int):
        found = vec8i()
        for n in range(8):
            i = c // 16 + n // 4
            j = (c // 4) % 4 + (n // 2) % 2
            k = c % 4 + n % 2
            other = g.near[27 * b + (9 * ((i >> 2) + 1) + 3 * ((j >> 2) + 1) + (k >> 2) + 1)]
            found[n] = other * CELLS + (16 * (i & 3) + 4 * (j & 3) + (k & 3))
        return found

    return SimpleNamespace(SandCells=SandCells, SandCorners=SandCorners, CornerContacts=CornerContacts, corner_rows=corner_rows)
