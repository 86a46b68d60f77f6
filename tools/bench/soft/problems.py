"""Problems with known answers of soft bodies: further rows of suite.py; see problems.py for what a problem is.

    soft_rest        a clamped bar under gravity: every point's place at rest on this very mesh, over the tip's drop
                                                                                  reference.rest (needs SciPy)
    soft_frequency   the same swinging in its first mode by 1 mm: its frequency on this mesh
                                                                                  reference.frequencies (needs SciPy)
    soft_modulus     a bar that hangs with a weight F: E = F / (A strain) and nu, both well inside; the worse of them, relative
    soft_spin        a free body at 10 rad/s for 1 s: change of kinetic and elastic energy, and `drift`, of angular momentum;
                     both exactly 0

Bars are corotational, of five-tet cells, nu 0.3 and 1000 kg/m^3; XPBD has no tets. The weight in `soft_modulus` is 5 times that
of the bar, and each point of the end carries what uniform tension puts on it: a third of the triangles around it.
"""

from math import pi

import numpy as np

from tools.bench.problems import FPS, GRAVITY, Judged, Problem
from wsim import scene as scenes
from wsim.scene import Scene, SceneError, Soft, shapes
from wsim.scene.solid import Bulk
from wsim.simulation.simulation import Simulation

YOUNG, POISSON, DENSITY = 1e6, 0.3, 1e3
LONG, WIDE = 1.0, 0.25                        # [m]
SOLVERS = ("explicit", "implicit")


def bar(**more) -> Scene:
    scene = Scene(fps=FPS, **more)
    points, tets = shapes.block((LONG, WIDE, WIDE), (8, 2, 2))
    body = scene.soft("/bar", points, tets, material=Bulk(YOUNG, POISSON, DENSITY))
    scene.pin("/wall", body, range(9))
    return scene


def instrument(sim: Simulation):
    """The module tools.bench.soft.reference, and this scene's body in it. SceneError without SciPy."""
    try:
        from tools.bench.soft import reference as soft_reference
    except ImportError as error:
        raise SceneError(scenes.Problem("reference", f'{error}: pip install -e ".[dev]" brings SciPy')) from None
    soft, g = sim.given.softs[0], sim.given.gravity
    return soft_reference, soft_reference.Solid(soft.points, soft.tets, sim.given.pins[0].points, YOUNG, POISSON, DENSITY,
                                                gravity=tuple(map(float, g)))


def rest(sim: Simulation, cache) -> Judged:
    reference, solid = instrument(sim)
    sim.run(180)                              # drag 16 / s, twice the first frequency: what is left is 25 exp(-24)
    wanted, x = reference.rest(solid), sim.positions()
    drop = float(np.abs(wanted - solid.points).max())
    return {"error": float(np.linalg.norm(x - wanted, axis=1).max() / drop)}


def frequency(sim: Simulation, cache) -> Judged:
    """From the mode's upward zero crossings in 4 s; nan where damping has left none."""
    reference, solid = instrument(sim)
    hertz, found = reference.frequencies(solid)
    mode = 1e-3 * found[0] / np.abs(found[0]).max()
    sim.set("/bar", "positions", solid.points + mode)
    parts: list[float] = []
    weight = solid.masses[:, None] * mode
    sim.run(240, lambda s: parts.append(float(np.sum(weight * (s.positions() - solid.points)))))
    y, t = np.array(parts), np.arange(1, 241) / FPS
    up = np.flatnonzero((y[:-1] < 0) & (y[1:] >= 0))
    if len(up) < 2:
        return {"error": float("nan")}
    zeros = t[up] - y[up] * (t[up + 1] - t[up]) / (y[up + 1] - y[up])
    return {"error": float(abs((len(zeros) - 1) / (zeros[-1] - zeros[0]) / hertz[0] - 1.0))}


# the moduli

SIDE, CELLS, STRAIN = 0.1, 12, 0.01            # [m] of the cells


def weighted() -> Scene:
    """Hangs along y from its upper end."""
    scene = Scene(fps=FPS, air_drag=40.0)
    height = SIDE * CELLS
    points, tets = shapes.block((SIDE, height, SIDE), (1, CELLS, 1))
    body = scene.soft("/bar", points, tets, material=Bulk(YOUNG, POISSON, DENSITY))
    end = points[:, 1] < points[:, 1].min() + 1e-9
    masses = np.full(len(points), 0.2 * STRAIN * YOUNG * SIDE**2 / GRAVITY / len(points))
    masses[end] = STRAIN * YOUNG * SIDE**2 / GRAVITY * shares(body, end)
    body.masses = masses.astype(np.float32)
    scene.pin("/ceiling", body, np.flatnonzero(points[:, 1] > points[:, 1].max() - 1e-9))
    return scene


def shares(body: Soft, end: np.ndarray) -> np.ndarray:
    """Part of a uniform load on the triangles of the end that each of its points carries."""
    faces = np.array([tet[end[tet]] for tet in body.tets if end[tet].sum() == 3])
    area = np.linalg.norm(np.cross(*(body.points[faces[:, k]] - body.points[faces[:, 0]] for k in (1, 2))), axis=1)
    part = np.bincount(faces.ravel(), np.repeat(area, 3), len(end))[end]
    return part / part.sum()


def modulus(sim: Simulation, cache) -> Judged:
    sim.run(180)
    X, x, masses = sim.given.softs[0].points.astype(float), sim.positions(), sim.given.softs[0].masses.astype(float)
    height, layers = np.round(X[:, 1] / SIDE, 6), np.unique(np.round(X[:, 1] / SIDE, 6))
    low, high = layers[CELLS // 4], layers[-1 - CELLS // 4]
    tops, lows = height == high, height == low
    strain = (x[tops, 1].mean() - x[lows, 1].mean()) / (X[tops, 1].mean() - X[lows, 1].mean()) - 1.0
    held = np.mean([masses[height < at].sum() for at in layers[(layers > low) & (layers <= high)]]) * GRAVITY
    inside = [height == at for at in layers[CELLS // 2 - 1:CELLS // 2 + 2]]      # farthest from the clamp
    wide = np.mean([np.ptp(x[at, 0]) + np.ptp(x[at, 2]) for at in inside]) / (2.0 * SIDE) - 1.0
    errors = {"young": held / SIDE**2 / strain / YOUNG - 1.0, "poisson": -wide / strain / POISSON - 1.0}
    return {"error": max(map(abs, errors.values()))} | errors


# spinning

OMEGA = (3.0, 4.0, 8.0)                       # [rad/s]


def free() -> Scene:
    scene = Scene(fps=FPS, gravity=(0.0, 0.0, 0.0))
    points, tets = shapes.block((0.4, 0.2, 0.2), (4, 2, 2))
    scene.soft("/bar", points, tets, material=Bulk(1e5, POISSON, DENSITY), velocities=np.cross(OMEGA, points))
    return scene


def momentum(sim: Simulation) -> np.ndarray:
    """Angular momentum about the centre [kg m^2/s]."""
    body, x, v = sim.model.bodies[0], sim.positions(), sim.velocities()
    m = body.masses[body.index - body.first][:, None]
    centre, drift = (m * x).sum(0) / m.sum(), (m * v).sum(0) / m.sum()
    return (m * np.cross(x - centre, v - drift)).sum(0)


def spin(sim: Simulation, cache) -> Judged:
    before, start = momentum(sim), sim.indicators()["energy"]
    sim.run(60)
    return {"error": abs(sim.indicators()["energy"] / start - 1.0),
            "drift": float(np.linalg.norm(momentum(sim) - before) / np.linalg.norm(before))}


FIRST = 2.0 * pi * 1.3                        # [rad/s] about, of the bar

PROBLEMS = (
    Problem("soft_rest", lambda: bar(air_drag=2.0 * FIRST), rest, "1", 12, (1, 4), known=1e-5, solvers=SOLVERS),
    Problem("soft_frequency", lambda: bar(gravity=(0.0, 0.0, 0.0)), frequency, "1", 12, (1, 4), known=2e-5, solvers=SOLVERS),
    Problem("soft_modulus", weighted, modulus, "1", 32, (1, 4), known=1e-4, solvers=SOLVERS),
    Problem("soft_spin", free, spin, "1", 6, (4, 16), known=1e-6, solvers=SOLVERS),
)
