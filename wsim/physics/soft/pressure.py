"""Pressure in soft bodies, on the device: a table of triangles that stands beside those of tets (`wsim.physics.soft.fem`).

It acts on the hollows of a body where there are some (a ball's air, say), else on the surface as a whole: what is inside is the
body then. Of ten-node tets each face is taken as four triangles, 4/3 times, and as one, -1/3 times: flat faces then get exactly
what belongs to their nodes (a third to each middle, nothing to corners), and curved ones to the fourth order of their size.
"""


import numpy as np
import warp as wp

from wsim.geometry.tetra.tets import EDGES
from wsim.geometry.topology import edges_of_triangles, labels_of_islands
from wsim.kernels.soft import pressure
from wsim.model.model import Model, PointBody


class SoftPressure:
    """All triangles that a pressure acts on, in the order of the bodies. Bodies without pressure have none."""

    name, noun, damped = "pressure", "triangles", False
    parts: list = []                  # of tets
    kept = None                       # nothing outlives a frame
    plastic = None

    def __init__(self, model: Model):
        self.model, real = model, model.real
        self.bodies = [b for b in model.bodies if has_pressure(b.source)]
        self.values = [float(b.source.pressure) for b in self.bodies]                 # type: ignore[union-attr]
        each = [pressure_faces(b) for b in self.bodies]
        self.weights = [w for _, w in each]
        self.ids = np.concatenate([ids for ids, _ in each]).astype(np.int32)
        self.size = len(self.ids)
        systems = [model.system(b.number) for b in self.bodies]
        sizes = np.bincount(systems, [len(w) for w in self.weights], len(model.starts) - 1)
        self.first = model.upload(np.r_[0, np.cumsum(sizes)].astype(np.int32), int)
        self.most = int(sizes.max())
        self.rest, self.ids = self.volumes(each), model.shared(self.ids)
        starts = np.cumsum([0, *(len(w) for w in self.weights)])[:-1]
        origin = np.repeat(self.ids[starts, 0], [len(w) for w in self.weights])
        self.data = pressure.pressure_tables(real)()
        self.data.point = model.upload(np.column_stack([self.ids, origin]).astype(np.int32), wp.vec4i)
        self.data.pressure = model.upload(self.spread(), real)
        self.q = None                 # no rotations

    def volumes(self, each: list) -> list[float]:
        """Volumes at rest, of the faces of each body [m^3]."""
        return [weighted_volume(b.rest[ids - b.first], w) for b, (ids, w) in zip(self.bodies, each, strict=True)]

    def spread(self) -> np.ndarray:
        """Pressure times weight of each triangle [Pa]."""
        return np.concatenate([p * w for p, w in zip(self.values, self.weights, strict=True)])

    def place(self, force: int, block: int) -> None:
        """Places where the forces of corners begin; blocks stay zero."""
        self.data.force = force

    def need_forces(self) -> None:
        self.pull = pressure.inflation_force_kernel(self.model.real, self.model.module)

    def forces(self, x: wp.array, d: wp.array, v: wp.array, force: wp.array | None) -> None:
        self.model.launch(self.pull, self.size, [self.data, x, d], [force])

    def kernels(self) -> list:
        return [f(self.model.real, self.model.step_modules[0])
                for f in (pressure.inflation_newton_kernel, pressure.inflation_energy_kernel)]

    def forget(self) -> None:
        """It remembers nothing."""

    def statistics(self, state) -> np.ndarray:
        """Statistics as of tets: no strain, and the energy -p (V - V at rest) [J] at x + e."""
        x = state.x.numpy().astype(np.float64) + state.e.numpy()
        starts = np.cumsum([0, *(len(w) for w in self.weights)])
        stored = [-p * (weighted_volume(x[self.ids[k:k + len(w)]], w) - rest)
                  for p, w, rest, k in zip(self.values, self.weights, self.rest, starts[:-1], strict=True)]
        return np.array([0.0, 0.0, sum(stored)])

    def set_value(self, path: str, name: str, value, world: int | None = None) -> bool:
        """pressure [Pa] of a body that has some from the start."""
        hit = [k for k, b in enumerate(self.bodies) if b.path == path and world in (None, b.world)]
        if name == "rest_shape" and hit:
            self.rest = self.volumes([pressure_faces(b) for b in self.bodies])
        if name != "pressure" or not hit:
            return False
        for k in hit:
            self.values[k] = float(value)
        self.data.pressure.assign(self.spread().astype(self.model.dtype))
        return True


def has_pressure(source) -> bool:
    return source.pressure != 0.0


def weighted_volume(corners: np.ndarray, weights: np.ndarray) -> float:
    """Volume [m^3] in triangles (m, 3, 3) that are closed, each counted by its weight."""
    a, b, c = (corners - corners[:1, :1]).transpose(1, 0, 2)
    return float(np.sum(weights * np.einsum("mi,mi->m", a, np.cross(b, c))) / 6.0)


def pressure_faces(body: PointBody) -> tuple[np.ndarray, np.ndarray]:
    """Triangles that the pressure acts on, counter-clockwise seen from where it does not, (m, 3), and their weights, (m,)."""
    triangles = body.triangles - body.first
    label = labels_of_islands(body.count, edges_of_triangles(triangles))[triangles[:, 0]]
    one = np.ones(len(triangles))
    hollow = np.isin(label,
                     [k for k in np.unique(label) if weighted_volume(body.rest[triangles[label == k]], one[label == k]) < 0.0])
    if hollow.any():
        triangles = triangles[hollow][:, ::-1]
    whole = triangles + body.first
    return (whole, np.ones(len(whole))) if body.tets.shape[1] == 4 else _split_curved_faces(whole, body.tets)


def _split_curved_faces(triangles: np.ndarray, tets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of ten-node tets: four triangles for each face, and it."""
    n = int(tets.max()) + 1

    def joined_edge_keys(i, j) -> np.ndarray:
        return np.minimum(i, j).astype(np.int64) * n + np.maximum(i, j)
    known = np.concatenate([joined_edge_keys(tets[:, i], tets[:, j]) for i, j in EDGES])
    order = np.argsort(known)
    a, b, c = triangles.T
    ab, bc, ca = (tets[:, 4:].T.ravel()[order[np.searchsorted(known, joined_edge_keys(i, j), sorter=order)]]
                  for i, j in ((a, b), (b, c), (c, a)))
    quarters = [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate([*quarters, triangles]), np.repeat([4.0 / 3.0, -1.0 / 3.0], [4 * len(a), len(a)])
