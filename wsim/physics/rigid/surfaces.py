"""Tables of convex hulls and of triangle meshes on a device, as the narrow phase reads them (kernels/rigid/narrow/shape.py,
kernels/rigid/narrow/mesh.py)."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from wsim.geometry.convex_hull import ConvexHull
from wsim.geometry.memo import digest_of_arguments
from wsim.kernels.math.real import types
from wsim.kernels.rigid.narrow.mesh import mesh_type
from wsim.kernels.rigid.narrow.shape import CORNERS, hull_type
from wsim.physics.rigid.contacts.features import contact_features, contact_reach


def adjacent_faces(faces: np.ndarray) -> np.ndarray:
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


def weld_equal_points(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces with points in one place as one, so that seams of a mesh are no rims."""
    _, first, same = np.unique(points, axis=0, return_index=True, return_inverse=True)
    return first[np.asarray(same).reshape(-1)][faces]


def point_neighbours(faces: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """(first, neighbours) of each point: the points at the other ends of its edges."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2)
    edges = np.unique(np.concatenate([edges, edges[:, ::-1]]), axis=0)
    return np.concatenate([[0], np.cumsum(np.bincount(edges[:, 0], minlength=points))]), edges[:, 1]


def equal_meshes(meshes: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[list[int], list[tuple[np.ndarray, np.ndarray]]]:
    """(number of each mesh among the different ones, those)."""
    place: dict[bytes, int] = {}
    found = [place.setdefault(digest_of_arguments(*mesh), len(place)) for mesh in meshes]
    return found, [meshes[found.index(k)] for k in range(len(place))]


def mesh_surface_tables(meshes: Sequence[tuple[np.ndarray, np.ndarray]], real, device, featured: bool = False) -> tuple:
    """(struct, trees) of meshes (points (n, 3) [m], triangles (m, 3)); the trees live as long as they are held.
    A mesh is closed where no edge is a rim. featured: with what touches other meshes, and planes."""
    t, found = types(real), mesh_type(real)()
    trees, faces, across, points, sided, first, base = [], [], [], [], [], [0], 0
    more, reach = [], []      # type: list[dict], list[float]
    for X, given in meshes:
        X, corners = np.asarray(X, np.float64), weld_equal_points(np.asarray(X), np.asarray(given, np.int64).reshape(-1, 3))
        trees.append(wp.Mesh(points=wp.array(X, dtype=wp.vec3f, device=device),
                             indices=wp.array(corners.ravel(), dtype=int, device=device)))
        next_to = adjacent_faces(corners)
        faces.append(corners + base)
        across.append(np.where(next_to < 0, -1, next_to + first[-1]))
        points.append(X)
        sided.append(int((next_to >= 0).all()))
        if featured:
            own = contact_features(X, corners, next_to)
            more.append({**own, "patch": own["patch"] + first[-1]})
            reach.append(contact_reach(X, corners, bool(sided[-1])))
        first.append(first[-1] + len(corners))
        base += len(X)
    found.id = wp.array([tree.id for tree in trees], dtype=wp.uint64, device=device)
    found.sided = wp.array(sided, dtype=int, device=device)
    found.first = wp.array(first, dtype=int, device=device)
    found.face = wp.array(np.concatenate(faces), dtype=wp.vec3i, device=device)
    found.beside = wp.array(np.concatenate(across), dtype=wp.vec3i, device=device)
    starts, ends = point_neighbours(np.concatenate(faces), base)
    found.first_around = wp.array(starts, dtype=int, device=device)
    found.around = wp.array(ends, dtype=int, device=device)
    found.point = wp.array(np.concatenate(points), dtype=t.vec3, device=device)
    if featured:
        for name, dtype in (("corner", wp.vec3i), ("sharp", wp.vec3i), ("patch", int)):
            setattr(found, name, wp.array(np.concatenate([own[name] for own in more]), dtype=dtype, device=device))
        found.reach = wp.array(reach, dtype=real, device=device)
    return found, trees


def simplify_face_loop(X: np.ndarray, loop: np.ndarray, most: int = CORNERS) -> np.ndarray:
    """A loop of at most `most` corners: those that take away the least area go first."""
    loop = np.asarray(loop)
    while len(loop) > most:
        a, b, c = X[np.roll(loop, 1)], X[loop], X[np.roll(loop, -1)]
        loop = np.delete(loop, np.linalg.norm(np.cross(b - a, c - a), axis=1).argmin())
    return loop


def hull_tables(shapes: Sequence[ConvexHull], real, device):
    """Struct of the tables of these hulls, in the frame in which their vertices are; row k is the k-th."""
    t, found = types(real), hull_type(real)()
    loops = [[simplify_face_loop(h.vertices, loop) for loop in h.loops] for h in shapes]

    def offset_array(counts) -> wp.array:
        return wp.array(np.concatenate([[0], np.cumsum(list(counts))]).astype(np.int32), dtype=int, device=device)

    def stack_hull_parts(parts, dtype, width: int = 0) -> wp.array:
        shape = (0, width) if width else (0,)
        return wp.array(np.concatenate([np.zeros(shape), *parts]), dtype=dtype, device=device)
    found.first = offset_array(len(h.vertices) for h in shapes)
    found.vertex = stack_hull_parts([h.vertices for h in shapes], t.vec3, 3)
    found.first_face = offset_array(len(of) for of in loops)
    found.normal = stack_hull_parts([h.normals for h in shapes], t.vec3, 3)
    found.offset = stack_hull_parts([h.offsets for h in shapes], real)
    found.first_corner = offset_array(len(loop) for of in loops for loop in of)
    found.corner = stack_hull_parts([loop for of in loops for loop in of], int)
    found.size = stack_hull_parts([[np.linalg.norm(h.vertices, axis=1).max()] for h in shapes], real)
    return found
