"""Mass, centre and inertia of solids of uniform density, of the shapes that colliders have. NumPy only, float64.

Solids of revolution about z, of height 2 h and radius r:

    sphere    V = 4/3 pi r^3          I = 2/5 m r^2
    cylinder  V = 2 pi r^2 h          I_z = 1/2 m r^2        I_x = m (3 r^2 + 4 h^2) / 12
    cone      V = 2/3 pi r^2 h        I_z = 3/10 m r^2       I_x = m (3/20 r^2 + 3/80 (2 h)^2), the centre h/2 below the middle
    capsule   a cylinder and two half balls, whose centres are 3/8 r beyond its ends

A closed mesh, with corners in one place as one and faces wound alike, is a sum of signed tetrahedra from one point to its
triangles: of one with corners 0, a, b, c, V = a . (b x c) / 6 and the centre (a + b + c) / 4; the integral of x x^T is
V / 20 (s s^T + a a^T + b b^T + c c^T), s = a + b + c (Tonon 2004, section 3). Inertia is tr(C) - C of the integral C about the
centre.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from wsim.geometry.convex_hull import ConvexHull, DegenerateHull, convex_hull
from wsim.geometry.memo import keep_latest_results
from wsim.geometry.rotation import matrix_quat, quat_conjugate, quat_product, quaternion_to_matrix, unit_quat
from wsim.geometry.triangulate import triangulate_polygons
from wsim.geometry.winding import wound_alike
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, Shape, Surface
from wsim.scene.check.signed_distance import is_closed_mesh
from wsim.scene.solids import Box, Capsule, Cone, Cylinder, Plane, Sphere, shape_row


@dataclass(frozen=True)
class MassVolume:
    """volume [m^3]; center [m]; inertia (3, 3) about the center per density [m^5]."""

    volume: float
    center: np.ndarray
    inertia: np.ndarray

    def moved(self, M: np.ndarray) -> "MassVolume":
        """The volume in a frame that M (4, 4), rigid, leads to."""
        R = M[:3, :3]
        return MassVolume(self.volume, R @ self.center + M[:3, 3], R @ self.inertia @ R.T)

    def shift_origin(self, x) -> "MassVolume":
        """The volume with its frame's origin at x (3,) [m]."""
        return MassVolume(self.volume, self.center + np.asarray(x), self.inertia)


@dataclass(frozen=True)
class Inertia:
    """mass [kg]; center (3,) [m]; moments (3,) [kg m^2] about it, ascending, along axes, (x, y, z, w) to the body's frame."""

    mass: float
    center: np.ndarray
    moments: np.ndarray
    axes: np.ndarray


SIDES = 32                 # of an outline
SMALL = 512                # hulls that are kept: a decomposition has many, of a few kilobytes each
MOST = 128                 # vertices of a hull: more are left out, those that stand out least
APPROXIMATED = ("convexHull", "boundingCube", "boundingSphere")
NOTHING = MassVolume(0.0, np.zeros(3), np.zeros((3, 3)))


def shape_volume(shape: Shape) -> MassVolume:
    """Volume of a shape in its own frame. A plane and an open mesh have none: 0."""
    if isinstance(shape, Plane):
        return NOTHING
    if isinstance(shape, Surface):
        return _mesh_volume_moments(shape)
    if isinstance(shape, Box):
        a = np.array(shape.half, np.float64)
        V = 8.0 * a.prod()
        return MassVolume(V, np.zeros(3), np.diag(V / 3.0 * ((a * a).sum() - a * a)))
    if not isinstance(shape, (Sphere, Cylinder, Cone, Capsule)):
        return _mesh_volume_moments(shape_outline_mesh(shape))
    V, z, across, along = _round_shape_moments(shape)
    return MassVolume(V, np.array([0.0, 0.0, z]), np.diag([across, across, along]))


def shape_outline_mesh(shape: Any) -> Surface:
    """A shape of another place as the mesh of its outline."""
    own = shape_row(shape)
    points, triangles = own.outline(own.given(shape), SIDES)
    return Surface(points, np.full(len(triangles), 3), np.ravel(triangles))


def collider_volume(collider: Collider) -> MassVolume:
    """Volume of a body's collider in the body's frame: of a mesh, what its approximation makes of it where that is a hull, a
    box or a ball, else what it encloses."""
    shape = collider.shape
    if isinstance(shape, Surface) and collider.approximation in APPROXIMATED and len(shape.points):
        solid, center = approximate_shape(shape, collider.approximation)
        return NOTHING if solid is None else shape_volume(solid).shift_origin(center).moved(collider.motion.at(0.0))
    return shape_volume(shape).moved(collider.motion.at(0.0))


def approximate_shape(shape: Surface, name: str) -> tuple[Shape | None, np.ndarray]:
    """What an approximation (`APPROXIMATED`) makes of a mesh, and where its middle is (3,) [m]; None: it has no volume."""
    points = shape.points.astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    if name == "boundingSphere":
        ball = Sphere(float(np.linalg.norm(points - middle, axis=1).max()))
        return ball if half.max() > 0.0 else None, middle
    if name == "boundingCube":
        return Box(tuple(half.tolist())) if half.min() > 0.0 else None, middle
    found = mesh_convex_hull(shape)
    if found is None:
        return None, np.zeros(3)
    met = Surface(found.vertices, np.array([len(loop) for loop in found.loops]), np.concatenate(found.loops))
    # the hull may lack some vertices
    return shape if shape_volume(shape).volume >= shape_volume(met).volume else met, np.zeros(3)


@partial(keep_latest_results, most=SMALL)
def _cached_convex_hull(points: np.ndarray) -> ConvexHull | None:
    try:
        return convex_hull(points, MOST)
    except DegenerateHull:
        return None


def mesh_convex_hull(shape: Surface) -> ConvexHull | None:
    """Convex hull that a mesh is met as; None where there is no volume."""
    return _cached_convex_hull(shape.points)


def _round_shape_moments(shape: Sphere | Cylinder | Cone | Capsule) -> tuple[float, float, float, float]:
    """Volume, height of the centre, inertia across the axis and along it."""
    r = shape.radius
    if isinstance(shape, Sphere):
        V = 4.0 / 3.0 * np.pi * r**3
        return V, 0.0, 0.4 * V * r * r, 0.4 * V * r * r
    h = shape.half_height
    if isinstance(shape, Cone):
        V = 2.0 / 3.0 * np.pi * r * r * h
        return V, -0.5 * h, V * (0.15 * r * r + 0.15 * h * h), 0.3 * V * r * r
    V = 2.0 * np.pi * r * r * h
    across, along = V * (3.0 * r * r + 4.0 * h * h) / 12.0, 0.5 * V * r * r
    if isinstance(shape, Capsule):
        ends = 4.0 / 3.0 * np.pi * r**3
        about = 0.4 * r * r - (0.375 * r) ** 2                 # of a half ball about its own centre, across
        V, across, along = (V + ends, across + ends * (about + (h + 0.375 * r) ** 2), along + 0.4 * ends * r * r)
    return V, 0.0, across, along


def _mesh_volume_moments(shape: Surface) -> MassVolume:
    """A mesh wound inward counts as the solid inside it."""
    points = np.asarray(shape.points, np.float64)
    triangles = wound_alike(points, triangulate_polygons(shape.points, shape.counts, shape.indices, True)[0])
    if not is_closed_mesh(points, triangles):
        return NOTHING
    middle = points.mean(axis=0)
    a, b, c = np.moveaxis(points[triangles] - middle, 1, 0)
    V = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    total = V.sum()
    if total == 0.0:
        return NOTHING
    s = a + b + c
    center = (V[:, None] * s).sum(axis=0) / (4.0 * total)
    C = sum(np.einsum("i,ij,ik->jk", V / 20.0, u, u) for u in (s, a, b, c)) - total * np.outer(center, center)
    inertia = np.trace(C) * np.eye(3) - C
    sign = np.sign(total)
    return MassVolume(abs(total), center + middle, sign * inertia)


def sum_volumes(parts: list[MassVolume]) -> MassVolume:
    """Volume of several, each of density 1; what overlaps counts twice, as USD has it."""
    total = sum(p.volume for p in parts)
    if total == 0.0:
        return NOTHING
    center = sum((p.volume * p.center for p in parts), np.zeros(3)) / total
    inertia = np.zeros((3, 3))
    for p in parts:
        d = p.center - center
        inertia += p.inertia + p.volume * (d @ d * np.eye(3) - np.outer(d, d))
    return MassVolume(total, center, inertia)


def principal_axes(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments (3,) and axes (x, y, z, w) of a symmetric (3, 3); a diagonal one keeps its own axes, and so
    does one that is not finite."""
    if not np.isfinite(inertia).all() or np.abs(inertia - np.diag(np.diag(inertia))).max() <= 1e-12 * np.abs(inertia).max():
        return np.diag(inertia).copy(), np.array([0.0, 0.0, 0.0, 1.0])
    moments, R = np.linalg.eigh(inertia)
    return moments, matrix_quat(R * np.sign(np.linalg.det(R)))


def sort_moments(moments: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same inertia with its moments in order, as kernels/rigid/motion.py has them."""
    if moments[0] <= moments[1] <= moments[2]:
        return moments, axes
    order = np.argsort(moments, kind="stable")
    R = np.eye(3)[:, order]
    return moments[order], quat_product(axes, matrix_quat(R * np.sign(np.linalg.det(R))))


def inertia_axis_directions(body: Body, now: Inertia) -> np.ndarray:
    """Directions of the axes of `now`, (3, 3) columns, in those that the body's inertia is given along (none is given: those
    that `body_inertia` finds)."""
    given = unit_quat(body.axes) if body.inertia is not None else body_inertia(body).axes
    return quaternion_to_matrix(quat_product(quat_conjugate(given), now.axes))


def reweigh_inertia(body: Body, now: Inertia, name: str, value) -> Inertia:
    """`now` with another mass [kg], which the moments follow where the body gives none, or other moments [kg m^2], in the order
    in which the body has them."""
    if name == "mass":
        part = 1.0 if body.inertia is not None else float(value) / now.mass
        return Inertia(float(value), now.center, part * now.moments, now.axes)
    given = unit_quat(body.axes) if body.inertia is not None else body_inertia(body).axes
    return Inertia(now.mass, now.center, *sort_moments(np.asarray(value, np.float64), given))


def body_inertia(body: Body) -> Inertia:
    """Inertia of a body: what is given, else of its colliders; a given mass scales the inertia of the colliders, and a given
    centre moves it."""
    whole = sum_volumes([collider_volume(c) for c in body.colliders])
    mass = body.density * whole.volume if body.mass is None else body.mass
    center = whole.center if body.center is None else body.center
    if body.inertia is not None:
        return Inertia(mass, center, *sort_moments(body.inertia, unit_quat(body.axes)))
    d = center - whole.center
    own = whole.inertia / whole.volume if whole.volume > 0.0 else np.zeros((3, 3))
    return Inertia(mass, center, *sort_moments(*principal_axes(mass * (own + d @ d * np.eye(3) - np.outer(d, d)))))
