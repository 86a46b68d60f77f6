"""Scenes of surfaces that touch, and how often they intersect by the exact test, on the float32 values of a file."""

from dataclasses import replace

import numpy as np
import pytest

from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.contact.selfcontact.crossings import crossed_triangles
from wsim.scene import Motion, Scene, shapes
from wsim.scene.fabric import Fabric
from wsim.simulation.simulation import Simulation

SOLVERS = {                              # that surfaces which collide may be stepped by, with substeps a frame of 1/60 s
    "xpbd": dict(solver="xpbd", integrator="backward_euler", substeps=10, iterations=6),
    "xpbd bdf2": dict(solver="xpbd", integrator="bdf2", substeps=10, iterations=6),
    "newton": dict(solver="implicit", integrator="backward_euler", substeps=10, iterations=3),
    "newton bdf2": dict(solver="implicit", integrator="bdf2", substeps=10, iterations=3),
    "newton midpoint": dict(solver="implicit", integrator="implicit_midpoint", substeps=10, iterations=6),
    "leapfrog": dict(solver="explicit", integrator="leapfrog", substeps=40),
    "rk4": dict(solver="explicit", integrator="rk4", substeps=40)}
THIN = Fabric(stretch=500.0, shear=100.0, bend=1e-6, thickness=2e-3, density=100.0)


def solvers(*names: str) -> list:
    """Rows of a test: settings of a scene by solvers of these names, or by all."""
    return [pytest.param(SOLVERS[name], id=name) for name in names or SOLVERS]


def surfaces(sim) -> tuple[np.ndarray, np.ndarray]:
    """Points as written, float32 in the frame that all surfaces have, and triangles of all surfaces of world 0."""
    points, triangles, count = [], [], 0
    for b in (b for b in sim.model.bodies if b.world == 0):
        m = b.source.motion.at(0.0)
        own = (sim.positions(b.path) - m[:3, 3]) @ np.linalg.inv(m[:3, :3]).T
        each = triangulate_polygons(b.source.points, b.source.counts, b.source.indices)[0]
        points.append(own.astype(np.float32))
        triangles.append(each + count)
        count += len(own)
    return np.concatenate(points), np.concatenate(triangles)


def crossed(sim) -> int:
    """Number of pairs of triangles that intersect in what a file would hold."""
    return len(crossed_triangles(*surfaces(sim)))


def said(sim) -> dict[str, float]:
    return sim.plan.method("selfcontact").indicators(None, None)


def layers(count: int, side: int, gap: float, *, size: float = 0.2, motion=None, velocity=(0.0, 0.0, 0.0), spin: float = 0.0,
           on: bool = True, **more) -> Scene:
    """Flat sheets one above the other, side x side points each, that fly with a velocity [m/s] and turn about y [rad/s]."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), **{"fps": 60.0, "substeps": 10, "iterations": 4, "solver": "xpbd", **more})
    for k in range(count):
        points, counts, indices = shapes.sheet(size, size, side - 1, side - 1, horizontal=True)
        points = np.array(points, np.float64)
        points -= points.mean(axis=0)
        points[:, 1] += k * gap
        v = np.array(velocity, np.float64) + np.cross((0.0, spin, 0.0), points)
        scene.cloth(f"/layer{k}", points, counts, indices, material=THIN, self_collision=on, velocities=v,
                    motion=motion or Motion.still())
    return scene


def crumple(seed: int, side: int = 18, speed: float = 8.0, **more) -> Scene:
    """A crumpled sheet: points thrown about its middle at random, which all fly towards it."""
    scene = Scene(gravity=(0.0, 0.0, 0.0), **{"fps": 60.0, "substeps": 10, "iterations": 4, "solver": "xpbd", **more})
    points, counts, indices = shapes.sheet(0.3, 0.3, side - 1, side - 1, horizontal=True)
    rng, points = np.random.default_rng(seed), np.array(points, np.float64)
    points -= points.mean(axis=0)
    waves = sum(rng.normal(size=3)[None] * np.sin(points @ (rng.normal(size=3) * 30.0) + rng.uniform(0, 6))[:, None]
                for _ in range(4))
    scene.cloth("/sheet", points, counts, indices, material=THIN, self_collision=True,
                velocities=-speed * points / 0.15 + 0.25 * speed * waves)
    return scene


def thrown(seed: int, side: int = 16, speed: float = 20.0, edge: float = 0.012, **more) -> Scene:
    """Two sheets of side x side points, edges [m] ten times as long as they are thick, which meet at a speed [m/s] and turn; by
    a seed for how."""
    rng, size = np.random.default_rng(seed), edge * (side - 1)
    scene = layers(2, side, 0.0, size=size, **more)
    for cloth, sign in zip(scene.cloths, (-1.0, 1.0), strict=True):
        turn, r = np.linalg.qr(rng.normal(size=(3, 3)))
        turn *= np.sign(np.diag(r))
        points = cloth.points @ (turn * np.linalg.det(turn)).T
        cloth.material = replace(THIN, stretch=300.0, shear=80.0, thickness=0.1 * edge)
        cloth.velocities = np.array((-0.5 * sign * speed, 0.0, 0.0)) + np.cross(rng.normal(size=3) * 10.0, points)
        cloth.points[:] = points + (sign * (0.5 * size * 2.0 ** 0.5 + 5e-3), 0.0, 0.0)
    return scene


def run(scene: Scene, device: str = "cpu", **more) -> Simulation:
    return Simulation(scene, device=device, **more)
