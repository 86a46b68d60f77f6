"""Particles and what they meet: python -m tools.bench.contact.meetings [--json FILE] [PARTNER ...]

A row for each kind of particle and partner, of two runs on a CPU. Free: 8 particles of 1 cm hit what is free, at 1 m/s, without
gravity and friction; 10 frames of 8 substeps of 4 iterations. dP: change of the sum of momentum over that of the particles;
dL: of angular momentum, over that and 0.1 m. depth: greatest overlap where frames end, over the radius of a particle (beside
half of the thickness of what it meets). Rest: the same particles lie on a partner that is held, after two seconds; carried:
reaction over weight, by the mean acceleration of the last quarter of a second.
"""

import argparse
import json
from math import inf
from pathlib import Path

import numpy as np

import wsim
from wsim import Bulk, Fabric, Pin, shapes
from wsim.geometry.tetra.tets import tet_surface_triangles
from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.position_based.objects import Grains
from wsim.scene import SceneError

R, THICK, G = 0.01, 0.002, 9.81
POINTS, TETS = shapes.block((0.15, 0.1, 0.15), (4, 3, 4))
POINTS = POINTS - POINTS.max(axis=0) * [0.5, 1.0, 0.5]
SURFACE = tet_surface_triangles(TETS)
ROWS, LENGTH = 9, 17
PARTNERS = ("plane", "body", "links", "cloth", "soft", "clusters", "rigid cluster", "cloud", "net", "rods")


def add_partner(scene: wsim.Scene, partner: str, held: bool) -> None:
    """Something whose top is at y = 0, free or held by pins or a floor."""
    if partner == "plane":
        scene.collider("/other", wsim.Plane(), static_friction=0.0, dynamic_friction=0.0)
    elif partner in ("body", "links"):
        scene.body("/other", wsim.Box((0.08, 0.03, 0.08)), at=(0, -0.03, 0), mass=0.5)
        if partner == "links":
            scene.body("/arm", wsim.Box((0.04, 0.01, 0.01)), at=(0.14, -0.03, 0), mass=0.1)
            scene.joint("revolute", "/joint", "/other", "/arm", at=(0.09, -0.03, 0), axis=(0, 0, 1))
    elif partner == "cloth":
        cloth = scene.cloth("/other", *shapes.sheet(0.2, 0.2, 12, 12, horizontal=True),
                            material=Fabric(2000.0, density=500.0, thickness=THICK, damping=2e-3))
        if held:
            scene.pin("/pin", cloth, np.flatnonzero(np.abs(cloth.points[:, [0, 2]]).max(axis=1) > 0.099))
    elif partner == "soft":
        scene.soft("/other", POINTS, TETS, material=Bulk(young=3e4, density=300.0, damping=2e-3))
    elif partner == "cloud":
        scene.clusters("/other", POINTS - [0, 0.018, 0], mass=0.7, stiffness=inf, radius=0.018, self_collision=True)
    elif partner in ("clusters", "rigid cluster"):
        scene.clusters("/other", POINTS, counts=np.full(len(SURFACE), 3), indices=SURFACE.ravel(), mass=0.7,
                       stiffness=4e3 if partner == "clusters" else inf, damping=2e-3)
    elif partner == "net":
        k = np.stack(np.meshgrid(np.arange(9), np.arange(9), indexing="ij"), -1).reshape(-1, 2)
        edges = [(i, j) for i in range(81) for j in range(i) if np.abs(k[i] - k[j]).sum() == 1]
        net = scene.net("/other", np.stack([0.02 * (k[:, 0] - 4), 0 * k[:, 0] - 0.004, 0.02 * (k[:, 1] - 4)], axis=1), edges,
                        [500.0] * len(edges), [2e-3] * 81, radius=0.004, damping=2e-3)
        if held:
            scene.pin("/pin", net, np.flatnonzero((k % 8 == 0).any(axis=1)))
    else:
        t = np.linspace(-0.12, 0.12, LENGTH)
        points = np.concatenate([np.stack([t, 0 * t - 0.004, 0 * t + z], axis=1) for z in np.linspace(-0.036, 0.036, ROWS)])
        rods = scene.rods("/other", points, [LENGTH] * ROWS, diameters=[0.008], young=1e8, density=1100.0, self_collision=True,
                          damping=2e-3)
        if held:
            ends = np.concatenate([[LENGTH * i, LENGTH * i + LENGTH - 1] for i in range(ROWS)])
            rods.pins.append(Pin("/other/pin", "/other", ends))


def make_scene(kind: str, partner: str, held: bool) -> wsim.Scene:
    """Eight particles above a partner; at rest they lie beside each other."""
    scene = wsim.Scene(fps=60, substeps=8, iterations=4, gravity=(0, -G * held, 0))
    add_partner(scene, partner, held)
    if held and partner in ("body", "links", "soft", "clusters", "rigid cluster", "cloud"):
        scene.collider("/floor", wsim.Plane(), at=(0, -0.0602 if partner in ("body", "links") else -0.1362 if partner == "cloud"
                                                   else -0.1002, 0))
    k = np.stack(np.meshgrid(*([np.arange(2)] * 3 if not held else (np.arange(2), np.arange(1), np.arange(4))),
                             indexing="ij"), -1).reshape(-1, 3)
    x = 2.1 * R * (k - 0.5 * k.max(axis=0)) + [0.003, R + THICK + (0.001 if held else 0.02), 0.002]
    still, smooth = Grains(rolling_friction=np.inf), Grains(static_friction=0.0, dynamic_friction=0.0, rolling_friction=np.inf)
    scene.particles("/p", points=x, radius=R, material="fluid" if kind == "fluid" else still if held else smooth,
                    velocities=np.tile(np.array([0.05, -1.0, 0.1]) * (not held), (8, 1)))
    return scene


def momenta(simulation: wsim.Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Sums of m v and of x cross m v over all that moves."""
    P, L = np.zeros(3), np.zeros(3)
    parts = [(b.point_masses, simulation.positions(b.path).astype(float), simulation.velocities(b.path).astype(float))
             for b in simulation.model.bodies]
    if simulation.scene.things("Rods"):
        rods = simulation.plan.method("rods")
        parts.append((rods.table.values["m"].T.ravel(), *rods.points(0)))
    if bodies := simulation.scene.things("Body"):
        rigid = simulation.plan.method("rigid").part.arrays
        p, own, x = (rigid[name].numpy().astype(float) for name in "pLx")
        x = x + np.stack([simulation.plan.method("rigid").origin[k] for k in range(len(bodies))])
        P, L = P + p[:len(bodies)].sum(axis=0), L + (own + np.cross(x, p))[:len(bodies)].sum(axis=0)
    for m, x, v in parts:
        P, L = P + m @ v, L + np.cross(x, m[:, None] * v).sum(axis=0)
    return P, L


def sampled_distance(p: np.ndarray, corners: np.ndarray) -> float:
    """Least distance of points to triangles, or to edges that have a corner twice, at places of each."""
    k = np.stack(np.meshgrid(*[np.arange(25)] * 2, indexing="ij"), -1).reshape(-1, 2) / 24.0
    k = k[k.sum(axis=1) <= 1.0]
    places = (np.column_stack([1.0 - k.sum(axis=1), k]) @ corners).reshape(-1, 3)
    return min(float(np.linalg.norm(x - places, axis=1).min()) for x in p)


def overlap(simulation: wsim.Simulation, partner: str) -> float:
    """Greatest overlap over R; of a body the depth below its top where it stands level."""
    p = simulation.positions("/p").astype(float)
    if partner == "plane":
        return 1.0 - float(p[:, 1].min()) / R
    if partner in ("body", "links"):
        M = simulation.poses()["/other"]
        q = np.abs((p - M[:3, 3]) @ M[:3, :3]) - [0.08, 0.03, 0.08]
        return 1.0 - float((np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0)).min()) / R
    if partner == "rods":
        x = simulation.plan.method("rods").points(0)[0].reshape(ROWS, LENGTH, 3)
        a, b = x[:, :-1].reshape(-1, 3), x[:, 1:].reshape(-1, 3)
        return (R + 0.004 - sampled_distance(p, np.stack([a, b, b], axis=1))) / R
    x, thing = simulation.positions("/other").astype(float), simulation.scene.bodies()[0]
    if partner in ("net", "cloud"):
        grains = next(m for m in simulation.plan.methods if m.name == "grains")
        first = sum(body.count for body in grains.bodies[:[body.path for body in grains.bodies].index("/other")])
        near = min(float(np.linalg.norm(x - q, axis=1).min()) for q in p)
        return (R + float(grains.search.rows.reach.numpy()[first]) - near) / R
    thing = next(body for body in simulation.scene.bodies() if body.path == "/other")
    corners = x[triangulate_polygons(thing.points, *thing.surface_faces())[0]]
    half = float(simulation.plan.method("selfcontact").surfaces.reach[simulation.model.body("/other").first])
    return (R + half - sampled_distance(p, corners)) / R


def measure(kind: str, partner: str) -> dict:
    """A row; "refused" where a scene is."""
    row: dict = {"particles": kind, "partner": partner}
    try:
        free = wsim.Simulation(make_scene(kind, partner, False), device="cpu")
    except SceneError as error:
        return row | {"refused": str(error)}
    (P, L), depth = momenta(free), 0.0
    for _ in range(10):
        free.step()
        depth = max(depth, overlap(free, partner))
    (now, moment), size = momenta(free), float(np.linalg.norm(P))
    if partner != "plane":
        row |= {"dP": float(np.abs(now - P).max() / size), "dL": float(np.abs(moment - L).max() / (0.1 * size))}
    row |= {"depth": depth, "solver": free.plan.choice.solver}
    held = wsim.Simulation(make_scene(kind, partner, True), device="cpu")
    held.run(105)
    before = held.velocities("/p")[:, 1].mean()
    held.run(15)
    change = (held.velocities("/p")[:, 1].mean() - before) / 0.25
    return row | {"carried": float(1.0 + change / G), "rest_depth": overlap(held, partner),
                  "rest_speed": float(np.abs(held.velocities("/p")).max()), "warnings": [str(w)[:120] for w in held.warnings]}


def main() -> None:
    """Prints the table, and writes it where a file is named."""
    parser = argparse.ArgumentParser()
    parser.add_argument("partners", nargs="*", default=PARTNERS)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    for partner in given.partners:
        for kind in ("grains", "fluid"):
            rows.append(measure(kind, partner))
            print(json.dumps(rows[-1]), flush=True)
    if given.json:
        given.json.write_text(json.dumps({"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
