"""What tests/gradient/test_gradients.py shares with other tests: Run, WEIGHTS, bar, everything_of_a_sheet, leapfrog, net,
sheet."""

import numpy as np
import pytest

from wsim.gradient.recording import Recording
from wsim.scene import Cloth, Pin, Scene, Soft, Springs, shapes
from wsim.scene.check.sharp import has_edge_contacts
from wsim.scene.fabric import Fabric
from wsim.scene.solid import Bulk
from wsim.simulation.simulation import Simulation

STEPS = {"damping": 0.03, "poisson": 0.002, "bend": 0.03, "stretch": 0.006, "weft": 0.006, "shear": 0.006}      # relative
WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])      # Fornberg 1988, table 1


class Run:
    """A scene, a linear loss of its last positions and velocities, and its gradient."""

    def __init__(self, scene: Scene, frames: int = 3, **how):
        self.scene, self.frames = scene, frames
        self.sim = Simulation(scene, device="cpu", precision="float64", gradients=True)
        self.recording = Recording(self.sim, frames, **how)
        self.recording.run()
        self.path = scene.bodies()[0].path
        rng = np.random.default_rng(5)
        self.x, self.v = rng.normal(size=(2, len(scene.bodies()[0].points), 3))
        self.v *= 0.01
        self.gradient = self.recording.backward({frames: {self.path: self.x}}, {frames: {self.path: self.v}})

    def loss(self) -> float:
        """Of the recording itself."""
        r = self.recording
        return float((r.positions(self.frames) * self.x).sum() + (r.velocities(self.frames) * self.v).sum())

    def slope(self, values, step: float) -> float:
        """Derivative of the loss of runs without gradients by s, where values(s) are (path, name, value) to be set: to order 8,
        a world for each run. Edges of cloth meet nothing where there are gradients."""
        parts = [sign * k * step for k in range(1, 5) for sign in (1, -1)]
        solved = self.scene.solver == "implicit"         # to the residual that recordings reach
        sim = Simulation(self.scene, device="cpu", precision="float64", worlds=len(parts),
                         gradients=solved or has_edge_contacts(self.scene))
        for world, s in enumerate(parts):
            sim.set(*values(s), world)
        Recording(sim, self.frames).run() if solved else sim.run(self.frames)
        losses = [(sim.positions(self.path, w) * self.x).sum() + (sim.velocities(self.path, w) * self.v).sum()
                  for w in range(len(parts))]
        return float(np.reshape(losses, (4, 2)) @ (1, -1) @ WEIGHTS / step)

    def check(self, found: float, values, step: float, within: float = 2e-9) -> None:
        expected = self.slope(values, step)
        assert abs(expected) > 0.0
        assert found == pytest.approx(expected, rel=within)

    def state(self, name: str, step: float = 5e-5) -> None:
        """By the initial positions or velocities (of a step 40 times as long), along a random direction."""
        start = getattr(self.recording, name)(0, self.path)
        way = np.random.default_rng(6).normal(size=start.shape)
        self.check((getattr(self.gradient, name)(self.path) * way).sum(), lambda s: (self.path, name, start + s * way),
                   step if name == "positions" else 40.0 * step)

    def material(self, name: str, value: float, step: float = 1.0) -> None:
        self.check(self.gradient.material(name, self.path), lambda s: (self.path, name, value + s),
                   step * STEPS.get(name, 0.02) * value)

    def world(self) -> None:
        """By gravity and drag of the air."""
        g, way = np.asarray(self.scene.gravity), np.array([0.3, -0.5, 0.8])
        self.check(self.gradient.gravity() @ way, lambda s: ("/", "gravity", g + s * way), 0.02)
        self.check(self.gradient.air_drag(), lambda s: ("/", "air_drag", self.scene.air_drag + s), 0.02)


def net(**kwargs) -> Scene:
    """A chain of springs hung at one end, not quite straight."""
    points = np.array([[0.1 * i, 0.0, 0.003 * (i % 3)] for i in range(12)])
    edges = np.stack([np.arange(11), np.arange(1, 12)], axis=1)
    chain = Springs("/chain", points, edges, masses=0.01, stiffness=np.array([kwargs.pop("stiffness", 40.0)]),
                    damping=kwargs.pop("damping", 1e-3), lengths=kwargs.pop("lengths", None))
    return Scene(**({"objects": {"Springs": [chain]}, "pins": [Pin("/pin", "/chain", np.array([0]))], "fps": 60, "frames": 4,
                     "air_drag": 0.4, "solver": "explicit", "substeps": 40} | kwargs))


def leapfrog(x, v, free, i, j, k, rest, masses, gravity, h: float, steps: int) -> np.ndarray:
    """Kick, drift, kick of springs between the points i and j, of analytic functions only: right for complex arguments too."""
    def speed(x):
        r = x[j] - x[i]
        pull = (k * (1.0 - rest / np.sqrt((r * r).sum(axis=1))))[:, None] * r
        f = np.zeros(x.shape, complex)
        np.add.at(f, i, pull)
        np.add.at(f, j, -pull)
        return free * (f / masses[:, None] + gravity)
    a = speed(x)
    for _ in range(steps):
        v = v + 0.5 * h * a
        x = x + h * v
        a = speed(x)
        v = v + 0.5 * h * a
    return np.stack([x, v])


def sheet(model: str, **kwargs) -> Scene:
    """A cloth of 5 x 5 points, bent and sheared, held at two corners."""
    points, counts, indices = shapes.sheet(0.2, 0.2, 4, 4)
    rest = points.copy()
    points[:, 2] = 0.3 * points[:, 0] ** 2 + 0.1 * points[:, 0] * points[:, 1]
    fabric = Fabric(stretch=40.0, weft=25.0 * (model == "membrane"), shear=15.0, bend=2e-4, density=150.0,
                    thickness=1e-3, poisson=0.2 * (model == "membrane"), damping=kwargs.pop("damping", 0.0))
    cloth = Cloth("/cloth", points, counts, indices, rest_points=rest, model=model, material=fabric)
    return Scene(objects={"Cloth": [cloth]}, pins=[Pin("/pin", "/cloth", np.array([20, 24]))], fps=60, frames=4, air_drag=0.2,
                 **({"solver": "explicit", "integrator": "leapfrog", "substeps": 50} | kwargs))


def everything_of_a_sheet(run: Run) -> None:
    """By its material, its start, its density and the world."""
    cloth = run.scene.cloths[0]
    for name in ("stretch", "bend", "damping", *["shear", "weft"] * (cloth.model == "membrane")):
        run.material(name, getattr(cloth.material, name))
    run.state("positions")
    run.state("velocities")
    run.check(run.gradient.density(), lambda s: ("/cloth", "density", 150.0 + s), 0.8)
    run.world()


def bar(model: str, **kwargs) -> Scene:
    """A bar of 40 tets, clamped at one end and turning about itself."""
    points, tets = shapes.block((0.4, 0.1, 0.1), (4, 2, 1))
    ends = np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6)
    spin = np.stack([0 * points[:, 0], -4.0 * points[:, 2] * points[:, 0], 4.0 * points[:, 1] * points[:, 0]], axis=1)
    soft = Soft("/bar", points, tets, velocities=spin, material=Bulk(2e4, 0.35, 1e3, model, damping=kwargs.pop("damping", 0.0)))
    return Scene(objects={"Soft": [soft]}, pins=[Pin("/pin", "/bar", ends)], fps=60, frames=4,
                 **({"solver": "explicit", "integrator": "leapfrog", "substeps": 40} | kwargs))
