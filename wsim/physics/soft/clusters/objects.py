"""Clusters of points that keep their shape, in a scene: plain data in SI units, NumPy only."""

from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np

from wsim.physics.soft.clusters.groups import cells_of_points, group_starts, kept_groups
from wsim.scene.bodies import BodyGeometry, Deformable
from wsim.scene.curve import Motion
from wsim.scene.values.arrays import contiguous_array, polygon_corners, real_array


@dataclass(eq=False)
class Clusters(Deformable):
    """Points that shape matching keeps in clusters, as in `scene.clusters("/jelly", points, mass=1.0, stiffness=4e3)`. Each
    cluster is pulled to its rest shape, turned and moved to where it fits best (Mueller, Heidelberger, Teschner, Gross 2005).

    path                prim path
    points              (n, 3) [m], own frame, float32 or float64
    masses              of each point, (n,) [kg]; None: `mass` in even parts
    mass                of the whole body [kg]; used where masses is None
    counts              corners of each polygon of a surface, (faces,), or its triangles (t, 3); none: it is a cloud of points
    indices             point of each corner, (sum of counts,)
    stiffness           force on a point over its mass and its distance from the matched shape [1/s^2]: a cluster alone vibrates
                        at its square root [rad/s]; inf: rigid
    damping             relaxation time of the elastic forces [s]: a cluster alone has the damping ratio
                        sqrt(stiffness) damping / 2
    spacing             edge of the cubes whose points make a cluster each [m]; inf: one cluster of all points
    overlap             part of `spacing` by which cubes reach beyond their faces, from 0 to 1 [1]; below 0.5 a point is in few
    sizes               number of points of each cluster, (clusters,) [1], where spacing is not to say; None: by spacing
    members             indices of points [1], cluster behind cluster, (sum of sizes,)
    yield_strain        strain (Frobenius norm of the stretch less 1) beyond which the rest shape flows [1]; inf: never
    creep               rate at which it flows [1/s]
    max_strain          plastic strain that it keeps at most [1]
    radius              distance that colliders keep from its points [m]
    motion              own frame to world at the start, lengths [m]
    velocities          at the start, (n, 3) [m/s], own frame; None: at rest
    rest_points         shape that is kept, (n, 3) [m], own frame; None: points
    static_friction     coefficient of friction [1] up to which a contact sticks
    dynamic_friction    coefficient of friction of a contact that slides [1]
    self_collision      True: its surface passes neither through itself, nor others that say so, nor mesh colliders and boxes;
                        without a surface its points are balls of `radius` that touch particles, surfaces, other such clouds

    Raises ValueError, with the path and the name, where an array holds no numbers or rows of another length. Numbers out of
    their range, and clusters whose points lie in a line, raise SceneError when a `Simulation` is made.
    """

    noun, is_cluster = "shape-matching body", True
    mesh_fields = ("counts", "indices")

    path: str
    points: np.ndarray
    masses: np.ndarray | None = None
    mass: float | None = None
    counts: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    indices: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    stiffness: float = 1e4
    damping: float = 0.0
    spacing: float = inf
    overlap: float = 0.25
    sizes: np.ndarray | None = None
    members: np.ndarray | None = None
    yield_strain: float = inf
    creep: float = 0.0
    max_strain: float = inf
    radius: float = 0.0
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    rest_points: np.ndarray | None = None
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    self_collision: bool = False

    def __post_init__(self):
        self.points, self.masses = real_array(self.points, -1, 3), real_array(self.masses, -1)
        self.counts, self.indices = polygon_corners(self.path, self.counts, self.indices)
        self.sizes, self.members = contiguous_array(self.sizes, np.int32, -1), contiguous_array(self.members, np.int32, -1)
        self.velocities, self.rest_points = real_array(self.velocities, -1, 3), real_array(self.rest_points, -1, 3)

    @property
    def flows(self) -> bool:
        """True if its rest shape may flow."""
        return isfinite(self.yield_strain) and self.creep > 0.0

    @property
    def loses_energy(self) -> bool:
        """See `Deformable`."""
        return self.flows or self.damping > 0.0

    @property
    def meets_as_balls(self) -> bool:                                  # type: ignore[override]
        """See `Deformable`: a cloud of points that collides does."""
        return self.self_collision and not len(self.counts)

    @property
    def is_rigid_cluster(self) -> bool:                                # type: ignore[override]
        """See `Deformable`."""
        return self.stiffness == inf

    @property
    def has_surface(self) -> bool:
        """See `Deformable`."""
        return len(self.counts) > 0

    @property
    def groups(self) -> list[np.ndarray]:
        """Points of each cluster, in the author's order."""
        if self.sizes is not None:
            members = np.zeros(0, np.int32) if self.members is None else self.members
            return np.split(members, group_starts(self.sizes)[1:-1])
        places = np.asarray(self.points if self.rest_points is None else self.rest_points, np.float64)
        return kept_groups(places, cells_of_points(places, self.spacing, self.overlap))

    def point_masses(self) -> np.ndarray:
        """Mass of each point [kg], (n,); none where the scene gives none."""
        n = len(self.points)
        if self.masses is not None:
            return np.broadcast_to(np.asarray(self.masses, np.float64), n).copy()
        return np.full(n, (self.mass or 0.0) / max(n, 1))

    def geometry(self, places: np.ndarray) -> BodyGeometry:
        """See `Deformable`."""
        rest, n, triangles = self.rest_places(), len(places), self.surface_triangles()
        return BodyGeometry(rest - rest.mean(axis=0), self.point_masses(), np.full(n, self.radius), np.arange(n), triangles,
                            np.arange(len(triangles)))

    def surface_faces(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Deformable`."""
        return self.counts, self.indices

    def surface_triangles(self) -> np.ndarray:
        """See `Deformable`."""
        if not len(self.counts):
            return np.zeros((0, 3), np.int32)
        from wsim.geometry.triangulate import triangulate_polygons
        return triangulate_polygons(self.points, self.counts, self.indices)[0]

    def held_points(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Deformable`. Points of a cluster hold each other, as if by the first of them."""
        pairs = [np.stack([np.full(len(g) - 1, g[0]), g[1:]], axis=1) for g in self.groups if len(g) > 1]
        return np.concatenate([np.zeros((0, 2), np.int32), *pairs]), np.concatenate([np.zeros(0, np.int32), *self.groups])

    def least_reach(self) -> float:
        """See `Deformable`."""
        return self.radius

    def stiffness_at_point(self) -> float:
        """See `Deformable`."""
        k = self.stiffness if isfinite(self.stiffness) else 1e4
        return float(k * self.point_masses().mean()) if len(self.points) else 1.0

    def kernel_traits(self) -> set[tuple]:
        """See `Deformable`."""
        return {(self.flows, self.damping > 0.0)}
