"""Scenes of joints without shapes in maximal coordinates (those of `trees` are reduced), and what is read off them. They share
one set of kernels for each precision."""

import numpy as np

from wsim.physics.rigid.objects import Body
from wsim.scene import Scene
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

G = 9.81


def rod(path: str, at, mass: float = 1.0, moments=(0.01, 0.02, 0.02), **more) -> Body:
    """A body without shapes, its centre of mass at its origin."""
    return Body(path, [], Motion.at_place(at), mass=mass, center=(0.0, 0.0, 0.0), inertia=moments, **more)


def scene(*things, gravity=(0.0, -G, 0.0), fps: float = 60.0, substeps: int = 8,
          coordinates: str = "maximal", **more) -> Scene:
    found = Scene(gravity=gravity, fps=fps, substeps=substeps, coordinates=coordinates, **more)
    for thing in things:
        found.add(thing)
    return found


def start(*things, precision: str = "float64", worlds: int = 1, device: str = "cpu", **more) -> Simulation:
    return Simulation(scene(*things, **more), device=device, precision=precision, worlds=worlds)


def places(sim: Simulation) -> np.ndarray:
    """Origins of the bodies [m]."""
    return sim.plan.method("rigid").poses()[:, :3, 3]


def errors(sim: Simulation) -> tuple[float, float]:
    """By how much joints are off [m], [rad]."""
    return sim.plan.method("rigid").joints.error()


def coordinates(sim: Simulation) -> np.ndarray:
    """(joints, 6): shifts [m], twist and swing [rad], now."""
    return sim.plan.method("rigid").joints.linked.now.numpy()
