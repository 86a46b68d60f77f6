"""What tests/physics/contact/test_free_flight_test.py shares with other tests: CPU, FORMS, MARCH, WHOLE, rising, sheet, state,
swelling."""

from typing import Any

import numpy as np

from wsim.scene import Scene, Surface, shapes
from wsim.scene.curve import Curve, Motion
from wsim.simulation.simulation import Simulation

G = 9.81
CPU: dict[str, Any] = {"device": "cpu", "precision": "float64"}
MARCH, LEAPS = {"solver": "explicit"}, {"solver": "explicit", "cloth": True}
STAGES = {"solver": "explicit", "integrator": "rk4"}
XPBD, NEWTON = {"solver": "xpbd", "iterations": 3}, {"solver": "implicit", "iterations": 2}
FORMS = {"march": MARCH, "leaps": LEAPS, "stages": STAGES, "xpbd": XPBD, "newton": NEWTON,
         "midpoint": NEWTON | {"integrator": "implicit_midpoint"}}
WHOLE = ("march", "leaps", "stages")


def sheet(shape=None, *, at=(0.0, 0.0, -9.0), cloth=False, height=0.0, velocity=(0.0, 0.0, 0.0), pinned=True, motion=None,
          **more) -> Scene:
    scene = Scene(**({"fps": 60.0, "substeps": 10, "iterations": 1, "gravity": (0.0, 0.0, -G), "up": "Z"} | more))
    place = {"motion": Motion.at_place((0.0, 0.0, height))}
    if cloth:
        flat = shapes.sheet(1.0, 1.0, 5, 5, horizontal=True, up="Z")
        body = scene.cloth("/sheet", *flat, velocities=[velocity] * 36, **place)
    else:
        body = scene.net("/sheet", *shapes.spring_sheet(1.0, 6, stretch=100.0, up="Z"), velocities=[velocity] * 36, **place)
    if pinned:
        scene.pin("/pin", body, [0, 5])
    if shape is not None:
        scene.collider("/wall", shape, **({"motion": motion} if motion else {"at": at}))
    return scene


def state(sim: Simulation) -> np.ndarray:
    return np.concatenate([getattr(sim.state, name).numpy() for name in ("x", "e", "v")])


def rising(low: float, high: float, until: float = 0.02) -> Motion:
    return Motion.through([0.0, until], [(0.0, 0.0, z) for z in (low, high)], kind="linear")


def swelling(size: float, more: float, times) -> Surface:
    """A ball of a radius [m] that grows by `more` [m] at every other time [s]."""
    points, *faces = shapes.sphere(size, 8)
    return Surface(points, *faces, Curve(times, np.array([points * (1.0 + more / size * (k % 2)) for k in range(len(times))])))
