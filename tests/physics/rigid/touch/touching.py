"""Scenes of a ball, a box and points that they touch. All have the same kinds of things, so that they share their kernels."""

import numpy as np

from tests.make.physics.rigid.contact import ball, box
from wsim.scene import Scene
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

FAR = 50.0


def grid(n: int, size: float, y: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Points (n n, 3) of a level square about the origin, and its quads."""
    side = np.linspace(-0.5 * size, 0.5 * size, n)
    points = np.array([(x, y, z) for z in side for x in side])
    k = np.arange(n * n).reshape(n, n)[:-1, :-1].ravel()
    return points, np.stack([k, k + n, k + n + 1, k + 1], 1)


def rim(n: int) -> list[int]:
    k = np.arange(n * n)
    return k[(k % n == 0) | (k % n == n - 1) | (k // n == 0) | (k // n == n - 1)].tolist()


def scene(*bodies, n: int = 13, size: float = 1.0, density: float = 200.0, stretch: float = 1e3, damping: float = 0.0,
          pinned: bool = False, gravity=(0.0, -9.81, 0.0), rub: float = 0.5, **more) -> Scene:
    """A sheet of 1 mm in y = 0 and bodies, with a ball and a box that are far away."""
    found = Scene(**{"gravity": gravity, "fps": 60.0, "substeps": 10, "iterations": 8, "solver": "xpbd"} | more)
    points, quads = grid(n, size)
    fabric = Fabric(density=density, thickness=1e-3, stretch=stretch, shear=0.3 * stretch, damping=damping, static_friction=rub,
                    dynamic_friction=rub)
    sheet = found.cloth("/sheet", points, np.full(len(quads), 4), quads.ravel(), material=fabric)
    if pinned:
        found.pin("/pin", sheet, rim(n))
    for body in (*bodies, ball("/far/ball", (FAR, 0.0, 0.0), rub=rub), box("/far/box", (FAR, 0.0, 5.0), rub=rub)):
        found.add(body)
    return found


def run(found: Scene, **more) -> Simulation:
    return Simulation(found, **{"device": "cpu"} | more)


class Mixed:
    """What bodies near the sheet and its points have together, now."""

    def __init__(self, sim: Simulation):
        s, w = sim.plan.state, sim.plan.ports.constants.w.numpy().astype(np.float64)
        self.m = np.where(w > 0.0, 1.0 / np.maximum(w, 1e-300), 0.0)
        self.v = (s.b if s.has_point_field("b") else s.v).numpy().astype(np.float64)  # leapfrog's own is half a step before
        method = sim.plan.method("rigid")
        self.near = np.array(["far" not in body.path for body, _ in method.bodies])
        self.p, self.speeds, self.spins = method.get("p"), method.velocities(), method.spins()
        self.x = method.poses()[:, :3, 3]
        self.mass = np.array([one.mass for one in method.masses])

    @property
    def momentum(self) -> np.ndarray:
        return self.m @ self.v + self.p[self.near].sum(0)

    @property
    def moved(self) -> float:
        """Sum of the momenta' sizes."""
        return float(self.m @ np.linalg.norm(self.v, axis=1) + np.linalg.norm(self.p[self.near], axis=1).sum())

    @property
    def fastest(self) -> float:
        return float(max(np.abs(self.v).max(), np.abs(self.speeds[self.near]).max()))
