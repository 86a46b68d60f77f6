"""Random draws of surfaces that collide: no two triangles may intersect, by the exact test on the float32 values of a file.

    python tools/draws.py [--draws 100] [--first 0] [--solvers xpbd,newton,...] [--frames 12] [--side 11] [--device cpu]
                          [--json FILE]

Draw k is of kind k mod 3: a sheet that drops on a floor, two that are thrown at each other at 20 m/s and turn, one whose points
all fly inwards. Each tenth draw is tested behind every substep, the others behind every frame. Exit code 1 where triangles
intersect, energy that cuts take is beyond 1e-3 of the kinetic energy a second, or a point is cut by more than 5 % in more than
10 substeps running.
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from wsim.physics.selfcontact.crossings import crossings  # noqa: E402
from wsim.scene import Plane, Scene, shapes  # noqa: E402
from wsim.scene.fabric import Fabric  # noqa: E402
from wsim.simulation.simulation import Simulation  # noqa: E402

SOLVERS = {
    "xpbd": {"solver": "xpbd", "integrator": "backward_euler", "iterations": 4},
    "xpbd bdf2": {"solver": "xpbd", "integrator": "bdf2", "iterations": 4},
    "newton": {"solver": "implicit", "integrator": "backward_euler", "iterations": 2},
    "newton bdf2": {"solver": "implicit", "integrator": "bdf2", "iterations": 2},
    "leapfrog": {"solver": "explicit", "integrator": "leapfrog"}}
KINDS = ("drop", "throw", "scrunch")
SPEED, SIZE = 20.0, 0.3                  # [m/s], [m]
CLOTH = Fabric(stretch=300.0, shear=80.0, bend=1e-6, thickness=2e-3, density=100.0)
MOST_ENERGY, MOST_RUN = 1e-3, 10         # [1/s]; substeps
COUNTED = ("projected", "cut", "held", "repeated", "cut_energy", "cut_run", "searches")
HEAD = (f"{'draw':>5} {'kind':<8} {'solver':<12} {'tested':>6} {'crossed':>7} {'cut':>5} {'held':>4} {'energy/s':>9} "
        f"{'run':>4} {'gap um':>8} {'s':>6}")


def turn(rng) -> np.ndarray:
    """A random rotation, (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


def sheet(rng, side: int) -> tuple:
    """A flat sheet about the origin, turned at random: points, counts, indices."""
    points, counts, indices = shapes.sheet(SIZE, SIZE, side - 1, side - 1, horizontal=True)
    points = np.array(points, np.float64)
    return (points - points.mean(axis=0)) @ turn(rng).T, counts, indices


def drawn(k: int, side: int, solver: str) -> Scene:
    """The scene of a draw."""
    rng, kind = np.random.default_rng(k), KINDS[k % 3]
    settings = {"substeps": 60 if solver == "leapfrog" else 12} | SOLVERS[solver]
    scene = Scene(gravity=(0.0, -9.81 if kind == "drop" else 0.0, 0.0), fps=60.0, **settings)
    if kind == "drop":
        points, *mesh = sheet(rng, side)
        points[:, 1] += 5e-3 - points[:, 1].min()
        speed = rng.uniform(1.0, 5.0)
        scene.cloth("/sheet", points, *mesh, material=CLOTH, self_collision=True,
                    velocities=np.tile((0.0, -speed, 0.0), (len(points), 1)))
        scene.collider("/floor", Plane("Y"))
    elif kind == "throw":
        for j, sign in enumerate((-1.0, 1.0)):
            points, *mesh = sheet(rng, side)
            spin, aside = rng.normal(size=3) * 10.0, rng.normal(size=3) * 0.03
            v = np.array((0.5 * SPEED * -sign, 0.0, 0.0)) + np.cross(spin, points)
            scene.cloth(f"/sheet{j}", points + aside + (sign * 0.17, 0.0, 0.0), *mesh, material=CLOTH, self_collision=True,
                        velocities=v)
    else:
        points, *mesh = sheet(rng, side)
        speed = rng.uniform(2.0, SPEED)
        waves = sum(rng.normal(size=3)[None] * np.sin(points @ (rng.normal(size=3) * 30.0) + rng.uniform(0, 6))[:, None]
                    for _ in range(4))
        scene.cloth("/sheet", points, *mesh, material=CLOTH, self_collision=True,
                    velocities=-speed * points / (0.5 * SIZE) + 0.25 * speed * waves)
    return scene


def written(sim) -> tuple[np.ndarray, np.ndarray]:
    """Points as a file holds them, and triangles."""
    points, triangles, first = [], [], 0
    for b in sim.model.bodies:
        points.append(sim.positions(b.path).astype(np.float32))
        triangles.append(b.triangles - b.first)
        order = np.argsort(b.index)                        # places to the author's order
        triangles[-1] = order[triangles[-1]] + first
        first += len(points[-1])
    return np.concatenate(points), np.concatenate(triangles)


def tried(k: int, solver: str, side: int, frames: int, device: str) -> dict:
    """A row of results."""
    scene, began = drawn(k, side, solver), time.process_time()
    if k % 10 == 0:
        frames, scene.fps, scene.substeps = frames * scene.substeps, scene.fps * scene.substeps, 1
    sim = Simulation(scene, device=device)
    crossed, gap = 0, np.inf
    for _ in range(frames):
        sim.step()
        crossed += len(crossings(*written(sim)))
        gap = min(gap, told(sim).get("least_gap", np.inf))
    found = told(sim)
    return {"draw": k, "kind": KINDS[k % 3], "solver": solver, "tested": frames, "crossed": crossed, "least_gap": gap,
            **{name: found[name] for name in COUNTED}, "seconds": time.process_time() - began}


def told(sim) -> dict[str, float]:
    return sim.plan.method("selfcontact").indicators(None, None)


def held(row: dict) -> bool:
    return row["crossed"] == 0 and row["cut_energy"] <= MOST_ENERGY and row["cut_run"] <= MOST_RUN


def line(row: dict) -> str:
    return (f"{row['draw']:>5} {row['kind']:<8} {row['solver']:<12} {row['tested']:>6} {row['crossed']:>7} {row['cut']:>5.0f} "
            f"{row['held']:>4.0f} {row['cut_energy']:>9.2g} {row['cut_run']:>4.0f} {row['least_gap'] * 1e6:>8.2f} "
            f"{row['seconds']:>6.1f}{'' if held(row) else '  FAILS'}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in (("draws", 100), ("first", 0), ("frames", 12), ("side", 11)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--solvers", default=",".join(SOLVERS))
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    print(HEAD)
    for k in range(given.first, given.first + given.draws):
        for solver in given.solvers.split(","):
            rows.append(tried(k, solver, given.side, given.frames, given.device))
            print(line(rows[-1]), flush=True)
            if given.json:
                given.json.write_text("[" + ",\n".join(json.dumps(row) for row in rows) + "]\n")
    failed = sum(not held(row) for row in rows)
    print(f"{len(rows)} runs, {sum(row['tested'] for row in rows)} states tested, {failed} fail")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
