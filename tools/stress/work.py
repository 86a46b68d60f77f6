"""Work of the wind and of what carries the scene, in float64 NumPy from the positions of every substep, and what else works.

    F = -1/2 rho A |r.n| cd r - 1/2 rho A (r.n) |r| cl (n - (n.r) r / |r|^2),    r = (u0 + u1 + u2)/3 - wind, of a triangle
        - c A (r.n) n
    f = sum F/3 / (1 + h w K),  K = sum 1/3 rho A |r.n| cd + 1/3 c A             of a point, w its inverse mass
    W = sum f.(x1 - x0)                                                           of a substep from x0 to x1

The law and its implicit drag are those of kernels/cloth/air.py, written anew; they are taken at x0 and at the velocity
u = (x1 - x0)/h - h w f without the wind's own part, found by fixed-point iteration. So W is the work of the impulses as a
substep applies them at its beginning. It exceeds the work along the way by the first order of h. For implicit integrators W is
the work along the way to first order in h; they dissipate more. Leapfrog takes the wind at order 2. There f is F at
(x0 + x1)/2 and u = (x1 - x0)/h, so that W is the work along the way to order 2.

Pins and colliders that all go with one rigid motion, of displacement D(x) in a substep, push with forces whose resultant and
moment about any axis are those of the change of momentum, whatever acts within the bodies:

    W = sum (m (u1 - u0)/h - m g - f).D(x0)  of the points that no pin holds  -  sum m g.(x1 - x0)  of those that one holds
"""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from wsim.model.stage import Clock, Method, Stage
from wsim.scene import Cloth, Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

APART = 1e-6          # [m] or of a rotation: motions that differ by less are the same
PASSES = 3            # of the fixed point: h w k << 1 in a step that follows the flutter
MOVES = 1e-9          # [m] or of a rotation: a motion that changes by less stands still


@dataclass
class Wind:
    """Air of one velocity around the triangles of cloth: drag, lift with rho / 2 in them [kg/m^3], normal_drag [kg/(m^2 s)],
    (t,)."""

    triangles: np.ndarray        # (t, 3)
    drag: np.ndarray
    lift: np.ndarray
    normal_drag: np.ndarray
    wind: np.ndarray             # [m/s], (3,)
    weights: np.ndarray          # inverse masses [1/kg], (n,)

    def forces(self, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces [N], (n, 3), and K [kg/s], (n,), of points at x [m] with velocities v [m/s]."""
        p = x[self.triangles]
        area = 0.5 * np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        size = np.linalg.norm(area, axis=1)
        n = area / np.where(size > 0.0, size, 1.0)[:, None]
        r = v[self.triangles].mean(axis=1) - self.wind
        rn, rr = (r * n).sum(axis=1), np.linalg.norm(r, axis=1)
        k = self.drag * size * np.abs(rn)
        across = rr[:, None] * n - (rn / np.where(rr > 0.0, rr, 1.0))[:, None] * r          # |r| (n - (n.r) r / |r|^2)
        F = -k[:, None] * r - (self.lift * size * rn)[:, None] * across - (self.normal_drag * size * rn)[:, None] * n
        gathered = [np.bincount(self.triangles.ravel(), np.repeat(a / 3.0, 3), len(x))
                    for a in (*F.T, 2.0 * k + self.normal_drag * size)]
        return np.stack(gathered[:3], axis=1), gathered[3]

    def impulse(self, x0: np.ndarray, x1: np.ndarray, h: float, leaps: bool = False) -> np.ndarray:
        """Forces f [N], (n, 3), that act in a substep of h [s] from x0 to x1 (n, 3) [m]. leaps: of leapfrog."""
        v, own = (x1 - x0) / h, np.zeros_like(x0)
        if leaps:
            return self.forces(0.5 * (x0 + x1), v)[0]
        for _ in range(PASSES):
            F, k = self.forces(x0, v - own)
            f = F / (1.0 + h * self.weights * k)[:, None]
            own = h * self.weights[:, None] * f
        return f


def wind_of(sim: Simulation) -> Wind | None:
    """Air around a simulation's cloth over its points in solver order; None where there is none."""
    scene, model = sim.scene, sim.model
    cloths = [b for b in model.bodies if isinstance(b.source, Cloth) and b.source.feels_air]
    if not cloths:
        return None
    each, half = [len(b.triangles) for b in cloths], 0.5 * scene.air_density
    drag, lift, normal = (share * np.repeat([b.source.air[name] for b in cloths], each)
                          for name, share in (("drag", half), ("lift", half), ("normal_drag", 1.0)))
    triangles = np.concatenate([b.triangles for b in cloths])
    return Wind(triangles, drag, lift, normal, np.asarray(scene.wind, float), weights_of(sim))


def weights_of(sim: Simulation) -> np.ndarray:
    """Inverse masses [1/kg], (n,); 0 where a hard pin holds."""
    weights = 1.0 / sim.model.stack("masses")
    for pin in (p for p in sim.scene.pins if p.stiffness == np.inf):
        weights[sim.model.body(pin.body, 0).index[pin.points]] = 0.0
    return weights


class Work:
    """Follows a simulation of one world, launch by launch; where nothing is to be counted it leaves it as it is. A frame that
    is repeated counts once. frames: how many there will be. besides: what does work and is not counted, in words, or ""."""

    def __init__(self, sim: Simulation, frames: int):
        self.sim, self.air, self.weights = sim, wind_of(sim), weights_of(sim)
        self.masses = sim.model.stack("masses")
        self.masses[sim.model.gone] = 0.0
        self.blows = self.air is not None and bool(np.any(sim.scene.wind))       # air at rest only takes energy
        self.leaps = sim.plan.integrator == "leapfrog"
        self.motion = carried(sim.scene, frames) if self.steps() else None
        self.besides = uncounted(sim.scene, frames, self.motion is not None)
        self.total, self.gross, self.seconds = 0.0, 0.0, 0.0      # [J] given, [J] given and taken, [s] spent here
        self.now: list[float] = []
        self.method = Method("work", [Stage("work", "deform", self.look, 0, 0)])
        self.v = self.before = sim.state.v.numpy().astype(float)
        if self.blows or self.motion:
            sim._replay = self.frame                              # type: ignore[method-assign]
            sim.model.fuser = None                                # substeps launched one by one, whose bits are the same

    def steps(self) -> bool:
        """Whether positions are there after every substep."""
        explicit = self.sim.plan.method("explicit")
        return bool(explicit is None or explicit.steps)           # type: ignore[attr-defined]

    def places(self) -> np.ndarray:
        """World positions [m], (n, 3) in solver order."""
        state, model = self.sim.state, self.sim.model
        x = state.x.numpy().astype(float) + state.e.numpy()
        for b in model.bodies:
            x[b.first:b.last] += b.origin
        return x if model.alias is None else x[model.alias]

    def frame(self) -> None:
        """One attempt at a frame."""
        plan = self.sim.plan
        if self.method not in plan.methods:
            plan.methods.append(self.method)
        self.now, self.x, self.v = [], self.places(), self.before
        plan.frame()

    def look(self, clock: Clock) -> None:
        """A substep; of sdirk3 its second stage."""
        if not clock.ends:
            return
        began, x, h = perf_counter(), self.places(), clock.h * clock.integrator.solves
        f = np.zeros_like(x) if self.air is None else self.air.impulse(self.x, x, h, self.leaps)
        given = float((f * (x - self.x)).sum()) if self.blows else 0.0
        if self.motion:
            given += self.carry(x, f, self.sim.time + (clock.k + 1) * clock.h, h)
        self.now.append(given)
        self.v, self.x, self.seconds = (x - self.x) / h, x, self.seconds + perf_counter() - began

    def carry(self, x: np.ndarray, f: np.ndarray, t: float, h: float) -> float:
        """[J] of what has carried the scene in the substep to x at t [s]."""
        assert self.motion
        m, g, free = self.masses[:, None], np.asarray(self.sim.scene.gravity, float), self.weights > 0.0
        T = self.motion.at(t) @ np.linalg.inv(self.motion.at(t - h))
        D = self.x @ (T[:3, :3] - np.eye(3)).T + T[:3, 3]
        force = m * (((x - self.x) / h - self.v) / h - g) - f
        return float((force * D)[free].sum() - (m * g * (x - self.x))[~free].sum())

    def close(self) -> None:
        """Behind a frame."""
        self.total += sum(self.now)
        self.gross += sum(map(abs, self.now))
        self.now, self.before = [], self.v


def relative(motion: Motion, frames: np.ndarray) -> np.ndarray:
    """Transforms from the start, (frames, 4, 4)."""
    first = np.linalg.inv(motion.at(0.0))
    return np.stack([motion.at(t) @ first for t in frames])


def carried(scene: Scene, frames: int) -> Motion | None:
    """The rigid motion that every collider and every pin has, all hard; None where they have none or several, or drag of the
    whole scene takes momentum."""
    times, movers = np.arange(2 * frames + 1) / (2.0 * scene.fps), [*scene.colliders, *scene.pins]
    if scene.air_drag or not movers or any(p.stiffness < np.inf for p in scene.pins):
        return None
    each = [relative(m.motion, times) for m in movers]
    R = each[0][:, :3, :3]
    rigid = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max() < APART
    alone = all(np.abs(e - each[0]).max() < APART for e in each[1:])
    return movers[0].motion if rigid and alone and np.ptp(each[0], axis=0).max() > MOVES else None


def uncounted(scene: Scene, frames: int, carries: bool) -> str:
    """What else may do work within so many frames, in words, or "". carries: what moves is counted."""
    times = np.arange(frames + 1) / scene.fps
    movers = [] if carries else [*scene.colliders, *scene.pins]
    found = [f"{m.path} moves" for m in movers if np.ptp(relative(m.motion, times), axis=0).max() > MOVES]
    found += [f"load {load.path}" for load in scene.loads] + ["values that vary"] * bool(scene.varying)
    found += [f"muscles of {s.path}" for s in scene.springs if s.actuation]
    found += [f"pressure in {s.path}" for s in scene.softs if s.pressure]
    return ", ".join(found)
