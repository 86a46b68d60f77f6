"""Places of particles that fill a shape. NumPy only.

A fluid begins on a cubic lattice of edge 2 r, at which its density is that at rest, each moved at random by up to 0.1 r, so
that it does not spread along rows. Grains begin on a body-centred one, two cubic lattices of edge a of which one has its places
in the middles of the other's cubes: as many grains as on a cubic one of edge 2.2 r, but none stands straight on the next. A
cubic block of grains stands as a wall, one tower beside the other; this one falls in a heap.

    a = 2^(1/3) 2.2 r = 2.77 r       nearest places: a sqrt(3) / 2 = 2.40 r

Each grain is moved at random along each axis by up to (1.20 r - r) / sqrt(3), so that none overlaps another.
"""

from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np

from wsim.physics.particles.check_shapes import check_volume_shape
from wsim.physics.particles.lattice import index_block, indices_inside_mesh
from wsim.physics.particles.pouring import MOST_PLACES
from wsim.physics.position_based.objects import LOOSE, ConstraintFluid, lattice_edge
from wsim.scene import Plane, Problem, SceneError, Surface
from wsim.scene.solids import SOLIDS, shape_row

Indices = Callable[[np.ndarray, np.ndarray], np.ndarray]


def fill_with_particles(path: str, shape: Any, radius: Any, material: Any = None) -> np.ndarray:
    """Places within a closed shape, in its own frame (n, 3) [m]. Balls about them lie within a convex one, and do not overlap.
    Raises SceneError where there is not one radius > 0, a shape has no inside, or it holds no particle or too many."""
    _demand_shape_and_radius(path, shape, radius)
    r, fluid = float(radius), material == "fluid" or isinstance(material, ConstraintFluid)
    edge = lattice_edge(r, fluid)
    step = edge if fluid else 2.0 ** (-2.0 / 3.0) * edge                         # of a body-centred lattice: a / 2
    free = 0.0 if fluid else 0.5 * step - r / np.sqrt(3.0)
    within = _places_in_mesh if isinstance(shape, Surface) else _places_in_solid
    places = within(path, shape, r, step, free, index_block if fluid else body_centred_block)
    if not len(places):
        raise SceneError(Problem(path, f"its shape holds no particle: its radius is {r:g} m; allowed: a shape that "
                                 "holds one; fix: give a smaller radius, or a larger shape"))
    shift = ((LOOSE - 1.0) * r if fluid else free) * np.random.default_rng(0).uniform(-1.0, 1.0, places.shape)
    return places + (_shift_within(shape, places, shift, r) if fluid and not isinstance(shape, Surface) else shift)


def _shift_within(shape: Any, places: np.ndarray, shift: np.ndarray, r: float) -> np.ndarray:
    """Random shifts (n, 3) [m] by which balls stay within a convex shape: what would stand out goes back, or nowhere."""
    for factor in (-1.0, 0.0):
        out = shape_row(shape).distance(shape, places + shift) > -r * (1.0 - 1e-6)
        shift[out] *= factor
    return shift


def body_centred_block(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rows of `index_block` whose numbers are all even, then those whose are all odd (n, 3)."""
    begin = np.asarray(begin)
    return np.concatenate([index_block(begin + (begin + odd) % 2, end, 2) for odd in (0, 1)])


def _places_in_mesh(path: str, shape: Surface, r: float, step: float, free: float, block: Indices) -> np.ndarray:
    """Places of a lattice within a mesh [m]."""
    low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    begin, end = np.floor(low / step).astype(int) - 1, np.ceil(high / step).astype(int) + 1
    _demand_room(path, r, float(np.prod(end - begin, dtype=np.float64)))
    inside = np.zeros(end - begin, bool)
    inside.reshape(-1)[:] = indices_inside_mesh(shape, np.eye(4), begin, end, lambda x: x / step - 0.5)
    index = block(begin, end)
    return (index[inside[tuple((index - begin).T)]] + 0.5) * step


def _places_in_solid(path: str, shape: Any, r: float, step: float, free: float, block: Indices) -> np.ndarray:
    """Places of a lattice about the middle of a convex shape whose balls lie within it [m]: of a box as many as there fit."""
    if hasattr(shape, "half"):
        count = np.maximum(np.floor(2.0 * (np.array(shape.half, float) - r - free) / step + 1.0 + 1e-6), 0.0)
        _demand_room(path, r, float(np.prod(count)))
        return (block(np.zeros(3, int), count.astype(int)) - 0.5 * (count - 1.0)) * step
    most = np.full(3, np.ceil(float(shape_row(shape).ball(shape)) / step) + 1.0)
    _demand_room(path, r, float(np.prod(2.0 * most)))
    lattice = block(-most.astype(int), most.astype(int) + 1) * step
    return lattice[shape_row(shape).distance(shape, lattice) < -(r + np.sqrt(3.0) * free) * (1.0 - 1e-6)]


def _demand_shape_and_radius(path: str, shape: Any, radius: Any) -> None:
    """Raises SceneError where there is not one radius > 0, or a shape has no inside."""
    known = isinstance(radius, Real | np.ndarray)
    if not known or np.size(radius) != 1 or not 0.0 < float(radius) < np.inf:
        raise SceneError(Problem(path, f"radius is {radius!r:.60}; allowed is one length > 0 [m] where a shape is filled; fix: "
                                 "give radius=0.01, or points with a radius each"))
    if type(shape) not in (Surface, *(row.shape for row in SOLIDS)):
        raise SceneError(Problem(path, f"shape is {shape!r:.60}; allowed is a closed shape; fix: give Box((0.1, 0.1, 0.1)) or "
                                 "wsim.Surface(points, counts, indices) of a mesh"))
    if isinstance(shape, Plane):
        raise SceneError(Problem(path, "a Plane has no end to fill; allowed is a closed shape; fix: give a Box, say"))
    if broken := [problem for problem in check_volume_shape(path, shape) if problem.fatal]:
        raise SceneError(broken)


def _demand_room(path: str, radius: float, places: float) -> None:
    """Raises SceneError where the lattice about a shape would not fit in memory."""
    if places > MOST_PLACES:
        larger = radius * (places / MOST_PLACES) ** (1.0 / 3.0)
        raise SceneError(Problem(path, f"radius is {radius:g} m, with which the box about the shape has {places:.3g} places; "
                                 f"allowed are {MOST_PLACES:.3g}; fix: give a radius of {larger:.2g} m, or a smaller shape"))
