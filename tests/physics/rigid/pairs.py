"""Pairs of shapes put through the narrow phase, all of them in one launch; float64 references by NumPy."""

from functools import cache

import numpy as np
import warp as wp

from tests.make.suite.every_shape import ALL
from wsim.kernels.math.real import types
from wsim.kernels.rigid.lists.manifold import manifold_type
from wsim.kernels.rigid.narrow.pair import narrow_phase_func, pairs_of_kinds
from wsim.kernels.rigid.narrow.shape import KINDS, hull_type, shape_type

PRECISIONS = [wp.float32, wp.float64]
WHERE = {"device": "cpu"}               # tests/gpu/test_rigid_narrow.py has the same tests on a GPU


@cache
def kernel(pairs, real):
    t = types(real)
    Shape, Hulls, Manifold, made = shape_type(real), hull_type(real), manifold_type(real), narrow_phase_func(pairs, real)

    @wp.kernel(module="unique", enable_backward=False)
    def touch(a: wp.array(dtype=Shape), b: wp.array(dtype=Shape), H: Hulls, pose_a: wp.array(dtype=t.transform),
              pose_b: wp.array(dtype=t.transform), margin: wp.array(dtype=real), out: wp.array(dtype=Manifold)):
        i = wp.tid()
        out[i] = made(a[i], b[i], H, pose_a[i], pose_b[i], margin[i])

    return touch


def shapes(rows, real):
    """Array of Shape of rows (kind, size) or (kind, size, row)."""
    Shape = shape_type(real)
    found = np.zeros(len(rows), Shape.numpy_dtype())
    for k, (kind, size, *row) in enumerate(rows):
        found[k]["kind"] = KINDS[kind]
        if kind == "triangle":
            found[k]["corners"] = size
        else:
            found[k]["size"][:len(np.atleast_1d(size))] = size
        found[k]["row"] = row[0] if row else 0
    return wp.array(found, dtype=Shape, **WHERE)


def touch(a, pose_a, b, pose_b, margin=1e30, real=wp.float64, H=None, pairs=None):
    """Manifolds as a structured array: fields n, count, x, gap, key. Poses: (..., 7), translation and (x, y, z, w)."""
    t = types(real)
    pairs = ALL if WHERE["device"] == "cpu" else pairs or pairs_of_kinds({row[0] for row in (*a, *b)})  # a kernel for all tests
    out = wp.zeros(len(a), dtype=manifold_type(real), **WHERE)
    margin = np.broadcast_to(np.asarray(margin, float), len(a))
    poses = [wp.array(np.ascontiguousarray(np.broadcast_to(p, (len(a), 7))), dtype=t.transform, **WHERE)
             for p in (pose_a, pose_b)]
    wp.launch(kernel(pairs, real), len(a), [shapes(a, real), shapes(b, real), H or hull_type(real)(), *poses,
                                            wp.array(margin, dtype=real, **WHERE)], [out], **WHERE)
    return out.numpy()


def turns(rng, n):
    q = rng.normal(size=(n, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def poses(rng, n, far=1.0):
    """Random poses whose places lie within `far` [m] of 0."""
    return np.hstack([rng.uniform(-far, far, (n, 3)), turns(rng, n)])


def matrix(q):
    x, y, z, w = np.moveaxis(np.asarray(q, float), -1, 0)
    return np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w),
                     1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 2 * (x * z - y * w), 2 * (y * z + x * w),
                     1 - 2 * (x * x + y * y)], -1).reshape(*np.shape(q)[:-1], 3, 3)
