"""A plane, z = 0 and all below, against a convex shape: the corners of the shape's lowest face, and its lowest place.

    n = -z (from the shape B to the plane A),  gap = z(p) - R,  x = p - (R + gap / 2) z
"""

from functools import cache

import warp as wp

from wsim.kernels.math.marks import scratch
from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists.manifold import manifold_makers, manifold_reduction_func, manifold_type
from wsim.kernels.rigid.narrow.face import support_face_func
from wsim.kernels.rigid.narrow.shape import hull_type, shape_extent_funcs, shape_type, support_map_func


@cache
def plane_manifold_func(kinds: frozenset[str], real, corners: int):
    """Function (b, hulls, R, p, margin) -> Manifold, b in the pose (R, p) in the plane's frame."""
    t, Shape, Hulls, Manifold = types(real), shape_type(real), hull_type(real), manifold_type(real)
    lowest, place, reduce = support_map_func(kinds, real), support_face_func(kinds, real), manifold_reduction_func(real)
    radius, extent_of = shape_extent_funcs(real)
    single, _flipped, _turned = manifold_makers(real)
    vec3 = t.vec3

    @wp.func(inline=False)
    def plane_contact_manifold(b: Shape, H: Hulls, R: t.mat33, p: t.vec3, margin: real):
        P = scratch(shape=(corners,), dtype=vec3)
        gap = scratch(shape=(corners,), dtype=real)
        key = scratch(shape=(corners,), dtype=int)
        d = -R[2]                                               # down, in the frame of b
        r = radius(b)
        up = t.vec3(real(0.0), real(0.0), real(1.0))
        low = R * lowest(b, H, d) + p
        m = Manifold()
        if low[2] - r <= margin:
            count, number, _n = place(b, H, d, P)
            kept = int(0)
            least = margin
            for c in range(count):
                q = R * P[c] + p
                if q[2] - r <= margin:
                    P[kept] = q - (real(0.5) * (q[2] + r)) * up
                    gap[kept] = q[2] - r
                    key[kept] = (number % 512) * 4096 + c * 64 + 63
                    least = wp.min(least, q[2] - r)
                    kept += 1
            m = reduce(-up, P, gap, key, kept, extent_of(b, H))
            if kept == 0 or least > low[2] - r + real(1.0e-3) * extent_of(b, H):
                m = single(-up, low - (real(0.5) * (low[2] + r)) * up, low[2] - r, 0)
        return m

    return plane_contact_manifold
