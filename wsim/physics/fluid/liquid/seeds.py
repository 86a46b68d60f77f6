"""Where the particles of a liquid start: a lattice of ACROSS along each edge of a cell, of what shapes fill. On the host."""

from collections.abc import Iterator

import numpy as np

from wsim.physics.contact.collider.point_cloud import PointCloud, fill_lattice
from wsim.physics.contact.collider.shells import body_shells
from wsim.physics.contact.collider.table import collider_shape_kind
from wsim.physics.fluid.liquid.objects import ACROSS, Liquid, LiquidSource
from wsim.physics.particles.lattice import index_block, indices_inside_mesh
from wsim.scene import Scene, Surface
from wsim.scene.solids import shape_row

SLAB = 1 << 20             # places that are looked at at a time
SKIN = 1.0e-3              # cells: what is nearer to a wall might be on its other side (kernels/particles/sides.py)
SAMPLES = 48               # along the longest edge of a box, by which the number of particles is estimated


def sources_of_role(liquid: Liquid, scene: Scene, role: str = "start") -> list[LiquidSource]:
    return [s for s in scene.things("LiquidSource") if s.role == role and s.liquid in ("", liquid.path)]


def particle_lattice(liquid: Liquid, count: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """First place and distance of places along each axis, `count` of them: world (3,) [m]."""
    edge = liquid.cell * np.array(liquid.shape) / np.array(count)
    return liquid.low + 0.5 * edge, edge


def lattice_inside_shape(thing, first: np.ndarray, edge: np.ndarray, low: np.ndarray, high: np.ndarray,
                         margin: float) -> np.ndarray:
    """True where places first + edge * k, low <= k < high, are inside the shape of a thing at the start, (places,) bool; beside
    a convex one less than margin [m], which below 0 is within."""
    M, shape = thing.motion.at(0.0), thing.shape
    if isinstance(shape, PointCloud):
        return fill_lattice(shape, M, first, edge, low, high, margin)
    if not isinstance(shape, Surface):
        return shape_row(shape).distance(shape, (first + edge * index_block(low, high) - M[:3, 3]) @ M[:3, :3]) < margin
    return indices_inside_mesh(shape, M, low, high, lambda x: (x - first) / edge)


def lattice_slabs(count: tuple[int, ...]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Boxes (low, high) of indices that make up the whole, each of about SLAB places."""
    thick = max(1, SLAB // (count[1] * count[2]))
    for a in range(0, count[0], thick):
        yield np.array([a, 0, 0]), np.array([min(a + thick, count[0]), count[1], count[2]])


def filled_places(liquid: Liquid, scene: Scene, count: tuple[int, ...]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """(places (n, 3) world [m], velocities (n, 3) [m/s]) of a lattice of `count` that are filled, slab by slab."""
    first, edge = particle_lattice(liquid, count)
    for low, high in lattice_slabs(count):
        v = np.zeros((int(np.prod(high - low)), 3))
        full = np.zeros(len(v), bool)
        for source in sources_of_role(liquid, scene):
            inside = lattice_inside_shape(source, first, edge, low, high, -SKIN * liquid.cell)
            v[inside] = 0.0 if source.velocity is None else source.velocity
            full |= inside
        met: list = [*scene.colliders, *body_shells(scene)]
        for collider in met:
            if full.any() and collider_shape_kind(collider.shape) != "sheet":
                full &= ~lattice_inside_shape(collider, first, edge, low, high, SKIN * liquid.cell)
        yield (first + edge * index_block(low, high))[full], v[full]


def particle_seeds(liquid: Liquid, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) world [m] and velocities (n, 3) [m/s] of all particles at the start."""
    count = tuple(n * ACROSS if n > 1 else 1 for n in liquid.shape)
    found = list(filled_places(liquid, scene, count))
    return np.concatenate([x for x, _ in found]), np.concatenate([v for _, v in found])


def estimated_particles(liquid: Liquid, scene: Scene) -> int:
    """About how many particles there are at the start, of a coarse lattice."""
    longest = max(liquid.shape)
    count = tuple(max(1, min(ACROSS * n if n > 1 else 1, round(n * SAMPLES / longest))) for n in liquid.shape)
    part = sum(len(x) for x, _ in filled_places(liquid, scene, count)) / float(np.prod(count))
    return round(part * liquid.cells * ACROSS ** len(liquid.axes))
