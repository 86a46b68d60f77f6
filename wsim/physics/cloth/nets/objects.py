"""Spring nets of a scene: plain data in SI units, NumPy only."""

from dataclasses import dataclass, field

import numpy as np

from wsim.scene.bodies import BodyGeometry, Deformable
from wsim.scene.curve import Curve, Motion
from wsim.scene.values.arrays import contiguous_array, real_array


@dataclass(eq=False)
class Springs(Deformable):
    """A net of linear springs between own points, as in `scene.net("/rope", [(0, 0, 0), (1, 0, 0)], [(0, 1)],
    stiffness=[100.0], masses=[0.1])`. With `actuation` some are muscles: their rest length is multiplied by the factor of
    their group, which changes over time.

    path                prim path
    points              (n, 3) [m], own frame, float32 or float64
    edges               points of each spring, (m, 2)
    stiffness           (m,) or (1,) for all [N/m]
    masses              (n,) or (1,) for all [kg]
    lengths             rest lengths, (m,) [m]; None: those of points
    damping             relaxation time of the elastic forces [s]
    radius              distance that colliders keep from its points [m]
    motion              own frame to world at the start, lengths [m]
    velocities          at the start, (n, 3) [m/s], own frame; None: at rest
    static_friction     coefficient of friction [1] up to which a contact sticks
    dynamic_friction    coefficient of friction of a contact that slides [1]
    actuation           factors of rest lengths over time, values (keys, groups), > 0 [1], linear between keys
    muscles             group of each spring, (m,), -1: passive; None: all are of group 0
    """

    noun, model, is_net = "spring net", "springs", True
    mesh_fields = ("edges",)

    path: str
    points: np.ndarray
    edges: np.ndarray
    stiffness: np.ndarray
    masses: np.ndarray
    lengths: np.ndarray | None = None
    damping: float = 0.0
    radius: float = 0.0
    motion: Motion = field(default_factory=Motion.still)
    velocities: np.ndarray | None = None
    static_friction: float = 0.5
    dynamic_friction: float = 0.5
    actuation: Curve | None = None
    muscles: np.ndarray | None = None

    def __post_init__(self):
        self.muscles = contiguous_array(self.muscles, np.int32, -1)
        if self.actuation is not None:
            self.actuation = self.actuation.flat()
        self.points, self.edges = real_array(self.points, -1, 3), contiguous_array(self.edges, np.int32, -1, 2)
        self.stiffness, self.masses = real_array(self.stiffness, -1), real_array(self.masses, -1)
        self.lengths, self.velocities = real_array(self.lengths, -1), real_array(self.velocities, -1, 3)

    def geometry(self, places: np.ndarray) -> BodyGeometry:
        """See `Deformable`."""
        n, masses = len(places), np.broadcast_to(self.masses, len(places)).astype(np.float64)
        return BodyGeometry(places - places.mean(axis=0), masses, np.full(n, self.radius), np.arange(n), edges=self.edges)

    def held_points(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Deformable`."""
        return self.edges, self.edges.reshape(-1)

    def least_reach(self) -> float:
        """See `Deformable`."""
        return self.radius

    def kernel_traits(self) -> set[tuple]:
        """See `Deformable`."""
        return {(self.damping > 0, len(self.stiffness) > 1)}
