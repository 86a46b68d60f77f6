"""Cloth of a scene: plain data in SI units, NumPy only."""

from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any

import numpy as np

from wsim.geometry import topology
from wsim.geometry.triangulate import triangulate_polygons
from wsim.scene.bodies import BodyGeometry, Deformable
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric
from wsim.scene.nodal.masses import cloth_masses
from wsim.scene.values.arrays import demand_kind, polygon_corners, real_array

CLOTH_MODELS = ("membrane", "springs")


@dataclass(eq=False)
class Cloth(Deformable):
    """A surface that deforms, as in `scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, 8, 8), material=fabric("silk"))`. Polygons
    as authored; `wsim.geometry.triangulate` cuts them into triangles.

    path           prim path
    points         (n, 3) [m], own frame, float32 or float64
    counts         corners of each polygon, (faces,); or, without indices, the corners of triangles (t, 3) or quads (t, 4)
    indices        point of each corner, (sum of counts,)
    material       a `Fabric`
    motion         own frame to world at the start, lengths [m]
    velocities     at the start, (n, 3) [m/s], own frame; None: at rest
    rest_points    shape without strain, (n, 3) [m], own frame; None: points
    masses         of each point, (n,) [kg]; None: from the material's density
    mass           of the whole cloth [kg]; used where masses is None
    thicknesses    of each point, (n,) [m]; None: the material's thickness
    model          in-plane elasticity: "membrane" (strain of triangles) or "springs" (edges)
    flat           True: it bends from flat; False: from the angles of its rest shape
    weld           points closer than this are one particle [m] (seams); 0: none
    tethers        long-range attachments to the nearest pin
    drag           aerodynamic drag coefficient [1], along the relative wind; it replaces the `normal_drag` of the material, so
                   that 0 is no drag at all. None: the material's `normal_drag`, which presets have
    lift           aerodynamic lift coefficient [1], across the relative wind
    stretches      stiffness of each polygon, (faces,) [N/m], shear and weft in its ratio; None: the material's
    bends          of each polygon, (faces,) [N m]; None: the material's bend
    self_collision    True: it passes neither through itself, nor other surfaces that say so, nor mesh colliders and boxes
    """

    noun, is_sheet = "cloth", True
    mesh_fields = ("counts", "indices", "weld")

    path: str
    points: np.ndarray
    counts: np.ndarray
    indices: Any = None
    material: Fabric = field(default_factory=Fabric)
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    rest_points: np.ndarray | None = None
    masses: np.ndarray | None = None
    mass: float | None = None
    thicknesses: np.ndarray | None = None
    model: str = "membrane"
    flat: bool = True
    weld: float = 0.0
    tethers: bool = False
    drag: float | None = None
    lift: float = 0.0
    stretches: np.ndarray | None = None
    bends: np.ndarray | None = None
    self_collision: bool = False

    def __post_init__(self):
        demand_kind(self.path, "material", self.material, Fabric, 'wsim.fabric("silk")')
        self.points = real_array(self.points, -1, 3)
        self.counts, self.indices = polygon_corners(self.path, self.counts, self.indices)
        self.velocities = real_array(self.velocities, -1, 3)
        self.rest_points = real_array(self.rest_points, -1, 3)
        self.masses, self.thicknesses = real_array(self.masses, -1), real_array(self.thicknesses, -1)
        self.stretches, self.bends = real_array(self.stretches, -1), real_array(self.bends, -1)

    @property
    def air(self) -> dict[str, float]:
        """Coefficients that count: drag [1], lift [1], normal_drag [kg/(m^2 s)]."""
        own = self.material.normal_drag if self.drag is None else 0.0
        return {"drag": self.drag or 0.0, "lift": self.lift, "normal_drag": own}

    @property
    def materials(self) -> list[Fabric]:
        """The one material."""
        return [self.material]

    def geometry(self, places: np.ndarray) -> BodyGeometry:
        """See `Deformable`."""
        triangles, polygon = triangulate_polygons(self.points, self.counts, self.indices)
        rest = self.rest_places()
        rest, masses = rest - rest.mean(axis=0), cloth_masses(self, triangles, rest)
        particle = topology.weld_points(places, self.weld) if self.weld > 0.0 else np.arange(len(places))
        thick = np.full(len(places), self.material.thickness) if self.thicknesses is None else self.thicknesses
        return BodyGeometry(rest, masses, 0.5 * thick, particle, triangles, polygon)

    def masses_at_rest(self, rest: np.ndarray) -> np.ndarray | None:
        """See `Deformable`."""
        return cloth_masses(self, self.surface_triangles(), rest)

    def surface_faces(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Deformable`."""
        return self.counts, self.indices

    def surface_triangles(self) -> np.ndarray:
        """See `Deformable`."""
        return triangulate_polygons(self.points, self.counts, self.indices)[0]

    def held_points(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Deformable`."""
        edges = topology.edges_of_triangles(self.surface_triangles())
        if self.weld > 0.0:                       # a duplicate of a seam goes with the particle that it is welded to
            particle = topology.weld_points(self.motion.points(self.points), self.weld)
            first = np.unique(particle, return_index=True)[1]
            edges = np.concatenate([edges, np.stack([np.arange(len(self.points)), first[particle]], axis=1)])
        return edges, self.indices

    def least_reach(self) -> float:
        """See `Deformable`."""
        return 0.5 * float(self.material.thickness if self.thicknesses is None else self.thicknesses.min(initial=inf))

    def stiffness_at_point(self) -> float:
        """See `Deformable`."""
        return self.material.stretch

    def kernel_traits(self) -> set[tuple]:
        """See `Deformable`."""
        m = self.material
        return {(self.model, m.damping > 0, m.bend > 0, isfinite(m.strain_limit), self.tethers)}
