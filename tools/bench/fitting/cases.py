"""Experiments of tools/bench/fitting/coverage.py: small scenes, what is seen of them, and where fits start, three times off.

    net         stiffness and damping of a net of springs that falls; one frame in two was seen
    drag        damping and air_drag of one spring that bounces: only their sum slows it down
    chain       stiffness and damping of a chain that is plucked at one end, seen at the other: the wave arrives late
    program     stiffness of a net and gravity, observed as an independent program has it (NumPy, Runge-Kutta of order 4)
    bar         young and density of a bar by its motion: only their ratio matters
    reaction    the same with the force of the wall
    poisson     young and poisson of a bar
    warp        stretch and shear of a membrane that hangs and swings
    fold        bend of a membrane over the edge of its pins, and stretch
    narrow      poisson of a membrane, and stretch
    wind        wind along a sheet and across it, and how thick the air is (air_drag)
    friction    of a net that slides to rest on the floor
    weigh       mass of a rigid body that a known force pushes
    slide       friction of a floor on which a box comes to rest
    pull        mass of a box and friction of its floor, by a known force across the way that it slides
    strike      mass of a ball, by the other one that it strikes

and `fine`, of a sheet of 15 x 15 points observed as 29 x 29 points are by Runge-Kutta of order 4 with half the step: what a
coarse mesh makes of its parameters is no noise, and the fit is to say so.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tools.bench.nets import reference
from wsim import Box, Bulk, Fabric, Motion, Plane, Scene, Simulation, Sphere
from wsim.fitting import Markers, Pull, Settings, Track, fit
from wsim.physics.rigid.objects import Body
from wsim.scene import Collider, shapes


@dataclass
class Case:
    """A scene, what is seen of it without noise (frames, n, 3) [m], the noise [m], true values, and where fits start. body:
    path of the rigid body of which x are the poses, (frames, 4, 4)."""

    scene: Scene
    x: np.ndarray
    noise: float
    truth: dict[str, float]
    start: dict[str, float]
    frames: np.ndarray
    points: np.ndarray | None = None
    forces: np.ndarray | None = None            # of the first pin [N]
    force_noise: float = 0.0
    body: str = ""
    together: Callable[[dict[str, float]], float] | None = None      # what alone matters of parameters that are not known apart

    @property
    def path(self) -> str:
        return self.scene.bodies()[0].path

    def seen(self, seed: int) -> list[Track]:
        """With a draw of noise, of each experiment its own; its size is told where there are forces beside positions."""
        rng, sigma = np.random.default_rng([seed, *"".join(self.truth).encode()]), None if self.forces is None else self.noise
        if self.body:
            marked = Markers.of(self.body, self.frames, self.x, size=0.3)
            marked.positions += self.noise * rng.normal(size=marked.positions.shape)
            return [marked]
        found = [Track(self.path, self.frames, self.x + self.noise * rng.normal(size=self.x.shape), self.points, sigma=sigma)]
        if self.forces is not None:
            noisy = self.forces + self.force_noise * rng.normal(size=self.forces.shape)
            found.append(Pull(self.scene.pins[0].path, self.frames, noisy, sigma=self.force_noise))
        return found

    def fit(self, seed: int):
        return fit(self.scene, self.seen(seed), list(self.truth), start=self.start, settings=Settings(device="cpu"))


def motion(scene: Scene) -> np.ndarray:
    """Positions at frames 1, 2 ..., in float64."""
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    sim.run(scene.frames, lambda s: found.append(s.positions()))
    return np.array(found)


def plain(scene: Scene, noise: float, truth: dict[str, float], start: dict[str, float], points=None, every: int = 1) -> Case:
    """All frames from `every` on, one in so many, of all points or of some."""
    frames = np.arange(every, scene.frames + 1, every)
    x = motion(scene)[frames - 1]
    return Case(scene, x if points is None else x[:, points], noise, truth, start, frames, points)


def net() -> Case:
    scene = Scene(fps=30, frames=12, solver="explicit", substeps=30)
    points, edges, stiffness, masses = shapes.spring_sheet(1.0, 4, stretch=60.0, diagonal=60.0, cross=60.0)
    scene.pin("/pin", scene.net("/net", points, edges, stiffness, masses, damping=0.02), [0, 3])
    true = float(np.mean(np.asarray(scene.springs[0].stiffness, np.float64)))
    return plain(scene, 1e-3, {"stiffness": true, "damping": 0.02}, {"stiffness": 3.0 * true, "damping": 0.02 / 3.0}, every=2)


def drag() -> Case:
    scene = Scene(fps=30, frames=20, solver="explicit", substeps=20, air_drag=1.0)
    points = np.array([[0.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    scene.pin("/pin", scene.net("/net", points, [[0, 1]], [40.0], [1.0, 1.0], damping=0.02), [0])
    case = plain(scene, 1e-4, {"damping": 0.02, "air_drag": 1.0}, {"damping": 0.06})
    case.together = lambda v: 40.0 * v["damping"] + v["air_drag"]
    return case


def chain() -> Case:
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60, frames=24, solver="explicit", substeps=20)
    points = np.zeros((12, 3))
    points[:, 0] = 0.1 * np.arange(12)
    edges = np.stack([np.arange(11), np.arange(1, 12)], axis=1)
    body = scene.net("/net", points, edges, [300.0] * 11, [0.05] * 12, damping=2e-3)
    times = np.arange(25) / 60.0
    values = np.stack([np.eye(4)] * 25)
    values[:, 0, 3] = -0.05 * np.sin(np.pi * np.minimum(times / 0.1, 1.0))**2
    scene.pin("/pin", body, [0], motion=Motion(times, values))
    return plain(scene, 1e-4, {"stiffness": 300.0, "damping": 2e-3}, {"stiffness": 100.0, "damping": 6e-3}, np.arange(9, 12))


def program() -> Case:
    scene = reference.spring_cloth(6)
    scene.solver, scene.substeps, scene.frames = "explicit", 64, 12
    frames = np.arange(1, 13)
    x, error = reference.exact(reference.net(scene), (frames / scene.fps).tolist(), tolerance=1e-7)
    assert error < 1e-7
    stiffness = float(scene.springs[0].stiffness.astype(np.float64).mean())
    return Case(scene, x, 1e-3, {"stiffness": stiffness, "gravity_y": scene.gravity[1]},
                {"stiffness": stiffness / 3.0, "gravity_y": scene.gravity[1] / 3.0}, frames)


def soft(young: float, poisson: float, frames: int) -> Scene:
    scene = Scene(fps=60, frames=frames, solver="implicit", integrator="bdf2", substeps=2, iterations=3)
    points, tets = shapes.block((0.6, 0.2, 0.2), (3, 1, 1))
    body = scene.soft("/bar", points, tets, material=Bulk(young, poisson, 1e3))
    scene.pin("/wall", body, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def bar() -> Case:
    case = plain(soft(7e6, 0.3, 8), 1e-5, {"young": 7e6, "density": 1e3}, {"young": 2.1e7, "density": 5e2})
    case.together = lambda v: v["young"] / v["density"]
    return case


def reaction() -> Case:
    scene = soft(1e5, 0.3, 12)
    case = plain(scene, 1e-4, {"young": 1e5, "density": 1e3}, {"young": 3e5, "density": 3e3})
    sim, forces = Simulation(scene, device="cpu", precision="float64"), []
    sim.run(scene.frames, lambda s: forces.append(s.reactions("/wall").sum(axis=0)))
    case.forces, case.force_noise = np.array(forces), 0.5
    return case


def poisson() -> Case:
    return plain(soft(1e5, 0.3, 12), 1e-6, {"young": 1e5, "poisson": 0.3}, {"young": 3e5, "poisson": 0.1})


def membrane(frames: int = 10, substeps: int = 24, horizontal: bool = True, **more) -> Scene:
    scene = Scene(fps=30, frames=frames, solver="explicit", substeps=substeps)
    fabric = {"stretch": 60.0, "shear": 25.0, "bend": 1e-3, "density": 200.0} | more
    mesh = shapes.sheet(1.0, 1.0, 4, 4, horizontal=horizontal)
    cloth = scene.cloth("/sheet", *mesh, model="membrane", material=Fabric(**fabric))
    scene.pin("/pin", cloth, [0, 4])
    return scene


def warp() -> Case:
    return plain(membrane(), 1e-4, {"stretch": 60.0, "shear": 25.0}, {"stretch": 180.0, "shear": 25.0 / 3.0})


def fold() -> Case:
    return plain(membrane(bend=0.02), 1e-5, {"stretch": 60.0, "bend": 0.02}, {"stretch": 20.0, "bend": 0.06})


def narrow() -> Case:
    return plain(membrane(poisson=0.3), 1e-4, {"stretch": 60.0, "poisson": 0.3}, {"stretch": 180.0, "poisson": 0.1})


def wind() -> Case:
    scene = membrane(horizontal=False)
    scene.wind, scene.air_drag = (3.0, 0.0, 6.0), 0.5
    scene.cloths[0].drag, scene.cloths[0].lift = 1.0, 0.5
    return plain(scene, 1e-3, {"wind_x": 3.0, "wind_z": 6.0, "air_drag": 0.5}, {"wind_x": 1.0, "wind_z": 2.0, "air_drag": 1.5})


def friction() -> Case:
    scene = Scene(fps=30, frames=12, solver="explicit", substeps=30)
    points, edges, stiffness, masses = shapes.spring_sheet(0.4, 3, stretch=200.0, diagonal=200.0, cross=10.0)
    points = points - [0.0, points[:, 1].min() - 1e-3, 0.0]
    body = scene.net("/net", points, edges, stiffness, masses)
    body.velocities = np.tile([1.5, 0.0, 0.0], (len(points), 1))
    scene.collider("/floor", Plane("Z"), static_friction=0.3, dynamic_friction=0.3)
    return plain(scene, 1e-3, {"dynamic_friction": 0.3}, {"dynamic_friction": 0.1})


def rigid(frames: int = 20) -> Scene:
    return Scene(gravity=(0.0, 0.0, -9.81), up="Z", fps=60.0, frames=frames, substeps=4, contact_tolerance=1e-10)


def watched(scene: Scene, path: str, truth: dict[str, float], start: dict[str, float]) -> Case:
    """The poses of a rigid body, to a millimetre."""
    sim, found = Simulation(scene, device="cpu", precision="float64"), []
    sim.run(scene.frames, lambda s: found.append(s.poses(path)[path]))
    return Case(scene, np.array(found), 1e-3, truth, start, np.arange(1, scene.frames + 1), body=path)


def weigh() -> Case:
    scene = rigid()
    scene.add(Body("/body", mass=0.4, center=np.zeros(3), inertia=np.ones(3), velocity=(3.0, 0.0, 4.0), force=(5.0, 0.0, 0.0)))
    return watched(scene, "/body", {"mass": 0.4}, {"mass": 1.2})


def floored(floor: float, **more) -> Scene:
    """A box on a floor, of which friction is the mean of both."""
    scene = rigid()
    scene.collider("/floor", Plane("Z"), static_friction=floor, dynamic_friction=floor)
    shape = Collider("/box/shape", Box((0.2, 0.15, 0.04)), static_friction=0.35, dynamic_friction=0.35)
    scene.add(Body("/box", [shape], Motion.at_place((0.0, 0.0, 0.04 - 1e-9)), mass=0.8, **more))
    return scene


def slide() -> Case:
    return watched(floored(0.55, velocity=(1.2, 0.0, 0.0)), "/box", {"/floor:dynamic_friction": 0.55},
                   {"/floor:dynamic_friction": 0.55 / 3.0})


def pull() -> Case:
    scene = floored(0.3, velocity=(2.5, 0.0, 0.0), force=(0.0, 3.0, 0.0))
    return watched(scene, "/box", {"mass": 0.8, "/floor:dynamic_friction": 0.3}, {"mass": 2.4, "/floor:dynamic_friction": 0.1})


def strike() -> Case:
    scene = rigid()
    for path, mass, x, v in (("/first", 0.5, 0.0, 2.0), ("/second", 1.0, 0.35, 0.0)):
        shape = Collider(f"{path}/ball", Sphere(0.1), restitution=0.6, static_friction=0.0, dynamic_friction=0.0)
        scene.add(Body(path, [shape], Motion.at_place((x, 0.03 * (path == "/first"), 1.0)), mass=mass, velocity=(v, 0.0, 0.0)))
    return watched(scene, "/second", {"/first:mass": 0.5}, {"/first:mass": 1.5})


def fine() -> Case:
    def sheet(cells: int, substeps: int, integrator: str) -> Scene:
        scene = Scene(fps=24, frames=10, solver="explicit", substeps=substeps, integrator=integrator)
        cloth = scene.cloth("/sheet", *shapes.sheet(1.0, 1.0, cells, cells, horizontal=True),
                            material=Fabric(stretch=200.0, shear=60.0, bend=1e-2, density=200.0))
        scene.pin("/pin", cloth, [0, cells])
        return scene
    scene, other = sheet(14, 60, "auto"), sheet(28, 360, "rk4")
    own = (2 * np.arange(15)[:, None] * 29 + 2 * np.arange(15)).ravel()
    return Case(scene, motion(other)[:, own], 5e-3, {"stretch": 200.0, "bend": 1e-2}, {"stretch": 300.0, "bend": 7e-3},
                np.arange(1, 11))


CASES: dict[str, Callable[[], Case]] = {f.__name__: f for f in (net, drag, chain, program, bar, reaction, poisson, warp, fold,
                                                                narrow, wind, friction, weigh, slide, pull, strike, fine)}
