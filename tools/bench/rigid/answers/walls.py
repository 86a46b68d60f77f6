"""Fast bodies and thin walls: nothing passes. A lane for each body, speed and thickness, without gravity."""

from functools import partial

import numpy as np

from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.rolling import named
from tools.bench.rigid.answers.shapes import grid, prism
from tools.bench.rigid.answers.stage import NONE, RATES, Stage, turned
from wsim.scene import Box, Capsule, Cone, Cylinder, Sphere

SPEEDS, THICK = (10.0, 30.0, 100.0), (0.002, 0.01)
UPRIGHT = turned((0.0, 1.0, 0.0), 90.0)                     # own z along x
BODIES = {"ball": (Sphere(0.05), NONE), "small ball": (Sphere(0.01), NONE), "cube": (Box((0.05,) * 3), NONE),
          "cube, corner first": (Box((0.05,) * 3), turned((1.0, -1.0, 0.0), 54.7)),
          "plate, flat": (Box((0.005, 0.2, 0.2)), NONE), "plate, edge first": (Box((0.2, 0.2, 0.005)), NONE),
          "disc, flat": (Cylinder(0.1, 0.005), UPRIGHT), "disc, edge first": (Cylinder(0.1, 0.005), NONE),
          "cone": (Cone(0.05, 0.1), UPRIGHT), "capsule": (Capsule(0.02, 0.1), NONE), "prism": (prism(8, 0.1, 0.005), UPRIGHT)}


def shots(precision: str, rate, wall: str, rest: float, spin: float = 0.0) -> tuple[list[Figure], float]:
    stage, rng = Stage(*rate, gravity=0.0), np.random.default_rng(2)
    lanes = [(name, v, thick) for name in BODIES for v in SPEEDS for thick in THICK]
    for k, (name, v, thick) in enumerate(lanes):
        shape, turn = BODIES[name]
        place = np.array([0.0, 5.0 * (k % 7), 5.0 * (k // 7)])
        if wall == "box":
            stage.collider(f"/wall{k}", Box((0.5 * thick, 1.0, 1.0)), place, rest=rest)
        elif wall == "mesh":
            stage.collider(f"/wall{k}", grid(5, 2.0, jitter=0.2, seed=k), place, UPRIGHT, rest=rest)
        else:
            stage.body(f"/wall{k}", Box((0.5 * thick, 1.0, 1.0)), place, mass=1e3, rest=rest)
        start = place - (0.5 + v * rng.uniform(0.05, 0.1), 0.0, 0.0)
        stage.body(f"/body{k}", shape, start, turn, (v, 0.0, 0.0), (0.0, 0.0, spin), rest=rest)
    track = stage.run(0.4, precision)
    rows = np.array([track.row[f"/body{k}"] for k in range(len(lanes))])
    ahead = track.x[-1, rows, 0]
    if wall == "body":
        ahead = ahead - track.x[-1, np.array([track.row[f"/wall{k}"] for k in range(len(lanes))]), 0]
    found = []
    for name in BODIES:
        through = [f"{lanes[k][1]:g} m/s" for k in range(len(lanes)) if lanes[k][0] == name and ahead[k] > 0.0]
        said = f" at {', '.join(sorted(set(through)))}" if through else ""
        found.append(Figure(f"{name} through{said}", float(len(through)), 0.0))
    return found, track.cpu


WALLS = (("box", 0.0, 0.0), ("mesh", 0.0, 0.0), ("body", 0.0, 0.0), ("box", 0.5, 0.0), ("box", 0.0, 25.0), ("mesh", 0.0, 25.0),
         ("body", 0.0, 25.0))


def cases() -> list[Case]:
    return [Case(f"wall/{wall}/{named(rate)}/e{rest:g}" + f"/spin{spin:g}" * (spin > 0.0),
                 partial(shots, wall=wall, rate=rate, rest=rest, spin=spin))
            for wall, rest, spin in WALLS
            for rate in RATES[:2]]
