"""Floors of several pieces that lie flush are one floor: nothing jumps at a seam.

A ball that is sent off without spin slides, then rolls at 5/7 of its speed. A cube without friction keeps its velocity.
"""

from functools import partial

import numpy as np

from tools.bench.rigid.answers.case import Case, Figure
from tools.bench.rigid.answers.rolling import TILTS, named
from tools.bench.rigid.answers.shapes import grid
from tools.bench.rigid.answers.stage import RATES, Stage, turned
from wsim.scene import Box, Sphere, shapes
from wsim.scene.solids import Surface

SPEEDS = (1.0, 2.0, 5.0)
R = 0.1                                               # [m] of the ball
LANES = ((0.0, 0.0), (0.0, 0.5), (0.0, 0.497), (7.0, 0.13), (45.0, 0.0))     # heading [degrees], place across, in tiles
COUNT = 8                                             # tiles along the way


def tile(kind: str, size: float):
    """A piece whose top is a square at z = 0."""
    if kind == "boxes":
        return Box((0.5 * size, 0.5 * size, 0.25 * size)), 0.25 * size
    if kind == "hulls":
        return Surface(*shapes.box((0.5 * size, 0.5 * size, 0.25 * size))), 0.25 * size
    return grid(1, size), 0.0


def lay(stage: Stage, kind: str, size: float, lane: int, away: float) -> None:
    """COUNT tiles along x from 0 on, five across; of the kind "mesh" one mesh."""
    if kind == "mesh":
        length = COUNT * size
        stage.collider(f"/lane{lane}", grid(COUNT, length, (0.5 * length - 0.5 * size, 0.0), 0.2, lane), (0.0, away, 0.0))
        return
    shape, depth = tile(kind, size)
    for i in range(COUNT):
        for j in range(-COUNT // 2, COUNT // 2 + 1):
            stage.collider(f"/lane{lane}/t{i}_{j + COUNT}", shape, (i * size, away + j * size, -depth))


def ball(precision: str, kind: str, rate, size: float, tilt: str = "level") -> tuple[list[Figure], float]:
    stage, lanes = Stage(*rate, turn=TILTS[tilt]), [(v, *lane) for v in SPEEDS for lane in LANES]
    ways = []
    for k, (v, heading, across) in enumerate(lanes):
        away = 2.0 * COUNT * size * (k - len(lanes) // 2)
        lay(stage, kind, size, k, away)
        turn = turned((0.0, 0.0, 1.0), heading)
        start = (-2.5 * size if heading == 45.0 else across * size) + away
        stage.body(f"/ball{k}", Sphere(R), (0.1 * size, start, R), velocity=turn @ (v, 0.0, 0.0))
        ways.append(turn)
    track = stage.run((COUNT - 1.5) * size / (SPEEDS[0] * 5.0 / 7.0), precision)
    figures = []
    for v in SPEEDS:
        found = {"jump": [], "sinks": [], "speed": [], "sideways": []}
        for k in (k for k, lane in enumerate(lanes) if lane[0] == v):
            went = (track.x[:, k] - track.x[0, k]) @ ways[k]
            now = slice(0, max(2, int(np.searchsorted(went[:, 0], (COUNT - 1.5) * size))))       # still over the tiles
            speed = (track.v[now, k] @ ways[k])[-1, 0]
            slid = 12.0 / 49.0 * v * v / (0.5 * 9.81)
            found["jump"].append(went[now, 2].max())
            found["sinks"].append(-went[now, 2].min())
            found["sideways"].append(np.abs(went[now, 1]).max())
            if slid < 0.8 * (COUNT - 1.5) * size:
                found["speed"].append(abs(speed / (5.0 / 7.0 * v) - 1.0))
        allowed = {"jump": (1e-4, "m"), "sinks": (1e-3, "m"), "speed": (1e-2, ""), "sideways": (1e-3, "m")}
        figures += [Figure(f"{name} at {v:g} m/s", float(max(found[name])), *allowed[name]) for name in found if found[name]]
    return figures, track.cpu


def cube(precision: str, rate, runs: int = 30, half: float = 0.15, cells: int = 12) -> tuple[list[Figure], float]:
    """Every cube has a mesh of its own, whose inner points lie off the grid; it starts at rest on it, at any angle."""
    stage, rng = Stage(*rate), np.random.default_rng(7)
    for k in range(runs):
        place = np.array([0.0, 20.0 * k, 0.0])
        of_mesh, of_way, of_cube = (turned((0.0, 0.0, 1.0), angle) for angle in rng.uniform(0.0, 360.0, 3))
        stage.collider(f"/mesh{k}", grid(cells, 8.0, jitter=0.24, seed=k), place, of_mesh, 0.0)
        v = of_way @ (rng.uniform(0.5, 4.0), 0.0, 0.0)
        stage.body(f"/cube{k}", Box((half,) * 3), place + (0.0, 0.0, half), of_cube, v, rub=0.0)
    track = stage.run(0.8, precision)
    jumps = track.x[:, :, 2].max(axis=0) - half
    tilt = np.degrees(np.arccos(np.clip(track.R[:, :, 2, 2], -1.0, 1.0))).max()
    v0 = np.linalg.norm(track.v[0], axis=1)
    return [Figure(f"jump, of {runs} runs {int((jumps > 1e-4).sum())} above it", float(jumps.max()), 1e-4, "m"),
            Figure("tilt", float(tilt), 0.1, "deg"),
            Figure("change of velocity", float((np.linalg.norm(track.v - track.v[0], axis=2)[:, :] / v0).max()), 1e-2),
            Figure("spin", float(np.linalg.norm(track.w, axis=2).max()), 0.02, "rad/s")], track.cpu


def cases() -> list[Case]:
    found = [Case(f"flush/{kind}/{size:g}/{named(rate)}", partial(ball, kind=kind, rate=rate, size=size))
             for kind in ("boxes", "mesh", "quads", "hulls") for size in (0.3, 2.0)
             for rate in ((24.0, 10), (60.0, 8), (60.0, 80))[:3 if (kind, size) == ("boxes", 2.0) else 2]]
    found.append(Case("flush/boxes/0.3/24x10/tilted", partial(ball, kind="boxes", rate=RATES[0], size=0.3, tilt="tilted")))
    return found + [Case(f"flush/cube/{named(rate)}", partial(cube, rate=rate)) for rate in RATES[:3]]
