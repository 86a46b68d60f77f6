"""The measuring instrument for spring nets: float64 trajectories with a known error, and closed forms. NumPy.

    m x'' = m g + sum over springs k (|r| - L) r/|r|,   r the vector to the other end; pinned points stay

    exact           classical Runge-Kutta of order 4, steps halved until Richardson's estimate of its error is small
    spring_cloth    the scene that trajectories are judged by: a square net pinned along one edge, starting horizontal
    chain_*         static stretch and first longitudinal frequency of a hanging chain
    cantilever      a strip bending under its own weight, at any deflection

Runge-Kutta is stable for h omega < 2.83; `exact` starts below that by a row-sum bound on the highest frequency.
Hairer, Norsett, Wanner 1993, II.1, II.4. What a perfect solver of an implicit integrator gives: converged.py.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import ceil, cos, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from wsim.scene import Scene, shapes
from wsim.scene.curve import Motion


@dataclass
class Net:
    """Springs between points, in float64. A positive mass moves; a point in `pinned` does not.

    points (n, 3) [m], edges (m, 2), stiffness (m,) [N/m], masses (n,) [kg], pinned (k,), gravity (3,) [m/s^2],
    lengths (m,) rest lengths [m] (None: those of the points)."""

    points: np.ndarray
    edges: np.ndarray
    stiffness: np.ndarray
    masses: np.ndarray
    pinned: np.ndarray
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    lengths: np.ndarray | None = None
    free: np.ndarray = field(init=False, repr=False)      # (n, 1) 1 moves, 0 is pinned
    room: tuple = field(init=False, repr=False)           # work arrays of `forces`: fresh ones cost five times the sums

    def __post_init__(self):
        self.points = np.asarray(self.points, np.float64)
        self.edges = np.asarray(self.edges, np.int64)
        self.stiffness = np.broadcast_to(np.asarray(self.stiffness, np.float64), len(self.edges))
        self.masses = np.broadcast_to(np.asarray(self.masses, np.float64), len(self.points))
        self.pinned = np.asarray(self.pinned, np.int64)
        if self.lengths is None:
            i, j = self.edges.T
            self.lengths = np.linalg.norm(self.points[i] - self.points[j], axis=1)
        self.free = np.ones((len(self.points), 1))
        self.free[self.pinned] = 0.0
        m = len(self.edges)
        self.room = (np.empty((3, m)), np.empty((3, m)), np.empty(m), *np.ascontiguousarray(self.edges.T))

    def forces(self, x: np.ndarray) -> np.ndarray:
        """Spring forces [N], (n, 3)."""
        r, other, size, i, j = self.room
        columns = np.ascontiguousarray(x.T)
        np.take(columns, j, 1, out=r, mode="clip")       # any mode but "raise" writes straight to `out`
        np.take(columns, i, 1, out=other, mode="clip")
        np.subtract(r, other, out=r)
        np.multiply(r, r, out=other)
        np.sqrt(np.sum(other, 0, out=size), out=size)
        np.divide(self.lengths, size, out=size)
        np.multiply(self.stiffness, np.subtract(1.0, size, out=size), out=size)
        np.multiply(r, size, out=r)
        return np.stack([np.bincount(i, f, len(x)) - np.bincount(j, f, len(x)) for f in r], axis=1)

    def acceleration(self, x: np.ndarray) -> np.ndarray:
        """[m/s^2], (n, 3); zero at pins."""
        return self.free * (self.forces(x) / self.masses[:, None] + np.asarray(self.gravity))

    def energy(self, x: np.ndarray, v: np.ndarray) -> float:
        """Kinetic, elastic and gravitational energy [J]; the last about the origin."""
        i, j = self.edges.T
        strain = np.linalg.norm(x[j] - x[i], axis=1) - self.lengths
        weight = self.masses @ (x @ np.asarray(self.gravity))
        return float(0.5 * self.masses @ np.sum(v * v, axis=1) + 0.5 * self.stiffness @ strain ** 2 - weight)

    def frequency(self) -> float:
        """Bound [rad/s] on the highest frequency: Gershgorin's row sums of M^-1 K, no spring shorter than its rest."""
        sums = np.bincount(self.edges.ravel(), np.repeat(self.stiffness, 2), len(self.points))
        return sqrt(2.0 * float(np.max(sums / self.masses)))


def runge_kutta(net: Net, x: np.ndarray, v: np.ndarray, h: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """x [m], v [m/s] after `steps` of size h [s] by the classical method of order 4."""
    for _ in range(steps):
        a1 = net.acceleration(x)
        v2 = v + 0.5 * h * a1
        a2 = net.acceleration(x + 0.5 * h * v)
        v3 = v + 0.5 * h * a2
        a3 = net.acceleration(x + 0.5 * h * v2)
        v4 = v + h * a3
        a4 = net.acceleration(x + h * v3)
        x = x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return x, v


def rms(difference: np.ndarray) -> float:
    """Root of the mean over points of the squared distance [m]; (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(difference ** 2, axis=-1))))


def steps_between(times: Sequence[float], h: float) -> list[int]:
    """Steps of size h between 0 and the times, one after the other; ValueError if a time is no multiple of h."""
    ends = [round(t / h) for t in times]
    if any(abs(end * h - t) > 1e-9 * t or end <= 0 for end, t in zip(ends, times, strict=True)):
        raise ValueError(f"times {list(times)} must be positive multiples of the step {h:g} s")
    return [b - a for a, b in zip([0, *ends], ends, strict=False)]


def exact(net: Net, times: Sequence[float], tolerance: float = 1e-8, folder: Path | str | None = None,
          frame: float = 1.0 / 60.0) -> tuple[np.ndarray, float]:
    """Positions (times, n, 3) [m] at increasing times [s], multiples of `frame`, and an estimate of their RMS error.

    Steps are halved until |x_h - x_2h| / 15 (Richardson, order 4) is under tolerance at every time. A folder keeps the
    result, keyed by the net and the arguments. RuntimeError when eight halvings do not reach the tolerance: the
    motion amplifies perturbations too strongly for that tolerance.
    """
    file = None
    if folder is not None:
        key = hashlib.sha256(repr((times, tolerance, frame, net.gravity)).encode())
        for array in (net.points, net.edges, net.stiffness, net.masses, net.pinned, net.lengths):
            key.update(np.ascontiguousarray(array).tobytes())
        file = Path(folder) / f"exact_{key.hexdigest()[:16]}.npz"
    return kept(file, lambda: halved(net, times, tolerance, frame, net.frequency(), 8))


def kept(file: Path | None, run: Callable[[], tuple[np.ndarray, float]]) -> tuple[np.ndarray, float]:
    """Positions and their error from a file; where there is none yet, by `run`, and into it."""
    if file is not None and file.exists():
        with np.load(file) as found:
            return found["positions"], float(found["error"])
    positions, error = run()
    if file is not None:
        np.savez(file, positions=positions, error=error)
    return positions, error


def halved(body: Any, times: Sequence[float], tolerance: float, frame: float, highest: float,
           most: int) -> tuple[np.ndarray, float]:
    """`exact` of a body with `points` [m] and `acceleration(x)` [m/s^2] that starts at rest: steps from half of what the
    frequency `highest` [rad/s] allows on, halved at most so often."""
    steps_between(times, frame)
    coarse, substeps = None, ceil(frame * highest / 2.0)
    for _ in range(most + 1):
        x, v, positions = body.points, np.zeros_like(body.points), []
        for steps in steps_between(times, frame / substeps):
            x, v = runge_kutta(body, x, v, frame / substeps, steps)
            positions.append(x)
        if coarse is not None:
            error = max(rms(a - b) for a, b in zip(positions, coarse, strict=True)) / 15.0
            if error < tolerance:
                return np.array(positions), error
        coarse, substeps = positions, 2 * substeps
    raise RuntimeError(f"error {error:.1e} m at {substeps // 2} steps a frame; {tolerance:.1e} is not reached")


def spring_cloth(n: int, *, side: float = 1.0, at=(0.0, 0.0, 0.0), **parameters) -> Scene:
    """A horizontal net of n by n points, one edge pinned, 60 frames a second for 0.5 s; placed `at` [m].

    parameters: those of `wsim.shapes.spring_sheet` (stretch, diagonal, cross [N/m], density [kg/m^2]).
    """
    scene = Scene(fps=60.0, frames=30)
    cloth = scene.net("/cloth", *shapes.spring_sheet(side, n, **parameters), motion=Motion.at_place(at))
    scene.pin("/pins", cloth, points=range(n))
    return scene


def net(scene: Scene) -> Net:
    """The spring net of a scene, in its own frame, with the float32 values that the scene holds.

    ValueError for anything that `Net` does not know: other bodies, colliders, turned frames, damping, soft pins.
    """
    if len(scene.springs) != 1 or scene.cloths or scene.colliders:
        raise ValueError("the reference takes a scene of one spring net and nothing else")
    springs = scene.springs[0]
    if springs.damping or springs.velocities is not None or scene.air_drag or any(scene.wind):
        raise ValueError("the reference knows neither damping nor air nor a start in motion")
    if not np.array_equal(springs.motion.at(0.0)[:3, :3], np.eye(3)):
        raise ValueError("the reference takes a net that is placed, not turned")
    if any(np.isfinite(pin.stiffness) or pin.motion.moves or pin.places is not None for pin in scene.pins):
        raise ValueError("the reference takes hard pins where the points are")
    pinned = np.concatenate([pin.points for pin in scene.pins]) if scene.pins else np.zeros(0, int)
    return Net(springs.points, springs.edges, springs.stiffness, springs.masses, pinned, tuple(scene.gravity),
               springs.lengths)


def chain_stretch(stiffness: np.ndarray, masses: np.ndarray, gravity: float = 9.81) -> np.ndarray:
    """Static stretch [m] of each spring of a hanging chain: what hangs below it over its stiffness [N/m].

    Spring i, counted from the support, holds the masses [kg] i, i+1, ... ; n equal ones: m g (n - i) / k.
    """
    return gravity * np.cumsum(np.asarray(masses, np.float64)[::-1])[::-1] / np.asarray(stiffness, np.float64)


def chain_frequency(stiffness: np.ndarray, masses: np.ndarray) -> float:
    """Lowest longitudinal frequency [rad/s] of that chain, from the tridiagonal M^-1/2 K M^-1/2.

    n equal ones: 2 sqrt(k/m) sin(pi / (4 n + 2)).
    """
    k, w = np.asarray(stiffness, np.float64), 1.0 / np.sqrt(np.asarray(masses, np.float64))
    K = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    return sqrt(np.linalg.eigvalsh(w[:, None] * K * w)[0])


def cantilever(bend: float, weight: float, length: float, steps: int = 500) -> tuple[float, float]:
    """Reach and drop [m] of the free end of an inextensible strip clamped horizontally, under its own weight.

    bend B [N m], weight w per area [N/m^2], length L [m]. B theta'' = -w (L - s) cos(theta), theta(0) = 0,
    theta'(L) = 0, theta below the horizontal along the arc s; by shooting on theta'(0), which is between 0 and
    w L^2 / (2 B), and Runge-Kutta. Small loads: drop w L^4 / (8 B). Error O(steps^-4); good to w L^3 / B of 100.
    """
    load, h = weight * length ** 3 / bend, 1.0 / steps

    def slope(s, y):
        return np.array([y[1], -load * (1.0 - s) * cos(y[0]), cos(y[0]), sin(y[0])])

    def shoot(curvature):
        y = np.array([0.0, curvature, 0.0, 0.0])                  # theta, theta', reach, drop, over L
        for i in range(steps):
            s = i * h
            k1 = slope(s, y)
            k2 = slope(s + 0.5 * h, y + 0.5 * h * k1)
            k3 = slope(s + 0.5 * h, y + 0.5 * h * k2)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(s + h, y + h * k3))
        return y

    low, high = 0.0, 0.5 * load
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if shoot(middle)[1] > 0 else (middle, high)
    _, _, reach, drop = shoot(0.5 * (low + high))
    return float(reach * length), float(drop * length)
