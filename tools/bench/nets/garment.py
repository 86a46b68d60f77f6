"""A garment as a net of springs: the irregular mesh of scenes/shirt.usda hung by its collar, no colliders, no bending.

A spring for every edge, as stiff as its triangles make it, and a third of each triangle's mass at its corners:

    k_e = E h (sum of the areas of the edge's triangles) / L^2        Van Gelder 1998, eq. 20, with E h [N/m] as `stretch`

Edges of one garment differ in length, and so springs in stiffness and points in mass: what a grid does not show. A net that
folds is no problem with a trajectory to compare (neighbouring starts part), so it is judged by what any solution shares:

    energy_*    |E(t) - E(0)| over the energy that gravity has turned over by t in the reference; no damping: exactly 0
    strain_*    |rms strain - the reference's| over the reference's; where the folds fall is chance, and that is some
                hundredths of it in solutions of any step
    error_*     the energy's; the larger of both where the strain is wrong by more than CHANCE: soft cloth keeps energy too

The reference is float64 Runge-Kutta of order 4 at half the largest stable step; its own energy error is said beside.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from tools.bench.nets.reference import Net, net, runge_kutta, steps_between
from wsim.geometry import topology
from wsim.scene import Scene

ROOT = Path(__file__).resolve().parents[3]
CHANCE = 0.25
HUNG = 0.02            # [m]: points this close to the highest one of either side are pinned


def shirt(stretch: float = 1e3, density: float = 0.2) -> Scene:
    """The scene, 60 frames a second for 0.5 s; stretch E h [N/m], density [kg/m^2]."""
    from wsim.usd import load
    cloth = load(str(ROOT / "scenes" / "shirt.usda")).cloths[0]
    points, triangles = cloth.points.astype(np.float64), cloth.indices.reshape(-1, 3)
    points -= points.mean(axis=0)                # about the origin, where float32 is finest: g h^2 is 7e-9 m at 600 substeps
    edges, areas = topology.edges_of_triangles(triangles), topology.triangle_areas(points, triangles)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    n = len(points)
    which = np.searchsorted(edges[:, 0].astype(np.int64) * n + edges[:, 1], sides[:, 0].astype(np.int64) * n + sides[:, 1])
    area = np.bincount(which, np.repeat(areas, 3), len(edges))
    length2 = np.sum((points[edges[:, 0]] - points[edges[:, 1]]) ** 2, axis=1)
    masses = np.bincount(triangles.ravel(), np.repeat(density * areas / 3.0, 3), n)
    scene = Scene(fps=60.0, frames=30)
    body = scene.net("/shirt", points, edges, stretch * area / length2, masses)
    middle, pinned = 0.5 * (points[:, 0].min() + points[:, 0].max()), []
    for half in (points[:, 0] < middle, points[:, 0] >= middle):
        top = points[np.flatnonzero(half)[np.argmax(points[half, 1])]]
        pinned += np.flatnonzero(np.linalg.norm(points - top, axis=1) < HUNG).tolist()
    scene.pin("/pins", body, sorted(set(pinned)))
    return scene


def rms_strain(body: Net, x: np.ndarray) -> float:
    """Root of the mean over springs of the squared relative stretch."""
    i, j = body.edges.T
    return float(np.sqrt(np.mean((np.linalg.norm(x[j] - x[i], axis=1) / body.lengths - 1.0) ** 2)))


class Hanging:
    """The shirt's reference at times [s], and the judge of other runs."""

    def __init__(self, scene: Scene, times, frame: float = 1.0 / 60.0, folder=None):
        self.net = net(replace(scene))
        self.start = self.net.energy(self.net.points, np.zeros_like(self.net.points))
        substeps = int(np.ceil(frame * self.net.frequency()))
        cache = None if folder is None else Path(folder) / f"shirt_{len(self.net.points)}_{substeps}_{self.start:.6f}.npz"
        if cache is not None and cache.exists():
            with np.load(cache) as found:
                self.turned, self.strain, self.drift = (found[k].tolist() for k in ("turned", "strain", "drift"))
            return
        x, v = self.net.points, np.zeros_like(self.net.points)
        self.turned, self.strain, self.drift = [], [], []
        for steps in steps_between(times, frame / substeps):
            x, v = runge_kutta(self.net, x, v, frame / substeps, steps)
            fallen = (x - self.net.points) @ np.asarray(self.net.gravity)
            self.turned.append(float(self.net.masses @ fallen))
            self.strain.append(rms_strain(self.net, x))
            self.drift.append(abs(self.net.energy(x, v) - self.start) / self.turned[-1])
        if cache is not None:
            np.savez(cache, turned=self.turned, strain=self.strain, drift=self.drift)

    def judge(self, states) -> dict[str, float]:
        """Errors of [(x, v), ...] at the times, (n, 3) [m], [m/s]."""
        found = {}
        for (x, v), name, turned, strain in zip(states, ("025", "05"), self.turned, self.strain, strict=True):
            energy = abs(self.net.energy(x, v) - self.start) / turned
            stretch = abs(rms_strain(self.net, x) - strain) / strain
            found |= {f"energy_{name}": energy, f"strain_{name}": stretch,
                      f"error_{name}": max(energy, stretch) if stretch > CHANCE else energy}
        return found
