"""What tests/physics/rods/test_bodies.py shares with other tests: G, THICK, at, box, line, lying, masses, thrown."""

import numpy as np

from tests.physics.rods.rig import simulated
from wsim.physics.rigid.objects import Body
from wsim.physics.rods.objects import Rods
from wsim.scene import Box, Collider, Motion, Scene

G, THICK = 9.81, 0.02


def at(x) -> Motion:
    frame = np.eye(4)
    frame[:3, 3] = x
    return Motion.still(frame)


def box(scene: Scene, path: str, half, x, friction: float = 0.5, **more) -> Body:
    """A box of half edges `half` about x."""
    c = Collider(f"{path}/shape", Box(half), static_friction=friction, dynamic_friction=friction)
    return scene.add(Body(path, [c], at(x), **more))


def line(n: int, half: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    return np.stack([np.linspace(-half, half, n), np.full(n, y), np.full(n, z)], axis=1)


def masses(method, rigid) -> tuple[np.ndarray, np.ndarray]:
    """Of points and bodies [kg]."""
    return method.table.values["m"].T.ravel(), np.array([m.mass for m in rigid.masses])


def thrown(mass: float, on: bool, speed: float = 10.0) -> Scene:
    """A box that is thrown at a rope which nothing holds, beside its middle."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=60.0, substeps=4)
    scene.add(Rods("/rope", line(21, 0.4), [21], THICK, young=1e7, self_collision=on))
    box(scene, "/box", (0.05, 0.05, 0.05), (0.03, 0.15, 0.0), mass=mass, velocity=np.array([0.5, -speed, 0.1]))
    return scene


def lying(degrees: float, frames: int, n: int = 41) -> float:
    """Speed [m/s] of a box of 1 kg on two held rods of n points which are tilted, friction 0.5, after so many frames."""
    a = np.radians(degrees)
    scene = Scene(gravity=(G * np.sin(a), -G * np.cos(a), 0.0), fps=60.0, substeps=4)
    rods = scene.add(Rods("/rails", np.concatenate([line(n, 1.0, 0.0, z) for z in (0.08, -0.08)]), [n, n], THICK, young=1e9))
    rods.pin("/held", np.arange(2 * n))
    box(scene, "/box", (0.1, 0.02, 0.15), (0.0, 0.02 + 0.5 * THICK, 0.0), mass=1.0)
    simulation, _ = simulated(scene)
    simulation.run(frames)
    return float(simulation.plan.method("rigid").velocities()[0, 0])
