"""Tables of convex hulls on a device, as the narrow phase reads them (kernels/rigid/narrow/shape.py)."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from wsim.geometry.convex_hull import ConvexHull
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.shape import CORNERS, hulls


def thinned(X: np.ndarray, loop: np.ndarray, most: int = CORNERS) -> np.ndarray:
    """A loop of at most `most` corners: those that take away the least area go first."""
    loop = np.asarray(loop)
    while len(loop) > most:
        a, b, c = X[np.roll(loop, 1)], X[loop], X[np.roll(loop, -1)]
        loop = np.delete(loop, np.linalg.norm(np.cross(b - a, c - a), axis=1).argmin())
    return loop


def tables(shapes: Sequence[ConvexHull], real, device):
    """Struct of the tables of these hulls, in the frame in which their vertices are; row k is the k-th."""
    t, found = types(real), hulls(real)()
    loops = [[thinned(h.vertices, loop) for loop in h.loops] for h in shapes]

    def starts(counts) -> wp.array:
        return wp.array(np.concatenate([[0], np.cumsum(list(counts))]).astype(np.int32), dtype=int, device=device)

    def stacked(parts, dtype, width: int = 0) -> wp.array:
        shape = (0, width) if width else (0,)
        return wp.array(np.concatenate([np.zeros(shape), *parts]), dtype=dtype, device=device)
    found.first = starts(len(h.vertices) for h in shapes)
    found.vertex = stacked([h.vertices for h in shapes], t.vec3, 3)
    found.first_face = starts(len(of) for of in loops)
    found.normal = stacked([h.normals for h in shapes], t.vec3, 3)
    found.offset = stacked([h.offsets for h in shapes], real)
    found.first_corner = starts(len(loop) for of in loops for loop in of)
    found.corner = stacked([loop for of in loops for loop in of], int)
    found.size = stacked([[np.linalg.norm(h.vertices, axis=1).max()] for h in shapes], real)
    return found
