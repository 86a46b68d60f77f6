"""A soft bar as a scene, how it is run, and what is read off it."""

import numpy as np

from wsim import Bulk, Scene, Simulation
from wsim.scene import shapes

E, NU, RHO = 1e5, 0.3, 1e3


def bar(cells=(6, 2, 2), size=(0.6, 0.2, 0.2), model="corotational", held=True, bulk=None, **more) -> Scene:
    """A bar along x, held at its left end."""
    given = {"solver": "implicit", "integrator": "backward_euler", "substeps": 2, "iterations": 2, "fps": 60.0}
    scene = Scene(**given | more)
    points, tets = shapes.block(size, cells)
    body = scene.soft("/bar", points, tets, material=bulk or Bulk(E, NU, RHO, model))
    if held:
        scene.pin("/wall", body, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-6))
    return scene


def ran(scene: Scene, frames: int, **options) -> Simulation:
    sim = Simulation(scene, device="cpu", **options)
    sim.run(frames)
    return sim


def given_way(sim: Simulation) -> list[str]:
    return [w for w in sim.warnings if "cells across" not in w]


def settled(scene: Scene, **options) -> Simulation:
    """At rest: long steps of backward Euler, with a drag that takes what is left."""
    scene.fps, scene.substeps, scene.air_drag = 10.0, 1, 5.0
    return ran(scene, 60, **options)


def spin(sim: Simulation) -> tuple[np.ndarray, float]:
    """Angular momentum about the centre, and kinetic plus elastic energy."""
    body, x, v = sim.model.bodies[0], sim.positions(), sim.velocities()
    m = body.masses[body.index - body.first][:, None]
    centre, drift = (m * x).sum(0) / m.sum(), (m * v).sum(0) / m.sum()
    return (m * np.cross(x - centre, v - drift)).sum(0), sim.indicators()["kinetic_energy"] + sim.indicators()["elastic_energy"]
