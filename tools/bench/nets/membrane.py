"""Sheets of one isotropic material for several engines: the problems, and the float64 answer for Newton's own triangles.

Newton 1.8 (VBD, and SolverSemiImplicit with lambda + mu in the place of lambda) has, of each triangle of rest area A,

    U = A (mu / 2 (tr F^T F - 2) + (lambda + mu) / 2 (J - a)^2),   J = |f_1 x f_2|,  a = 1 + mu / (lambda + mu)

(Smith, de Goes, Kim 2018, for sheets), wsim strains of its own: near rest both are plane stress of E h and Poisson's ratio,

    mu = E h / (2 (1 + nu)),   lambda = nu E h / (1 - nu^2)

so that each engine is held against the exact trajectory of its own energy. Neither bends, damps or meets anything. Masses are a
third of each triangle's. Leapfrog by two kernels of this file, whose step is halved until Richardson's estimate of its error is
small.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import warp as wp

from tools.bench.nets.garment import HUNG
from wsim.scene import Scene, shapes
from wsim.scene.fabric import isotropic_fabric

ROOT = Path(__file__).resolve().parents[3]
STRETCH, POISSON, DENSITY, THICKNESS = 2000.0, 0.3, 0.2, 1e-3          # E h [N/m], nu, [kg/m^2], [m]

# Points (n, 3) [m] at rest, triangles (t, 3), held points, a frame [s], frames after which rows are judged
Given = tuple[np.ndarray, np.ndarray, list[int], float, int]


@dataclass
class Membrane:
    """Triangles of Newton's energy in float64: points (n, 3) [m] at rest and at the start, triangles (t, 3), pinned (k,)."""

    points: np.ndarray
    triangles: np.ndarray
    pinned: np.ndarray
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    mu: float = STRETCH / (2.0 * (1.0 + POISSON))                      # [N/m]
    lame: float = POISSON * STRETCH / (1.0 - POISSON**2)               # lambda [N/m]
    areas: np.ndarray = field(init=False, repr=False)                  # [m^2], (t,)
    inverse: np.ndarray = field(init=False, repr=False)                # of the sides at rest in their plane [1/m], (t, 2, 2)
    masses: np.ndarray = field(init=False, repr=False)                 # [kg], (n,)

    def __post_init__(self):
        a, b = (self.points[self.triangles[:, k]] - self.points[self.triangles[:, 0]] for k in (1, 2))
        self.inverse, self.areas = inverse_sides(a, b)
        self.masses = np.bincount(self.triangles.ravel(), np.repeat(DENSITY * self.areas / 3.0, 3), len(self.points))

    def trajectory(self, substeps: int, frames: int, frame: float, device=None) -> np.ndarray:
        """Positions after each frame by leapfrog, (frames, n, 3) [m]."""
        free = np.ones(len(self.points))
        free[self.pinned] = 0.0
        inverse, areas, w = (wp.array(a, dtype=t, device=device) for a, t in (
            (self.inverse, wp.mat22d), (self.areas, wp.float64), (free / self.masses, wp.float64)))
        triangles = wp.array(self.triangles, dtype=wp.vec3i, device=device)
        x, v, f = (wp.array(a, dtype=wp.vec3d, device=device) for a in (self.points, 0.0 * self.points, 0.0 * self.points))
        h, g, found = frame / substeps, wp.vec3d(*self.gravity), []
        for number in range(frames * substeps):
            wp.launch(pull, len(areas), [x, triangles, inverse, areas, self.mu, self.lame], [f], device=device)
            wp.launch(kick, len(free), [f, w, g, h if number else 0.5 * h, h], [v, x], device=device)
            if (number + 1) % substeps == 0:
                found.append(x.numpy().copy())              # of a CPU it is a view
        return np.array(found)

    def exact(self, substeps: int, frames: int, frame: float, tolerance: float, device=None) -> tuple[np.ndarray, float]:
        """The trajectory, and an estimate of its RMS error [m]: steps are halved until it is under the tolerance, six times at
        most. RuntimeError if it is not."""
        coarse = None
        for _ in range(6):
            fine = self.trajectory(substeps, frames, frame, device)    # a step that is too long flies apart
            if coarse is not None and np.isfinite(fine).all() and np.isfinite(coarse).all():
                error = float(np.sqrt(np.mean(np.sum((fine - coarse)**2, axis=2), axis=1)).max() / 3.0)
                if error < tolerance:
                    return fine, error
            coarse, substeps = fine, 2 * substeps
        raise RuntimeError(f"the float64 trajectory did not reach {tolerance:g} m in {substeps // 2} substeps a frame")


def inverse_sides(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse (t, 2, 2) [1/m] of the sides a, b (t, 3) [m] of triangles in their plane, as columns; areas (t,) [m^2]."""
    along = np.linalg.norm(a, axis=1)
    normal = np.linalg.norm(np.cross(a, b), axis=1)
    sides = np.zeros((len(a), 2, 2))
    sides[:, 0, 0], sides[:, 0, 1], sides[:, 1, 1] = along, np.sum(a * b, axis=1) / along, normal / along
    return np.linalg.inv(sides), 0.5 * normal


@wp.kernel(enable_backward=False)
def pull(x: wp.array(dtype=wp.vec3d), triangles: wp.array(dtype=wp.vec3i), inverse: wp.array(dtype=wp.mat22d),
         areas: wp.array(dtype=wp.float64), mu: wp.float64, lame: wp.float64, f: wp.array(dtype=wp.vec3d)):
    """Adds the elastic forces [N] of a triangle: -A P D^-T, P = dU/dF / A."""
    t = triangles[wp.tid()]
    D = inverse[wp.tid()]
    area = areas[wp.tid()]
    o = x[t[0]]
    F = wp.matrix_from_cols(x[t[1]] - o, x[t[2]] - o) * D                # (3, 2)
    a = wp.vec3d(F[0, 0], F[1, 0], F[2, 0])
    b = wp.vec3d(F[0, 1], F[1, 1], F[2, 1])
    normal = wp.normalize(wp.cross(a, b))
    J = wp.length(wp.cross(a, b))
    p = (lame + mu) * (J - wp.float64(1.0)) - mu
    ends = (mu * F + p * wp.matrix_from_cols(wp.cross(b, normal), wp.cross(normal, a))) * wp.transpose(D)
    one = -area * wp.vec3d(ends[0, 0], ends[1, 0], ends[2, 0])
    two = -area * wp.vec3d(ends[0, 1], ends[1, 1], ends[2, 1])
    wp.atomic_add(f, t[0], -one - two)
    wp.atomic_add(f, t[1], one)
    wp.atomic_add(f, t[2], two)


@wp.kernel(enable_backward=False)
def kick(f: wp.array(dtype=wp.vec3d), w: wp.array(dtype=wp.float64), g: wp.vec3d, hv: wp.float64, h: wp.float64,
         v: wp.array(dtype=wp.vec3d), x: wp.array(dtype=wp.vec3d)):
    """Velocities by a step hv [s], positions by h; forces are used up. A point of inverse mass 0 stays."""
    i = wp.tid()
    if w[i] > wp.float64(0.0):
        v[i] = v[i] + hv * (w[i] * f[i] + g)
        x[i] = x[i] + h * v[i]
    f[i] = wp.vec3d()


def peak_strain(rest: np.ndarray, triangles: np.ndarray, x: np.ndarray) -> float:
    """The largest stretch of any edge less 1; rest and x (n, 3) [m]. Not of triangles: needles of a garment turn rounding into
    strains of hundreds."""
    i, j = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0).T
    length = np.linalg.norm(rest[i] - rest[j], axis=1)
    return float((np.linalg.norm(x[i] - x[j], axis=1) / np.maximum(length, 1e-12)).max() - 1.0)


def held(points: np.ndarray) -> list[int]:
    """Points of a shirt within HUNG [m] of the highest one of either side."""
    middle, found = 0.5 * (points[:, 0].min() + points[:, 0].max()), []
    for half in (points[:, 0] < middle, points[:, 0] >= middle):
        top = points[np.flatnonzero(half)[np.argmax(points[half, 1])]]
        found += np.flatnonzero(np.linalg.norm(points - top, axis=1) < HUNG).tolist()
    return sorted(set(found))


def split(points: np.ndarray, triangles: np.ndarray, times: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with every triangle cut in four, `times` over."""
    for _ in range(times):
        sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        ends, which = np.unique(sides, axis=0, return_inverse=True)
        m = len(points) + which.reshape(-1, 3)
        points = np.concatenate([points, 0.5 * (points[ends[:, 0]] + points[ends[:, 1]])])
        i, j, k = triangles.T
        triangles = np.stack([i, m[:, 0], m[:, 2], m[:, 0], j, m[:, 1], m[:, 2], m[:, 1], k, *m.T], axis=1).reshape(-1, 3)
    return points, triangles


def sheet() -> Given:
    """33 x 33 points of a square metre, one edge held, 15 frames of 1/60 s."""
    points, _, indices = shapes.sheet(1.0, 1.0, 32, 32, horizontal=True)
    return points, indices.reshape(-1, 3), list(range(33)), 1.0 / 60.0, 15


def shirt() -> Given:
    """The garment of scenes/shirt.usda hung by its collar, three frames of 1/60 s, to which halved steps agree by 1e-7 m.
    Without bending rounding decides where it buckles: at 0.067 s float64 agrees with itself by 2e-5, at 0.125 s by 6e-4."""
    from wsim.usd import load
    cloth = load(str(ROOT / "scenes" / "shirt.usda")).cloths[0]
    points = cloth.points - cloth.points.mean(axis=0)
    return points, cloth.indices.reshape(-1, 3), held(points), 1.0 / 60.0, 3


PROBLEMS: dict[str, Callable[[], Given]] = {"sheet": sheet, "shirt": shirt}


def scene(name: str) -> Scene:
    """A problem for wsim."""
    points, triangles, pinned, frame, _ = PROBLEMS[name]()
    made = Scene(fps=1.0 / frame, frames=30)
    fabric = replace(isotropic_fabric(STRETCH / THICKNESS, POISSON, THICKNESS, DENSITY / THICKNESS), bend=0.0)
    made.pin("/held", made.cloth("/cloth", points, np.full(len(triangles), 3), triangles.ravel(), material=fabric), pinned)
    return made
