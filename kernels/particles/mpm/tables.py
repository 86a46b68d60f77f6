"""Structs of the material point method: particles, their materials, and the sparse grid of blocks.

A place is the nearest node of the grid, three whole numbers, and an offset from it in cells: particles may go anywhere, and
the same happens far from the origin. Strain is the left Cauchy-Green tensor less 1, B = F F^T - 1. Isotropic laws need no more
of F, a turn leaves the size of its entries alone, and small strains keep their digits in float32.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.math.real import types

SIDE = wp.constant(4)              # cells along an edge of a block
CELLS = wp.constant(64)            # cells of a block
LAYER = wp.constant(16)            # cells of a layer of it
NUMBERS = 8                        # of a material, see laws.py


@cache
def point_tables(real) -> SimpleNamespace:
    """Structs PointRows (one row a particle), MaterialRows (one row an object of a world), BlockGrid, and SortedRows."""
    t = types(real)
    vec8 = wp.types.vector(NUMBERS, real)

    @wp.struct
    class PointRows:
        i: wp.array(dtype=int)             # nearest node along x
        j: wp.array(dtype=int)
        k: wp.array(dtype=int)
        o: wp.array(dtype=t.vec3)          # offset from the nearest node [cells], each entry within half a cell
        e: wp.array(dtype=t.vec3)          # rounding remainder of o [cells]
        v: wp.array(dtype=t.vec3)          # [m/s]
        C: wp.array(dtype=t.mat33)         # rows: gradient of each component of v [1/s]
        b: wp.array(dtype=t.vec3)          # xx, yy, zz of B [1]
        s: wp.array(dtype=t.vec3)          # yz, zx, xy of B [1]
        T: wp.array(dtype=t.vec3)          # xx, yy, zz of the Kirchhoff stress [Pa]
        S: wp.array(dtype=t.vec3)          # yz, zx, xy of it [Pa]
        q: wp.array(dtype=real)            # inner variable of the law [1], see laws.py
        a: wp.array(dtype=real)            # stiffness of the fastest wave, density c^2 [Pa]
        volume: wp.array(dtype=real)       # at rest [m^3]
        row: wp.array(dtype=int)           # of its material
        there: wp.array(dtype=int)         # where particles come and go: see actions/flow.py; else empty

    @wp.struct
    class MaterialRows:
        law: wp.array(dtype=int)           # number of its law in laws.LAWS
        world: wp.array(dtype=int)
        density: wp.array(dtype=real)      # at rest [kg/m^3]
        numbers: wp.array(dtype=vec8)      # of the law
        gravity: wp.array(dtype=t.vec3)    # of each world [m/s^2]

    @wp.struct
    class BlockGrid:
        slot: wp.array(dtype=wp.int64)     # hash table: key of a block, or EMPTY; a power of two of slots
        number: wp.array(dtype=int)        # number of the block in that slot
        key: wp.array(dtype=wp.int64)      # of each block; as many as there is room for
        near: wp.array(dtype=int)          # numbers of a block's 27 neighbours, z fastest, -1: there is none
        used: wp.array(dtype=int)          # blocks that are used, rows of `order` that are used
        count: wp.array(dtype=int)         # particles of each cell
        first: wp.array(dtype=int)         # first of them in `order`
        order: wp.array(dtype=int)         # particles by cell
        block: wp.array(dtype=int)         # of each particle: its block
        rank: wp.array(dtype=int)          # of each particle: which of its cell's it is
        bits: int                          # of a key for each axis
        dx: real                           # edge of a cell [m]

    @wp.struct
    class SortedRows:
        m: wp.array(dtype=t.vec4)          # offset [cells] and mass [kg]
        x: wp.array(dtype=t.vec4)          # momentum along x and its gradient [kg m/s], a cell each; y and z alike
        y: wp.array(dtype=t.vec4)
        z: wp.array(dtype=t.vec4)

    return SimpleNamespace(PointRows=PointRows, MaterialRows=MaterialRows, BlockGrid=BlockGrid, SortedRows=SortedRows,
                           vec8=vec8)
