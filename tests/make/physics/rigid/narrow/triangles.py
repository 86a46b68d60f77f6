"""What tests/physics/rigid/narrow/test_triangles.py shares with other tests: KINDS, cube, floor, kernel."""

from functools import cache

import numpy as np
import warp as wp

from tests.physics.rigid.narrow.reference import SIGNS
from wsim.geometry.convex_hull import convex_hull
from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists.manifold import manifold_type
from wsim.kernels.rigid.narrow import mesh
from wsim.kernels.rigid.narrow.shape import hull_type, shape_type
from wsim.kernels.rigid.narrow.triangle import triangle_func

KINDS = frozenset(("sphere", "capsule", "box", "hull"))


@cache
def kernel(real):
    t, Shape, Hulls, Manifold, Surfaces = (types(real), shape_type(real), hull_type(real), manifold_type(real),
                                           mesh.mesh_type(real))
    made, seen = triangle_func(KINDS, real), mesh.relative_pose_func(real)

    @wp.kernel(module="unique", enable_backward=False)
    def touch(a: wp.array(dtype=Shape), H: Hulls, S: Surfaces, pose: wp.array(dtype=t.transform), still: t.transform,
              where: wp.array(dtype=wp.vec2i), margin: real, out: wp.array(dtype=Manifold)):
        i = wp.tid()
        of = where[i]
        R, c = seen(pose[of[0]], still)
        out[i] = made(a[of[0]], H, S, wp.vec2i(0, of[1]), R, c, margin)

    return touch


def floor(n=6, seed=0):
    """A square of 2 m in z = 0 in 2 n^2 triangles, its inner points moved and its diagonals laid at random."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1), indexing="ij")
    points = np.stack([x, y, 0 * x], -1)
    points[1:-1, 1:-1, :2] += rng.uniform(-0.3, 0.3, (n - 1, n - 1, 2)) / n
    faces = []
    for i in range(n):
        for j in range(n):
            a, b, c, d = (i * (n + 1) + j, (i + 1) * (n + 1) + j, (i + 1) * (n + 1) + j + 1, i * (n + 1) + j + 1)
            faces += [(a, b, c), (a, c, d)] if rng.random() < 0.5 else [(a, b, d), (b, c, d)]
    return points.reshape(-1, 3), np.array(faces)


def cube():
    """Of half edge 1, closed."""
    hull = convex_hull(SIGNS)
    return hull.vertices, hull.triangles
