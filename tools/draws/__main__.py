"""Random draws of surfaces that collide: no two triangles may intersect, by the exact test on the float32 values of a file.

    python -m tools.draws [--draws 100] [--first 0] [--solvers xpbd,newton,...] [--frames 12] [--most 5000] [--device cpu]
                          [--jobs 1] [--seconds S] [--json FILE]

Each tenth draw is tested behind every substep, the others behind every frame. Triangles of mesh colliders and boxes, where they
stand then, are tested against surfaces too. Exit code 1 where triangles intersect, energy that cuts take is beyond 1e-3 of the
kinetic energy a second, a point is cut by more than 5 % in more than 10 substeps running, or a value is not finite.
"""

import argparse
import itertools
import json
import sys
import time
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing import get_context
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tools.draws.scenes import KINDS, SOLVERS, Draw  # noqa: E402
from wsim.geometry import primitives, topology  # noqa: E402
from wsim.geometry.triangulate import triangulate  # noqa: E402
from wsim.physics.selfcontact.crossings import crossings  # noqa: E402
from wsim.scene import Box, Surface  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

MOST_ENERGY, MOST_RUN = 1e-3, 10         # [1/s]; substeps
COUNTED = ("projected", "cut", "held", "repeated", "cut_energy", "cut_run", "searches")
HEAD = (f"{'draw':>5} {'kind':<8} {'prims':>5} {'points':>6} {'solver':<12} {'tested':>6} {'crossed':>7} {'proj':>4} {'cut':>4} "
        f"{'held':>4} {'energy/s':>9} {'run':>4} {'gap/th':>7} {'strain':>7} {'momentum':>9} {'s':>6}")


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
        p, faces = primitives.box(c.shape.half) if box else (c.shape.points, triangulate(
            c.shape.points, c.shape.counts, c.shape.indices)[0])
        triangles = np.concatenate([triangles, faces + len(points)])
        points = np.concatenate([points, np.asarray(p, np.float32).astype(np.float64) @ M[:3, :3].T + M[:3, 3]])
    return len(crossings(points, triangles, own=own))


def momentum(sim) -> tuple[np.ndarray, float]:
    """Sum of m v of all points, and of its sizes [kg m/s]."""
    each = [b.masses[b.index - b.first][:, None] * sim.velocities(b.path) for b in sim.model.bodies]
    return sum(p.sum(axis=0) for p in each), sum(np.linalg.norm(p, axis=1).sum() for p in each)


def strain(sim) -> float:
    """Largest relative change of an edge of a surface [1]."""
    found = 0.0
    for b in sim.model.bodies:
        ends = topology.edges(b.triangles) - b.first
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


def line(row: dict) -> str:
    lost = "" if row["momentum"] is None else f"{row['momentum']:.1e}"
    return (f"{row['draw']:>5} {row['kind']:<8} {row['prims']:>5} {row['points']:>6} {row['solver']:<12} {row['tested']:>6} "
            f"{row['crossed']:>7} {row['projected']:>4.0f} {row['cut']:>4.0f} {row['held']:>4.0f} {row['cut_energy']:>9.2g} "
            f"{row['cut_run']:>4.0f} {row['least_gap']:>7.3f} {row['strain']:>7.3f} {lost:>9} "
            f"{row['seconds']:>6.1f}{'' if held(row) else '  FAILS'}")


def rows(given, began: float):
    """Rows as they come; no run begins after `seconds`."""
    todo = [(k, solver) for k in range(given.first, given.first + given.draws) for solver in given.solvers.split(",")
            if not (KINDS[k % len(KINDS)] == "soft" and solver.startswith("xpbd"))         # it has no tetrahedra
            and sum(len(b.points) for b in Draw(k, solver).scene.bodies()) <= given.most]
    if given.jobs == 1:
        for k, solver in todo:
            if time.monotonic() - began < given.seconds:
                yield tried(k, solver, given.frames, given.device)
        return
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        left, running = iter(todo), set()
        while True:
            room = given.jobs - len(running) if time.monotonic() - began < given.seconds else 0
            running |= {pool.submit(tried, k, s, given.frames, given.device) for k, s in itertools.islice(left, room)}
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            yield from (f.result() for f in done)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.draws", description=__doc__.splitlines()[0])
    for name, default in (("draws", 100), ("first", 0), ("frames", 12), ("most", 5000), ("jobs", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--solvers", default=",".join(SOLVERS))
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seconds", type=float, default=np.inf)
    parser.add_argument("--json", type=Path)
    given, found = parser.parse_args(), []
    print(HEAD)
    for row in rows(given, time.monotonic()):
        found.append(row)
        print(line(row), flush=True)
        if given.json:
            given.json.write_text("[" + ",\n".join(json.dumps(r) for r in found) + "]\n")
    failed = sum(not held(row) for row in found)
    print(f"{len(found)} runs, {sum(row['tested'] for row in found)} states tested, {failed} fail")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
