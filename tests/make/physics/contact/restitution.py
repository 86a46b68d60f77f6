"""What tests/physics/contact/test_restitution.py shares with other tests: G, ball, bounced, cube, run."""

import numpy as np

from wsim.scene import Plane, Scene, Surface
from wsim.scene.curve import Motion
from wsim.simulation.simulation import Simulation

G = 9.81
UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])       # a plane's z is +y


def cube(half: float) -> Surface:
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return Surface(corners, np.full(6, 4), np.ravel(quads))


def ball(e=0.8, height=1.0, v=(0.0, 0.0, 0.0), shape=None, motion=None, solver="explicit", integrator="leapfrog",
         **more) -> Scene:
    scene = Scene(**({"fps": 60.0, "substeps": 8, "iterations": 1, "solver": solver, "integrator": integrator,
                      "gravity": (0.0, -G, 0.0)} | more))
    scene.net("/ball", [[0, height, 0], [1, height, 0]], [[0, 1]], [100.0], [0.25], velocities=[v, v],
              static_friction=0.0, dynamic_friction=0.0)
    at = (0.4, -4.0, 0.3) if shape else (0.0, 0.0, 0.0)
    scene.collider("/floor", shape or Plane(), motion=motion or (Motion.at_place(at) if shape else Motion.still(UP)),
                   static_friction=0.0, dynamic_friction=0.0, restitution=e)
    return scene


def bounced(t, y, v, e, g=G):
    """(height, velocity, bounces) at time t; also of complex numbers, by their real parts."""
    count = 0
    while True:
        s = (v + np.sqrt(v * v + 2 * g * y)) / g
        if s.real > t.real:
            return y + v * t - g * t * t / 2, v - g * t, count
        y, v, t, count = 0.0, -e * (v - g * s), t - s, count + 1


def run(scene, frames, **more):
    sim = Simulation(scene, **({"device": "cpu", "precision": "float64"} | more))
    states = []
    for _ in range(frames):
        sim.step()
        states.append((sim.positions()[0, 1], sim.velocities()[0, 1]))
    return sim, np.array(states)
