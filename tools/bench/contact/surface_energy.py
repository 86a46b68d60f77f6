"""Energy that surfaces gain where they touch each other, beside penetration, the motion of a converged run, and CPU time.

    python -m tools.bench.contact.surface_energy [--scenes box,crumple] [--methods "newton,newton bdf2"] [--reference]
        [--counts]

Colliders are still and nothing drives, so total energy may fall only. Of a row, at ends of frames:

    gain       largest rise of the energy over its least so far, in percent of the largest kinetic energy so far
    lost       energy that is gone at the end, in percent of the largest kinetic energy
    deep       largest depth of a point below a collider [mm]        thin: part of the points nearer than half a thickness
    crossed    pairs of triangles that intersect, by the exact test, behind the last frame
    off        distance of the points from those of the reference behind the frame NEAR, root mean square [mm]
    steps      Newton steps a substep, with --counts       rounds: iterations of conjugate gradients a substep, likewise
    CPU-s      of the frames but the first two, which compile and capture

The reference is leapfrog at four times the substeps that are stable. Motions of sheets that crumple are chaotic behind some
frames: `off` is read before that, and compares methods with each other.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.make.physics.contact.selfcontact.rest import folded
from tests.make.physics.solver.newton_surfaces import draped, thrown
from tests.physics.contact.selfcontact.rig import crossed
from tools.bench.nets.garments import stable
from wsim.physics.rigid.objects import Body
from wsim.physics.rods.objects import Rods
from wsim.scene import Collider, Motion, Plane, Scene, Sphere, shapes
from wsim.scene.fabric import fabric
from wsim.simulation.simulation import Simulation

G = (0.0, -9.81, 0.0)
NEAR = 6                         # frame behind which motions are compared
FINER = 4                        # times the substeps with which leapfrog is stable
METHODS = {"newton": "backward_euler", "newton bdf2": "bdf2", "newton midpoint": "implicit_midpoint"}
MIXED = ("newton", "newton bdf2")               # with strands


def level(side: float, count: int, y: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A level sheet about (0, y, 0)."""
    points, counts, indices = shapes.sheet(side, side, count, count, horizontal=True)
    points = np.array(points, np.float64)
    return points - points.mean(axis=0) + (0.0, y, 0.0), counts, indices


def made(integrator: str, **more) -> Scene:
    given = dict(solver="implicit", integrator=integrator, substeps=12, iterations=3, fps=24.0, gravity=G)
    return Scene(**given | more)


def on_ball(integrator: str, **more) -> Scene:
    """A sheet of cotton that falls on a ball on a floor."""
    scene = made(integrator, **more)
    scene.cloth("/c", *level(0.5, 10, 0.26), material=fabric("cotton"), self_collision=True)
    scene.collider("/ball", Sphere(0.12), at=(0.01, 0.12, 0.02))
    scene.collider("/floor", Plane())
    return scene


def crumpled(integrator: str, **more) -> Scene:
    """A crumpled sheet whose points fly towards its middle, and fall on a floor."""
    scene = made(integrator, **more)
    points, counts, indices = level(0.3, 12, 0.2)
    rng, place = np.random.default_rng(3), points - (0.0, 0.2, 0.0)
    waves = sum(rng.normal(size=3)[None] * np.sin(place @ (rng.normal(size=3) * 30.0) + rng.uniform(0, 6))[:, None]
                for _ in range(4))
    scene.cloth("/c", points, counts, indices, material=fabric("cotton"), self_collision=True,
                velocities=-3.0 * place / 0.15 + 0.75 * waves)
    scene.collider("/floor", Plane())
    return scene


def twice(integrator: str, **more) -> Scene:
    """A strip that is laid in three and falls from 3 cm on a floor, without air."""
    scene = folded(**dict(solver="implicit", integrator=integrator, substeps=10, iterations=3) | more)
    scene.air_drag = 0.0
    scene.cloths[0].points[:, 1] += 0.03
    return scene


def block(scene: Scene, path: str, at, size: float = 0.12, cells: int = 2, **more) -> None:
    points, tets = shapes.block((size, size, size), (cells, cells, cells))
    points = np.array(points, np.float64)
    scene.soft(path, points - points.mean(axis=0) + at, tets, self_collision=True, **more)


def blocks(integrator: str, **more) -> Scene:
    """Two blocks of jelly on a floor, one falls on the other off its middle."""
    scene = made(integrator, **more)
    block(scene, "/a", (0.0, 0.07, 0.0))
    block(scene, "/b", (0.03, 0.26, 0.02))
    scene.collider("/floor", Plane())
    return scene


def block_on_cloth(integrator: str, **more) -> Scene:
    """A block of jelly that falls into a cloth held by its corners."""
    scene = made(integrator, **more)
    scene.cloth("/c", *level(0.5, 8), material=fabric("denim"), self_collision=True)
    scene.pin("/p", scene.cloths[0], [0, 8, 72, 80])
    block(scene, "/b", (0.02, 0.15, 0.01))
    return scene


def rope_on_cloth(integrator: str, **more) -> Scene:
    """A rope that falls across a cloth held by its corners."""
    scene = made(integrator, **more)
    scene.cloth("/c", *level(0.5, 8), material=fabric("denim"), self_collision=True)
    scene.pin("/p", scene.cloths[0], [0, 8, 72, 80])
    x = np.stack([np.linspace(-0.2, 0.2, 17), np.full(17, 0.1), np.linspace(-0.05, 0.03, 17)], axis=1)
    scene.add(Rods("/rope", x, [17], 8e-3, young=1e6, self_collision=True))
    return scene


def ball_in_cloth(integrator: str, **more) -> Scene:
    """A rigid ball that falls into a cloth which touches itself, held by its corners."""
    scene = made(integrator, **more)
    scene.cloth("/c", *level(0.5, 8), material=fabric("cotton"), self_collision=True)
    scene.pin("/p", scene.cloths[0], [0, 8, 72, 80])
    scene.add(Body("/ball", [Collider("/ball/shape", Sphere(0.06))], Motion.at_place((0.02, 0.15, 0.01)), mass=0.3))
    return scene


def wrapped(integrator: str, **more) -> Scene:
    """A sheet that falls over a rigid ball on a floor."""
    scene = made(integrator, **more)
    scene.cloth("/c", *level(0.5, 10, 0.26), material=fabric("cotton"), self_collision=True)
    scene.add(Body("/ball", [Collider("/ball/shape", Sphere(0.1))], Motion.at_place((0.01, 0.1, 0.02)), mass=0.3))
    scene.collider("/floor", Plane())
    return scene


@dataclass(frozen=True)
class Case:
    make: Callable[..., Scene]
    frames: int
    methods: tuple[str, ...] = tuple(METHODS)


CASES = {"box": Case(draped, 12), "ball": Case(on_ball, 16), "thrown": Case(thrown, 12), "crumple": Case(crumpled, 16),
         "folded": Case(twice, 24), "blocks": Case(blocks, 16), "block on cloth": Case(block_on_cloth, 16),
         "rope on cloth": Case(rope_on_cloth, 16, MIXED), "ball in cloth": Case(ball_in_cloth, 16, MIXED),
         "wrapped": Case(wrapped, 16, MIXED)}


def rod_energy(method) -> tuple[float, float]:
    """Kinetic energy, and all, of straight rods: with that in gravity, of stretching and bending."""
    table, kinetic, stored = method.table, 0.0, 0.0
    for k, (rods, world) in enumerate(table.pairs):
        if world == 0:
            x, v = method.points(k)
            m = table.values["m"].T.ravel()
            d = np.diff(x, axis=0)
            length = np.linalg.norm(d, axis=1)
            rest = np.linalg.norm(np.diff(rods.points, axis=0), axis=1)
            area, second = np.pi * rods.diameters[0]**2 / 4.0, np.pi * rods.diameters[0]**4 / 64.0
            t = d / length[:, None]
            turn = 2.0 * np.cross(t[:-1], t[1:]) / (1.0 + (t[:-1] * t[1:]).sum(1))[:, None]
            kinetic += float(0.5 * m @ (v**2).sum(1))
            stored += float((0.5 * rods.young * area * (length - rest)**2 / rest).sum() - m @ (x @ np.array(G)))
            stored += float((rods.young * second * (turn**2).sum(1) / (rest[:-1] + rest[1:])).sum())
    return kinetic, kinetic + stored


def energies(sim: Simulation) -> tuple[float, float]:
    """Kinetic energy of what moves, and total energy [J]."""
    told = sim.indicators()
    kinetic, total = told["kinetic_energy"], told["energy"] + told.get("rigid_energy", 0.0)
    if rods := next((m for m in sim.plan.methods if m.name == "rods"), None):
        more = rod_energy(rods)
        kinetic, total = kinetic + more[0], total + more[1]
    if rigid := next((m for m in sim.plan.methods if m.name == "rigid"), None):
        kinetic += 0.5 * float((rigid.read("p") * rigid.velocities()).sum() + (rigid.read("L") * rigid.spins()).sum())
    return kinetic, total


class Counts:
    """Newton steps and iterations of conjugate gradients of frames that are not captured."""

    def __init__(self, sim: Simulation):
        self.steps = self.rounds = 0
        newton = next(m for m in sim.plan.methods if m.name == "implicit")
        self.count, own = newton.assembly.system.count, newton.step
        sim._replay = sim.plan.frame

        def step(*given, **more) -> None:
            before = self.count.numpy().max()
            own(*given, **more)
            self.steps += 1
            self.rounds += max(int(self.count.numpy().max() - before), 0)
        newton.step = step


@dataclass
class Seen:
    """What a run gave, by frames."""

    energy: list[float]
    kinetic: list[float]
    deep: float = 0.0
    thin: float = 0.0
    near: np.ndarray | None = None
    crossed: int = 0
    seconds: float = 0.0
    integrator: str = ""
    steps: float = 0.0
    rounds: float = 0.0

    def gain(self) -> float:
        """In percent of the largest kinetic energy so far."""
        e = np.array(self.energy)
        return 100.0 * float(np.max((e - np.minimum.accumulate(e)) / np.maximum(np.maximum.accumulate(self.kinetic), 1e-300)))

    def lost(self) -> float:
        return 100.0 * (self.energy[0] - self.energy[-1]) / max(self.kinetic)


def watched(scene: Scene, frames: int, counts: bool = False) -> Seen:
    sim = Simulation(scene, device="cpu")
    kinetic, energy = energies(sim)
    seen, counter = Seen([energy], [kinetic]), Counts(sim) if counts else None
    for k in range(frames):
        began = time.process_time()
        sim.step()
        seen.seconds += time.process_time() - began if k > 1 else 0.0
        kinetic, energy = energies(sim)
        told = sim.indicators()
        seen.kinetic.append(kinetic)
        seen.energy.append(energy)
        seen.deep = max(seen.deep, 1e3 * told.get("penetration", 0.0))
        seen.thin = max(seen.thin, told.get("thin", 0.0))
        if k == NEAR - 1:
            seen.near = np.concatenate([sim.positions(b.path) for b in sim.model.bodies])
    if not scene.softs:
        seen.crossed = crossed(sim)
    seen.integrator = sim.plan.integrator
    if counter:
        n = frames * sim.plan.clock.substeps
        seen.steps, seen.rounds = counter.steps / n, counter.rounds / n
    return seen


def reference(case: Case) -> Seen:
    scene = case.make("backward_euler")
    scene.solver, scene.integrator = "explicit", "leapfrog"
    scene.substeps = FINER * stable(scene, "cpu")
    print(f"{'':16} leapfrog by {scene.substeps} substeps")
    return watched(scene, case.frames)


def row(name: str, method: str, seen: Seen, truth: Seen | None) -> str:
    off = 1e3 * float(np.sqrt(((seen.near - truth.near)**2).sum(1).mean())) if truth else float("nan")
    by = f"gave way to {seen.integrator}" if method in METHODS and METHODS[method] != seen.integrator else ""
    return (f"{name:16} {method:16} {seen.gain():7.2f} {seen.lost():7.1f} {seen.deep:7.3f} {seen.thin:5.2f} {seen.crossed:7d} "
            f"{off:7.2f} {seen.steps:6.2f} {seen.rounds:7.1f} {seen.seconds:7.2f} {by}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default=",".join(CASES))
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--reference", action="store_true")
    parser.add_argument("--counts", action="store_true", help="count Newton steps; times mean nothing then")
    args = parser.parse_args()
    heads = {"gain %": 7, "lost %": 7, "deep mm": 7, "thin": 5, "crossed": 7, "off mm": 7, "steps": 6, "rounds": 7, "CPU-s": 7}
    print(f"{'scene':16} {'method':16} " + " ".join(f"{head:>{width}}" for head, width in heads.items()))
    for name in args.scenes.split(","):
        case = CASES[name]
        truth = reference(case) if args.reference else None
        if truth:
            print(row(name, "leapfrog", truth, truth), flush=True)
        for method in args.methods.split(","):
            if method in case.methods:
                print(row(name, method, watched(case.make(METHODS[method]), case.frames, args.counts), truth), flush=True)


if __name__ == "__main__":
    main()
