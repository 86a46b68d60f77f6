"""One run of a draw: stepped, tested and measured."""

import time

import numpy as np

from tools.draws.scenes import Draw
from wsim.geometry import primitives, topology
from wsim.geometry.triangulate import triangulate_polygons
from wsim.physics.contact.selfcontact.crossings import crossed_triangles
from wsim.scene import Box, Surface
from wsim.simulation.simulation import Simulation

MOST_ENERGY, MOST_RUN = 1e-3, 10         # [1/s]; substeps
COUNTED = ("projected", "cut", "held", "repeated", "cut_energy", "cut_run", "searches")


def written(sim) -> tuple[np.ndarray, np.ndarray]:
    """Points as a file holds them, float32 in their prims, taken to the world in float64 where these are turned or scaled,
    and triangles."""
    points, triangles, first = [], [], 0
    for b in sim.model.bodies:
        M = b.source.motion.at(0.0)
        own = ((sim.positions(b.path) - M[:3, 3]) @ np.linalg.inv(M[:3, :3]).T).astype(np.float32).astype(np.float64)
        points.append(own @ M[:3, :3].T + M[:3, 3])
        order = np.argsort(b.index)                        # places to the author's order
        triangles.append(order[b.triangles - b.first] + first)
        first += len(own)
    return np.concatenate(points), np.concatenate(triangles)


def crossed(sim) -> int:
    """Pairs of triangles that intersect, of surfaces, or of one and a mesh collider or box."""
    points, triangles = written(sim)
    own, time_ = len(triangles), sim.frame * sim.plan.clock.dt
    for c in (c for c in sim.scene.colliders if isinstance(c.shape, Box | Surface)):
        M, box = c.motion.at(time_), isinstance(c.shape, Box)
        p, faces = primitives.box_outline(c.shape.half) if box else (c.shape.points, triangulate_polygons(
            c.shape.points, c.shape.counts, c.shape.indices)[0])
        triangles = np.concatenate([triangles, faces + len(points)])
        points = np.concatenate([points, np.asarray(p, np.float32).astype(np.float64) @ M[:3, :3].T + M[:3, 3]])
    return len(crossed_triangles(points, triangles, own=own))


def momentum(sim) -> tuple[np.ndarray, float]:
    """Sum of m v of all points, and of its sizes [kg m/s]."""
    each = [b.masses[b.index - b.first][:, None] * sim.velocities(b.path) for b in sim.model.bodies]
    return sum(p.sum(axis=0) for p in each), sum(np.linalg.norm(p, axis=1).sum() for p in each)


def strain(sim) -> float:
    """Largest relative change of an edge of a surface [1]."""
    found = 0.0
    for b in sim.model.bodies:
        ends = topology.edges_of_triangles(b.triangles) - b.first
        x, order = sim.positions(b.path), np.argsort(b.index)
        now, rest = (np.linalg.norm(p[ends[:, 1]] - p[ends[:, 0]], axis=1) for p in (x[order], b.rest))
        found = max(found, float(np.abs(now / rest - 1.0).max()))
    return found


def tried(k: int, solver: str, frames: int, device: str) -> dict:
    """A row of results."""
    draw, began = Draw(k, solver), time.process_time()
    scene = draw.scene
    if k % 10 == 0:
        frames, scene.fps, scene.substeps = frames * scene.substeps, scene.fps * scene.substeps, 1
    sim = Simulation(scene, device=device)
    (before, size), hits, gap = momentum(sim), 0, np.inf
    for _ in range(frames):
        sim.step()
        hits += crossed(sim)
        gap = min(gap, told(sim).get("least_gap", np.inf))
    found, lost = told(sim), np.linalg.norm(momentum(sim)[0] - before) / size
    alone = not scene.colliders and not any(scene.gravity)
    return {"draw": k, "kind": draw.kind, "prims": draw.prims, "points": sum(b.count for b in sim.model.bodies),
            "solver": solver, "tested": frames, "crossed": hits, "least_gap": gap / draw.fabric.thickness,
            "finite": all(np.isfinite(sim.positions(b.path)).all() for b in sim.model.bodies), "strain": strain(sim),
            "momentum": float(lost) if alone else None, "pinched": found.get("pinched", 0.0),
            **{name: found[name] for name in COUNTED}, "seconds": time.process_time() - began}


def told(sim) -> dict[str, float]:
    return sim.plan.method("selfcontact").indicators(None, None)


def held(row: dict) -> bool:
    return row["finite"] and row["crossed"] == 0 and row["cut_energy"] <= MOST_ENERGY and row["cut_run"] <= MOST_RUN
