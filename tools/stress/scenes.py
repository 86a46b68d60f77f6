"""The small things that are abused. SI; x right, y up. A sheet hangs in the x-y plane from its top row."""

import numpy as np

from wsim.scene import Box, Scene, Sphere, Surface, shapes
from wsim.scene.curve import Motion
from wsim.scene.fabric import Fabric

SIDE, CELLS, DENSITY = 0.5, 8, 0.2                # [m], cells a side, [kg/m^2]
EDGE = SIDE / CELLS                               # [m]
MASS = DENSITY * SIDE * SIDE                      # [kg]
G = 9.81
STRETCH = 1.0e3                                   # [N/m] where a row does not say
TOP = list(range(CELLS + 1))                      # points of the top row
LEFT = [row * (CELLS + 1) for row in range(CELLS + 1)]
RIGHT = [p + CELLS for p in LEFT]


def sheet(kind: str = "membrane", stretch: float = STRETCH, *, pins=TOP, gravity: float = G, at=(0.0, 0.0, 0.0),
          fabric=None, **more) -> Scene:
    """A sheet of a kind: "membrane" (triangle strain and bending) or "springs" (a net).

    at [m] is the place of its frame; pins hold points where they are; `fabric` and what is left go to the cloth."""
    settings = {k: more.pop(k) for k in ("fps", "substeps", "iterations", "wind") if k in more}
    scene = Scene(gravity=(0.0, -gravity, 0.0), **({"fps": 60.0} | settings))
    motion = Motion.at_place(at)
    if kind == "springs":
        flat, edges, k, masses = shapes.spring_sheet(SIDE, CELLS + 1, stretch=stretch, diagonal=stretch, cross=1e-3 * stretch,
                                                     density=DENSITY)
        points = flat[:, [0, 2, 1]] * (1.0, -1.0, 1.0)
        body = scene.net("/sheet", points, edges, k, masses, motion=motion, **more)
    else:
        points, counts, indices = shapes.sheet(SIDE, SIDE, CELLS, CELLS)
        material = Fabric(**({"stretch": stretch, "shear": 0.3 * stretch, "density": DENSITY / 1e-3} | (fabric or {})))
        body = scene.cloth("/sheet", points, counts, indices, material=material, motion=motion, **more)
    if len(pins):
        scene.pin("/pin", body, pins)
    return scene


def hung(kind: str = "membrane", stretch: float = STRETCH, **more) -> Scene:
    """`sheet`, where a strip under its own weight would not strain by more than 5 %; softer ones without weight."""
    return sheet(kind, stretch, gravity=G if static(stretch) < 0.05 else 0.0, **more)


def static(stretch: float, gravity: float = G) -> float:
    """Strain of a sheet at its upper edge under its own weight: density g height / stretch."""
    return DENSITY * gravity * SIDE / stretch


def chain(masses, stiffness: float, length: float = 0.1, **more) -> Scene:
    """A chain hanging straight down from a pinned point of the first mass, unstretched at first."""
    points = np.zeros((len(masses), 3))
    points[:, 1] = -length * np.arange(len(masses))
    scene = Scene(**({"fps": 60.0} | more))
    net = scene.net("/chain", points, [[i, i + 1] for i in range(len(masses) - 1)], [stiffness], masses)
    scene.pin("/pin", net, [0])
    return scene


def moving(points_in_time, seconds) -> Motion:
    """Motion through places [m] at seconds."""
    matrices = np.tile(np.eye(4), (len(seconds), 1, 1))
    matrices[:, :3, 3] = points_in_time
    return Motion(np.asarray(seconds, float), matrices)


def with_ball(at, **more) -> Scene:
    scene = hung(**more)
    scene.collider("/ball", Sphere(0.12), at=at)
    return scene


def between_walls() -> Scene:
    """Two walls of 1 m close from 0.4 m to 1 cm on a sheet that hangs between them, in half a second, and open."""
    scene = hung()
    times = [0.0, 0.5, 0.7, 1.0]
    for name, side in (("left", -1.0), ("right", 1.0)):
        way = [(0.0, 0.0, side * (0.5 + gap)) for gap in (0.2, 0.005, 0.005, 0.2)]
        scene.collider(f"/{name}", Box((1.0, 1.0, 0.5)), motion=moving(way, times))
    return scene


def crushed() -> Scene:
    """The walls close along the sheet: 0.5 m become 10 cm."""
    scene = hung(pins=[CELLS // 2])
    times = [0.0, 0.4, 0.6, 1.0]
    for name, side in (("left", -1.0), ("right", 1.0)):
        way = [(side * (0.5 + gap), 0.0, 0.0) for gap in (0.3, 0.05, 0.05, 0.3)]
        scene.collider(f"/{name}", Box((0.5, 1.0, 1.0)), motion=moving(way, times))
    return scene


def yanked(speed: float, seconds: float) -> Scene:
    """The top row goes sideways at `speed` [m/s] for so long, and stops dead."""
    scene = hung()
    far = speed * seconds
    scene.pins[0].motion = moving([(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, far)], [0.0, 0.2, 0.2 + seconds])
    return scene


def pulled(kind: str) -> Scene:
    """Both sides held; one goes to ten times the width in half a second, stays, and is back within a frame."""
    scene = sheet(kind, pins=LEFT, gravity=0.0)
    x = scene.bodies()[0].points[RIGHT]
    motion = moving([(0.0, 0.0, 0.0), (9.0 * SIDE, 0.0, 0.0), (9.0 * SIDE, 0.0, 0.0), (0.0, 0.0, 0.0)],
                    [0.0, 0.5, 0.7, 0.7 + 1.0 / 60.0])
    scene.pin("/other", scene.bodies()[0], RIGHT, places=x, motion=motion)
    return scene


def doubled_points(rest: float) -> Scene:
    """A net in which every fourth spring joins two points at one place; rest [m] is the length of those springs."""
    points = np.zeros((9, 3))
    points[:, 1] = -0.1 * np.array([0, 1, 2, 2, 3, 4, 4, 5, 6])
    scene = Scene(fps=60.0)
    lengths = np.where(np.diff(points[:, 1]) == 0.0, rest, 0.1)
    net = scene.net("/sheet", points, [[i, i + 1] for i in range(8)], [STRETCH], [MASS / 9.0], lengths=lengths)
    scene.pin("/pin", net, [0])
    return scene


def flat_triangles() -> Scene:
    """A sheet with two columns of points in one place: a row of cells without area, whose points still have neighbours."""
    scene = hung()
    cloth = scene.cloths[0]
    for row in range(CELLS + 1):
        cloth.points[row * (CELLS + 1) + 4] = cloth.points[row * (CELLS + 1) + 3]
    return scene


def dummy(at) -> Scene:
    """A closed mesh that holds a part of the sheet from the start, or comes later."""
    scene = hung()
    scene.collider("/ball", Surface(*shapes.sphere(0.12, 16)), at=at)
    return scene


def dragged() -> Scene:
    """The pins go down through a box and come back."""
    scene = hung()
    scene.collider("/box", Box((0.3, 0.05, 0.3)), at=(0.0, -0.45, 0.0))
    scene.pins[0].motion = moving([(0.0, 0.0, 0.0), (0.0, -1.2, 0.05), (0.0, 0.0, 0.0)], [0.0, 0.5, 1.0])
    return scene


def contested() -> Scene:
    """Two soft pins of 1e5 N/m pull the same corner to places 0.2 m apart; the top row is held."""
    scene = hung()
    corner = scene.cloths[0].points[-1:]
    for name, side in (("one", -0.1), ("other", 0.1)):
        scene.pin(f"/{name}", scene.cloths[0], [len(scene.cloths[0].points) - 1], places=corner + (side, 0.0, 0.0),
                  stiffness=1e5, damping=1.0)
    return scene


def uneven() -> Scene:
    """Masses of a sheet's points between 1 mg and 1 g."""
    scene = sheet()
    scene.cloths[0].masses = (10.0 ** np.random.default_rng(3).uniform(-6.0, -3.0, len(scene.cloths[0].points))).astype(
        np.float32)
    return scene


def needles(ratio: float) -> Scene:
    """Cells so many times as high as wide."""
    scene = sheet()
    scene.cloths[0].points *= np.float32([1.0 / ratio, 1.0, 1.0])
    return scene


def slivers(height: float) -> Scene:
    """Every eighth triangle has a point at the middle of an edge, off it by so much of its height."""
    scene = sheet()
    cloth = scene.cloths[0]
    points, faces = cloth.points.astype(float), cloth.indices.reshape(-1, 3)
    a, b, c = (points[faces[::8, k]] for k in range(3))
    middle, (i, j, k), new = 0.5 * (a + b), faces[::8].T, len(points) + np.arange(len(a))
    cut = np.stack([i, j, new, j, k, new, k, i, new], axis=1).reshape(-1, 3)
    return _meshed(np.concatenate([points, middle + height * (c - middle)]), np.concatenate([np.delete(
        faces, np.s_[::8], axis=0), cut]))


def buttons(size: float) -> Scene:
    """A square of so much [m], a thousand times as stiff, in the middle of every fourth cell of a metre of cloth."""
    points, _, faces = shapes.sheet(2.0 * SIDE, 2.0 * SIDE, CELLS, CELLS, cut="quads")
    corners = faces.reshape(-1, 4)[::4]
    x = points[corners]
    middle = x.mean(axis=1, keepdims=True)
    a, b = corners, len(points) + np.arange(4 * len(corners)).reshape(-1, 4)
    rims = [[a[:, k], a[:, (k + 1) % 4], b[:, (k + 1) % 4], b[:, k]] for k in range(4)]
    quads = np.concatenate([np.delete(faces.reshape(-1, 4), np.s_[::4], axis=0), *(np.stack(r, axis=1) for r in rims), b])
    points = np.concatenate([points, (middle + 0.5 * size * np.sign(x - middle) * (1.0, 1.0, 0.0)).reshape(-1, 3)])
    scene = _meshed(points, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))
    stiff = np.arange(len(quads)) >= len(quads) - len(b)
    scene.cloths[0].stretches = np.where(np.tile(stiff, 2), 1e3 * STRETCH, STRETCH).astype(np.float32)
    return scene


def _meshed(points, faces) -> Scene:
    """A hanging sheet of other triangles (t, 3), whose first points are the top row."""
    scene = Scene(gravity=(0.0, -G, 0.0), fps=60.0)
    fabric = Fabric(stretch=STRETCH, shear=0.3 * STRETCH, density=DENSITY / 1e-3)
    points = points.astype(np.float32)                    # as solvers see them: rounding makes slivers flat
    scene.pin("/pin", scene.cloth("/sheet", points, np.full(len(faces), 3), faces.ravel(), material=fabric), TOP)
    return scene


def decades() -> Scene:
    """A sheet without weight whose faces have 1e-3 to 1e9 N/m, in no order."""
    scene = sheet(gravity=0.0)
    count = len(scene.cloths[0].counts)
    scene.cloths[0].stretches = 10.0**np.random.default_rng(3).permutation(np.linspace(-3.0, 9.0, count)).astype(np.float32)
    return scene


def heavy(ratio: float, last: bool) -> Scene:
    """Ten points of 1 g, the lowest (or the first below the pin) `ratio` times as heavy; springs strain by 1 %."""
    masses = np.full(11, 1e-3)
    masses[10 if last else 1] *= ratio
    return chain(masses, stiffness=masses.sum() * G / 1e-3)
