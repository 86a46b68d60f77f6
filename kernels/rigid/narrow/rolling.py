"""Speed at which the contact point of a rolling or spinning body moves over its shape.

A body turns at omega relative to the body that it touches. The outward normal n is fixed to the other body, so that n moves on
a circle about omega in the frame of the shape. In a time h there pass

    hull              h |omega| / 2 pi times the facets of one turn: the corners that are in turn the farthest along n, counted
                      at SAMPLES angles
    cylinder, cone    the turn [rad] of the contact point e of the rim about the axis z, in the world frame: 0 for a disc that
                      rolls straight on, the precession of a leaning coin

A substep is too long if most of a facet, or half a radian of precession, passes in it. A prism of 64 sides lost 10 % of its
speed in 2 s at 0.7 facets a substep, 2 % at 0.35 and 0.5 % at 0.2. A coin that precesses at W first loses (h W)^2 / 2 of its
kinetic energy, and falls flat from 0.8 rad a substep on.
"""

from functools import cache

import warp as wp

from wsim.kernels.contact.collider.shape import CONE, CYLINDER
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.shape import FLAT, HULL, hull_type, shape_type

SAMPLES = wp.constant(256)
SAME = wp.constant(1.0e-3)             # of a hull's size: corners nearer than this across the axis count as one


@cache
def rolling_passage_func(real, least: float):
    """Function (shape, hulls, q, o, n, h) -> facets or [rad] that pass in h [s]; 0 if they are certainly below `least`.

    q: from the shape's frame to the world; o: omega relative to the other body [rad/s]; n: unit normal out of the shape."""
    t, Shape, Hulls = types(real), shape_type(real), hull_type(real)

    @wp.func
    def facets_per_turn(row: int, H: Hulls, u: t.vec3, n: t.vec3):
        """Facets in a turn about the unit vector u."""
        along = wp.dot(n, u) * u
        x = n - along
        y = wp.cross(u, x)
        last = t.vec3()
        count = int(0)
        samples = int(SAMPLES)
        for k in range(samples + 1):
            angle = real(2.0) * real(wp.pi) * real(k % samples) / real(samples)
            d = along + wp.cos(angle) * x + wp.sin(angle) * y
            best = H.vertex[H.first[row]]
            for v in range(H.first[row] + 1, H.first[row + 1]):
                if wp.dot(d, H.vertex[v] - best) > real(0.0):
                    best = H.vertex[v]
            turning = best - wp.dot(best, u) * u
            if k > 0 and wp.length(turning - last) > real(SAME) * H.size[row]:
                count += 1
            last = turning
        return count

    @wp.func
    def of_hull(row: int, H: Hulls, o: t.vec3, n: t.vec3, h: real):
        turn = h * wp.length(o) / (real(2.0) * real(wp.pi))
        found = real(0.0)
        if turn * real(H.first[row + 1] - H.first[row]) > real(least):
            u = wp.normalize(o)
            if wp.length(wp.cross(n, u)) > real(FLAT):
                found = turn * real(facets_per_turn(row, H, u, n))
        return found

    @wp.func
    def rim_contact_turn(o: t.vec3, z: t.vec3, n: t.vec3, h: real):
        across = n - wp.dot(n, z) * z
        found = real(0.0)
        if wp.length(across) > real(FLAT):
            y = wp.normalize(z + h * wp.cross(o, z))
            later = n - wp.dot(n, y) * y
            found = wp.atan2(wp.length(wp.cross(across, later)), wp.dot(across, later))
        return found

    @wp.func(inline=False)
    def rolling_passage(s: Shape, H: Hulls, q: t.quat, o: t.vec3, n: t.vec3, h: real):
        found = real(0.0)
        if s.kind == HULL:
            found = of_hull(s.row, H, wp.quat_rotate_inv(q, o), wp.quat_rotate_inv(q, n), h)
        elif (s.kind == CYLINDER or s.kind == CONE) and h * wp.length(o) > real(0.0):
            found = rim_contact_turn(o, wp.quat_rotate(q, t.vec3(real(0.0), real(0.0), real(1.0))), n, h)
        return found

    return rolling_passage
