"""Work of the wind on cloth, in float64 NumPy from the positions of every substep, and what else of a scene does work.

    F = -1/2 rho A |r.n| cd r - 1/2 rho A (r.n) |r| cl (n - (n.r) r / |r|^2),    r = (u0 + u1 + u2)/3 - wind, of a triangle
    f = sum F/3 / (1 + 2 h w k),  k = sum 1/6 rho A |r.n| cd                     of a point, w its inverse mass
    W = sum f.(x1 - x0)                                                           of a substep from x0 to x1

The law and its implicit drag are those of kernels/aero.py, written anew; they are taken at x0 and at the velocity
u = (x1 - x0)/h - h w f without the wind's own part, found by fixed-point iteration. So W is the work of the impulses as an
explicit substep applies them, at its beginning: a bound on what its wind gives, which exceeds the work along the way by the
first order of h (the flag by leapfrog: by 5 % of what the wind gives and takes). For implicit integrators W is the work along
the way to first order in h; they dissipate more.
"""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from wsim.scene import Cloth, Scene
from wsim.simulation import Simulation
from wsim.stage import Clock, Method, Stage

PASSES = 3            # of the fixed point: h w k << 1 in a step that follows the flutter
MOVES = 1e-9          # [m] or of a rotation: a motion that changes by less stands still


@dataclass
class Wind:
    """Air of one velocity around the triangles of cloth: drag, lift with rho / 2 in them [kg/m^3], (t,)."""

    triangles: np.ndarray        # (t, 3)
    drag: np.ndarray
    lift: np.ndarray
    wind: np.ndarray             # [m/s], (3,)
    weights: np.ndarray          # inverse masses [1/kg], (n,)

    def forces(self, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces [N], (n, 3), and k [kg/s], (n,), of points at x [m] with velocities v [m/s]."""
        p = x[self.triangles]
        area = 0.5 * np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        size = np.linalg.norm(area, axis=1)
        n = area / np.where(size > 0.0, size, 1.0)[:, None]
        r = v[self.triangles].mean(axis=1) - self.wind
        rn, rr = (r * n).sum(axis=1), np.linalg.norm(r, axis=1)
        k = self.drag * size * np.abs(rn)
        across = rr[:, None] * n - (rn / np.where(rr > 0.0, rr, 1.0))[:, None] * r          # |r| (n - (n.r) r / |r|^2)
        F = -k[:, None] * r - (self.lift * size * rn)[:, None] * across
        gathered = [np.bincount(self.triangles.ravel(), np.repeat(a / 3.0, 3), len(x)) for a in (*F.T, k)]
        return np.stack(gathered[:3], axis=1), gathered[3]

    def work(self, x0: np.ndarray, x1: np.ndarray, h: float) -> float:
        """[J] of a substep of h [s] from x0 to x1 (n, 3) [m]."""
        v, own = (x1 - x0) / h, np.zeros_like(x0)
        for _ in range(PASSES):
            F, k = self.forces(x0, v - own)
            f = F / (1.0 + 2.0 * h * self.weights * k)[:, None]
            own = h * self.weights[:, None] * f
        return float((f * (x1 - x0)).sum())


def wind_of(sim: Simulation) -> Wind | None:
    """Wind of a simulation's scene over its points in solver order; None where air is at rest, which only takes energy."""
    scene, model = sim.scene, sim.model
    cloths = [b for b in model.bodies if isinstance(b.source, Cloth) and (b.source.drag or b.source.lift)]
    if not (cloths and np.any(scene.wind)):
        return None
    each, half = [len(b.triangles) for b in cloths], 0.5 * scene.air_density
    drag, lift = (half * np.repeat([getattr(b.source, name) for b in cloths], each) for name in ("drag", "lift"))
    weights = 1.0 / model.stack("masses")
    for pin in (p for p in scene.pins if p.stiffness == np.inf):
        body = model.body(pin.body, 0)
        weights[body.index[pin.points]] = 0.0
    return Wind(np.concatenate([b.triangles for b in cloths]), drag, lift, np.asarray(scene.wind, float), weights)


class Work:
    """Follows a simulation of one world, launch by launch; without wind it leaves it as it is. A frame that is repeated counts
    once."""

    def __init__(self, sim: Simulation):
        self.sim, self.wind = sim, wind_of(sim)
        self.total, self.gross, self.seconds = 0.0, 0.0, 0.0      # [J] given, [J] given and taken, [s] spent here
        self.now: list[float] = []
        self.method = Method("work", [Stage("work", "deform", self.look, 0, 0)])
        if self.wind:
            sim._replay = self.frame                              # type: ignore[method-assign]

    def places(self) -> np.ndarray:
        """World positions [m], but for the origins of the bodies, (n, 3) in solver order."""
        state, alias = self.sim.state, self.sim.model.alias
        x = state.x.numpy().astype(float) + state.e.numpy()
        return x if alias is None else x[alias]

    def frame(self) -> None:
        """One attempt at a frame."""
        plan = self.sim.plan
        if self.method not in plan.methods:
            plan.methods.append(self.method)
        self.now, self.x = [], self.places()
        plan.frame()

    def look(self, clock: Clock) -> None:
        if clock.staged and clock.k % 2 == 0:
            return
        assert self.wind is not None
        began, x = perf_counter(), self.places()
        self.now.append(self.wind.work(self.x, x, clock.h * (1 + clock.staged)))
        self.x, self.seconds = x, self.seconds + perf_counter() - began

    def close(self) -> None:
        """Behind a frame."""
        self.total += sum(self.now)
        self.gross += sum(map(abs, self.now))
        self.now = []


def uncounted(scene: Scene, frames: int) -> str:
    """What else may do work within so many frames, in words, or ""."""
    times = np.arange(frames + 1) / scene.fps

    def moves(motion) -> bool:
        return float(np.ptp([motion.at(t) for t in times], axis=0).max()) > MOVES
    found = [f"{m.path} moves" for m in (*scene.colliders, *scene.pins) if moves(m.motion)]
    found += [f"load {load.path}" for load in scene.loads] + ["values that vary"] * bool(scene.varying)
    found += [f"muscles of {s.path}" for s in scene.springs if s.actuation]
    found += [f"pressure in {s.path}" for s in scene.softs if s.pressure]
    return ", ".join(found)
