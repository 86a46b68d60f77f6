"""Colliders with edges or corners that may stand out of a cloth between its points, and cloths whose edges meet them
(`wsim.physics.cloth.edge_contacts`). NumPy only."""

import weakref

import numpy as np

from wsim.geometry import topology
from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene import Collider, Problem, Scene, Surface
from wsim.scene.check.chord import CREASE
from wsim.scene.check.objects import object_warning
from wsim.scene.check.signed_distance import is_closed_mesh
from wsim.scene.methods import method_colliders
from wsim.scene.solids import Box, Cone, Cylinder

EDGED = 2.5            # creases [m] / root of the area [m]: a cube has 4.9, a cylinder 3; a body with a few cuts is
                       # no block, and a query of a mesh for each edge would double its time
KNOWN: dict[int, tuple[weakref.ref, bool]] = {}         # of meshes, which plans ask for several times


def has_sharp_edges(collider: Collider) -> bool:
    """True if a collider has edges or corners that may stand out of a sheet between its points; not a mesh that deforms."""
    shape = collider.shape
    if isinstance(shape, Surface):
        return shape.poses is None and _is_creased_mesh(shape)
    return isinstance(shape, (Box, Cylinder, Cone))


def _is_creased_mesh(surface: Surface) -> bool:
    """True if a mesh is closed, and edges that bend outward by more than CREASE are what it is made of."""
    known = KNOWN.get(id(surface))
    if known is None or known[0]() is not surface:
        known = KNOWN[id(surface)] = weakref.ref(surface), _find_creases(surface)
    return known[1]


def _find_creases(surface: Surface) -> bool:
    points = surface.points.astype(np.float64)
    triangles, _ = triangulate_polygons(surface.points, surface.counts, surface.indices)
    if not len(triangles) or not is_closed_mesh(points, triangles):
        return False
    place = topology.weld_points(points, 1e-6 * float(np.ptp(points, axis=0).max(initial=0.0)))
    faces = place[triangles]
    first = np.zeros((place.max() + 1, 3))
    first[place] = points
    hinge = topology.hinges_of_triangles(faces.astype(np.int32))
    a, b, c, d = (first[hinge[:, k]] for k in range(4))
    m, n = np.cross(b - a, c - a), np.cross(a - b, d - b)
    angle = np.arctan2(np.linalg.norm(np.cross(m, n), axis=1), (m * n).sum(axis=1))
    volume = np.einsum("ij,ij->", first[faces[:, 0]], np.cross(first[faces[:, 1]], first[faces[:, 2]]))
    outward = np.sign(volume) * ((d - a) * m).sum(axis=1) < 0.0
    creases = np.linalg.norm(b - a, axis=1)[outward & (angle > CREASE)].sum()
    corners = first[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    return bool(creases > EDGED * np.sqrt(area))


def has_edges(body) -> bool:
    """True if edges and triangles of a body meet sharp colliders."""
    return body.is_sheet and not body.self_collision


def has_edge_contacts(scene: Scene) -> bool:
    """True if a cloth of a scene meets a sharp collider by its edges, in runs without gradients by sweeps or explicit steps."""
    return scene.contact_width == 0.0 and any(map(has_edges, scene.bodies())) and any(map(has_sharp_edges,
                                                                                        point_contact_colliders(scene)))


def point_contact_colliders(scene: Scene) -> list[Collider]:
    """Colliders of a scene, and those of its rigid bodies that meet points."""
    return [*scene.colliders, *method_colliders(scene)]


def warn_of_gradients(scene: Scene) -> Problem:
    """What a run with gradients says of a scene that `has_edge_contacts`: its cloths meet colliders by points alone."""
    cloth, collider = _sharp_contact_example(scene)
    return object_warning(cloth,
                          f"its edges meet {collider} without gradients, and not in this simulation with gradients=True, where "
                          "points alone meet it: contacts of edges have no derivative, and the two differ",
                          "a collider without sharp edges",
                          "round it, or compare with a simulation that has gradients=True too")


def warn_of_newton(scene: Scene) -> Problem:
    """What a run by Newton's method says of a scene that `has_edge_contacts`."""
    cloth, collider = _sharp_contact_example(scene)
    return object_warning(cloth, f"its points alone meet {collider} by wsim:solver = implicit, and sharp edges may stand out "
                          "of the cloth between them", "explicit, xpbd or auto, by which its edges meet it too",
                          "name one of these, or turn wsim:selfCollision on")


def _sharp_contact_example(scene: Scene) -> tuple[str, str]:
    """Paths of a cloth and of a sharp collider."""
    return next(filter(has_edges, scene.bodies())).path, next(filter(has_sharp_edges, point_contact_colliders(scene))).path
