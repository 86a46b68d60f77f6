"""Tanks of liquid, and what is known of them."""

import numpy as np

from wsim.physics.fluid.liquid.objects import Liquid, LiquidSource
from wsim.scene import Motion, Scene
from wsim.scene.solids import Box
from wsim.simulation.simulation import Simulation

GRAVITY = (0.0, -9.81, 0.0)
NAMES = "xyz"


def water(low, high, **more) -> LiquidSource:
    """A box of it, from corner to corner [m]."""
    low, high = np.array(low, float), np.array(high, float)
    path, half = more.pop("path", "/water"), tuple(0.5 * (high - low))
    return LiquidSource(path, Box(half), Motion.at_place(tuple(0.5 * (low + high))), **more)


def tank(n: tuple[int, ...], fill, *, cell: float = 1.0 / 32.0, frames: int = 24, fps: float = 24.0, gravity=GRAVITY,
         velocity=None, **more) -> Scene:
    """A scene with a box of n cells from the origin on, filled from corner fill[0] to corner fill[1] [m]."""
    scene = Scene(fps=fps, frames=frames, gravity=gravity)
    shape = np.array([*n, 1, 1][:3])
    scene.add(Liquid("/tank", np.zeros(3), shape * cell, cell, **more))
    if len(n) == 2:
        fill = [(*fill[0], 0.0), (*fill[1], cell)]
    scene.add(water(*fill, velocity=velocity))
    return scene


def method(sim: Simulation):
    return sim.plan.method("liquid")


def particles(sim: Simulation) -> dict[str, np.ndarray]:
    return method(sim).particles(0)


def ready(scene: Scene, **more) -> Simulation:
    """Before the first step, with its kernels."""
    sim = Simulation(scene, device="cpu", **more)
    sim.load()
    method(sim).before_frame(0.0, sim.plan.clock)
    return sim


def put(sim: Simulation, v: np.ndarray) -> None:
    """Gives the particles, in the order of their rows, these velocities (n, dim) [m/s]."""
    part = method(sim).parts[0]
    rows = part.arrays["v"].numpy()
    rows[:len(v), :v.shape[1]] = v
    part.arrays["v"].assign(rows)


def to_grid(sim: Simulation) -> None:
    """Particles by cell, and their velocities on the faces."""
    d = method(sim).domains[0]
    d.order.sort(d.particles)
    for a in range(d.layout.dim):
        d.threads.over(d.to_faces, d.sizes[a], [d.grid, a, d.particles, d.order.cells], [getattr(d.u, NAMES[a]), d.mass[a]])
        if d.liquid.transfer == "flip":
            getattr(d.before, NAMES[a]).assign(getattr(d.u, NAMES[a]))


def to_particles(sim: Simulation) -> None:
    d = method(sim).domains[0]
    d.threads.over(d.to_particles, d.order.room, [d.grid, d.u, d.before, sim.model.real(d.liquid.flip), d.particles],
                   [d.particles])


def momenta(sim: Simulation) -> tuple[np.ndarray, float, float]:
    """On the grid: momentum of each axis, angular momentum about the origin (third axis), the sum of its parts' sizes; mass 1 a
    particle, lengths in cells."""
    d = method(sim).domains[0]
    found, turn, size = [], 0.0, 0.0
    for a in range(d.layout.dim):
        shape = d.layout.faces(a)
        m, u = (x.numpy().astype(np.float64).reshape(shape) for x in (d.mass[a], getattr(d.u, NAMES[a])))
        found.append(float((m * u).sum()))
        if a < 2:
            arm = np.arange(shape[1 - a]) + 0.5
            arm = arm[None, :] if a == 0 else arm[:, None]
            arm = arm if len(shape) == 2 or shape[2] == 1 else arm[..., None]
            part = (1 - 2 * (a == 0)) * (m * u).reshape(shape) * arm.reshape([*arm.shape, *[1] * (len(shape) - arm.ndim)])
            turn += float(part.sum())
            size += float(np.abs(part).sum())
    return np.array(found), turn, size
