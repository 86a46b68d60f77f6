"""Places, volumes and velocities of particles as a scene starts: a lattice of 2 x 2 x 2 of each cell within a shape, or points
that are given. Then the order in which the device has them: cell by cell, block by block. NumPy only."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from wsim.geometry.memo import keep_latest_results
from wsim.physics.mpm.objects import ACROSS, MaterialPoints
from wsim.physics.particles.lattice import index_block, indices_inside_mesh
from wsim.physics.particles.pouring import PouredPoints
from wsim.scene import Surface
from wsim.scene.solids import shape_row

SIDE = 4                   # cells along an edge of a block, as kernels/particles/mpm/tables.py
BLOCK = 16                 # lattice points along an edge of a block that is looked at as a whole
BLOCKS = 256               # blocks that are looked at together: bounds the memory
SKIN = 1e-6                # cells: what is nearer to a surface is not within
BODIES = 12                # whose lattices are kept: 24 MB each for a million particles


@dataclass
class PlacedPoints:
    """x [m] world (n, 3), volume [m^3] (n,), v [m/s] (n, 3), gradient of v [1/s] (n, 3, 3), times when they come [s] (n,),
    minus infinity of those that are there at the start; all float64."""

    x: np.ndarray
    volume: np.ndarray
    v: np.ndarray
    C: np.ndarray
    times: np.ndarray


def shape_bounds(thing: MaterialPoints) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner of a box about a thing's shape, or its points, world [m]."""
    M = thing.motion.at(0.0)
    if thing.points is not None:
        return thing.points.min(axis=0), thing.points.max(axis=0)
    if isinstance(thing.shape, Surface):
        points = thing.shape.points.astype(np.float64) @ M[:3, :3].T + M[:3, 3]
        return points.min(axis=0), points.max(axis=0)
    reach = float(shape_row(thing.shape).ball(thing.shape))
    return M[:3, 3] - reach, M[:3, 3] + reach


def coarsened(thing: MaterialPoints, across: int) -> MaterialPoints:
    """A thing of a shape with cells so large that it is no more than so many across; other things as they are."""
    if thing.points is not None:
        return thing
    low, high = shape_bounds(thing)
    return replace(thing, cell=max(thing.cell, float((high - low).max()) / across))


def lattice_within(distance: Callable, begin: np.ndarray, end: np.ndarray, edge: float) -> np.ndarray:
    """Indices (n, 3) of lattice points (index + 1/2) edge where distance(x) < 0, in the order of their numbers. Blocks whose
    middle is farther from the shape than their corners are left out unseen: a long box takes no more memory than its points."""
    corner = index_block(begin, end, BLOCK)
    middle = (corner + 0.5 * BLOCK) * edge
    corner = corner[distance(middle) < 0.5 * np.sqrt(3.0) * BLOCK * edge]
    within = index_block(np.zeros(3, int), np.full(3, BLOCK))
    found = [np.empty((0, 3), int)]
    for first in range(0, len(corner), BLOCKS):
        index = (corner[first:first + BLOCKS, None] + within).reshape(-1, 3)
        found.append(index[distance((index + 0.5) * edge) < 0.0])
    index = np.concatenate(found)
    return index[np.lexsort(index.T[::-1])]


def fill_shape(thing: MaterialPoints) -> np.ndarray:
    """Places of the lattice within a thing's shape, world (n, 3) [m]. A scene asks nine times before its first frame, so the
    latest are kept by content; not of shapes from elsewhere, whose distance may be another by the next call."""
    shape, (low, high), M = thing.shape, shape_bounds(thing), thing.motion.at(0.0)
    if isinstance(shape, Surface):
        return _fill_mesh(thing.cell, low, high, M, shape.points, shape.counts, shape.indices)
    fill = _fill_solid_once if type(shape).__module__ == Surface.__module__ else _fill_solid
    return fill(thing.cell, low, high, M, shape)


def _lattice_range(cell: float, low: np.ndarray, high: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Edge of the lattice [m], and its indices from, and to, which a box reaches."""
    edge = cell / ACROSS
    return edge, np.floor(low / edge).astype(int) - 1, np.ceil(high / edge).astype(int) + 1


def _fill_solid(cell: float, low: np.ndarray, high: np.ndarray, M: np.ndarray, shape: Any) -> np.ndarray:
    edge, begin, end = _lattice_range(cell, low, high)

    def distance(x: np.ndarray) -> np.ndarray:
        return shape_row(shape).distance(shape, (x - M[:3, 3]) @ M[:3, :3]) + SKIN * cell
    return (lattice_within(distance, begin, end, edge) + 0.5) * edge


_fill_solid_once = keep_latest_results(_fill_solid, BODIES)


@partial(keep_latest_results, most=BODIES)
def _fill_mesh(cell: float, low: np.ndarray, high: np.ndarray, M: np.ndarray, points: np.ndarray, counts: np.ndarray,
               indices: np.ndarray) -> np.ndarray:
    edge, begin, end = _lattice_range(cell, low, high)
    inside = indices_inside_mesh(Surface(points, counts, indices), M, begin, end, lambda x: x / edge - 0.5)
    return (index_block(begin, end)[inside] + 0.5) * edge


def place_particles(thing: MaterialPoints) -> PlacedPoints:
    """Particles of a thing as the scene starts."""
    if thing.points is not None:
        x = thing.points
        volume = np.broadcast_to(np.asarray(thing.volumes, np.float64), len(x)).copy()
    else:
        x = fill_shape(thing)
        volume = np.full(len(x), (thing.cell / ACROSS) ** 3)
    W = np.stack([np.cross(np.asarray(thing.spin, np.float64), e) for e in np.eye(3)], axis=1)        # W r = spin x r
    center = np.average(x, axis=0, weights=volume) if len(x) else np.zeros(3)
    v = np.asarray(thing.velocity, np.float64) + (x - center) @ W.T
    return PlacedPoints(x, volume, v, np.broadcast_to(W, (len(x), 3, 3)).copy(), np.full(len(x), -np.inf))


def place_poured(poured: PouredPoints) -> PlacedPoints:
    """Particles that come later."""
    return PlacedPoints(poured.x, poured.volume, poured.v, np.zeros((len(poured.x), 3, 3)), poured.t)


def nearest_nodes(x: np.ndarray, corner: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Nearest nodes (n, 3) int and offsets from them [cells] (n, 3) of places [m]; the corner is node 0."""
    at = (x - corner) / cell
    node = np.floor(at + 0.5)
    return node.astype(np.int64), at - node


def locality_order(node: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Order of particles by block, then by cell, then as they come; what comes later by its times [s], behind them."""
    block, later = node // SIDE, np.isfinite(times)
    node, block = (np.where(later[:, None], 0, each) for each in (node, block))
    return np.lexsort((node[:, 2], node[:, 1], node[:, 0], block[:, 2], block[:, 1], block[:, 0], times))


def count_blocks(node: np.ndarray) -> int:
    """Blocks that 27 nodes about each particle lie in."""
    cells = np.unique(node, axis=0)
    corners = [np.array([x, y, z]) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    return len(np.unique(np.concatenate([(cells + c) // SIDE for c in corners]), axis=0))
