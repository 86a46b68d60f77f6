"""Soft bodies of a scene, and meshes that follow them: plain data in SI units, NumPy only."""

from dataclasses import dataclass, field
from math import inf

import numpy as np

from wsim.scene.bodies import ArrayDataclass, BodyGeometry, Deformable
from wsim.scene.curve import Motion
from wsim.scene.nodal.masses import soft_masses, soft_weights
from wsim.scene.solid import Bulk
from wsim.scene.values.arrays import contiguous_array, demand_kind, polygon_corners, real_array


@dataclass(eq=False)
class Skin(ArrayDataclass):
    """A mesh that is only seen: each point follows the tet of its soft body that it lies in (USD: a Mesh of the body), as in
    `jelly.skins.append(Skin("/jelly/skin", *shapes.box((0.1, 0.1, 0.1))))`.

    path       prim path
    points     (m, 3) [m], the soft body's own frame, where its rest (bind) pose is, float32
    counts     corners of each polygon, (faces,), or its triangles (t, 3), so that it can be saved
    indices    point of each corner, (sum of counts,)
    """

    path: str
    points: np.ndarray
    counts: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    indices: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))

    def __post_init__(self):
        self.points = contiguous_array(self.points, np.float32, -1, 3)
        self.counts, self.indices = polygon_corners(self.path, self.counts, self.indices)


@dataclass(eq=False)
class Soft(Deformable):
    """A solid of tetrahedra that deforms, as in `scene.soft("/cube", *shapes.block((0.2, 0.2, 0.2), 3),
    material=Bulk(young=2e4))`. Volumes are positive: `wsim.geometry.tetra.repair` turns others.

    path           prim path
    points         (n, 3) [m], own frame, float32 or float64
    tets           corners of each tet, (t, 4)
    material       a `Bulk`
    others         further materials of some tets, list of `Bulk`
    which          material of each tet, (t,): 0 is `material`, k is others[k - 1]; None: all 0
    motion         own frame to world at the start, lengths [m]
    velocities     at the start, (n, 3) [m/s], own frame; None: at rest
    rest_points    shape without strain, (n, 3) [m], own frame; None: points
    masses         of each point, (n,) [kg]; None: from the material's density
    mass           of the whole body [kg]; used where masses is None
    filled         share of each tet of a cage that is body, (t,) [1]: weighs mass and stiffness; None: all of it
    pressure       inside above that outside [Pa]: in its hollows, or where it has none on its surface
    quadratic      ten-node tets: accurate from 2 cells across, where four nodes need 4 and more
    skins          meshes that follow it, list of `Skin`
    self_collision    True: its surface passes neither through itself, nor others that say so, nor mesh colliders and boxes
    """

    noun, is_solid = "soft body", True
    mesh_fields = ("tets", "quadratic")

    path: str
    points: np.ndarray
    tets: np.ndarray
    material: Bulk = field(default_factory=Bulk)
    others: list[Bulk] = field(default_factory=list)
    which: np.ndarray | None = None
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    rest_points: np.ndarray | None = None
    masses: np.ndarray | None = None
    mass: float | None = None
    filled: np.ndarray | None = None
    pressure: float = 0.0
    quadratic: bool = False
    skins: list[Skin] = field(default_factory=list)
    self_collision: bool = False

    def __post_init__(self):
        for material in self.materials:
            demand_kind(self.path, "material", material, Bulk, "wsim.Bulk(young=2e4)")
        self.points, self.tets = real_array(self.points, -1, 3), contiguous_array(self.tets, np.int32, -1, 4)
        self.which, self.filled = contiguous_array(self.which, np.int32, -1), real_array(self.filled, -1)
        self.velocities = real_array(self.velocities, -1, 3)
        self.rest_points = real_array(self.rest_points, -1, 3)
        self.masses = real_array(self.masses, -1)

    @property
    def materials(self) -> list[Bulk]:
        """All materials, in the order that `which` counts."""
        return [self.material, *self.others]

    def geometry(self, places: np.ndarray) -> BodyGeometry:
        """See `Deformable`."""
        from wsim.geometry.tetra import tets
        rest, triangles = self.rest_places(), self.surface_triangles()
        rest = rest - rest.mean(axis=0)
        masses, idle = soft_masses(self, rest)
        shape = BodyGeometry(rest, masses, np.zeros(len(places)), np.arange(len(places)), triangles, np.arange(len(triangles)),
                             tets.edges_of_tets(self.tets), self.tets, idle)
        if not self.quadratic:
            return shape
        from wsim.model.midnodes import with_middles
        return with_middles(shape, soft_weights(self))

    def masses_at_rest(self, rest: np.ndarray) -> np.ndarray | None:
        """See `Deformable`. Of quadratic tets those of the middles of edges stand behind."""
        masses = soft_masses(self, rest)[0]
        if not self.quadratic:
            return masses
        from wsim.model.midnodes import lump_node_masses
        return lump_node_masses(masses, soft_weights(self), rest, self.tets)[0]

    def surface_faces(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Deformable`."""
        surface = self.surface_triangles()
        return np.full(len(surface), 3), surface.ravel()

    def surface_triangles(self) -> np.ndarray:
        """See `Deformable`."""
        from wsim.geometry.tetra.tets import tet_surface_triangles
        return tet_surface_triangles(self.tets)

    def held_points(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Deformable`."""
        from wsim.geometry.tetra.tets import edges_of_tets
        return edges_of_tets(self.tets), self.tets.reshape(-1)

    def stiffness_at_point(self) -> float:
        """See `Deformable`."""
        if not len(self.tets) or self.tets.min() < 0 or self.tets.max() >= len(self.points):
            return 1.0                                             # reported by `wsim.physics.soft.check`
        x, (a, b) = self.rest_places(), self.held_points()[0].T
        return self.material.young * float(np.linalg.norm(x[b] - x[a], axis=1).mean())

    def kernel_traits(self) -> set[tuple]:
        """See `Deformable`."""
        return {(m.model, m.damping > 0, m.yield_strain < inf, self.pressure != 0.0, self.quadratic) for m in self.materials}
