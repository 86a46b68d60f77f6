"""Which colliders rigid bodies meet, and as what: simple shapes as they are, meshes as their `approximation` says. NumPy only.

    none, meshSimplification, sdf      its triangles; its hull where it is convex, or open and of a body
    convexHull                         one hull
    convexDecomposition                hulls of convex parts (decomposition.py beside this); without coacd its triangles
    boundingCube, boundingSphere       box, ball about its middle

A shape of another place (a row of wsim/scene/solids.py) is met as the hull of its outline, of 32 sides.

Triangles of a mesh that is not closed hold from both sides. Flat meshes have no hull: of a body they meet nothing. Meshes that
move their points are not met.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from wsim.geometry.convex_hull import ConvexHull, convex_hull
from wsim.geometry.memo import keep_latest_results
from wsim.geometry.triangulate import triangulate_polygons
from wsim.geometry.winding import wound_alike
from wsim.physics.rigid.mass import MOST, approximate_shape, mesh_convex_hull, shape_outline_mesh, shape_volume
from wsim.physics.rigid.solids.decomposition import NoParts, convex_parts
from wsim.scene import Collider, Surface
from wsim.scene.attachments import body_ties
from wsim.scene.methods import driving_bodies
from wsim.scene.solids import Box, Capsule, Cone, Cylinder, Plane, Shape, Sphere, shape_row

EXACT = (Plane, Sphere, Box, Capsule, Cylinder, Cone)
MESHES = 64                # different meshes whose figures are kept
CONVEX = 0.01              # part of a hull's volume that a mesh may lack and count as convex
NOWHERE = (0.0, 0.0, 0.0)
WEIGHT = 9.81              # [m/s^2] by which speeds are judged where a scene has no gravity


@dataclass(frozen=True)
class ContactShape:
    """The shape that a collider is met as.

    kind      its name, as kernels/rigid/narrow/shape.py has it
    shape     a simple shape, or None
    hull      of a mesh, or None
    mesh      (points (n, 3) [m], triangles (m, 3)) about the center, or None
    center    of its frame in the collider's, (3,) [m]; axes are the same
    """

    kind: str
    shape: Shape | None = None
    hull: ConvexHull | None = None
    mesh: tuple[np.ndarray, np.ndarray] | None = None
    center: tuple[float, float, float] = NOWHERE

    @property
    def ball(self) -> float:
        """Radius of a ball about its center that holds it [m]; -1: it has no end."""
        if self.shape is not None:
            return -1.0 if isinstance(self.shape, Plane) else shape_row(self.shape).ball(self.shape)
        points = self.hull.vertices if self.hull is not None else self.mesh[0] if self.mesh is not None else np.zeros((1, 3))
        return float(np.linalg.norm(points, axis=1).max())

    @property
    def outer_points(self) -> np.ndarray:
        """Vertices (n, 3) [m] of the hull, also of a mesh, about its center."""
        return (self.hull or convex_hull(self.mesh[0], MOST)).vertices     # type: ignore[index]

    @property
    def size(self) -> tuple:
        """Size as the device has it; of a mesh half of the edges of its bounds [m]."""
        if self.shape is not None:
            return shape_row(self.shape).size(self.shape)
        return NOWHERE if self.mesh is None else tuple(np.abs(self.mesh[0]).max(axis=0))

    @property
    def core(self) -> tuple[float, float, float, float]:
        """Centre and radius of a ball of half the size of one that fits in [m]; radius 0: there is none."""
        center, radius, shape = NOWHERE, 0.0, self.shape
        if isinstance(shape, Box):
            radius = min(shape.half)
        elif isinstance(shape, Cylinder):
            radius = min(shape.radius, shape.half_height)
        elif isinstance(shape, Cone):
            slope = shape.radius / np.hypot(shape.radius, 2.0 * shape.half_height)
            radius = slope * shape.half_height
        elif isinstance(shape, (Sphere, Capsule)):
            radius = shape.radius
        elif self.hull is not None:
            center = tuple(self.hull.vertices.mean(axis=0).tolist())
            radius = float((self.hull.offsets - self.hull.normals @ center).min())
        return (*center, 0.5 * radius)

    @property
    def skin(self) -> float:
        """Radius of what is round [m]."""
        return self.shape.radius if isinstance(self.shape, (Sphere, Capsule)) else 0.0


def hull_fill_ratio(shape: Surface) -> float:
    """Part of its hull's volume that a mesh encloses; 0 without a hull, or where the mesh is open."""
    return _filled_part_of_hull(shape.points, shape.counts, shape.indices)


@partial(keep_latest_results, most=MESHES)
def _filled_part_of_hull(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> float:
    shape = Surface(points, counts, indices)
    own = shape_volume(shape).volume
    found = mesh_convex_hull(shape) if own > 0.0 else None
    if found is None:
        return 0.0
    corners = np.array([len(loop) for loop in found.loops])
    return own / shape_volume(Surface(found.vertices, corners, np.concatenate(found.loops))).volume


def _mesh_contact_shape(shape: Surface, of_body: bool = False) -> ContactShape | None:
    """A mesh as it is; of a body with its faces outward."""
    triangles = wound_alike(shape.points, triangulate_polygons(shape.points, shape.counts, shape.indices, of_body)[0])
    if len(triangles) == 0:
        return None
    if of_body:
        a, b, c = np.moveaxis(shape.points[triangles].astype(np.float64) - shape.points.mean(axis=0), 1, 0)
        triangles = triangles[:, ::-1] if np.einsum("ij,ij->", a, np.cross(b, c)) < 0.0 else triangles
    used = shape.points[np.unique(triangles)].astype(np.float64)
    middle = 0.5 * (used.min(axis=0) + used.max(axis=0))
    return ContactShape("mesh", mesh=(shape.points - middle, triangles), center=tuple(middle.tolist()))


def contact_shape_of(collider: Collider, of_body: bool) -> ContactShape | None:
    """None: bodies pass through it."""
    shape = collider.shape
    if not collider.meets:
        return None
    if not isinstance(shape, Surface):
        return (ContactShape(shape_row(shape).kind, shape) if isinstance(shape, EXACT)
                else ContactShape("hull", hull=mesh_convex_hull(shape_outline_mesh(shape))))
    if shape.poses is not None or len(shape.points) == 0:
        return None
    if collider.approximation in ("boundingCube", "boundingSphere"):
        solid, middle = approximate_shape(shape, collider.approximation)
        return None if solid is None else ContactShape(shape_row(solid).kind, solid, center=tuple(middle.tolist()))
    fill = 1.0 if collider.approximation == "convexHull" else hull_fill_ratio(shape)
    if fill >= 1.0 - CONVEX or of_body and fill == 0.0:
        found = mesh_convex_hull(shape)
        if found is not None or of_body:
            return None if found is None else ContactShape("hull", hull=found)
    return _mesh_contact_shape(shape, of_body)


def collider_parts(colliders: list[Collider]) -> list[Collider]:
    """Colliders, and in the place of those that ask for a decomposition their convex parts, of the same path."""
    found = []
    for c in colliders:
        parts = _decomposed_parts(c) if c.approximation == "convexDecomposition" and isinstance(c.shape, Surface) else []
        found += [replace(c, shape=_cloud_of(part), approximation="convexHull") for part in parts] or [c]
    return found


def _decomposed_parts(c: Collider) -> list[np.ndarray]:
    """Vertices of the parts of a mesh; none where it is convex, or has none."""
    shape: Any = c.shape
    if shape.poses is not None or len(shape.points) == 0 or hull_fill_ratio(shape) >= 1.0 - CONVEX:
        return []
    triangles = triangulate_polygons(shape.points, shape.counts, shape.indices)[0]
    try:
        return convex_parts(shape.points, triangles) if len(triangles) else []
    except (NoParts, ImportError):                       # check.py says so
        return []


def _cloud_of(points: np.ndarray) -> Surface:
    return Surface(points, np.zeros(0, int), np.zeros(0, int))


def body_contact_parts(body) -> list[Collider]:
    """Colliders of a body that touch something, decomposed ones as their parts."""
    return [c for c in collider_parts(body.colliders) if contact_shape_of(c, True) is not None]


def fall_accelerations(gravity: np.ndarray) -> np.ndarray:
    """Size of gravity (worlds, 3) [m/s^2] in each world, (worlds,)."""
    found = np.linalg.norm(gravity, axis=1)
    return np.where(found > 0.0, found, WEIGHT)


def bodies_have_meshes(scene) -> bool:
    """True if a body touches as a concave mesh, triangle by triangle."""
    found = (contact_shape_of(c, True) for body in scene.things("Body") for c in body_contact_parts(body))
    return any(met is not None and met.kind == "mesh" for met in found)


def touching_colliders(body) -> list[Collider]:
    """Colliders of a body that touch something."""
    return [c for c in body.colliders if contact_shape_of(c, True) is not None]


def scene_contact_colliders(colliders: list[Collider]) -> list[Collider]:
    """Colliders of a scene that bodies meet."""
    return [c for c in collider_parts(colliders) if contact_shape_of(c, False) is not None]


def has_rigid_contacts(scene) -> bool:
    """True if there are two things that can touch."""
    bodies = [body for body in scene.things("Body") if touching_colliders(body)]
    return bool(bodies) and len(bodies) + len(scene_contact_colliders(scene.colliders)) > 1


def has_soft_contacts(scene) -> bool:
    """True if bodies touch as MuJoCo has it."""
    return scene.contact_model == "mujoco" and has_rigid_contacts(scene)


def enabled_joints(scene) -> list:
    """Joints of a scene that act."""
    return [joint for joint in scene.things("Joint") if joint.enabled]


def bodies_may_sleep(scene) -> bool:
    """True if something may sleep: not beside points and fluids, where others may wake it."""
    return asks_for_sleep(scene) and not (scene.bodies() or scene.things("Liquid") or scene.things("Fluid")
                                          or scene.things("MaterialPoints") or bodies_met_by_strands(scene))


def asks_for_sleep(scene) -> bool:
    """True if a scene asks for sleep."""
    return scene.sleep_speed > 0.0 or any(body.asleep for body in scene.things("Body"))


def bodies_touch_points(scene) -> bool:
    """True if bodies may touch points."""
    if not scene.bodies():
        return False
    apart = driving_bodies(scene)
    return any(touching_colliders(body) for body in scene.things("Body") if body.path not in apart)


def bodies_met_by_strands(scene) -> list[tuple]:
    """(body, its colliders) of those that rods meet, or are tied to."""
    if not scene.things("Rods"):
        return []
    apart, tied = driving_bodies(scene), {tie.other for rods in scene.things("Rods") for tie in body_ties(scene, rods.path)}
    found = [(body, touching_colliders(body)) for body in scene.things("Body") if body.path not in apart]
    return [(body, colliders) for body, colliders in found if colliders or body.path in tied]


def star_fields(b) -> tuple:
    """Fields of bodies that points touch, besides those of all bodies."""
    if not bodies_touch_points(b.scene):
        return ()
    from wsim.physics.rigid.touch import half_step
    return half_step.half_step_fields(b.choice)
