"""Rods of a scene: plain data in SI units, NumPy only.

A prim holds many strands, all of one material, of round cross-section and any shape at rest. A strand's first and last points
are free unless pins hold them; two points in a row held by one pin hold the frame of the edge between them too: it is clamped.
"""

from dataclasses import dataclass, field

import numpy as np

from wsim.geometry.topology import first_face_corners
from wsim.scene import Collider, Pin, Problem, SceneError, Surface, shapes
from wsim.scene.bodies import PointObject
from wsim.scene.curve import Motion
from wsim.scene.methods import method_file
from wsim.scene.solids import shape_row
from wsim.scene.values.arrays import contiguous_array, demand_kind, real_array

LEAST = 3                          # points of a strand that can bend, and of a closed one


@dataclass(eq=False)
class Rods(PointObject):
    """Strands that stretch, bend and twist (Kirchhoff rods: cross-sections stay across their centre line), as in
    `scene.rods("/rope", [(0.1 * k, 1, 0) for k in range(9)], counts=[9], diameters=0.01)`.

    path                prim path
    points              (n, 3) [m], own frame, strand behind strand
    counts              points of each strand, (strands,), 2 or more
    diameters           of each point, (n,), or one for all, (1,) [m]
    young               Young's modulus [Pa]
    poisson             Poisson's ratio [1]
    density             [kg/m^3]
    stretch             stiffness E A [N]; None: from young and the diameter
    bend                stiffness E I [N m^2]; None: likewise
    twist               stiffness G J [N m^2]; None: likewise
    motion              own frame to world at the start, lengths [m]
    velocities          at the start, (n, 3) [m/s], own frame; None: at rest
    rest_points         shape without strain, (n, 3) [m], own frame; None: points
    directors           a direction across each edge, that of its first point, (n, 3) [1], own frame: twist at the start; None:
                        none
    rest_directors      likewise without strain, (n, 3) [1]; None: none
    masses              of each point, (n,) [kg]; None: from the density
    static_friction     coefficient of friction [1] up to which a contact sticks
    dynamic_friction    coefficient of friction of a contact that slides [1]
    damping             relaxation time of the elastic forces [s], of stretching, bending and twisting
    drag                drag coefficient of the air across an edge, on its length times its diameter [1]
    skin_drag           drag coefficient along it, on its surface [1]
    closed              True: the last point of each strand is joined to its first, as in a ring; 3 or more points each
    self_collision      True: its strands pass neither through themselves, nor other strands, cloth and soft bodies that say so
    pins                `Pin`s of its points
    """

    noun, plural = "rods", True
    refused = {"tie": "rods share no points with other bodies"}        # noqa: RUF012  (nobody changes it)

    path: str
    points: np.ndarray
    counts: np.ndarray
    diameters: np.ndarray | float = 1e-3
    young: float = 1e6
    poisson: float = 0.3
    density: float = 1000.0
    stretch: float | None = None
    bend: float | None = None
    twist: float | None = None
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    rest_points: np.ndarray | None = None
    directors: np.ndarray | None = None
    rest_directors: np.ndarray | None = None
    masses: np.ndarray | None = None
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    damping: float = 0.0
    drag: float = 0.0
    skin_drag: float = 0.0
    closed: bool = False
    self_collision: bool = False
    pins: list[Pin] = field(default_factory=list)

    def __post_init__(self):
        self.points, self.counts = real_array(self.points, -1, 3), contiguous_array(self.counts, np.int32, -1)
        self.diameters, self.masses = real_array(self.diameters, -1), real_array(self.masses, -1)
        for name in ("velocities", "rest_points", "directors", "rest_directors"):
            setattr(self, name, real_array(getattr(self, name), -1, 3))

    def pin(self, path: str, points, **more) -> Pin:
        """Adds a pin of some points; see `Pin` for the fields."""
        self.pins.append(Pin(path, self.path, points, **more))
        return self.pins[-1]

    def pin_roots(self, path: str, collider: Collider) -> Pin:
        """Clamps the first two points of each strand to a collider, so that it grows from there. They go along with it; on a
        mesh that a skeleton moves, each strand moves and turns with the face nearest to its root. Raises SceneError for a mesh
        whose points are animated without a skeleton."""
        first = np.cumsum(self.counts) - self.counts
        points = np.stack([first, first + 1], axis=1).ravel()
        mesh = collider.shape
        if not isinstance(mesh, Surface) or mesh.poses is None:
            return self.pin(path, points, target=collider.path, motion=collider.motion)
        if not hasattr(mesh.poses, "skeleton"):
            raise SceneError(Problem(path, f"holds strands at {collider.path}, whose points are animated; allowed are meshes "
                                     "that a skeleton or a motion moves; fix: skin it, or pin the strands by motion=..."))
        faces, skin = first_face_corners(mesh.counts, mesh.indices), method_file("Skeleton", "objects")
        x = self.motion.points(self.points, 0.0)
        roots = skin.Follow.near(mesh.poses, faces, x[first])
        return self.pin(path, points, target=collider.path, follows=skin.Follow.over_triangles(
            mesh.poses, np.repeat(roots.corners, 2, axis=0), x[points], np.repeat(roots.faces, 2)))


def strand_neighbours(counts: np.ndarray, point: int, closed: bool = False) -> tuple[list[int], list[int]]:
    """(points, edges by their first point) that touch a point: itself, those beside it. closed: of rings."""
    last = int(np.searchsorted(np.cumsum(counts), point, side="right"))
    first = int(counts[:last].sum())
    if closed:
        before, behind = (first + (point - first + step) % counts[last] for step in (-1, 1))
        return sorted({point, before, behind}), [before, point]
    edges = [p for p in (point - 1, point) if first <= p < first + counts[last] - 1]
    return sorted({point, *edges, *(p + 1 for p in edges)}), edges


def segment_ends(rods: Rods) -> np.ndarray:
    """Both points of each segment, (segments, 2), in the order of the first."""
    first = np.arange(len(rods.points))
    last = np.cumsum(rods.counts) - 1
    behind = first + 1
    behind[last] = last + 1 - rods.counts
    return np.stack([first, behind], axis=1) if rods.closed else np.delete(np.stack([first, behind], axis=1), last, axis=0)


def grow_hair(path: str, collider: Collider, number: int, length: float, where, segments: int, more: dict) -> Rods:
    """Rods that stand on a collider, clamped to it: see `Scene.hair`."""
    demand_kind(path, "collider", collider, Collider, 'scene.collider("/head", Sphere(0.1))')
    if isinstance(collider.shape, Surface):
        x = collider.shape.points if collider.shape.poses is None else collider.shape.poses.at(0.0)
        counts, indices = collider.shape.counts, collider.shape.indices
    else:
        row = shape_row(collider.shape)
        x, triangles = row.outline(row.given(collider.shape), 64)
        counts, indices = np.full(len(triangles), 3), triangles.ravel()
    try:
        grown = shapes.grow_strands(collider.motion.points(x, 0.0), counts, indices, number, length, segments, where)
    except ValueError as error:
        raise SceneError(Problem(path, f"cannot grow on {collider.path}: {error}")) from None
    hair = Rods(path, *grown, **more)
    hair.pin_roots(f"{path}_roots", collider)
    return hair
