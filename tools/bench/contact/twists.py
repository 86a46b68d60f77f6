"""Scenes of surfaces that touch, for timing: a flat cloth that falls and meets nothing, a sheet that is scrunched, and a cloth
that is twisted into a rope by its two ends.

The twist: 20 x 80 cm of an isotropic sheet 0.5 mm thick, no gravity; both short edges turn against each other, and come nearer
as the rope shortens. A packed rope of radius r and n turns has fibres of length sqrt(H^2 + (2 pi n r)^2) outside, H along its
axis: with r = 6.7 mm (0.7 of the section filled) those of 80 cm leave H = 68 cm at 10 turns, and r = 12 mm, of a loose one,
leaves 74 cm at 4. The ends stay as wide as they are: fibres at the side go in from there, 4 cm more at each end.
"""

import numpy as np

from wsim.scene import Motion, Scene, shapes
from wsim.scene.fabric import Fabric, isotropic_fabric

WIDTH, LENGTH = 0.2, 0.8                         # [m]
GATHERED, SHORTER = 0.08, 0.14                   # [m] that the ends come nearer by in the first two turns, and until MOST
MOST, RATE, FPS = 10.0, 2.0, 60.0                # turns, of one end against the other; turns a second; frames a second
STRETCH, POISSON, DENSITY, THICKNESS = 2000.0, 0.3, 0.2, 0.5e-3          # E h [N/m], nu, [kg/m^2], [m]
FRICTION = 0.2
CLOTH = "/cloth"
SOLVERS = {"xpbd": dict(solver="xpbd", integrator="backward_euler", substeps=10, iterations=4),
           "leapfrog": dict(solver="explicit", integrator="leapfrog"),
           "newton": dict(solver="implicit", integrator="backward_euler", substeps=10, iterations=2)}


def sheet(points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sheet of about so many points in the plane z = 0, its rows across y; and the two rows of its ends."""
    columns = round(np.sqrt(points * WIDTH / LENGTH))
    place, _, indices = shapes.sheet(WIDTH, LENGTH, columns - 1, round(points / columns) - 1)
    place = np.asarray(place, np.float64)
    place[:, 1] -= place[:, 1].mean()
    return place, np.asarray(indices).reshape(-1, 3), [np.flatnonzero(np.abs(place[:, 1] - y) < 1e-6)
                                                       for y in (place[:, 1].max(), place[:, 1].min())]


def turned(times: np.ndarray, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Angle [rad] about y and place [m] of an end: sign 1 the upper, -1 the lower. Starts gently, within half a second."""
    n = turns(times)
    nearer = GATHERED * np.minimum(0.5 * n, 1.0)**2 + SHORTER * np.minimum(n / MOST, 1.0)
    return sign * np.pi * n, sign * 0.5 * (LENGTH - nearer)


def turns(t):
    """Turns at times [s], of one end against the other."""
    return RATE * np.where(t < 0.5, t * t, t - 0.25)


def seconds(turns: float) -> float:
    return turns / RATE + 0.25


def fabric() -> Fabric:
    return isotropic_fabric(STRETCH / THICKNESS, POISSON, THICKNESS, DENSITY / THICKNESS, damping=1e-4,
                            static_friction=FRICTION, dynamic_friction=FRICTION)


def buckled(place: np.ndarray) -> np.ndarray:
    """Where the points start: waves of a millimetre, so that all solvers buckle alike."""
    x, y = place[:, 0], place[:, 1]
    inside = np.cos(np.pi * y / LENGTH)
    return place + np.stack([0.0 * x, 0.0 * x, 1e-3 * inside * np.sin(40.0 * x) * np.cos(25.0 * y)], axis=1)


def twist(points: int, self_collision: bool = True, **more) -> Scene:
    """The scene, for as long as it is run."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), fps=FPS, **{**SOLVERS["xpbd"], "air_drag": 1.0, **more})
    place, triangles, ends = sheet(points)
    scene.cloth(CLOTH, buckled(place), np.full(len(triangles), 3), triangles, material=fabric(), self_collision=self_collision,
                rest_points=place)
    times = np.linspace(0.0, seconds(MOST), 201)
    for name, rows, sign in zip(("/upper", "/lower"), ends, (1.0, -1.0), strict=True):
        angle, y = turned(times, sign)
        turns = np.stack([0.0 * angle, np.sin(0.5 * angle), 0.0 * angle, np.cos(0.5 * angle)], axis=1)
        motion = Motion.through(times, np.stack([0.0 * y, y, 0.0 * y], axis=1), turns, "linear")
        where = place[rows] - (0.0, y[0], 0.0)
        scene.pin(name, CLOTH, rows, motion=motion, places=where)
    return scene


def drop(points: int, self_collision: bool, **more) -> Scene:
    """A flat cloth of a metre that falls and meets nothing."""
    scene = Scene(fps=FPS, **more)
    side = round(np.sqrt(points)) - 1
    sheet = shapes.sheet(1.0, 1.0, side, side, horizontal=True)
    scene.cloth(CLOTH, *sheet, material=Fabric(stretch=500.0, shear=100.0, bend=1e-6, thickness=0.3 / side, density=100.0),
                self_collision=self_collision)
    return scene


def strain(rest: np.ndarray, triangles: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """RMS and largest strain of the edges."""
    i, j = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0).T
    e = np.linalg.norm(x[i] - x[j], axis=1) / np.linalg.norm(rest[i] - rest[j], axis=1) - 1.0
    return float(np.sqrt(np.mean(e * e))), float(np.abs(e).max())
