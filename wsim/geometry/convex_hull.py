"""Convex hull of points (quickhull; Barber, Dobkin, Huhdanpaa 1996), with faces merged where they lie in one plane. NumPy only.

The farthest point of all is added next, so that a hull of few vertices is a good one: `error` says how far the farthest that
is left out lies beyond. Every tolerance is a part of the size, the diagonal of the points' bounds: what lies within NEAR of a
face makes no vertex; triangles whose corners lie within FLAT of the plane of a larger neighbour are part of its face. Points
on a plane, on a line or in one place have no hull with an inside and raise DegenerateHull, which says which.
"""

from dataclasses import dataclass

import numpy as np

NEAR = 1e-7               # coordinates of a stage are float32: 6e-8 of the size
FLAT = 2e-6


class DegenerateHull(ValueError):
    """Points without a volume; dimension: 0 in one place, 1 on a line, 2 on a plane."""

    def __init__(self, dimension: int, message: str):
        super().__init__(message)
        self.dimension = dimension


@dataclass(frozen=True)
class ConvexHull:
    """A convex polyhedron: normals @ x <= offsets."""

    vertices: np.ndarray              # (n, 3) [m]
    loops: tuple[np.ndarray, ...]     # vertices around each face, counterclockwise as seen from outside
    normals: np.ndarray               # (faces, 3), unit, outward
    offsets: np.ndarray               # (faces,) [m]
    triangles: np.ndarray             # (m, 3) vertices of the same surface
    error: float                      # farthest point that is left out, beyond the hull [m]

    @property
    def volume(self) -> float:
        """[m^3]"""
        a, b, c = np.moveaxis(self.vertices[self.triangles] - self.vertices[0], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def initial_simplex(points: np.ndarray, size: float) -> np.ndarray:
    """Four points that span a volume, ordered so that 0 1 2 faces away from 3. Raises DegenerateHull."""
    first = int(np.argmin(points @ np.array([1.0, 1e-3, 1e-6])))
    d = points - points[first]
    second = int(np.argmax((d * d).sum(1)))
    if not size > 0.0 or np.linalg.norm(d[second]) <= 1e-30:
        raise DegenerateHull(0, "all points are in one place")
    axis = d[second] / np.linalg.norm(d[second])
    across = np.linalg.norm(d - np.outer(d @ axis, axis), axis=1)
    third = int(np.argmax(across))
    if across[third] <= 1e-6 * size:
        raise DegenerateHull(1, "all points lie on a line")
    n = np.cross(axis, d[third])
    n /= np.linalg.norm(n)
    height = d @ n
    fourth = int(np.argmax(np.abs(height)))
    if abs(height[fourth]) <= 1e-6 * size:
        raise DegenerateHull(2, "all points lie on a plane")
    return np.array([first, third, second, fourth] if height[fourth] > 0 else [first, second, third, fourth])


class GrowingHull:
    """Triangles of a growing hull, and for each the points that lie beyond it."""

    def __init__(self, points: np.ndarray, start: np.ndarray, near: float):
        self.points, self.near = points, near
        self.triangle: list[tuple[int, int, int]] = []
        self.plane: np.ndarray = np.zeros((0, 4))
        self.beyond: list[np.ndarray] = []
        self.farthest: np.ndarray = np.zeros(0)
        a, b, c, d = (int(k) for k in start)
        self.add([(a, b, c), (a, d, b), (b, d, c), (c, d, a)], np.setdiff1d(np.arange(len(points)), start))

    def add(self, triangles: list, points: np.ndarray) -> None:
        """New triangles; each of `points` belongs to the one that it is farthest beyond, or to none."""
        X = self.points[np.array(triangles)]
        n = np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0])
        long = np.linalg.norm(n, axis=1, keepdims=True)
        n = np.divide(n, long, out=np.zeros_like(n), where=long > 0.0)
        plane = np.column_stack([n, (n * X.mean(1)).sum(1)])
        height = self.points[points] @ n.T - plane[:, 3]
        owner = height.argmax(1) if len(points) else np.zeros(0, int)
        far = height[np.arange(len(points)), owner]
        lists = [points[(owner == k) & (far > self.near)] for k in range(len(triangles))]
        self.triangle += triangles
        self.plane = np.concatenate([self.plane, plane])
        self.beyond += lists
        most = [height[(owner == k), k].max(initial=0.0) if len(lists[k]) else 0.0 for k in range(len(triangles))]
        self.farthest = np.concatenate([self.farthest, most])

    def grow(self) -> None:
        """Adds the farthest point of all."""
        face = int(self.farthest.argmax())
        members = self.beyond[face]
        point = int(members[np.argmax(self.points[members] @ self.plane[face, :3])])
        seen = self.plane[:, :3] @ self.points[point] - self.plane[:, 3] > 0.5 * self.near
        seen[face] = True
        gone = np.flatnonzero(seen)
        edges = {(t[k], t[(k + 1) % 3]) for t in (self.triangle[g] for g in gone) for k in range(3)}
        rim = sorted(e for e in edges if e[::-1] not in edges)
        points = np.unique(np.concatenate([self.beyond[g] for g in gone]))
        kept = np.flatnonzero(~seen)
        self.triangle = [self.triangle[k] for k in kept]
        self.beyond = [self.beyond[k] for k in kept]
        self.plane, self.farthest = self.plane[kept], self.farthest[kept]
        self.add([(i, j, point) for i, j in rim], points[points != point])


def merge_coplanar_faces(X: np.ndarray, triangles: np.ndarray, flat: float) -> list[np.ndarray]:
    """Loops of the faces: from the largest triangle on, neighbours in its plane are joined to it."""
    n = np.cross(X[triangles[:, 1]] - X[triangles[:, 0]], X[triangles[:, 2]] - X[triangles[:, 0]])
    area = np.linalg.norm(n, axis=1)
    edge = {(t[k], t[(k + 1) % 3]): f for f, t in enumerate(triangles.tolist()) for k in range(3)}
    taken = np.zeros(len(triangles), bool)
    loops = []
    for seed in np.argsort(-area, kind="stable"):
        if taken[seed]:
            continue
        normal, group, front = n[seed] / max(area[seed], 1e-300), [seed], [seed]
        taken[seed] = True
        offset = normal @ X[triangles[seed][0]]
        while front:
            t = triangles[front.pop()].tolist()
            for k in range(3):
                f = edge.get((t[(k + 1) % 3], t[k]), -1)
                if f >= 0 and not taken[f] and np.abs(X[triangles[f]] @ normal - offset).max() <= flat and n[f] @ normal >= 0:
                    taken[f] = True
                    group.append(f)
                    front.append(f)
        loops += loop_around_triangles(triangles[group])
    return loops


def loop_around_triangles(group: np.ndarray) -> list[np.ndarray]:
    """The loop around triangles that hang together; the triangles themselves if it is not one."""
    edges = {(t[k], t[(k + 1) % 3]) for t in group.tolist() for k in range(3)}
    after = {i: j for i, j in edges if (j, i) not in edges}
    loop = [min(after)] if after else []
    while loop and len(loop) < len(after) and after.get(loop[-1], loop[0]) != loop[0]:
        loop.append(after[loop[-1]])
    if len(loop) == len(after) == sum((j, i) not in edges for i, j in edges) and len(loop) > 2:
        return [np.array(loop)]
    return [np.array(t) for t in group.tolist()]


def convex_hull(points, most: int | None = None) -> ConvexHull:
    """Hull of points (n, 3) [m], of at most `most` vertices (None: all). Raises DegenerateHull without a volume, ValueError for
    points that are not finite."""
    X = np.unique(np.asarray(points, np.float64).reshape(-1, 3), axis=0)
    if not len(X) or not np.isfinite(X).all():
        raise ValueError("a hull needs points, all of them finite")
    size = float(np.linalg.norm(np.ptp(X, axis=0)))
    center = 0.5 * (X.min(0) + X.max(0))
    growing = GrowingHull(X - center, initial_simplex(X - center, size), NEAR * size)
    added = 4
    while growing.farthest.max() > 0.0 and (most is None or added < most):
        growing.grow()
        added += 1
    triangles = np.array(growing.triangle)
    used, triangles = np.unique(triangles, return_inverse=True)
    triangles, X = triangles.reshape(-1, 3), X[used]
    loops = merge_coplanar_faces(X - center, triangles, FLAT * size)
    normals = np.array([plane_normal(X[loop]) for loop in loops])
    offsets = ((X - center) @ normals.T).max(0) + normals @ center
    return ConvexHull(X, tuple(loops), normals, offsets, triangles, float(growing.farthest.max()))


def plane_normal(X: np.ndarray) -> np.ndarray:
    """Unit normal of a loop, by its area (Newell)."""
    n = np.cross(X - X[0], np.roll(X, -1, axis=0) - X[0]).sum(0)
    return n / max(float(np.linalg.norm(n)), 1e-300)
