"""Rods with known answers."""

import numpy as np

from wsim.physics.rods.objects import Rods
from wsim.scene import Motion, Scene, Sphere
from wsim.simulation.simulation import Simulation

YOUNG, POISSON, DENSITY, RADIUS = 1e8, 0.3, 1000.0, 0.01
AREA, SECOND = np.pi * RADIUS**2, np.pi * RADIUS**4 / 4.0
FIRST = 1.8751040687                      # of a clamped beam: cosh b cos b = -1


def scene(x, gravity=(0.0, 0.0, 0.0), fps=60.0, **more) -> tuple[Scene, Rods]:
    """A rod through points x, of `RADIUS`, alone."""
    found = Scene(gravity=gravity, fps=fps, substeps=1)
    given = {"diameters": 2.0 * RADIUS, "young": YOUNG, "poisson": POISSON, "density": DENSITY} | more
    return found, found.add(Rods("/rod", x, [len(x)], **given))


def clamped(n: int, **more) -> tuple[Scene, Rods]:
    """A metre of rod along x with n points, clamped at 0 by an edge before it."""
    x = np.zeros((n + 1, 3))
    x[:, 0] = (np.arange(n + 1) - 1.0) / (n - 1)
    found, rods = scene(x, **more)
    rods.pin("/clamp", [0, 1])
    return found, rods


def simulated(scene: Scene, **more):
    """The simulation, and its method."""
    simulation = Simulation(scene, device="cpu", **more)
    return simulation, simulation.plan.method("rods")


def period(times: np.ndarray, values: np.ndarray) -> float:
    """From the first two zeros of an oscillation."""
    k = np.flatnonzero(values[:-1] * values[1:] < 0.0)[:2]
    zero = times[k] + (times[k + 1] - times[k]) * values[k] / (values[k] - values[k + 1])
    return 2.0 * (zero[1] - zero[0])


def turning(axis: np.ndarray, center: np.ndarray, times: np.ndarray, angles: np.ndarray) -> Motion:
    """Rotation about an axis through a place."""
    K = np.cross(np.eye(3), -axis)
    frames = np.tile(np.eye(4), (len(times), 1, 1))
    for F, a in zip(frames, angles, strict=True):
        F[:3, :3] = np.eye(3) + np.sin(a) * K + (1.0 - np.cos(a)) * K @ K
        F[:3, 3] = center - F[:3, :3] @ center
    return Motion(times, frames)


def on_ball() -> Scene:
    """48 strands of three lengths that fall on a ball, which the first reach in the sixth frame."""
    k = np.arange(48)
    counts = np.array([9, 20, 40])[k % 3]
    x = np.concatenate([np.stack([np.full(n, 0.1 * np.cos(i)), np.full(n, 0.24 + 0.001 * i), np.linspace(-0.15, 0.2, n)],
                                 axis=1) for i, n in enumerate(counts)])
    made = Scene(gravity=(0.0, -9.81, 0.0), fps=60.0, substeps=4)
    made.add(Rods("/strands", x, counts, 2e-4, 1e9, density=1300.0))
    made.collider("/ball", Sphere(0.2))
    return made
