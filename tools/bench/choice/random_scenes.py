"""Random scenes of cloth, nets and soft bodies, reproducible by their number: what the choice of a solver was not tuned to.

    mesh       a grid; Delaunay's triangles of random points; the same with twins, a twentieth of the spacing away (slivers)
    size       0.1 to 2 m, 200 to 1500 points
    held by    two corners, an edge, a disc in the middle, or nothing: then a collider lies below
    collider   a ball, a capsule, a box, a cone, a cylinder, a floor, or none; still, rising or turning
    air        at rest, or a wind of 1 to 8 m/s
    fabric     the presets, and stretch of 100 to 10 000 N/m
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import Delaunay

from wsim.scene import Box, Capsule, Cone, Cylinder, Motion, Plane, Scene, Sphere, shapes
from wsim.scene.fabric import FABRICS, Fabric
from wsim.scene.solid import Bulk

MESHES = ("grid", "random", "slivers")
TWIN = 0.05                # distance of a twin over the mean spacing
SOLIDS = ("ball", "capsule", "box", "cone", "cylinder", "floor")


@dataclass
class Drawn:
    """A scene and what was drawn for it."""

    scene: Scene
    frames: int
    said: list[str] = field(default_factory=list)


def drawn(k: int, seed: int = 0) -> Drawn:
    """Scene k of a seed: of eight six are cloths, one is a net, one a soft body."""
    rng = np.random.default_rng([seed, k])
    size, count = 10.0**rng.uniform(-1.0, 0.3), int(200.0 * 7.5**rng.uniform())
    scene = Scene(fps=float(rng.choice((24.0, 24.0, 30.0, 30.0, 60.0))))
    made = Drawn(scene, int(rng.integers(6, 13)), [f"{size:.2f} m"])
    (_net if k % 8 == 6 else _soft if k % 8 == 7 else _cloth)(made, rng, size, count, MESHES[k % 3])
    return made


def sheet(rng, size: float, count: int, mesh: str) -> tuple[np.ndarray, np.ndarray]:
    """Points of a horizontal square (n, 3) and triangles (m, 3)."""
    side = max(4, round(count**0.5))
    if mesh == "grid":
        points, _, indices = shapes.sheet(size, size, side - 1, side - 1, horizontal=True)
        return points, indices.reshape(-1, 3)
    line, step = np.linspace(0.0, size, side), size / (side - 1)
    rim = np.concatenate([np.c_[line, 0 * line], np.c_[line, 0 * line + size], np.c_[0 * line, line][1:-1],
                          np.c_[0 * line + size, line][1:-1]])
    kept = list(rim)
    for point in rng.random((2 * count, 2)) * size:
        if np.linalg.norm(np.array(kept) - point, axis=1).min() > 0.5 * step:
            kept.append(point)
    flat = np.array(kept[:max(count, len(rim) + 4)])
    if mesh == "slivers":
        inside = np.arange(len(rim), len(flat))
        some = rng.choice(inside, max(1, len(inside) // 12), replace=False)
        angle = rng.uniform(0.0, 2.0 * np.pi, len(some))
        flat = np.concatenate([flat, flat[some] + TWIN * step * np.c_[np.cos(angle), np.sin(angle)]])
    triangles = Delaunay(flat).simplices
    a, b, c = (flat[triangles[:, j]] for j in range(3))
    u, v = (b - a).T, (c - a).T
    area = np.abs(u[0] * v[1] - u[1] * v[0])
    triangles = triangles[area > 1e-6 * step * step]                    # what rounding leaves along a straight rim
    return np.c_[flat[:, 0] - 0.5 * size, 0.0 * flat[:, 0], 0.5 * size - flat[:, 1]], triangles


def _cloth(made: Drawn, rng, size: float, count: int, mesh: str) -> None:
    points, triangles = sheet(rng, size, count, mesh)
    name = str(rng.choice([*FABRICS, "drawn", "drawn", "drawn", "drawn"]))
    area = 10.0**rng.uniform(-1.0, 0.0)
    thickness = min(1e-3, size / 200.0)
    stretch = 10.0**rng.uniform(2.0, 4.0)
    fabric = FABRICS.get(name) or Fabric(stretch=stretch, shear=stretch * rng.uniform(0.1, 0.5), bend=10.0**rng.uniform(-6, -4),
                                         thickness=thickness, density=area / thickness, poisson=rng.uniform(0.0, 0.3))
    air = {"drag": rng.uniform(0.5, 1.5), "lift": rng.uniform(0.0, 0.5)} if rng.random() < 0.3 else {}
    if air:
        wind = rng.normal(size=3)
        made.scene.wind = tuple(wind / np.linalg.norm(wind) * rng.uniform(1.0, 8.0))
    model = "springs" if rng.random() < 0.15 else "membrane"
    faces = np.full(len(triangles), 3), triangles.ravel()
    cloth = made.scene.cloth("/cloth", points, *faces, material=fabric, model=model, **air)
    made.said += [mesh, name, model, *["wind"] * bool(air)]
    _hold(made, rng, size, cloth, points)


def _net(made: Drawn, rng, size: float, count: int, mesh: str) -> None:
    points, triangles = sheet(rng, size, count, mesh)
    edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    mass = 10.0**rng.uniform(-1.0, 0.0) * size * size / len(points)
    made.said += [mesh, "net"]
    net = made.scene.net("/net", points, edges, [10.0**rng.uniform(2.0, 3.5)], [mass], radius=size / 200.0)
    _hold(made, rng, size, net, points)


def _soft(made: Drawn, rng, size: float, count: int, mesh: str) -> None:
    long, cells = 0.5 * size, max(2, round((min(count, 700) / 3.0)**(1 / 3)))
    points, tets = shapes.block((long, long / 3.0, long / 3.0), (3 * cells, cells, cells))
    points = np.array(points) - np.mean(points, axis=0)
    step = long / 3.0 / cells
    inside = np.all(np.abs(points) < 0.499 * np.array((long, long / 3.0, long / 3.0)), axis=1)
    if mesh != "grid":
        points[inside] += rng.uniform(-0.25, 0.25, (int(inside.sum()), 3)) * step
    young = 10.0**rng.uniform(4.5, 6.0)
    soft = made.scene.soft("/soft", points, tets, material=Bulk(young=young, poisson=rng.uniform(0.2, 0.45)))
    made.said += [mesh, "tets"]
    if rng.random() < 0.5:
        made.scene.pin("/pin", soft, np.flatnonzero(points[:, 0] < points[:, 0].min() + 1e-9))
        made.said.append("end")
    else:
        _collide(made, rng, size, -0.25 * size, SOLIDS)


def _hold(made: Drawn, rng, size: float, body, points: np.ndarray) -> None:
    held = str(rng.choice(("corners", "edge", "disc", "nothing", "nothing")))
    x, z = points[:, 0], points[:, 2]
    order = {"corners": [np.argmin(x + z), np.argmin(z - x)], "edge": np.flatnonzero(x < x.min() + 1e-9 * size),
             "disc": np.flatnonzero(np.hypot(x, z) < 0.12 * size)}.get(held, [])
    if len(order):
        made.scene.pin("/pin", body, order)
    made.said.append(held)
    if held == "nothing" or rng.random() < 0.5 and held != "disc":
        _collide(made, rng, size, -rng.uniform(0.0, 0.1) * size, SOLIDS if held == "nothing" else SOLIDS[:-1])


def _collide(made: Drawn, rng, size: float, below: float, solids) -> None:
    """A collider whose top is so high [m], a little away from the middle."""
    name, r = str(rng.choice(solids)), size * rng.uniform(0.12, 0.3)
    made.said.append(name)
    if name == "floor":
        made.scene.collider("/solid", Plane(), at=(0.0, below - 0.01 * size, 0.0))
        return
    shape, high = {"ball": (Sphere(r), r), "capsule": (Capsule(0.5 * r, r), 1.0 * r), "cone": (Cone(r, r), r),
                   "box": (Box((r, 0.6 * r, 0.8 * r)), 0.6 * r), "cylinder": (Cylinder(0.6 * r, 0.8 * r), 0.8 * r)}[name]
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])           # their axis, z, is up
    aside = rng.uniform(-0.1, 0.1, 2) * size
    rise, rate = (rng.uniform(0.0, 1.0) * (rng.random() < 0.3), rng.uniform(-6.0, 6.0) * (rng.random() < 0.3))
    tilt = rng.normal(size=3) * 0.15
    times = np.linspace(0.0, 1.0, 61) if rise or rate else np.zeros(1)
    M = np.tile(np.eye(4), (len(times), 1, 1))
    c, s = np.cos(rate * times), np.sin(rate * times)
    M[:, 0, 0], M[:, 2, 2], M[:, 0, 2], M[:, 2, 0] = c, c, s, -s
    lie = np.eye(3) if name in ("ball", "capsule", "box") else upright
    M[:, :3, :3] = M[:, :3, :3] @ _turned(tilt) @ lie
    M[:, :3, 3] = np.array((aside[0], below - 1.3 * high - 0.005 * size, aside[1])) + times[:, None] * (0.0, rise, 0.0)
    made.scene.collider("/solid", shape, motion=Motion(times, M))
    made.said += ["rises"] * bool(rise) + ["turns"] * bool(rate)


def _turned(axis: np.ndarray) -> np.ndarray:
    """Rotation by a vector [rad], (3, 3)."""
    angle = float(np.linalg.norm(axis))
    n = axis / angle
    K = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
