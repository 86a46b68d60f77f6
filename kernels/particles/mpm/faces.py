"""Faces of colliders that hold a node. The nearest face to a node within a solid need not be one that matter touches: below a
floor, outside of a wall that stands on it; within a box, near an edge of it. So a solid is asked from where the matter is:

    s = sum_c n_c r_c / sum_c n_c              n_c particles of the 27 cells about the node, r_c cells from the node to them
    q = y + OUTSIDE s dx                       a place in the matter, or beyond it
    (phi, n, p) closest to q;  the node is held where phi > 0 and (y - p) . n <= the depth that counts as within

A floor of two boxes has no edge at its seam: where p lies on another solid, the face of that counts. A node that no solid
holds by itself is held by none. Where q is within the solid too, the face nearest to the node counts.
"""

# ruff: noqa: UP018

from functools import cache
from types import SimpleNamespace

import warp as wp

from wsim.kernels.contact.collider.colliders import collider_type
from wsim.kernels.contact.collider.table import collider_queries
from wsim.kernels.contact.mesh import SHEET
from wsim.kernels.math.real import types
from wsim.kernels.particles.mpm.tables import CELLS, point_tables

HALF = wp.constant(0.5)            # cells: depth of an open mesh, which has no inside
OUTSIDE = wp.constant(1.5)         # as far as splines reach
SEAM = wp.constant(0.01)           # cells: solids so near to each other touch
BEYOND = wp.constant(2.5)             # cells: solids that are further from a node hold it by no face


@cache
def face_functions(kinds: tuple[str, ...], real) -> SimpleNamespace:
    """matter_side(grid, block, cell) -> s [cells]; holding_face(colliders, k, y, s, time, dx, depth [cells]) -> (whether k
    holds the node, n, p)."""
    t, T, Colliders = types(real), point_tables(real), collider_type(real)
    ask = collider_queries(kinds or ("sphere",), real)

    @wp.func(inline=False)
    def matter_side(g: T.BlockGrid, b: int, c: int):
        sum = wp.vec3i(0, 0, 0)
        count = int(0)
        cells = int(27)
        for n in range(cells):
            i = c // 16 + n // 9 - 1
            j = (c // 4) % 4 + (n // 3) % 3 - 1
            k = c % 4 + n % 3 - 1
            other = g.near[27 * b + (9 * ((i >> 2) + 1) + 3 * ((j >> 2) + 1) + (k >> 2) + 1)]
            if other >= 0:
                m = g.count[other * CELLS + (16 * (i & 3) + 4 * (j & 3) + (k & 3))]
                sum += m * wp.vec3i(n // 9 - 1, (n // 3) % 3 - 1, n % 3 - 1)
                count += m
        found = t.vec3()
        if count > 0:
            found = t.vec3(real(sum[0]), real(sum[1]), real(sum[2])) / real(count)
        return found

    @wp.func
    def pass_seam(c: Colliders, k: int, a: t.vec3, n: t.vec3, p: t.vec3, time: real, dx: real):
        """(n, p) of the face that a place a in the matter has before it: of another solid where p lies on that."""
        normal = n
        place = p
        for other in range(c.kind.shape[0]):
            if other != k and c.kind[other] != SHEET:
                if ask.signed(c, other, p, time) <= real(SEAM) * dx:
                    far, m, q = ask.closest(c, other, a, time)
                    if far > real(0.0):
                        normal = m
                        place = q
        return normal, place

    @wp.func
    def holding_face(c: Colliders, k: int, y: t.vec3, side: t.vec3, time: real, dx: real, depth: real):
        phi, n, p = ask.closest(c, k, y, time)
        within = depth
        if c.kind[k] == SHEET:
            within = real(HALF)
        holds = phi <= within * dx
        if c.kind[k] != SHEET and phi < real(BEYOND) * dx:
            a = y + (real(OUTSIDE) * dx) * side
            far, m, q = ask.closest(c, k, a, time)
            if far > real(0.0):
                m, q = pass_seam(c, k, a, m, q, time, dx)
                n = m
                p = q
                holds = wp.dot(y - p, n) <= within * dx
        return holds, n, p

    return SimpleNamespace(matter_side=matter_side, holding_face=holding_face, pass_seam=pass_seam)
