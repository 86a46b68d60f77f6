"""Half of the least width of a collider: what is wider than points of a strand are apart cannot pass between. NumPy only.

    convex shapes   radius of the largest ball inside (of a sphere, box, capsule or cylinder half its least width)
    meshes          min over pairs of corners p, q with opposite normals, n_p . n_q < OPPOSITE, of |d|^2 / (2 |n_p . d|),
                    d = q - p towards the inside: the ball that touches the surface at p and passes through q (Ma, Bae, Choi
                    2012, 3D medial axis point approximation using nearest neighbors and the normal field)

A mesh is known by its corners: where these are far apart what is found is too much. Pairs are those of evenly chosen corners,
PAIRS at most.
"""

from math import inf, isinf

import numpy as np

from wsim.geometry.triangulate import triangulate
from wsim.scene import Collider, Surface
from wsim.scene.solids import row

OPPOSITE = -0.5        # cosine: faces that meet in a ridge of more than 60 degrees bound nothing thin
SLIVER = 0.01          # of the mean area, below which a triangle's normal may be any
PAIRS = 2 ** 21
ROWS = 64              # corners at once
MANY = 2 ** 13         # corners that others are paired with
ALONG = 65             # places along the axis of a solid where its largest ball is sought


def half_width(collider: Collider, reach: float = inf) -> float:
    """Half of the least width [m]; inf of a plane, and where a mesh has no two faces that are opposite. Corners of a mesh that
    are farther than `reach` [m] from each other are left out: what is found below half of that is right."""
    shape = collider.shape
    if isinstance(shape, Surface):
        return _mesh(shape, reach)
    solid = row(shape)
    size = solid.ball(shape)
    if isinf(size):
        return inf
    z = np.linspace(-size, size, ALONG)
    return float(-solid.distance(shape, np.stack([0.0 * z, 0.0 * z, z], axis=1)).min())


def _mesh(shape: Surface, reach: float) -> float:
    points = (shape.points if shape.poses is None else shape.poses.at(0.0)).astype(np.float64)
    triangles, _ = triangulate(shape.points, shape.counts, shape.indices)
    p = points[triangles]
    cross = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    size = np.linalg.norm(cross, axis=1)
    whole = size > SLIVER * size.mean() if len(p) else size > 0.0
    if not whole.any():
        return inf
    p, n, size = p[whole] - points.mean(axis=0), cross[whole] / size[whole, None], size[whole]
    if (p.mean(axis=1) * n * size[:, None]).sum() < 0.0:      # wound inward
        n = -n
    x, n = p.reshape(-1, 3), np.repeat(n, 3, axis=0)
    axis = int(np.argmax(np.ptp(x, axis=0)))
    order = np.argsort(x[:, axis], kind="stable")
    q, m = _some(x[order], n[order], MANY)
    x, n = _some(x[order], n[order], max(PAIRS // len(q), 1))
    near = 1e-6 * float(np.ptp(points, axis=0).max())
    found = inf
    for a in range(0, len(x), ROWS):
        y, k = x[a:a + ROWS], n[a:a + ROWS]
        first, last = np.searchsorted(q[:, axis], (y[0, axis] - reach, y[-1, axis] + reach))
        z = q[first:last]
        inward = (k * y).sum(axis=1)[:, None] - k @ z.T
        thin = (k @ m[first:last].T < OPPOSITE) & (inward > near)
        far = (y**2).sum(axis=1)[:, None] + (z**2).sum(axis=1) - 2.0 * y @ z.T
        found = min(found, float(np.min(far / np.where(thin, 2.0 * inward, 1.0), initial=inf, where=thin)))
    return found


def _some(x: np.ndarray, n: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """At most so many corners, evenly chosen."""
    step = -(-len(x) // most)
    return x[::step], n[::step]
