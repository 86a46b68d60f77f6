"""Depths of points, triangles and edges inside of colliders: by kernels/contact/penetration.py, and inside of convex ones in
NumPy and float64, for scenes of so few that compiling those kernels costs more, and the same numbers.

phi, the signed distance of `wsim.scene.solids`, is convex: on a triangle it stays above every tangent. A triangle whose
tangents at its corners and its centre say that it is no deeper than what was found is left out, others are cut into four, until
none is deeper by `EXACT` of the longest edge. Never too great. Triangles with a pinned corner inside a collider were put there.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from wsim.kernels.contact.collider.shape import CONVEX
from wsim.kernels.contact.project import TOUCHED
from wsim.scene.solids import shape_row as solid_of

if TYPE_CHECKING:
    from wsim.physics.contact.contacts import ColliderContacts

FEW = 1 << 17          # points and triangles times colliders of an object, up to which the host takes a tenth of a second
ROWS = 64              # colliders of all objects, of which each costs the host its calls
EXACT, PARTS = 5e-5, 16          # of the longest edge; how often a triangle is cut at most
LANES = 4096           # threads of the kernels
SLOPE = 1e-6           # of the size of a triangle: step of the differences that give tangents


def suits_host_depth(contacts: "ColliderContacts") -> bool:
    """True if the host measures these: few, and convex shapes of ours."""
    rows = contacts.rows
    work = (contacts.count + len(contacts.faces)) * max(rows.most, 1)
    return work <= FEW and len(rows.collider) <= ROWS and all(kind in CONVEX for kind in contacts.kinds)


def penetration_indicators(contacts: "ColliderContacts", x) -> dict[str, float]:
    """Indicators as `ColliderContacts.indicators` has them. x: positions relative to the origins of objects [m], (points,) on
    the device."""
    return depths_on_host(contacts, x.numpy().astype(np.float64)) if suits_host_depth(contacts) else depths_by_kernels(contacts,
                                                                                                                       x)


def depths_by_kernels(contacts: "ColliderContacts", x) -> dict[str, float]:
    """Depths by kernels that are compiled when first asked for."""
    import warp as wp

    from wsim.kernels.contact import penetration
    from wsim.kernels.math.real import types
    from wsim.model import kernel_cache
    c, t = contacts, types(contacts.real)
    module = f"wsim_inside_{'_'.join(c.kinds)}_{t.name}"
    gauge, sink = (make(c.kinds, c.real, module)
                   for make in (penetration.point_penetration_kernel, penetration.face_penetration_kernel))
    for mesh in c.meshes.values():
        if mesh.moves:
            mesh.device["mesh"].refit()                  # winding numbers: substeps may have left them out
    lanes = min(LANES, max(c.count, 1))
    near, count, deep = (wp.zeros(lanes, dtype=kind, device=c.device) for kind in (t.vec2, int, c.real))
    kernel_cache.load_kernel_module(gauge.module, c.device)
    wp.launch(gauge, lanes, [c.table, c.points, c.slots, x, c.substeps, lanes], [near, count], device=c.device)
    wp.launch(sink, lanes, [c.table, c.points, c.faces, x, c.substeps, lanes], [deep], device=c.device)
    kept, solid = near.numpy().max(axis=0)
    return {"penetration": float(max(solid, deep.numpy().max())), "too_near": float(kept), "contacts": int(count.numpy().sum())}


def depths_on_host(contacts: "ColliderContacts", x: np.ndarray) -> dict[str, float]:
    """x: positions [m], (points, 3), float64."""
    points, table = contacts.points, contacts.table
    w, owner, reach = (a.numpy() for a in (points.w, points.object, points.reach))
    pose = table.of.pose.numpy()[contacts.substeps].astype(np.float64)
    gap, faces, first = table.of.thick.numpy().astype(np.float64), contacts.faces.numpy(), contacts.rows.first
    kept = solid = deep = 0.0
    for o in range(len(first) - 1):
        mine, corners = np.flatnonzero((owner == o) & (w > 0.0)), faces[owner[faces[:, 0]] == o]
        for r in range(first[o], first[o + 1]):
            place = PlacedShape(contacts.rows.colliders[contacts.rows.collider[r]].shape, pose[r])
            if len(mine):
                away = place.outside(x[mine])
                kept = max(kept, float((reach[mine] + gap[r] - away).max()))
                solid = max(solid, float(-away.min()))
            if len(corners):
                deep = max(deep, _triangle_depth(place, x[corners], w[corners] == 0.0, deep))
    mark = contacts.slots.mark.numpy()[w > 0.0]
    return {"penetration": max(solid, deep), "too_near": kept, "contacts": int((mark & TOUCHED).sum())}


class PlacedShape:
    """A convex shape where its collider is: pose (7,), translation [m] and quaternion (x, y, z, w)."""

    def __init__(self, shape: Any, pose: np.ndarray):
        self.shape, self.row = shape, solid_of(shape)
        x, y, z, w = pose[3:] / np.linalg.norm(pose[3:])
        self.at, self.turn = pose[:3], np.array([
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]])

    def own(self, x: np.ndarray) -> np.ndarray:
        """x in the frame of the collider."""
        return (x - self.at) @ self.turn

    def phi(self, q: np.ndarray) -> np.ndarray:
        """Signed distance [m], own frame, exact inside and a bound from below outside, of q (..., 3)."""
        return self.row.distance(self.shape, q.reshape(-1, 3)).reshape(q.shape[:-1])

    def slope(self, q: np.ndarray, step: float) -> np.ndarray:
        """grad phi at q (..., 3)."""
        turn = step * np.eye(3)
        return np.stack([self.phi(q + turn[k]) - self.phi(q - turn[k]) for k in range(3)], axis=-1) / (2.0 * step)

    def outside(self, x: np.ndarray) -> np.ndarray:
        """Signed distance [m], exact everywhere, of x (n, 3) in the frame of the object."""
        q = self.own(x)
        exact, found = OUTSIDE.get(self.row.kind), self.phi(q)
        if exact is not None and (out := found > 0.0).any():
            found[out] = exact(self.shape, q[out])
        return found


def _box_outside_distance(shape, q: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.maximum(np.abs(q) - np.asarray(shape.half), 0.0), axis=1)


def _cylinder_outside_distance(shape, q: np.ndarray) -> np.ndarray:
    rho = np.hypot(q[:, 0], q[:, 1])
    return np.hypot(np.maximum(rho - shape.radius, 0.0), np.maximum(np.abs(q[:, 2]) - shape.half_height, 0.0))


def _cone_outside_distance(shape, q: np.ndarray) -> np.ndarray:
    """To the flank from the rim (R, -H) to the apex (0, H), or to the base."""
    R, H, rho = shape.radius, shape.half_height, np.hypot(q[:, 0], q[:, 1])
    x, z, L = rho - R, q[:, 2] + H, np.hypot(R, 2.0 * H)
    along = np.clip((2.0 * H * z - R * x) / (L * L), 0.0, 1.0)
    flank = np.hypot(x + along * R, z - along * 2.0 * H)
    return np.minimum(flank, np.hypot(np.maximum(x, 0.0), z))


OUTSIDE = {"box": _box_outside_distance, "cylinder": _cylinder_outside_distance, "cone": _cone_outside_distance}


def _triangle_depth(place: PlacedShape, x: np.ndarray, pinned: np.ndarray, found: float) -> float:
    """Greatest depth of triangles x (t, 3, 3) [m] where that is more than `found`, which else is given back."""
    X = place.own(x.reshape(-1, 3)).reshape(x.shape)
    phi = place.phi(X)
    free = ~(pinned & (phi < 0.0)).any(axis=1)
    X, phi = X[free], phi[free]
    if not len(X):
        return found
    found = max(found, float(-phi.min()))
    edge = float(np.linalg.norm(X - np.roll(X, 1, axis=1), axis=2).max())
    for _ in range(PARTS):
        centre = X.mean(axis=1)
        middle, size = place.phi(centre), np.linalg.norm(X - centre[:, None], axis=2).max(axis=1)
        found = max(found, float(-middle.min()))
        near = middle - size < -found - EXACT * edge                             # slope 1: else none of it is deeper
        X, phi, centre, middle = X[near], phi[near], centre[near], middle[near]
        if not len(X):
            break
        where, value = np.concatenate([X, centre[:, None]], axis=1), np.concatenate([phi, middle[:, None]], axis=1)
        n = place.slope(where, SLOPE * edge)
        tangents = value[..., None] + np.einsum("tkc,tlkc->tkl", n, X[:, :, None] - where[:, None])
        deeper = tangents.min(axis=2).max(axis=1) < -found - EXACT * edge
        if not deeper.any():
            break
        X = _split_into_quarters(X[deeper])
        phi = place.phi(X)
        found = max(found, float(-phi.min()))
    return found


def _split_into_quarters(X: np.ndarray) -> np.ndarray:
    """Triangles (4 t, 3, 3) between the corners and the middles of the edges of X (t, 3, 3)."""
    a, b, c = X[:, 0], X[:, 1], X[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate(parts)
