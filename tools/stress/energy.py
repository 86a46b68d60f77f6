"""What a state holds, in float64 NumPy, independent of the solvers: energies, momentum, strain of edges.

    kinetic    1/2 sum m v^2 of the points that no hard pin holds [J]
    gravity    -sum m g.(x - level) [J], level a place below everything that the scene reaches
    elastic    springs 1/2 k (l - L)^2; membrane triangles A psi of `wsim.scene.fabric` with U = sqrt(F^T F);
               bending 1/2 |C_t|^2 of the curvatures that `wsim.physics.cloth.bending` makes of f = s + s^3 / 6, s the sines of
               the angles D of hinges, and 1/2 k q (D^2 - f^2) of each hinge, q its sum of |value|^2 [J]

Of a constraint much stiffer than a substep resolves, only a part of 1/2 C^2 / alpha can turn into motion: one implicit
step of h on effective inverse mass S = sum w |G|^2 frees 1/2 C^2 / (alpha + h^2 S). `elastic(x, h)` is that part, with
h = 0 all of it. Both are what they are said to be for any solver; the part never exceeds the whole.
"""

from dataclasses import dataclass

import numpy as np

from tools.stress.solids import Solid, solid
from wsim.geometry import topology
from wsim.model.model import PointBody, make_body
from wsim.physics.cloth import bending
from wsim.physics.cloth.kinds.membrane import flat_edge_matrices
from wsim.physics.cloth.painted import stretch_factors
from wsim.scene import Cloth, Scene, Soft, Springs


@dataclass
class Elastic:
    """Constraints of one body in the order of its own points: see `rows_of`."""

    edges: np.ndarray            # (m, 2), those with a rest length > 0
    rest: np.ndarray             # [m], (m,)
    stiffness: np.ndarray        # [N/m], (m,); 0 where the triangles carry the strain
    triangles: np.ndarray        # (t, 3)
    inverse: np.ndarray          # Dm^-1 [1/m], (t, 2, 2)
    areas: np.ndarray            # [m^2], (t,)
    moduli: tuple        # stretch, shear [N/m], of all or of each triangle (t,); poisson
    hinges: np.ndarray           # (q, 4)
    bends: np.ndarray            # of hinges alone that are at least as stiff [J], (q,)
    heights: np.ndarray          # of the free corners over the hinge at rest [m], (q, 2)
    weights: np.ndarray          # inverse masses [1/kg], (n,); 0 where a hard pin holds
    masses: np.ndarray           # [kg], (n,)
    coupling: bending.Coupling | None = None

    def strain(self, x: np.ndarray) -> np.ndarray:
        """Signed strain of every edge, (m,)."""
        return _length(x, self.edges) / self.rest - 1.0

    def stored(self, x: np.ndarray, h: float = 0.0) -> float:
        """Elastic energy [J] at positions x (n, 3) [m]; with h [s] the part that a substep can turn into motion."""
        total = 0.0
        if self.stiffness.any():
            C, w = _length(x, self.edges) - self.rest, self.weights[self.edges].sum(1)
            total += float(np.sum(0.5 * C**2 * self.stiffness / (1.0 + h * h * self.stiffness * w)))
        if len(self.triangles):
            total += self._membranes(x, h)
        if self.coupling:
            slot, value = self.coupling.slot, self.coupling.value
            angle = _angles(x, self.hinges)
            f = np.sin(angle) + np.sin(angle)**3 / 6.0
            z = np.where(slot >= 0, (np.sqrt(self.bends) * f)[slot], 0.0)
            own = np.bincount(slot[slot >= 0], (value**2).sum(axis=2)[slot >= 0], len(f))
            total += float(0.5 * ((z[..., None] * value).sum(axis=1)**2).sum() + 0.5 * (self.bends * own) @ (angle**2 - f**2))
        return total

    def _membranes(self, x: np.ndarray, h: float) -> float:
        p, w, B = x[self.triangles], self.weights[self.triangles], self.inverse
        F = np.stack([p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]], axis=2) @ B
        U = root(np.swapaxes(F, 1, 2) @ F)
        u, v, g = U[:, 0, 0] - 1.0, U[:, 1, 1] - 1.0, 2.0 * U[:, 0, 1]
        stretch, shear, nu = self.moduli
        b = np.concatenate([-B.sum(1, keepdims=True), B], axis=1)               # gradients of the corners' shares, (t, 3, 2)
        S = np.einsum("tk,tkc->tc", w, b * b)

        def freed(C, k, s):
            return 0.5 * C * C * k / (1.0 + h * h * k * s)
        k, mean = stretch / (1.0 - nu * nu) * self.areas, 0.5 * S.sum(1)
        # 1/2 k (u^2 + v^2 + 2 nu u v) by its independent parts (u + v) / sqrt 2 and (u - v) / sqrt 2
        return float(np.sum(freed((u + v) / 2.0**0.5, (1.0 + nu) * k, mean) + freed((u - v) / 2.0**0.5, (1.0 - nu) * k, mean)
                            + freed(g, shear * self.areas, S.sum(1))))


def root(C: np.ndarray) -> np.ndarray:
    """Square root of symmetric positive matrices (t, 2, 2): (C + det^1/2) / sqrt(tr C + 2 det^1/2)."""
    s = np.sqrt(np.maximum(C[:, 0, 0] * C[:, 1, 1] - C[:, 0, 1]**2, 0.0))
    t = np.sqrt(C[:, 0, 0] + C[:, 1, 1] + 2.0 * s)
    return (C + s[:, None, None] * np.eye(2)) / np.where(t > 0.0, t, 1.0)[:, None, None]


def _length(x: np.ndarray, ids: np.ndarray) -> np.ndarray:
    return np.linalg.norm(x[ids[:, 1]] - x[ids[:, 0]], axis=1)


def _angles(x: np.ndarray, hinges: np.ndarray) -> np.ndarray:
    """Angles of hinges [rad] between the normals of their two triangles, 0 when flat, (q,)."""
    p = x[hinges]
    E = p[:, 1] - p[:, 0]
    n2, n3 = np.cross(E, p[:, 2] - p[:, 0]), np.cross(p[:, 3] - p[:, 0], E)
    return np.arctan2(-np.linalg.norm(E, axis=1) * ((p[:, 3] - p[:, 0]) * n2).sum(1), (n2 * n3).sum(1))


def elastic_of(scene: Scene) -> list[tuple[str, Elastic | Solid]]:
    """(path, Elastic or Solid) of every body, in the author's order of points; nothing is welded here."""
    found: list[tuple[str, Elastic | Solid]] = []
    for number, source in enumerate(scene.bodies()):
        body = make_body(source, 0, number, 0)
        held = [p.points for p in scene.pins if p.body == source.path and p.stiffness == np.inf]
        points = np.concatenate([np.zeros(0, int), *held])
        found.append((source.path, solid(source, body, points) if isinstance(source, Soft) else _elastic(source, body, points)))
    return found


def _elastic(source: Cloth | Springs, body: PointBody, held: np.ndarray) -> Elastic:
    back = np.empty(body.count, int)                    # place in the arrays -> author's point
    back[body.index] = np.arange(body.count)
    rest, masses = body.rest[body.index], body.masses[body.index]
    edges, triangles = back[body.edges], back[body.triangles]
    weights = 1.0 / masses
    weights[held] = 0.0
    if isinstance(source, Springs):
        lengths = _length(rest, edges) if source.lengths is None else source.lengths.astype(float)
        k = np.broadcast_to(source.stiffness.astype(float), len(edges))
        return Elastic(edges, lengths, k, triangles, np.zeros((0, 2, 2)), np.zeros(0), (0.0, 0.0, 0.0),
                       np.zeros((0, 4), int), np.zeros(0), np.zeros((0, 2)), weights, masses)
    lengths, fabric = _length(rest, edges), source.material
    Dm, areas = flat_edge_matrices(rest[triangles])
    good, kept = areas > 0.0, lengths > 0.0
    hinges = topology.hinges_of_triangles(triangles)
    p, base = rest[hinges], _length(rest, hinges[:, :2])
    double = np.stack([np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, k] - p[:, 0]), axis=1) for k in (2, 3)], axis=1)
    sound = (double > 0.0).all(axis=1)
    hinges, base, double = hinges[sound], base[sound], double[sound]
    pinned = np.zeros(len(rest), bool)
    pinned[held] = True
    coupling, inverse = bending.hinge_coupling(rest, bending.sheet_patches(rest, triangles, hinges, pinned))
    bends = fabric.bend / inverse
    times = 1.0 if source.stretches is None else stretch_factors(source, body.polygon)[good]
    return Elastic(edges[kept], lengths[kept], np.zeros(int(kept.sum())), triangles[good], np.linalg.inv(Dm[good]),
                   areas[good], (times * fabric.stretch, times * fabric.shear, fabric.poisson), hinges, bends,
                   double / base[:, None], weights, masses, coupling if len(hinges) else None)


def fastest(scene: Scene) -> float:
    """Bound [rad/s] on the highest frequency, by row sums of M^-1 K (Gershgorin): sum of k |G_i| sum_j |G_j| over m_i; of
    soft bodies itself."""
    most = 0.0
    for _, e in elastic_of(scene):
        if isinstance(e, Solid):
            most = max(most, e.fastest()**2)
            continue
        sums = np.bincount(e.edges.ravel(), np.repeat(2.0 * e.stiffness, 2), len(e.masses))
        if len(e.triangles):
            b = np.linalg.norm(np.concatenate([-e.inverse.sum(1, keepdims=True), e.inverse], axis=1), axis=2)
            k = (e.moduli[0] / (1.0 - e.moduli[2]**2) + 2.0 * e.moduli[1]) * e.areas
            sums += np.bincount(e.triangles.ravel(), (k[:, None] * b * b.sum(1, keepdims=True)).ravel(), len(e.masses))
        if len(e.hinges):
            sums += np.bincount(e.hinges.ravel(), _bending(e).ravel(), len(e.masses))
        most = max(most, float(np.max(sums * e.weights, initial=0.0)))
    return most**0.5


def _bending(e: Elastic) -> np.ndarray:
    """k |G_i| sum_j |G_j| of hinges, (q, 4): |G| is 1 / height at the free corners, at most their sum on the hinge."""
    C = np.zeros((len(e.hinges), 4))
    for column, h in ((2, e.heights[:, 0]), (3, e.heights[:, 1])):
        C[:, column] = 1.0 / h
    C[:, :2] = C[:, 2:].sum(1, keepdims=True)
    return e.bends[:, None] * C * C.sum(1, keepdims=True)
