"""Tables of triangle meshes on a device, as the narrow phase reads them (kernels/rigid/narrow/mesh.py)."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.mesh import surfaces


def beside(faces: np.ndarray) -> np.ndarray:
    """Face across each edge k, from corner k to k + 1, of triangles (n, 3); -1 at a rim, where more than two faces meet, and
    where the neighbour is wound the other way."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2).astype(np.int64)
    count = int(faces.max(initial=0)) + 1
    own, other = edges @ (count, 1), edges @ (1, count)
    order = np.argsort(own, kind="stable")
    ranked = own[order]
    place = np.searchsorted(ranked, other)
    several = np.searchsorted(ranked, other, side="right") - place
    lone = np.searchsorted(ranked, own, side="right") - np.searchsorted(ranked, own) == 1
    met = (several == 1) & lone
    return np.where(met, order[np.minimum(place, len(order) - 1)] // 3, -1).reshape(-1, 3)


def welded(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces with points in one place as one, so that seams of a mesh are no rims."""
    _, first, same = np.unique(points, axis=0, return_index=True, return_inverse=True)
    return first[np.asarray(same).reshape(-1)][faces]


def around(faces: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """(first, neighbours) of each point: the points at the other ends of its edges."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2)
    edges = np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)
    return np.concatenate([[0], np.cumsum(np.bincount(edges[:, 0], minlength=points))]), edges[:, 1]


def tables(meshes: Sequence[tuple[np.ndarray, np.ndarray]], real, device) -> tuple:
    """(struct, trees) of meshes (points (n, 3) [m], triangles (m, 3)); the trees live as long as they are held.
    A mesh is closed where no edge is a rim."""
    t, found = types(real), surfaces(real)()
    trees, faces, across, points, sided, first, base = [], [], [], [], [], [0], 0
    for X, given in meshes:
        X, corners = np.asarray(X, np.float64), welded(np.asarray(X), np.asarray(given, np.int64).reshape(-1, 3))
        trees.append(wp.Mesh(points=wp.array(X, dtype=wp.vec3f, device=device),
                             indices=wp.array(corners.ravel(), dtype=int, device=device)))
        next_to = beside(corners)
        faces.append(corners + base)
        across.append(np.where(next_to < 0, -1, next_to + first[-1]))
        points.append(X)
        sided.append(int((next_to >= 0).all()))
        first.append(first[-1] + len(corners))
        base += len(X)
    found.id = wp.array([tree.id for tree in trees], dtype=wp.uint64, device=device)
    found.sided = wp.array(sided, dtype=int, device=device)
    found.first = wp.array(first, dtype=int, device=device)
    found.face = wp.array(np.concatenate(faces), dtype=wp.vec3i, device=device)
    found.beside = wp.array(np.concatenate(across), dtype=wp.vec3i, device=device)
    starts, ends = around(np.concatenate(faces), base)
    found.first_around = wp.array(starts, dtype=int, device=device)
    found.around = wp.array(ends, dtype=int, device=device)
    found.point = wp.array(np.concatenate(points), dtype=t.vec3, device=device)
    return found, trees
