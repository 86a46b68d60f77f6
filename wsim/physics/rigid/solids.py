"""Which colliders rigid bodies meet, and as what: simple shapes as they are, meshes as convex hulls. NumPy only.

A mesh of a body is its hull. A mesh that stands is its hull where it is convex, else it is not met: a hull would fill what is
hollow, a room or a bowl. Flat meshes have no hull.
"""

import numpy as np

from wsim.geometry.convex_hull import ConvexHull, DegenerateHull, convex_hull
from wsim.physics.rigid.mass import volume
from wsim.scene import Collider, Surface
from wsim.scene.solids import row

MOST = 64                  # vertices of a hull: more are left out, those that stand out least
CONVEX = 0.01              # part of a hull's volume that a mesh may lack and count as convex


def hull(shape: Surface) -> ConvexHull | None:
    """None where there is no volume."""
    try:
        return convex_hull(shape.points, MOST)
    except DegenerateHull:
        return None


def filled(shape: Surface) -> float:
    """Part of its hull's volume that a mesh encloses; 0 without a hull, or where the mesh is open."""
    found = hull(shape)
    if found is None:
        return 0.0
    counts = np.array([len(loop) for loop in found.loops])
    return volume(shape).volume / volume(Surface(found.vertices, counts, np.concatenate(found.loops))).volume


def met(collider: Collider, of_body: bool) -> bool:
    """Whether bodies meet it."""
    shape = collider.shape
    if not isinstance(shape, Surface):
        return collider.meets
    if shape.poses is not None:
        return False
    return collider.meets and (hull(shape) is not None if of_body else filled(shape) >= 1.0 - CONVEX)


def kind(collider: Collider) -> str:
    """Name of its shape, as kernels/rigid/narrow/shape.py has it."""
    return "hull" if isinstance(collider.shape, Surface) else row(collider.shape).kind


def meeting(body) -> list[Collider]:
    """Colliders of a body that touch something."""
    return [c for c in body.colliders if met(c, True)]


def standing(colliders: list[Collider]) -> list[Collider]:
    """Colliders of a scene that bodies meet."""
    return [c for c in colliders if met(c, False)]
