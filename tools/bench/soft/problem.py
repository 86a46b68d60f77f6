"""The soft beam by which engines are judged, with its right answers: trajectory, place at rest, first frequency. No Warp.

1 x 0.25 x 0.25 m along x, five-tet cells, nu 0.3, 1000 kg/m^3, clamped at its low end, gravity across; at an E of 1e6 Pa its
tip sinks by a fifth of its length. runs.py says what an engine runs; the answers are those of reference.py for
the row's own material on the same mesh.

    error_025, error_05     RMS distance [m] from the exact trajectory after 0.25 and 0.5 s
    static, still           (tip's drop where it comes to rest) / (the right one) - 1; what moved in the last frames [m], RMS
    frequency, damping      first frequency over the right one, less 1; damping ratio, of numerical origin: exactly 0

The small swing is not quite linear: frequencies are told apart from 2e-6 on.
"""

from math import nan

import numpy as np

from tools.bench.nets.reference import rms
from tools.bench.soft.reference import Solid, exact, frequencies, highest, rest
from wsim.geometry.tetra.lattice import tet_box

FRAME, TIMES, SIZE = 1.0 / 60.0, (0.25, 0.5), (1.0, 0.25, 0.25)      # [s], [s], [m]
ENDS = [round(t / FRAME) for t in TIMES]
TOLERANCE = 1e-7                             # [m] of the exact trajectory
SETTLE, SWING, OFFSET = 120, 96, 2e-3        # frames, frames, [m] of the tip: strains of 1e-3 shift the frequency by 1e-6


class Beam:
    """The problem and its right answers, each worked out when first asked for. `folder` keeps trajectories."""

    def __init__(self, cells: tuple[int, ...], young: float, folder):
        points, self.tets = tet_box(SIZE, cells)
        self.points = points.astype(np.float32).astype(np.float64)            # what a scene holds
        low, high = (np.isclose(points[:, 0], x) for x in (-0.5 * SIZE[0], 0.5 * SIZE[0]))
        self.pinned, self.tip, self.young, self.folder = np.flatnonzero(low), np.flatnonzero(high), young, folder
        self.name = f"beam, {' x '.join(map(str, cells))} cells, {len(self.tets)} tets, E {young:g} Pa"
        self.known: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        solid = self.solid("corotational")                                    # about rest all materials are one
        found, shapes = frequencies(solid)
        self.frequency, self.shape = float(found[0]), shapes[0] * np.sign(shapes[0][self.tip, 1].mean())
        self.masses, self.limit = solid.masses, FRAME * highest(solid) / 2.0
        self.offset = OFFSET / np.abs(self.shape).max() * self.shape

    def solid(self, model: str) -> Solid:
        return Solid(self.points, self.tets, self.pinned, young=self.young, model=model)

    def answers(self, model: str) -> tuple[np.ndarray, np.ndarray]:
        """Exact positions at TIMES (2, n, 3) and at rest (n, 3) [m]."""
        if model not in self.known:
            self.known[model] = (exact(self.solid(model), TIMES, TOLERANCE, self.folder, FRAME)[0], rest(self.solid(model)))
        return self.known[model]

    def facts(self) -> dict:
        drops = {model: self.drop(at) for model, (_, at) in self.known.items()}
        return {"tets": len(self.tets), "young": self.young, "frequency": self.frequency, "limit": self.limit, "drop": drops}

    def moved(self) -> float:
        """RMS distance [m] that the fall goes in 0.25 s, the least of the materials asked for: the error of standing still."""
        return min((rms(falls[0] - self.points) for falls, _ in self.known.values()), default=0.0)

    def drop(self, x: np.ndarray) -> float:
        """Of the tip [m]."""
        return float((self.points - x)[self.tip, 1].mean())

    def problem(self) -> dict[str, np.ndarray]:
        """As runs.py describes it. Velocities decay twice as fast as the first mode turns: critically damped."""
        solid = self.solid("corotational")
        values = {"points": self.points, "tets": self.tets, "masses": self.masses, "pinned": self.pinned,
                  "gravity": solid.gravity, "young": self.young, "poisson": solid.poisson, "density": solid.density,
                  "offset": self.offset, "frame": FRAME, "ends": ENDS, "settle": SETTLE, "swing": SWING,
                  "decay": 4.0 * np.pi * self.frequency}
        return {name: np.asarray(value) for name, value in values.items()}

    def judge(self, model: str, states: dict[str, np.ndarray]) -> dict[str, float]:
        falls, at = self.answers(model)
        q = ((states["swing"] - self.points) * (self.masses[:, None] * self.shape)).sum(axis=(1, 2))
        hertz, damping = oscillation(q, FRAME)
        last, before = states["settle"]
        errors = {f"error_{k}": rms(x - right) for x, k, right in zip(states["fall"], ("025", "05"), falls, strict=True)}
        return errors | {"static": self.drop(last) / self.drop(at) - 1.0, "still": rms(last - before),
                         "frequency": hertz / self.frequency - 1.0, "damping": damping}


def oscillation(q: np.ndarray, step: float) -> tuple[float, float]:
    """Frequency [Hz] and damping ratio of a decaying cosine sampled every `step` [s]; not a number where it does not swing.

    Least squares for q_n+1 = a q_n + b q_n-1, which exp(p n) obeys where exp(p) is a root of z^2 = a z + b (Prony 1795)."""
    (a, b), *_ = np.linalg.lstsq(np.stack([q[1:-1], q[:-2]], axis=1), q[2:], rcond=None)
    p = np.log(complex(np.roots([1.0, -a, -b])[0])) / step
    return (abs(p.imag) / (2.0 * np.pi), -p.real / abs(p)) if 0.0 < abs(p.imag) * step < 3.14 else (nan, nan)
