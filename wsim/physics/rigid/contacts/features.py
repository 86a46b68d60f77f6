"""What of a triangle mesh can touch another one: edges and corners that stand out, planes, and how deep a contact is sought.
Tables for kernels/rigid/narrow/mesh_pair.py. NumPy only.

    sharp     an edge whose other face lies below the plane of its own by more than the sine FLAT, or a rim; of a sheet also one
              whose face lies above. Of both faces the first has it
    corner    a point with a sharp edge; the first of its faces has it
    patch     faces that hang together by flat edges
    reach     DEEP of the thickness; this is what a quarter of the rays inward from the middles of faces pass at most, of RAYS
"""

import numpy as np

from wsim.geometry.topology import labels_of_islands

FLAT = 1e-4               # sine: of coordinates in float32 on a plane of 100 faces across
DEEP = 0.25               # more would take the far side of a wall for the near one
RAYS = 128
SHEET = 0.02              # of the size: reach of a mesh that encloses nothing


def edge_bends(points: np.ndarray, faces: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Of each edge k of triangles (m, 3): sine by which the face across lies below (> 0) the plane of its own; 0: a rim."""
    X = points[faces]
    n = np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0])
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300)
    e = np.roll(X, -1, axis=1) - X
    e /= np.maximum(np.linalg.norm(e, axis=2, keepdims=True), 1e-300)
    g = n[beside]                                                        # of a rim any
    return np.where(beside < 0, 0.0, np.einsum("mki,mki->mk", np.cross(n[:, None], g), e))


def contact_features(points: np.ndarray, faces: np.ndarray, beside: np.ndarray) -> dict[str, np.ndarray]:
    """corner (m, 3), sharp (m, 3), patch (m,) of welded triangles (m, 3); beside: the face across each edge, -1 at a rim."""
    m, bend, rim = len(faces), edge_bends(points, faces, beside), beside < 0
    own = rim | (np.arange(m)[:, None] < beside)
    stands = bend > FLAT if not rim.any() else np.abs(bend) > FLAT
    edge = rim | stands
    used = np.zeros(len(points), bool)
    used[faces[edge]] = True
    used[np.roll(faces, -1, axis=1)[edge]] = True
    first = np.zeros((m, 3), bool)
    _, at = np.unique(faces.ravel(), return_index=True)
    first.reshape(-1)[at] = True
    one, k = np.nonzero(~rim & (np.abs(bend) <= FLAT))
    patch = labels_of_islands(m, np.stack([one, beside[one, k]], axis=1))
    return {"corner": (first & used[faces]).astype(np.int32), "sharp": (own & edge).astype(np.int32),
            "patch": np.asarray(patch, np.int64)}


def contact_reach(points: np.ndarray, faces: np.ndarray, closed: bool) -> float:
    """Depth [m] up to which a contact with the mesh is sought."""
    if not closed:
        return SHEET * float(np.linalg.norm(np.ptp(points[faces.ravel()], axis=0)))
    X = points[faces]
    n = np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0])
    area = np.linalg.norm(n, axis=1)
    rank = (np.arange(RAYS) + 0.5) / RAYS * area.sum()                   # faces by their area
    some = np.unique(np.minimum(np.searchsorted(np.cumsum(area), rank), len(faces) - 1))
    depth = [_ray_depth(X, X[f].mean(axis=0), -n[f] / max(area[f], 1e-300), f) for f in some]
    return DEEP * float(np.quantile(depth, 0.25))


def _ray_depth(X: np.ndarray, o: np.ndarray, d: np.ndarray, own: int) -> float:
    """Way [m] of a ray to the first of triangles X (m, 3, 3) but its own (Moeller, Trumbore 1997); the size if none."""
    a, e, f = X[:, 0], X[:, 1] - X[:, 0], X[:, 2] - X[:, 0]
    p = np.cross(d, f)
    det = (e * p).sum(axis=1)
    safe = np.where(np.abs(det) > 0.0, det, 1.0)
    u = ((o - a) * p).sum(axis=1) / safe
    q = np.cross(o - a, e)
    v, way = q @ d / safe, (f * q).sum(axis=1) / safe
    hit = (np.abs(det) > 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (way > 0.0)
    hit[own] = False
    return float(way[hit].min()) if hit.any() else float(np.linalg.norm(np.ptp(X.reshape(-1, 3), axis=0)))
