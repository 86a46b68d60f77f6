"""Shapes in a fluid on the device: rows of the table of colliders, and which are walls that its grid is too coarse for."""

from math import sqrt
from typing import Any

import numpy as np
import warp as wp

from wsim.kernels.fluid import shapes as kernels
from wsim.model.model import Model
from wsim.model.structs import fill_struct
from wsim.physics.contact.collider.mesh import outward_triangles
from wsim.physics.contact.collider.table import ColliderTable
from wsim.physics.fluid.start import bounding_radius
from wsim.scene import Box, Surface
from wsim.scene.solids import shape_row

PLACES = 64              # on a mesh, where its thickness is looked at
WALL = 2.0               # cells: half the thickness up to which a liquid has a wall at its side. Thicker ones cover parts of
                         # faces, which is of higher order beside a smooth body and stirs the liquid in a cup that tilts
THINNEST = 0.1           # of its area; a few sharp edges make no thin wall
TOUCH = 1e-3             # cells that a domain may reach beyond a face of a wall at its rim


def half_thickness(shape: Any) -> float:
    """Half the thickness [m]: of a convex shape its greatest depth on its own axis, of a mesh that of the thinnest tenth of its
    area, of an open one 0."""
    if not isinstance(shape, Surface):
        found = shape_row(shape)
        if not np.isfinite(found.ball(shape)):
            return np.inf
        axis = np.outer(np.linspace(-1.0, 1.0, PLACES + 1) * found.ball(shape), (0.0, 0.0, 1.0))
        return float(-found.distance(shape, axis).min())
    triangles, solid = outward_triangles(shape)
    if not solid:
        return 0.0
    return 0.5 * float(np.quantile(surface_thickness(shape.points.astype(np.float64)[triangles]), THINNEST))


def surface_thickness(corners: np.ndarray) -> np.ndarray:
    """How far [m] it is to the surface's other side from places on it, one in each of PLACES equal parts of its area; corners
    (t, 3, 3) of its triangles."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    area = np.cumsum(np.linalg.norm(normal, axis=1))
    pick = np.searchsorted(area, (np.arange(PLACES) + 0.5) / PLACES * area[-1])
    start = corners[pick].mean(axis=1)
    way = -normal[pick] / np.linalg.norm(normal[pick], axis=1)[:, None]
    far = np.empty(PLACES)
    for k in range(PLACES):                                    # Moeller, Trumbore 1997, of one ray with all triangles
        cross = np.cross(way[k], c - a)
        det = np.einsum("ti,ti->t", b - a, cross)
        det[pick[k]] = 0.0
        inverse = np.divide(1.0, det, out=np.zeros_like(det), where=det != 0.0)
        off = start[k] - a
        u = np.einsum("ti,ti->t", off, cross) * inverse
        turned = np.cross(off, b - a)
        v = turned @ way[k] * inverse
        t = np.einsum("ti,ti->t", c - a, turned) * inverse
        far[k] = t[(det != 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)].min(initial=np.inf)
    return far


def least_thickness(axes: tuple[int, ...], cell: float) -> float:
    """Half the thickness [m] from which on the nodes of a grid tell a wall, however it lies: half of a cell's diagonal."""
    return 0.5 * sqrt(len(axes)) * cell


def is_thin_wall(thing: Any, low: np.ndarray, high: np.ndarray, cell: float) -> bool:
    """True of a wall whose sides a liquid keeps apart by segments (kernels/particles/walls.py). What floats is thickened, and
    so is a wall that has one side alone between the corners low and high of a domain, world [m]."""
    if getattr(thing, "body", -1) >= 0 or half_thickness(thing.shape) >= WALL * cell:
        return False
    return not one_sided(thing, low, high, cell)


def one_sided(thing: Any, low: np.ndarray, high: np.ndarray, cell: float) -> bool:
    """True of a box that stands, and beyond whose thin faces there is nothing of a domain: one at its rim."""
    if not isinstance(thing.shape, Box) or thing.motion.moves:
        return False
    M, half = np.asarray(thing.motion.at(0.0), np.float64), np.asarray(thing.shape.half, np.float64)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    own = (corners - M[:3, 3]) @ M[:3, :3]
    past = half + TOUCH * cell
    rim = (own <= past).all(axis=0) | (own >= -past).all(axis=0)
    return bool((rim | (half >= WALL * cell)).all())


class FluidShapeRows(ColliderTable):
    """Shapes of things that have a `shape` and a `motion`, places relative to a corner [m]. walls: what becomes of those that
    the grid is too coarse for: "thick", they are thickened; "thin", a liquid's, they are marked; "", nothing."""

    def __init__(self, model: Model, things: list, corner: np.ndarray, axes: tuple[int, ...], cell: float, walls: str = "",
                 far: Any = None):
        """far: the domain's other corner, where walls are thin."""
        self.cell = cell
        least = least_thickness(axes, cell) if walls else 0.0
        low, high = np.asarray(corner), np.asarray(far)
        self.thin = np.array([walls == "thin" and is_thin_wall(thing, low, high, cell) for thing in things], bool)
        self.thick = [0.0 if flag or not walls else max(0.0, least - half_thickness(thing.shape))
                      for thing, flag in zip(things, self.thin, strict=True)]
        super().__init__(model, things, corner, self.thick, screw=walls == "thin")
        marked = model.upload(self.thin.astype(np.int32), int)
        self.table = fill_struct(kernels.fluid_shape_structs(model.real).Shapes, of=self.rows, thin=marked, dx=model.real(cell),
                                 axes=wp.vec3i(*axes, *(0,) * (3 - len(axes))))

    def ball(self, k: int) -> float:
        """Radius about its own origin that holds a shape [m]."""
        return bounding_radius(self.things[k].shape) + self.thick[k]
