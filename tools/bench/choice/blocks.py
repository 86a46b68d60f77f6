"""How many blocks should share a sheet: time of a substep of explicit steps in one launch, by size and number of blocks.

    python -m tools.bench.choice.blocks [--sides 10,16,...] [--blocks 16,32,64,128] [--kinds plain,damped,...] [--frames 6]
                                       [--json FILE]

A row is a sheet (or a bar of tets) of a kind: microseconds a substep for each number of blocks, and beside it the largest
difference of a point [m] from the first number's motion, after the frames. CUDA, sm_90 and up.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import warp as wp

import wsim
from wsim.physics.motion.fused import domain_decomposition
from wsim.scene import Motion, Scene, Sphere, shapes
from wsim.scene.fabric import Fabric

SUBSTEPS = 400
FABRIC = Fabric(stretch=100.0, shear=40.0, bend=1e-4, thickness=1e-3)


def hung(side: int, fabric: Fabric = FABRIC, **more) -> Scene:
    """A square sheet of so many points a side, as many centimetres wide, on two corners."""
    scene = Scene(solver="explicit", integrator="leapfrog", substeps=SUBSTEPS, iterations=1, fps=24.0)
    points, counts, indices = shapes.sheet(0.01 * side, 0.01 * side, side - 1, side - 1, horizontal=True)
    cloth = scene.cloth("/cloth", points, counts, indices, material=fabric, **more)
    scene.pin("/a", cloth, [0])
    scene.pin("/b", cloth, [side - 1])
    return scene


def struck(side: int, balls: int = 1) -> Scene:
    """The same above balls that turn and rise into it."""
    scene = hung(side)
    for k in range(balls):
        low, high = np.eye(4), np.eye(4)
        high[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
        low[:3, 3], high[:3, 3] = (0.004 * side * (k - balls / 2), -0.1, 0.0), (0.004 * side * (k - balls / 2), 0.1, 0.0)
        scene.collider(f"/ball{k}", Sphere(0.05), motion=Motion([0.0, 1.0], [low, high]))
    return scene


def bar(side: int) -> Scene:
    """A bar of five tets a cube, about side^2 points."""
    scene = Scene(solver="explicit", integrator="leapfrog", substeps=SUBSTEPS, iterations=1, fps=24.0)
    across = max(2, round(side ** (2 / 3) / 2))
    points, tets = shapes.block((0.1, 0.1, 0.4), (across, across, 4 * across))
    scene.soft("/bar", points, tets)
    scene.pin("/end", "/bar", np.flatnonzero(points[:, 2] <= points[:, 2].min() + 1e-9))
    return scene


KINDS = {"plain": hung, "damped": lambda n: hung(n, replace(FABRIC, damping=1e-4)), "ball": struck,
         "air": lambda n: hung(n, drag=1.0, lift=0.5), "balls": lambda n: struck(n, 9),
         "limited": lambda n: hung(n, replace(FABRIC, strain_limit=0.02)), "bar": bar}


def row(kind: str, side: int, blocks: list[int], frames: int) -> dict:
    """What was found for each number of blocks: us a substep, difference [m], threads; nothing where they do not fit."""
    found, first, usual = {}, None, domain_decomposition.blocks_of
    for many in blocks:
        domain_decomposition.blocks_of = lambda *given, many=many: [many]
        try:
            sim = wsim.Simulation(KINDS[kind](side), device="cuda:0")
            sim.run(frames)
        except ValueError:                                 # more blocks than points
            continue
        finally:
            domain_decomposition.blocks_of = usual
        x = np.concatenate([sim.positions(b.path) for b in sim.model.bodies])
        first = x if first is None else first
        if plan := sim.plan.ports.force_gather.cluster:
            found[many] = {"us": 1e3 * float(np.median(sim.milliseconds[2:])) / SUBSTEPS,
                           "difference": float(np.abs(x - first).max()), "threads": plan.threads}
    return {"kind": kind, "points": len(x), "blocks": found}


def cell(found: dict | None) -> str:
    return f"{found['us']:.2f} ({found['difference']:.0e}, {found['threads']})" if found else "-"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sides", default="10,16,24,33,46,64,90")
    parser.add_argument("--blocks", default="16,32,64,128")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    wp.config.quiet = True
    blocks, rows = [int(b) for b in given.blocks.split(",")], []
    print(f"us a substep, by blocks (difference, threads)\n{'kind':<8} {'points':>6}  " + "".join(f"{b:<22}" for b in blocks))
    for kind in given.kinds.split(","):
        for side in map(int, given.sides.split(",")):
            rows.append(found := row(kind, side, blocks, given.frames))
            cells = (f"{cell(found['blocks'].get(b)):<22}" for b in blocks)
            print(f"{kind:<8} {found['points']:>6}  " + "".join(cells), flush=True)
            if given.json:
                given.json.write_text(json.dumps({"device": wp.get_device("cuda:0").name, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
